#include "io/range_grid.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <span>

#include "io/output_file.h"
#include "io/ply_header.h"
#include "io/text_scan.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

static_assert(std::endian::native == std::endian::little, "binary files are read in place");

struct GridHeader {
  PlyHeader ply;
  ImageSize size;
  std::uint64_t vertex_count = 0;
  std::array<std::size_t, 3> coordinate_columns{};  ///< of x, y, z among the vertex properties
  std::size_t vertex_columns = 0;
};

/// `obj_info num_cols 512`, and the like; 0 when it is missing.
int find_info(std::string_view header, std::string_view key) {
  while (!header.empty()) {
    std::string_view line = take_line(header);
    if (take_word(line) != "obj_info" || take_word(line) != key) continue;
    return parse_number<int>(take_word(line)).value_or(0);
  }
  return 0;
}

/// The element's bytes cannot be fewer than this; what they claim beyond the file is refused before it is allocated.
void check_fits(const Source& source, const PlyElement& element, PlyFormat format, std::size_t file_bytes) {
  const std::size_t row_bytes = std::max<std::size_t>(element.min_row_bytes(format), 1);
  if (element.count > file_bytes / row_bytes + 1)
    source.refuse("element " + element.name,
                  "claims " + std::to_string(element.count) + " rows, more than the file holds");
}

void check_vertex_element(const Source& source, const PlyElement& element, GridHeader& header) {
  constexpr std::array<std::string_view, 3> kNames{"x", "y", "z"};
  std::array<bool, 3> found{};
  for (std::size_t column = 0; column < element.properties.size(); ++column) {
    const PlyProperty& property = element.properties[column];
    if (property.is_list) source.refuse("element vertex", "list properties are not read here");
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (property.name != kNames[axis]) continue;
      header.coordinate_columns[axis] = column;
      found[axis] = true;
    }
  }
  if (!found[0] || !found[1] || !found[2]) source.refuse("element vertex", "has no x, y and z");
  header.vertex_columns = element.properties.size();
  header.vertex_count = element.count;
}

GridHeader parse_grid_header(const Source& source, std::span<const char> bytes, std::size_t file_bytes) {
  GridHeader header;
  header.ply = parse_ply_header(source.file, bytes);
  const std::string_view text(bytes.data(), header.ply.body_offset);
  header.size = {find_info(text, "num_cols"), find_info(text, "num_rows")};

  const auto& elements = header.ply.elements;
  const bool has_grid =
      std::any_of(elements.begin(), elements.end(), [](const auto& e) { return e.name == "range_grid"; });
  if (!has_grid) source.refuse({}, "this PLY file holds no range grid (a mesh or a point cloud is no range image)");
  if (header.size.width <= 0 || header.size.height <= 0)
    source.refuse("obj_info", "num_cols and num_rows must give the size of the grid");
  check_image_size(source, std::uint64_t(header.size.width), std::uint64_t(header.size.height), file_bytes, 2);
  if (elements.size() < 2 || elements[0].name != "vertex" || elements[1].name != "range_grid")
    source.refuse({}, "expected the elements vertex and range_grid, in this order");
  const PlyElement& grid = elements[1];
  if (grid.count != std::uint64_t(header.size.width) * std::uint64_t(header.size.height))
    source.refuse("element range_grid",
                  "has " + std::to_string(grid.count) + " rows for " + to_string(header.size) + " pixels");
  if (grid.properties.size() != 1 || !grid.properties[0].is_list || is_floating(grid.properties[0].type))
    source.refuse("element range_grid", "expected one list of indices");
  check_vertex_element(source, elements[0], header);
  check_fits(source, elements[0], header.ply.format, file_bytes);
  check_fits(source, grid, header.ply.format, file_bytes);
  return header;
}

/// Values one after another out of an ASCII body.
class AsciiBody {
 public:
  AsciiBody(const Source& source, std::string_view text) : source_(source), rest_(text) {}

  template <typename T>
  T next(PlyType) {
    const std::string_view word = take_word(rest_);
    const auto value = parse_number<T>(word);
    if (!value && word.empty()) source_.refuse({}, "the file is truncated");
    if (!value) source_.refuse({}, "'" + std::string(word.substr(0, 40)) + "' is not a valid number here");
    return *value;
  }

 private:
  const Source& source_;
  std::string_view rest_;
};

/// Values one after another out of a binary body.
class BinaryBody {
 public:
  BinaryBody(const Source& source, std::string_view bytes, bool is_big_endian)
      : source_(source), rest_(bytes), is_big_endian_(is_big_endian) {}

  template <typename T>
  T next(PlyType type) {
    switch (type) {
      case PlyType::kInt8:
        return T(take<std::int8_t>());
      case PlyType::kUint8:
        return T(take<std::uint8_t>());
      case PlyType::kInt16:
        return T(take<std::int16_t>());
      case PlyType::kUint16:
        return T(take<std::uint16_t>());
      case PlyType::kInt32:
        return T(take<std::int32_t>());
      case PlyType::kUint32:
        return T(take<std::uint32_t>());
      case PlyType::kFloat32:
        return T(take<float>());
      case PlyType::kFloat64:
        return T(take<double>());
    }
    return T{};
  }

 private:
  template <typename Stored>
  Stored take() {
    std::array<char, sizeof(Stored)> bytes;
    if (rest_.size() < bytes.size()) source_.refuse({}, "the file is truncated");
    std::memcpy(bytes.data(), rest_.data(), bytes.size());
    rest_.remove_prefix(bytes.size());
    if (is_big_endian_) std::reverse(bytes.begin(), bytes.end());
    return std::bit_cast<Stored>(bytes);
  }

  const Source& source_;
  std::string_view rest_;
  bool is_big_endian_;
};

template <typename Body>
std::vector<Eigen::Vector3d> read_vertices(const GridHeader& header, double scale_m, Body& body) {
  const std::vector<PlyProperty>& properties = header.ply.elements[0].properties;
  std::vector<Eigen::Vector3d> vertices_m(header.vertex_count);
  std::vector<double> row(header.vertex_columns);
  for (Eigen::Vector3d& vertex_m : vertices_m) {
    for (std::size_t column = 0; column < row.size(); ++column)
      row[column] = body.template next<double>(properties[column].type);
    for (int axis = 0; axis < 3; ++axis) vertex_m[axis] = row[header.coordinate_columns[std::size_t(axis)]] * scale_m;
  }
  return vertices_m;
}

template <typename Body>
RangeGrid read_body(const Source& source, const GridHeader& header, double scale_m, Body body) {
  const std::vector<Eigen::Vector3d> vertices_m = read_vertices(header, scale_m, body);
  const PlyProperty& list = header.ply.elements[1].properties[0];
  RangeGrid grid;
  grid.width = header.size.width;
  grid.height = header.size.height;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  grid.points_m.assign(std::size_t(grid.width) * std::size_t(grid.height), Eigen::Vector3d(nan, nan, nan));
  for (int row = 0; row < grid.height; ++row) {
    Eigen::Vector3d* out = grid.points_m.data() + std::size_t(grid.height - 1 - row) * std::size_t(grid.width);
    for (int column = 0; column < grid.width; ++column) {
      const auto count = body.template next<std::int64_t>(list.count_type);
      if (count == 0) continue;
      if (count != 1) source.refuse("element range_grid", "a pixel with " + std::to_string(count) + " samples");
      const auto index = body.template next<std::int64_t>(list.type);
      if (index < 0 || std::uint64_t(index) >= vertices_m.size())
        source.refuse("element range_grid", "vertex index " + std::to_string(index) + " is out of range");
      const Eigen::Vector3d& vertex_m = vertices_m[std::size_t(index)];
      if (vertex_m.allFinite()) out[column] = vertex_m;
    }
  }
  return grid;
}

}  // namespace

ImageSize probe_range_grid(const Source& source) {
  // Headers of range grids are short; a long one is only ever a hostile one.
  constexpr std::size_t kMostHeaderBytes = 1 << 16;
  const std::string start = read_file_start(source.file, kMostHeaderBytes);
  return parse_grid_header(source, start, file_size_bytes(source.file)).size;
}

RangeGrid read_range_grid(const Source& source, double scale_m) {
  const std::vector<char> bytes = read_file_bytes(source.file);
  const GridHeader header = parse_grid_header(source, bytes, bytes.size());
  const std::string_view body = std::string_view(bytes.data(), bytes.size()).substr(header.ply.body_offset);
  if (header.ply.format == PlyFormat::kAscii) return read_body(source, header, scale_m, AsciiBody(source, body));
  const bool is_big_endian = header.ply.format == PlyFormat::kBigEndian;
  return read_body(source, header, scale_m, BinaryBody(source, body, is_big_endian));
}

}  // namespace lapseam
