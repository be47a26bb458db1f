#include "io/exr_precheck.h"

#include <array>
#include <bit>
#include <cstring>
#include <fstream>
#include <string_view>
#include <utility>

namespace lapseam {
namespace {

static_assert(std::endian::native == std::endian::little, "EXR files are little-endian, and read in place");

// No compression of OpenEXR gets below this on anything but emptiness.
constexpr std::uint64_t kMaxPixelsPerByte = 4096;
constexpr std::size_t kMaxNameBytes = 255;
constexpr int kMaxAttributes = 1 << 16;

template <typename T>
bool read_value(std::istream& stream, T& value) {
  std::array<char, sizeof(T)> bytes;
  if (!stream.read(bytes.data(), bytes.size())) return false;
  value = std::bit_cast<T>(bytes);
  return true;
}

/// A name that ends in a zero; false at the end of the file, and for what is too long to be one.
bool read_name(std::istream& stream, std::string& name) {
  name.clear();
  for (int c = stream.get(); c > 0; c = stream.get()) {
    if (name.size() == kMaxNameBytes) return false;
    name += char(c);
  }
  return bool(stream);
}

struct Box {
  std::int32_t min_x, min_y, max_x, max_y;
};

void check_data_window(const Source& source, const Box& box, std::uint64_t file_bytes) {
  const std::int64_t width = std::int64_t(box.max_x) - box.min_x + 1, height = std::int64_t(box.max_y) - box.min_y + 1;
  if (width <= 0 || height <= 0) source.refuse("size", "the data window of the EXR image is empty");
  // Frame buffers are addressed from pixel (0, 0), wherever the window lies; nothing real lies this far out.
  constexpr std::int32_t kFarthest = 1 << 24;
  const auto is_far = [](std::int32_t at) { return at < -kFarthest || at > kFarthest; };
  if (is_far(box.min_x) || is_far(box.min_y)) source.refuse("size", "the data window of the EXR image lies far away");
  check_image_size(source, std::uint64_t(width), std::uint64_t(height), file_bytes, kMaxPixelsPerByte);
}

/// Types of one size only. OpenEXR reads that many bytes whatever size the file claims, and goes on from there.
constexpr std::array<std::pair<std::string_view, std::int32_t>, 24> kFixedSizes{{
    {"box2i", 16},      {"box2f", 16},   {"chromaticities", 32},
    {"compression", 1}, {"double", 8},   {"envmap", 1},
    {"float", 4},       {"int", 4},      {"keycode", 28},
    {"lineOrder", 1},   {"m33f", 36},    {"m33d", 72},
    {"m44f", 64},       {"m44d", 128},   {"rational", 8},
    {"tiledesc", 9},    {"timecode", 8}, {"v2i", 8},
    {"v2f", 8},         {"v2d", 16},     {"v3i", 12},
    {"v3f", 12},        {"v3d", 24},     {"deepImageState", 1},
}};

/// A list of channels: names with 16 bytes each, ended by an empty name.
bool is_channel_list(std::istream& stream, std::uint64_t end) {
  std::string name;
  while (read_name(stream, name) && !name.empty()) stream.seekg(16, std::ios::cur);
  return bool(stream) && std::uint64_t(stream.tellg()) == end;
}

/// Texts, each after its length.
bool is_text_list(std::istream& stream, std::uint64_t end) {
  while (stream && std::uint64_t(stream.tellg()) < end) {
    std::int32_t length = 0;
    if (!read_value(stream, length) || length < 0 || std::uint64_t(length) > end) return false;
    stream.seekg(length, std::ios::cur);
  }
  return bool(stream) && std::uint64_t(stream.tellg()) == end;
}

/// Width, height, and four bytes a pixel.
bool is_preview(std::istream& stream, std::int32_t size) {
  std::uint32_t width = 0, height = 0;
  if (size < 8 || !read_value(stream, width) || !read_value(stream, height)) return false;
  return width < 65536 && height < 65536 && std::uint64_t(width) * height * 4 + 8 == std::uint64_t(size);
}

/// Whether the value takes as many bytes as the header says: where it does not, OpenEXR would take what follows for
/// something else than it is here.
bool has_right_size(std::istream& stream, std::string_view type, std::int32_t size) {
  for (const auto& [fixed_type, fixed_size] : kFixedSizes)
    if (type == fixed_type) return size == fixed_size;
  const std::uint64_t end = std::uint64_t(stream.tellg()) + std::uint64_t(size);
  if (type == "chlist") return is_channel_list(stream, end);
  if (type == "stringvector") return is_text_list(stream, end);
  if (type == "preview") return is_preview(stream, size);
  if (type == "floatvector") return size % 4 == 0;
  return true;  // as long as it says, whatever it is
}

/// The attributes of one header; false when there are none, which ends a list of headers.
bool check_header(const Source& source, std::istream& stream, std::uint64_t file_bytes) {
  std::string name, type;
  for (int count = 0; count < kMaxAttributes; ++count) {
    std::int32_t size = 0;
    if (!read_name(stream, name)) break;
    if (name.empty()) return count > 0;
    if (!read_name(stream, type) || !read_value(stream, size)) break;
    const auto position = std::uint64_t(stream.tellg());
    if (size < 0 || std::uint64_t(size) > file_bytes - position)
      source.refuse(name, "damaged EXR image: the attribute does not fit the file");
    // Compressed tables of object names, which can ask for any amount of memory, come with deep images only.
    if (type == "idmanifest") source.refuse(name, "EXR images with an id manifest cannot be read");
    if (!has_right_size(stream, type, size))
      source.refuse(name, "damaged EXR image: the attribute has not the size of its type");
    Box box{};
    stream.seekg(std::streamoff(position));
    if (name == "dataWindow" && type == "box2i" && read_value(stream, box)) check_data_window(source, box, file_bytes);
    stream.seekg(std::streamoff(position + std::uint64_t(size)));
  }
  source.refuse({}, "damaged EXR image: the header has no end");
}

}  // namespace

void check_exr_headers(const Source& source) {
  std::ifstream stream(source.file, std::ios::binary);
  const std::uint64_t file_bytes = file_size_bytes(source.file);
  std::uint32_t magic = 0, version = 0;
  if (!read_value(stream, magic) || !read_value(stream, version))
    source.refuse({}, "damaged EXR image: it is truncated");
  constexpr std::uint32_t kIsMultiPart = 0x1000;
  bool has_more = check_header(source, stream, file_bytes);
  while (has_more && (version & kIsMultiPart)) has_more = check_header(source, stream, file_bytes);
}

}  // namespace lapseam
