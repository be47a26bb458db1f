// The format is that of NumPy Enhancement Proposal 1: a magic, a version, the length of a Python dictionary, and that.

#include "io/npy.h"

#include <array>
#include <cstring>

#include "io/output_file.h"
#include "io/text_scan.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

constexpr std::string_view kMagic = "\x93NUMPY";

struct Header {
  std::string type;  ///< as NumPy writes it: "<f4"
  bool is_by_columns = false;
  ImageSize size;
  std::size_t item_bytes = 0, body_offset = 0;
};

/// What follows 'key': in the dictionary.
std::string_view value_of(const Source& source, std::string_view dictionary, const std::string& key) {
  std::size_t at = dictionary.find("'" + key + "'");
  if (at == std::string_view::npos) source.refuse(key, "missing in the header of the .npy file");
  at = dictionary.find(':', at);
  return at == std::string_view::npos ? std::string_view() : trim(dictionary.substr(at + 1));
}

ImageSize parse_shape(const Source& source, std::string_view value) {
  std::array<std::uint64_t, 3> axes{1, 1, 1};
  std::size_t count = 0;
  const std::size_t end = value.find(')');
  bool is_good = value.starts_with('(') && end != std::string_view::npos;
  std::string_view rest = is_good ? value.substr(1, end - 1) : std::string_view();
  while (is_good && !trim(rest).empty()) {
    const std::size_t comma = rest.find(',');
    const auto axis = parse_number<std::uint64_t>(trim(rest.substr(0, comma)));
    is_good = axis && *axis <= kMaxPixels && count < axes.size();
    if (is_good) axes[count++] = *axis;
    rest = comma == std::string_view::npos ? std::string_view() : rest.substr(comma + 1);
  }
  if (!is_good || count < 2 || axes[2] != 1)
    source.refuse("shape", "'" + std::string(value.substr(0, 40)) + "' is none of an image: (height, width)");
  check_image_size(source, axes[1], axes[0], file_size_bytes(source.file), 1);
  return {int(axes[1]), int(axes[0])};
}

Header read_header(const Source& source) {
  // Dictionaries of arrays without fields have far fewer bytes.
  const std::string start = read_file_start(source.file, 4096);
  const std::string_view text = start;
  const bool is_long = text.size() > 6 && text[6] >= 2;
  const std::size_t length_bytes = is_long ? 4 : 2, begin = 8 + length_bytes;
  if (!looks_like_npy(text) || text.size() < begin) source.refuse({}, "this is no .npy file");
  if (text[6] < 1 || text[6] > 3) source.refuse("version", "of the .npy file is not 1, 2 or 3");
  std::uint32_t length = 0;
  std::memcpy(&length, text.data() + 8, length_bytes);
  if (length > text.size() - begin) source.refuse({}, "the header of the .npy file is truncated");
  const std::string_view dictionary = text.substr(begin, length);

  Header header;
  const std::string_view type = value_of(source, dictionary, "descr");
  if (type.size() > 5 && type[0] == '\'' && type[4] == '\'') header.type = type.substr(1, 3);
  for (const char* known : {"<f4", "<f8", "<u2", "<i2", "<u4", "<i4"})
    if (header.type == known) header.item_bytes = std::size_t(header.type[2] - '0');
  if (header.item_bytes == 0)
    source.refuse("descr",
                  "'" + std::string(type.substr(0, 20)) + "' is not read; <f4, <f8, <u2, <i2, <u4 and <i4 are");
  header.is_by_columns = value_of(source, dictionary, "fortran_order").starts_with("True");
  header.size = parse_shape(source, value_of(source, dictionary, "shape"));
  header.body_offset = begin + length;
  const std::uint64_t body = std::uint64_t(header.size.width) * std::uint64_t(header.size.height) * header.item_bytes;
  if (file_size_bytes(source.file) != header.body_offset + body)
    source.refuse("size", "the file's length is not that of " + to_string(header.size) + " numbers");
  return header;
}

template <typename Stored>
void unpack(const Header& header, const char* bytes, Image<double>& image) {
  for (int v = 0; v < image.height; ++v) {
    for (int u = 0; u < image.width; ++u) {
      const std::size_t i = header.is_by_columns ? std::size_t(u) * std::size_t(image.height) + std::size_t(v)
                                                 : std::size_t(v) * std::size_t(image.width) + std::size_t(u);
      Stored value;
      std::memcpy(&value, bytes + i * sizeof value, sizeof value);
      image.at(u, v) = double(value);
    }
  }
}

}  // namespace

bool looks_like_npy(std::string_view start) { return start.starts_with(kMagic); }

ImageSize probe_npy(const Source& source) { return read_header(source).size; }

Image<double> read_npy(const Source& source) {
  const Header header = read_header(source);
  const std::vector<char> bytes = read_file_bytes(source.file);
  Image<double> image(header.size.width, header.size.height);
  if (bytes.size() < header.body_offset + image.size() * header.item_bytes) source.refuse({}, "the file is truncated");
  const char* body = bytes.data() + header.body_offset;
  if (header.type == "<f4") unpack<float>(header, body, image);
  if (header.type == "<f8") unpack<double>(header, body, image);
  if (header.type == "<u2") unpack<std::uint16_t>(header, body, image);
  if (header.type == "<i2") unpack<std::int16_t>(header, body, image);
  if (header.type == "<u4") unpack<std::uint32_t>(header, body, image);
  if (header.type == "<i4") unpack<std::int32_t>(header, body, image);
  return image;
}

}  // namespace lapseam
