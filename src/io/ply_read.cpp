#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <vector>

#include "io/mesh_formats.h"
#include "io/ply_header.h"
#include "io/text_scan.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

// Every PLY type fits into a double without loss, so one type of value serves all.

/// Values of a binary body, one after another.
class BinaryCursor {
 public:
  BinaryCursor(std::span<const char> body, bool swap_bytes)
      : next_(body.data()), end_(body.data() + body.size()), swap_bytes_(swap_bytes) {}

  std::size_t remaining_bytes() const { return std::size_t(end_ - next_); }
  static std::size_t min_value_bytes(PlyType type) { return size_bytes(type); }

  /// False at the end of the file.
  bool read(PlyType type, double& value) {
    switch (type) {
      case PlyType::kInt8:
        return take<std::int8_t>(value);
      case PlyType::kUint8:
        return take<std::uint8_t>(value);
      case PlyType::kInt16:
        return take<std::int16_t>(value);
      case PlyType::kUint16:
        return take<std::uint16_t>(value);
      case PlyType::kInt32:
        return take<std::int32_t>(value);
      case PlyType::kUint32:
        return take<std::uint32_t>(value);
      case PlyType::kFloat32:
        return take<float>(value);
      case PlyType::kFloat64:
        return take<double>(value);
    }
    return false;
  }

  bool skip(PlyType type, std::size_t count) {
    if (count > remaining_bytes() / size_bytes(type)) return false;
    next_ += count * size_bytes(type);
    return true;
  }

 private:
  template <typename T>
  bool take(double& value) {
    if (remaining_bytes() < sizeof(T)) return false;
    char bytes[sizeof(T)];
    std::memcpy(bytes, next_, sizeof(T));
    if (swap_bytes_) std::reverse(bytes, bytes + sizeof(T));
    T stored;
    std::memcpy(&stored, bytes, sizeof(T));
    value = double(stored);
    next_ += sizeof(T);
    return true;
  }

  const char* next_;
  const char* end_;
  bool swap_bytes_;
};

/// Values of an ascii body: words between white space, however it is broken into lines.
class AsciiCursor {
 public:
  explicit AsciiCursor(std::span<const char> body) : rest_(body.data(), body.size()) {}

  std::size_t remaining_bytes() const { return rest_.size(); }
  static std::size_t min_value_bytes(PlyType) { return 1; }

  bool read(PlyType, double& value) {
    const auto number = parse_number<double>(take_word(rest_));
    if (number) value = *number;
    return number.has_value();
  }

  bool skip(PlyType, std::size_t count) {
    for (; count > 0; --count)
      if (take_word(rest_).empty()) return false;
    return true;
  }

 private:
  std::string_view rest_;
};

enum Role : std::uint8_t { kX, kY, kZ, kRed, kGreen, kBlue, kView, kPixel, kTag, kIndices, kIgnored, kRoleCount };

Role vertex_role(const PlyProperty& property) {
  if (property.is_list) return kIgnored;
  const std::string_view name = property.name;
  if (name == "x") return kX;
  if (name == "y") return kY;
  if (name == "z") return kZ;
  if (name == "red" || name == "diffuse_red") return kRed;
  if (name == "green" || name == "diffuse_green") return kGreen;
  if (name == "blue" || name == "diffuse_blue") return kBlue;
  if (is_floating(property.type)) return kIgnored;
  if (name == "view") return kView;
  if (name == "pixel") return kPixel;
  return kIgnored;
}

Role face_role(const PlyProperty& property) {
  const std::string_view name = property.name;
  if (property.is_list) return name == "vertex_indices" || name == "vertex_index" ? kIndices : kIgnored;
  if (is_floating(property.type)) return kIgnored;
  if (name == "view") return kView;
  if (name == "tag" && property.type == PlyType::kUint8) return kTag;
  return kIgnored;
}

/// Where each role is among an element's properties.
struct RoleTable {
  std::vector<Role> roles;
  std::array<const PlyProperty*, kRoleCount> property{};

  RoleTable(const PlyElement& element, Role (*role_of)(const PlyProperty&)) {
    for (const PlyProperty& p : element.properties) {
      roles.push_back(role_of(p));
      property[roles.back()] = &p;
    }
  }
  bool has(Role role) const { return property[role] != nullptr; }
};

/// What a stored channel must be multiplied with to span 0…255.
double color_scale(const PlyProperty& property) {
  if (is_floating(property.type)) return 255.0;
  return property.type == PlyType::kUint16 ? 255.0 / 65535.0 : 1.0;
}

std::uint8_t to_channel(double value, double scale) {
  const double scaled = value * scale;
  if (!(scaled > 0)) return 0;  // NaN too
  return scaled < 255 ? std::uint8_t(scaled + 0.5) : std::uint8_t(255);
}

std::uint32_t to_index(double value) {
  return value >= 0 && value < double(kInvalidIndex) ? std::uint32_t(value) : kInvalidIndex;
}

template <typename Cursor>
class BodyReader {
 public:
  BodyReader(const std::filesystem::path& file, const PlyHeader& header, Cursor cursor)
      : file_(file), header_(header), cursor_(cursor) {}

  Mesh run() {
    bool has_vertices = false, has_faces = false;
    for (const PlyElement& element : header_.elements) {
      const std::size_t row_bytes = element.min_row_bytes(header_.format);
      if (row_bytes > 0 && element.count > (cursor_.remaining_bytes() + 1) / row_bytes)
        fail("element " + element.name, "the header promises " + std::to_string(element.count) +
                                            " of them, more than the file can hold: it is truncated or broken");
      if (element.name == "vertex" && !has_vertices) {
        read_vertices(element);
        has_vertices = true;
      } else if (element.name == "face" && !has_faces) {
        read_faces(element);
        has_faces = true;
      } else {
        skip_element(element);
      }
    }
    if (!has_vertices) fail("element vertex", "missing");
    check_indices();
    return std::move(mesh_);
  }

 private:
  [[noreturn]] void fail(const std::string& field, const std::string& problem) const {
    throw InvalidInput(file_, {}, field, problem);
  }
  [[noreturn]] void fail_row(const PlyElement& element, std::uint64_t row, const std::string& problem) const {
    fail(element.name + " " + std::to_string(row), problem);
  }

  void read_value(const PlyElement& element, std::uint64_t row, PlyType type, double& value) {
    if (!cursor_.read(type, value)) fail_row(element, row, "the file ends here, or this is not a number");
  }

  /// The length of a list, for which there must be room in the file.
  std::size_t read_list_length(const PlyElement& element, std::uint64_t row, const PlyProperty& property) {
    double length = 0;
    read_value(element, row, property.count_type, length);
    const std::size_t most = cursor_.remaining_bytes() / Cursor::min_value_bytes(property.type);
    if (!(length >= 0 && length <= double(most)))
      fail_row(element, row, "list " + property.name + " is longer than the file");
    return std::size_t(length);
  }

  void skip_property(const PlyElement& element, std::uint64_t row, const PlyProperty& property) {
    const std::size_t count = property.is_list ? read_list_length(element, row, property) : 1;
    if (!cursor_.skip(property.type, count)) fail_row(element, row, "the file ends here");
  }

  void skip_element(const PlyElement& element) {
    if (element.properties.empty()) return;
    for (std::uint64_t row = 0; row < element.count; ++row)
      for (const PlyProperty& property : element.properties) skip_property(element, row, property);
  }

  void read_vertices(const PlyElement& element) {
    const RoleTable table(element, vertex_role);
    if (!table.has(kX) || !table.has(kY) || !table.has(kZ)) fail("element vertex", "has no x, y, z");
    if (element.count >= kInvalidIndex) fail("element vertex", "more vertices than 32-bit indices can tell apart");
    const bool has_colors = table.has(kRed) && table.has(kGreen) && table.has(kBlue);
    const std::size_t count = std::size_t(element.count);
    mesh_.positions_m.resize(count);
    if (has_colors) mesh_.colors.resize(count);
    if (table.has(kView)) mesh_.vertex_view.resize(count);
    if (table.has(kPixel)) mesh_.vertex_pixel.resize(count);
    const double scale = has_colors ? color_scale(*table.property[kRed]) : 1.0;
    // Floats are relative to the origin in the header; ascii and doubles may hold more digits than our floats.
    const bool has_long_digits = header_.format == PlyFormat::kAscii || table.property[kX]->type == PlyType::kFloat64;
    mesh_.origin_m = header_.origin_m.value_or(Eigen::Vector3d::Zero());

    std::array<double, kRoleCount> value{};
    for (std::size_t row = 0; row < count; ++row) {
      for (std::size_t p = 0; p < table.roles.size(); ++p) {
        const PlyProperty& property = element.properties[p];
        if (table.roles[p] == kIgnored) {
          skip_property(element, row, property);
        } else {
          read_value(element, row, property.type, value[table.roles[p]]);
        }
      }
      const Eigen::Vector3d stored(value[kX], value[kY], value[kZ]);
      if (row == 0 && has_long_digits && !header_.origin_m && stored.allFinite())
        origin_shift_m_ = choose_origin(stored);
      mesh_.positions_m[row] = (stored - origin_shift_m_).cast<float>();
      if (!mesh_.positions_m[row].allFinite()) fail_row(element, row, "the position is not finite");
      if (has_colors)
        mesh_.colors[row] = {to_channel(value[kRed], scale), to_channel(value[kGreen], scale),
                             to_channel(value[kBlue], scale)};
      if (!mesh_.vertex_view.empty()) mesh_.vertex_view[row] = to_index(value[kView]);
      if (!mesh_.vertex_pixel.empty()) mesh_.vertex_pixel[row] = to_index(value[kPixel]);
    }
    mesh_.origin_m += origin_shift_m_;
  }

  void read_faces(const PlyElement& element) {
    const RoleTable table(element, face_role);
    if (!table.has(kIndices)) fail("element face", "has no list vertex_indices");
    mesh_.triangles.reserve(mesh_.triangles.size() + std::size_t(element.count));
    std::array<double, kRoleCount> value{};
    for (std::uint64_t row = 0; row < element.count; ++row) {
      for (std::size_t p = 0; p < table.roles.size(); ++p) {
        const PlyProperty& property = element.properties[p];
        if (table.roles[p] == kIgnored) {
          skip_property(element, row, property);
        } else if (table.roles[p] == kIndices) {
          read_polygon(element, row, property);
        } else {
          read_value(element, row, property.type, value[table.roles[p]]);
        }
      }
      add_fan();
      if (table.has(kView)) mesh_.triangle_view.resize(mesh_.triangles.size(), to_index(value[kView]));
      if (!table.has(kTag)) continue;
      if (value[kTag] > double(TriangleTag::kFilled)) fail_row(element, row, "unknown tag");
      mesh_.triangle_tag.resize(mesh_.triangles.size(), TriangleTag(std::uint8_t(value[kTag])));
    }
  }

  void read_polygon(const PlyElement& element, std::uint64_t row, const PlyProperty& property) {
    polygon_.resize(read_list_length(element, row, property));
    for (std::uint32_t& index : polygon_) {
      double value = 0;
      read_value(element, row, property.type, value);
      if (!(value >= 0 && value < double(kInvalidIndex)))
        fail_row(element, row, "a vertex index is negative, too large or not a number");
      index = std::uint32_t(value);
    }
  }

  void add_fan() {
    for (std::size_t i = 2; i < polygon_.size(); ++i)
      mesh_.triangles.push_back({polygon_[0], polygon_[i - 1], polygon_[i]});
  }

  /// After the last element, because faces may come before vertices.
  void check_indices() const {
    for (std::size_t i = 0; i < mesh_.triangles.size(); ++i)
      for (const std::uint32_t index : mesh_.triangles[i])
        if (index >= mesh_.vertex_count())
          fail("triangle " + std::to_string(i),
               "uses vertex " + std::to_string(index) + " of " + std::to_string(mesh_.vertex_count()));
  }

  const std::filesystem::path& file_;
  const PlyHeader& header_;
  Cursor cursor_;
  Mesh mesh_;
  Eigen::Vector3d origin_shift_m_ = Eigen::Vector3d::Zero();
  std::vector<std::uint32_t> polygon_;
};

}  // namespace

bool looks_like_ply(std::span<const char> bytes) {
  return bytes.size() >= 4 && std::memcmp(bytes.data(), "ply", 3) == 0 && is_space(bytes[3]);
}

Mesh read_ply(const std::filesystem::path& file, std::span<const char> bytes) {
  const PlyHeader header = parse_ply_header(file, bytes);
  const std::span<const char> body = bytes.subspan(header.body_offset);
  if (header.format == PlyFormat::kAscii) return BodyReader(file, header, AsciiCursor(body)).run();
  const bool is_little = header.format == PlyFormat::kLittleEndian;
  const bool swap_bytes = is_little != (std::endian::native == std::endian::little);
  return BodyReader(file, header, BinaryCursor(body, swap_bytes)).run();
}

}  // namespace lapseam
