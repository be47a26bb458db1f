#pragma once

// PNG and JPEG, and colour images of any kind. Decoders take the whole file and name `source` in their errors; probes
// read headers only.

#include <cstdint>
#include <span>
#include <vector>

#include "io/source.h"
#include "lapseam/image.h"

namespace lapseam {

struct PngProbe {
  ImageSize size;
  bool is_gray16 = false;
};
PngProbe probe_png(const Source& source);
Image<std::uint16_t> decode_png16(const Source& source, std::span<const char> bytes);
ColorImage decode_png(const Source& source, std::span<const char> bytes);
std::vector<char> encode_png(const ColorImage& image);

ImageSize probe_jpeg(const Source& source);
ColorImage decode_jpeg(const Source& source, std::span<const char> bytes);

/// PNG, JPEG or EXR, by content; of an E57 file, the image that ColorSource::index names.
ImageSize probe_color_size(const Source& source, std::uint32_t index = 0);
ColorImage read_color(const Source& source, std::uint32_t index = 0);
/// 16-bit grey PNG.
Image<std::uint16_t> read_gray16(const Source& source);

}  // namespace lapseam
