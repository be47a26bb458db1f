#include "io/ply_header.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "io/text_scan.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

constexpr std::array<std::pair<std::string_view, PlyType>, 16> kTypeNames{{
    {"char", PlyType::kInt8},
    {"uchar", PlyType::kUint8},
    {"short", PlyType::kInt16},
    {"ushort", PlyType::kUint16},
    {"int", PlyType::kInt32},
    {"uint", PlyType::kUint32},
    {"float", PlyType::kFloat32},
    {"double", PlyType::kFloat64},
    {"int8", PlyType::kInt8},
    {"uint8", PlyType::kUint8},
    {"int16", PlyType::kInt16},
    {"uint16", PlyType::kUint16},
    {"int32", PlyType::kInt32},
    {"uint32", PlyType::kUint32},
    {"float32", PlyType::kFloat32},
    {"float64", PlyType::kFloat64},
}};

/// Reads the header line by line.
class HeaderParser {
 public:
  HeaderParser(const std::filesystem::path& file, std::span<const char> bytes)
      : file_(file), total_bytes_(bytes.size()), rest_(bytes.data(), bytes.size()) {}

  PlyHeader run() {
    next_line();
    if (trim(line_) != "ply") fail("does not begin with \"ply\"");
    bool has_format = false;
    for (;;) {
      next_line();
      std::string_view words = line_;
      const std::string_view keyword = take_word(words);
      if (keyword == "end_header") break;
      if (keyword == "format") {
        parse_format(words);
        has_format = true;
      } else if (keyword == "element") {
        parse_element(words);
      } else if (keyword == "property") {
        parse_property(words);
      } else if (keyword == "obj_info") {
        parse_info(words);
      } else if (keyword != "comment" && !keyword.empty()) {
        fail("unknown keyword");
      }
    }
    if (!has_format) fail("no format line");
    header_.body_offset = total_bytes_ - rest_.size();
    return std::move(header_);
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const {
    throw InvalidInput(file_, {}, "header line " + std::to_string(line_number_), problem);
  }

  void next_line() {
    ++line_number_;
    if (rest_.find('\n') == std::string_view::npos) fail("the file ends before end_header");
    line_ = take_line(rest_);
  }

  void parse_format(std::string_view words) {
    const std::string_view name = take_word(words);
    if (name == "ascii") {
      header_.format = PlyFormat::kAscii;
    } else if (name == "binary_little_endian") {
      header_.format = PlyFormat::kLittleEndian;
    } else if (name == "binary_big_endian") {
      header_.format = PlyFormat::kBigEndian;
    } else {
      fail("unknown format");
    }
  }

  void parse_element(std::string_view words) {
    PlyElement element;
    element.name = take_word(words);
    const auto count = parse_number<std::uint64_t>(take_word(words));
    if (element.name.empty() || !count) fail("an element needs a name and a count");
    element.count = *count;
    header_.elements.push_back(std::move(element));
  }

  PlyType parse_type(std::string_view word) const {
    for (const auto& [name, type] : kTypeNames)
      if (name == word) return type;
    fail("unknown type");
  }

  void parse_property(std::string_view words) {
    if (header_.elements.empty()) fail("a property before the first element");
    PlyProperty property;
    std::string_view type = take_word(words);
    property.is_list = type == "list";
    if (property.is_list) {
      property.count_type = parse_type(take_word(words));
      if (is_floating(property.count_type)) fail("the length of a list cannot be a floating-point number");
      type = take_word(words);
    }
    property.type = parse_type(type);
    property.name = take_word(words);
    if (property.name.empty()) fail("a property needs a name");
    header_.elements.back().properties.push_back(std::move(property));
  }

  void parse_info(std::string_view words) {
    if (take_word(words) != "origin_m") return;
    Eigen::Vector3d origin_m;
    for (int axis = 0; axis < 3; ++axis) {
      const auto value = parse_number<double>(take_word(words));
      if (!value || !std::isfinite(*value)) fail("origin_m needs three finite numbers");
      origin_m[axis] = *value;
    }
    header_.origin_m = origin_m;
  }

  const std::filesystem::path& file_;
  std::size_t total_bytes_;
  std::string_view rest_;
  std::string_view line_;
  std::size_t line_number_ = 0;
  PlyHeader header_;
};

}  // namespace

std::size_t size_bytes(PlyType type) {
  constexpr std::array<std::size_t, 8> kSizes{1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[std::size_t(type)];
}

std::size_t PlyElement::min_row_bytes(PlyFormat format) const {
  // Ascii: one digit and one separator a value; the last separator of the file may be missing.
  if (format == PlyFormat::kAscii) return 2 * properties.size();
  std::size_t bytes = 0;
  for (const PlyProperty& property : properties)
    bytes += size_bytes(property.is_list ? property.count_type : property.type);
  return bytes;
}

PlyHeader parse_ply_header(const std::filesystem::path& file, std::span<const char> bytes) {
  return HeaderParser(file, bytes).run();
}

}  // namespace lapseam
