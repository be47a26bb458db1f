// The header is text: FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, VIEWPOINT, POINTS, DATA (ascii, binary, or
// binary_compressed, the latter field by field and packed by LZF).

#include "io/pcd.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "io/output_file.h"
#include "io/text_scan.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

struct Field {
  std::string name;
  int size = 4;
  char type = 'F';
  std::size_t count = 1;
  std::size_t offset = 0;  ///< in a record, bytes
};

enum class Layout { kAscii, kBinary, kCompressed };

struct Header {
  std::vector<Field> fields;
  std::int64_t width = 0, height = 1, points = -1;
  std::optional<Eigen::Isometry3d> viewpoint;
  Layout layout = Layout::kAscii;
  std::size_t record_bytes = 0, body_offset = 0;

  int find(std::string_view name) const {
    const auto found = std::find_if(fields.begin(), fields.end(), [&](const Field& f) { return f.name == name; });
    return found == fields.end() ? -1 : int(found - fields.begin());
  }
};

std::vector<std::string_view> split(std::string_view line) {
  std::vector<std::string_view> words;
  for (std::string_view word = take_word(line); !word.empty(); word = take_word(line)) words.push_back(word);
  return words;
}

class HeaderParser {
 public:
  HeaderParser(const Source& source, std::string_view text) : source_(source), text_(text), rest_(text) {}

  Header run() {
    bool has_data = false;
    while (!has_data && !rest_.empty()) {
      const std::vector<std::string_view> words = split(take_line(rest_));
      if (words.empty() || words[0].front() == '#') continue;
      has_data = words[0] == "DATA";
      parse(words);
    }
    if (!has_data) source_.refuse("DATA", "missing");
    finish();
    return header_;
  }

 private:
  void parse(const std::vector<std::string_view>& words) {
    const std::string key(words[0]);
    if (key == "FIELDS" || key == "COLUMNS") {
      for (std::size_t i = 1; i < words.size(); ++i) header_.fields.push_back({std::string(words[i])});
    } else if (key == "SIZE" || key == "TYPE" || key == "COUNT") {
      if (words.size() != header_.fields.size() + 1) source_.refuse(key, "must have one entry for each of FIELDS");
      for (std::size_t i = 1; i < words.size(); ++i) set(key, header_.fields[i - 1], words[i]);
    } else if (key == "WIDTH") {
      header_.width = integer(words);
    } else if (key == "HEIGHT") {
      header_.height = integer(words);
    } else if (key == "POINTS") {
      header_.points = integer(words);
    } else if (key == "VIEWPOINT") {
      header_.viewpoint = viewpoint(words);
    } else if (key == "DATA") {
      set_layout(words.size() > 1 ? words[1] : "");
    } else if (key != "VERSION") {
      source_.refuse(key.substr(0, 40), "is no entry of a PCD header");
    }
  }

  void set(const std::string& key, Field& field, std::string_view word) {
    const auto number = parse_number<int>(word);
    if (key == "TYPE") {
      if (word != "F" && word != "I" && word != "U") source_.refuse(key, "must be F, I or U");
      field.type = word.front();
    } else if (key == "SIZE") {
      if (!number || (*number != 1 && *number != 2 && *number != 4 && *number != 8))
        source_.refuse(key, "must be 1, 2, 4 or 8");
      field.size = *number;
    } else {
      if (!number || *number < 1 || *number > 4096) source_.refuse(key, "must be from 1 to 4096");
      field.count = std::size_t(*number);
    }
  }

  std::int64_t integer(const std::vector<std::string_view>& words) const {
    const auto value = words.size() == 2 ? parse_number<std::int64_t>(words[1]) : std::nullopt;
    if (!value || *value < 0 || *value > std::int64_t(kMaxPixels))
      source_.refuse(std::string(words[0]), "must be one number, from 0 to 2^30");
    return *value;
  }

  Eigen::Isometry3d viewpoint(const std::vector<std::string_view>& words) const {
    std::array<double, 7> n{};
    for (std::size_t i = 0; i < n.size(); ++i) {
      const auto value = words.size() == 8 ? parse_number<double>(words[i + 1]) : std::nullopt;
      if (!value || !std::isfinite(*value)) source_.refuse("VIEWPOINT", "must be seven numbers: x y z qw qx qy qz");
      n[i] = *value;
    }
    const Eigen::Quaterniond q(n[3], n[4], n[5], n[6]);
    if (!(std::abs(q.norm() - 1) < 1e-3)) source_.refuse("VIEWPOINT", "the quaternion's length is not 1");
    Eigen::Isometry3d pose(q.normalized());
    pose.translation() = Eigen::Vector3d(n[0], n[1], n[2]);
    return pose;
  }

  void set_layout(std::string_view name) {
    if (name == "ascii")
      header_.layout = Layout::kAscii;
    else if (name == "binary")
      header_.layout = Layout::kBinary;
    else if (name == "binary_compressed")
      header_.layout = Layout::kCompressed;
    else
      source_.refuse("DATA", "must be ascii, binary or binary_compressed");
  }

  void finish() {
    header_.body_offset = text_.size() - rest_.size();
    for (Field& field : header_.fields) {
      field.offset = header_.record_bytes;
      header_.record_bytes += std::size_t(field.size) * field.count;
      if (field.type == 'F' && field.size < 4) source_.refuse("SIZE", "of a float must be 4 or 8");
    }
    // Each is below 2^30, so that their product is one of 64 bits.
    if (header_.width * header_.height > std::int64_t(kMaxPixels))
      source_.refuse("WIDTH", "times HEIGHT is over 2^30 points");
    if (header_.points >= 0 && header_.points != header_.width * header_.height)
      source_.refuse("POINTS", "is not WIDTH times HEIGHT");
    for (const char* name : {"x", "y", "z"})
      if (header_.find(name) < 0) source_.refuse("FIELDS", "have no x, y, z");
  }

  const Source& source_;
  std::string_view text_, rest_;
  Header header_;
};

double load(const Field& field, const char* bytes) {
  const auto as = [&](auto value) {
    std::memcpy(&value, bytes, sizeof value);
    return double(value);
  };
  if (field.type == 'F') return field.size == 4 ? as(float{}) : as(double{});
  const bool is_signed = field.type == 'I';
  switch (field.size) {
    case 1:
      return is_signed ? as(std::int8_t{}) : as(std::uint8_t{});
    case 2:
      return is_signed ? as(std::int16_t{}) : as(std::uint16_t{});
    case 4:
      return is_signed ? as(std::int32_t{}) : as(std::uint32_t{});
    default:
      return is_signed ? as(std::int64_t{}) : as(std::uint64_t{});
  }
}

/// LZF (Lehmann 2000): runs of up to 32 literal bytes, and copies of up to 264 bytes from up to 8 KiB before.
std::vector<char> unpack_lzf(const Source& source, std::string_view packed, std::size_t unpacked_bytes) {
  std::vector<char> out;
  out.reserve(unpacked_bytes);
  std::size_t i = 0;
  const auto next = [&]() -> std::size_t {
    if (i >= packed.size()) source.refuse("DATA", "the compressed points are damaged");
    return std::uint8_t(packed[i++]);
  };
  while (i < packed.size()) {
    const std::size_t control = next();
    std::size_t length = control < 32 ? control + 1 : control >> 5;
    if (control >= 32 && length == 7) length += next();
    const std::size_t back = control < 32 ? 0 : ((control & 31) << 8 | next()) + 1;
    if (control >= 32) length += 2;
    if (out.size() + length > unpacked_bytes || back > out.size() || (back == 0 && length > packed.size() - i))
      source.refuse("DATA", "the compressed points are damaged");
    for (std::size_t k = 0; k < length; ++k) out.push_back(back == 0 ? packed[i++] : out[out.size() - back]);
  }
  if (out.size() != unpacked_bytes) source.refuse("DATA", "the compressed points are truncated");
  return out;
}

class PcdScan : public GridScan {
 public:
  explicit PcdScan(const Source& source) : source_(source), bytes_(read_file_bytes(source.file)) {
    header_ = HeaderParser(source_, {bytes_.data(), bytes_.size()}).run();
    if (header_.width == 0 || header_.height == 0) source_.refuse("POINTS", "there are no points");
    check_body();
    const int rgb = header_.find("rgb");
    rgb_ = rgb >= 0 ? rgb : header_.find("rgba");
    if (rgb_ >= 0 && header_.fields[std::size_t(rgb_)].size != 4) rgb_ = -1;
  }

  std::optional<ImageSize> size() const override {
    if (header_.height <= 1) return std::nullopt;
    return ImageSize{int(header_.width), int(header_.height)};
  }
  std::optional<Eigen::Isometry3d> T_world_scan() const override { return header_.viewpoint; }
  bool has_color() const override { return rgb_ >= 0; }

  MissingSamples visit(ScanChannel, const Visit& visit) const override {
    const Field* axes[3];
    for (std::size_t axis = 0; axis < 3; ++axis)
      axes[axis] = &header_.fields[std::size_t(header_.find(std::array{"x", "y", "z"}[axis]))];
    // Points are in the world; the viewpoint says where the sensor stood.
    const Eigen::Isometry3d T_scan_world = header_.viewpoint.value_or(Eigen::Isometry3d::Identity()).inverse();
    MissingSamples missing;
    GridSample sample;
    const std::int64_t count = header_.width * header_.height;
    for (std::int64_t i = 0; i < count; ++i) {
      for (int axis = 0; axis < 3; ++axis) sample.stored[axis] = number(*axes[axis], std::size_t(i));
      if (!sample.stored.allFinite()) {
        ++missing.not_finite;
        continue;
      }
      if (sample.stored.isZero(0)) {
        ++missing.zero;
        continue;
      }
      if (header_.viewpoint) sample.stored = T_scan_world * sample.stored;
      sample.u = header_.height > 1 ? int(i % header_.width) : -1;
      sample.v = header_.height > 1 ? int(i / header_.width) : -1;
      visit(sample, color(std::size_t(i)));
    }
    return missing;
  }

 private:
  /// The body as fixed records (or columns), whatever its layout was.
  void check_body() {
    const auto count = std::size_t(header_.width * header_.height);
    std::string_view body(bytes_.data() + header_.body_offset, bytes_.size() - header_.body_offset);
    if (header_.layout == Layout::kAscii) {
      // A number and a blank are two bytes.
      if (count > body.size()) refuse_truncated();
      unpack_text(body, count);
      return;
    }
    if (header_.layout == Layout::kCompressed) {
      std::uint32_t sizes[2];
      if (body.size() < sizeof sizes) refuse_truncated();
      std::memcpy(sizes, body.data(), sizeof sizes);
      body.remove_prefix(sizeof sizes);
      // A copy of 264 bytes takes three.
      if (sizes[0] > body.size() || sizes[1] / 88 > sizes[0] || sizes[1] != count * header_.record_bytes)
        refuse_truncated();
      body_ = unpack_lzf(source_, body.substr(0, sizes[0]), sizes[1]);
    } else {
      if (count > body.size() / header_.record_bytes) refuse_truncated();
      body_.assign(body.begin(), body.end());
    }
    bytes_ = {};
  }

  [[noreturn]] void refuse_truncated() const { source_.refuse("DATA", "the file holds fewer points than it claims"); }

  /// Text becomes doubles, one column after another as in the compressed layout; colours keep their bits.
  void unpack_text(std::string_view body, std::size_t count) {
    std::size_t columns = 0;
    for (Field& field : header_.fields) columns += field.count;
    text_.reserve(std::min(count * columns, body.size() / 2 + 1));
    for (std::size_t i = 0; i < count * columns; ++i) {
      const std::string_view word = take_word(body);
      if (word.empty()) refuse_truncated();
      const auto value = parse_number<double>(word);
      if (!value) source_.refuse("DATA", "'" + std::string(word.substr(0, 40)) + "' is not a number");
      text_.push_back(*value);
    }
    text_columns_ = columns;
  }

  double number(const Field& field, std::size_t i) const {
    if (header_.layout == Layout::kAscii) return text_[i * text_columns_ + text_column(field)];
    return load(field, record(field, i));
  }

  std::size_t text_column(const Field& field) const {
    std::size_t column = 0;
    for (const Field& other : header_.fields) {
      if (&other == &field) break;
      column += other.count;
    }
    return column;
  }

  const char* record(const Field& field, std::size_t i) const {
    if (header_.layout == Layout::kBinary) return body_.data() + i * header_.record_bytes + field.offset;
    const auto count = std::size_t(header_.width * header_.height);
    return body_.data() + field.offset * count + i * std::size_t(field.size) * field.count;
  }

  /// 0x00RRGGBB, as an integer or as the float that has these bits.
  Rgb8 color(std::size_t i) const {
    if (rgb_ < 0) return {};
    const Field& field = header_.fields[std::size_t(rgb_)];
    std::uint32_t bits = 0;
    if (header_.layout != Layout::kAscii) {
      std::memcpy(&bits, record(field, i), sizeof bits);
    } else if (const double value = number(field, i); field.type == 'F') {
      const auto stored = float(value);
      std::memcpy(&bits, &stored, sizeof bits);
    } else if (value >= 0 && value <= 4294967295.0) {
      bits = std::uint32_t(value);
    }
    return {std::uint8_t(bits >> 16), std::uint8_t(bits >> 8), std::uint8_t(bits)};
  }

  Source source_;
  std::vector<char> bytes_, body_;
  std::vector<double> text_;
  std::size_t text_columns_ = 0;
  Header header_;
  int rgb_ = -1;
};

}  // namespace

bool looks_like_pcd(std::string_view start) {
  while (!start.empty()) {
    std::string_view line = take_line(start);
    const std::string_view word = take_word(line);
    if (word.empty() || word.front() == '#') continue;
    return word == "VERSION" || word == "FIELDS" || word == "COLUMNS";
  }
  return false;
}

Scene read_pcd_files(const std::filesystem::path& folder, const std::vector<std::string>& names,
                     const ReadSceneOptions& options, Context& context) {
  const std::filesystem::path path = names.size() == 1 ? folder / names.front() : folder;
  SceneBuilder builder(path, options, context);
  builder.set_name(resolved_path(path).stem().string());
  for (const std::string& name : names) {
    builder.add([&] {
      ViewDraft draft;
      draft.view.range.file = folder / name;
      draft.view.range.format = RangeFormat::kPcd;
      draft.view.name = draft.view.range.file.stem().string();
      return draft;
    });
  }
  return builder.finish();
}

std::unique_ptr<GridScan> open_pcd(const Source& source) { return std::make_unique<PcdScan>(source); }

}  // namespace lapseam
