#include "io/source.h"

#include <cerrno>
#include <fstream>
#include <system_error>

#include "io/colmap.h"
#include "io/npy.h"
#include "io/pcd.h"
#include "io/ptx.h"
#include "io/sens.h"
#include "io/text_scan.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

bool looks_like_conf(std::string_view text) {
  while (!text.empty()) {
    std::string_view line = take_line(text);
    const std::string_view word = take_word(line);
    if (word.empty() || word.front() == '#') continue;
    return word == "bmesh" || word == "mesh" || word == "camera";
  }
  return false;
}

bool looks_like_json(std::string_view text) {
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  text = trim(text);
  return !text.empty() && text.front() == '{';
}

std::string printable(std::string text) {
  for (char& c : text)
    if ((c >= 0 && c < ' ') || c == '\x7F') c = '?';
  return text;
}

}  // namespace

void Source::refuse(const std::string& field, const std::string& problem) const {
  throw InvalidInput(file, view, printable(field), printable(problem));
}

std::string to_string(ImageSize size) { return std::to_string(size.width) + " x " + std::to_string(size.height); }

std::uint64_t file_size_bytes(const std::filesystem::path& file) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  if (error) throw IoError(file, "cannot read: " + error.message());
  return size;
}

std::string read_file_start(const std::filesystem::path& file, std::size_t count) {
  std::error_code error;
  if (std::filesystem::is_directory(file, error)) throw IoError(file, "cannot read: this is a folder");
  errno = 0;
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw IoError(file, "cannot read: " + std::generic_category().message(errno));
  std::string text(count, '\0');
  stream.read(text.data(), std::streamsize(count));
  if (stream.bad()) throw IoError(file, "cannot read");
  text.resize(std::size_t(stream.gcount()));
  return text;
}

FileKind recognise_file(const std::filesystem::path& file) {
  using namespace std::string_view_literals;
  const std::string start = read_file_start(file, 4096);
  const std::string_view text = start;
  if (text.starts_with("\x89PNG\r\n\x1A\n"sv)) return FileKind::kPng;
  if (text.starts_with("\xFF\xD8\xFF"sv)) return FileKind::kJpeg;
  if (text.starts_with("\x76\x2F\x31\x01"sv)) return FileKind::kExr;
  if (text.starts_with("ply\n"sv) || text.starts_with("ply\r"sv)) return FileKind::kPly;
  if (text.starts_with("ASTM-E57"sv)) return FileKind::kE57;
  if (looks_like_sens(text)) return FileKind::kSens;
  if (looks_like_npy(text)) return FileKind::kNpy;
  if (looks_like_colmap_depth(text)) return FileKind::kColmapDepth;
  if (looks_like_json(text)) return FileKind::kJson;
  if (looks_like_conf(text)) return FileKind::kStanfordConf;
  if (looks_like_ptx(text)) return FileKind::kPtx;
  if (looks_like_pcd(text)) return FileKind::kPcd;
  return FileKind::kUnknown;
}

std::string_view describe(FileKind kind) {
  switch (kind) {
    case FileKind::kPng:
      return "a PNG image";
    case FileKind::kJpeg:
      return "a JPEG image";
    case FileKind::kExr:
      return "an OpenEXR image";
    case FileKind::kPly:
      return "a PLY file";
    case FileKind::kJson:
      return "a JSON file";
    case FileKind::kStanfordConf:
      return "a Stanford .conf file";
    case FileKind::kE57:
      return "an E57 file";
    case FileKind::kPtx:
      return "a PTX file";
    case FileKind::kPcd:
      return "a PCD file";
    case FileKind::kSens:
      return "a .sens file";
    case FileKind::kColmapDepth:
      return "a COLMAP depth map";
    case FileKind::kNpy:
      return "a NumPy array";
    case FileKind::kUnknown:
      break;
  }
  return "a file of unknown kind";
}

void check_image_size(const Source& source, std::uint64_t width, std::uint64_t height, std::uint64_t file_bytes,
                      std::uint64_t max_pixels_per_byte) {
  const std::string size = std::to_string(width) + " x " + std::to_string(height);
  if (width == 0 || height == 0) source.refuse("size", "the image is " + size + ": it has no pixels");
  if (width > kMaxPixels / height)
    source.refuse("size", "the image claims " + size + " pixels; no more than 2^30 are read");
  // Small files are let through: their headers alone outweigh the pixels.
  constexpr std::uint64_t kAlwaysFine = 1 << 16;
  if (width * height > kAlwaysFine && width * height / max_pixels_per_byte > file_bytes)
    source.refuse("size", "the image claims " + size + " pixels, more than a file of " + std::to_string(file_bytes) +
                              " bytes can hold");
}

}  // namespace lapseam
