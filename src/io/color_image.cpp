#include "io/codecs.h"
#include "io/e57/e57.h"
#include "io/exr.h"
#include "io/output_file.h"
#include "lapseam/io.h"

namespace lapseam {

ImageSize probe_color_size(const Source& source, std::uint32_t index) {
  switch (const FileKind kind = recognise_file(source.file)) {
    case FileKind::kPng:
      return probe_png(source).size;
    case FileKind::kJpeg:
      return probe_jpeg(source);
    case FileKind::kExr:
      return read_exr_header(source).size;
    case FileKind::kE57:
      if (index < kImageOfFile) source.refuse("color.index", "names no image of the E57 file");
      return probe_e57_image(source, index - kImageOfFile);
    default:
      source.refuse({}, "a colour image is PNG, JPEG or EXR; this is " + std::string(describe(kind)));
  }
}

ColorImage read_color(const Source& source, std::uint32_t index) {
  switch (const FileKind kind = recognise_file(source.file)) {
    case FileKind::kPng:
      return decode_png(source, read_file_bytes(source.file));
    case FileKind::kJpeg:
      return decode_jpeg(source, read_file_bytes(source.file));
    case FileKind::kExr:
      return read_exr_color(source);
    case FileKind::kE57:
      if (index < kImageOfFile) source.refuse("color.index", "names no image of the E57 file");
      return read_e57_image(source, index - kImageOfFile);
    default:
      source.refuse({}, "a colour image is PNG, JPEG or EXR; this is " + std::string(describe(kind)));
  }
}

Image<std::uint16_t> read_gray16(const Source& source) {
  const FileKind kind = recognise_file(source.file);
  if (kind != FileKind::kPng) source.refuse({}, "expected a PNG image; this is " + std::string(describe(kind)));
  return decode_png16(source, read_file_bytes(source.file));
}

ColorImage read_color_image(const std::filesystem::path& file) { return read_color({file, {}}); }
Image<std::uint16_t> read_png16(const std::filesystem::path& file) { return read_gray16({file, {}}); }

}  // namespace lapseam
