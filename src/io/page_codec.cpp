#include "io/page_codec.h"

#include <turbojpeg.h>

#include <memory>
#include <new>
#include <string>
#include <string_view>

#include "io/codecs.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

struct TurboDeleter {
  void operator()(void* handle) const { tjDestroy(handle); }
};
using TurboHandle = std::unique_ptr<void, TurboDeleter>;

}  // namespace

std::vector<char> encode_jpeg(const ColorImage& image, int quality) {
  constexpr int kMostPixelsWide = 65500;
  if (quality < 1 || quality > 100) throw InvalidInput({}, {}, "jpeg_quality", "must be 1 to 100");
  if (image.empty() || image.width > kMostPixelsWide || image.height > kMostPixelsWide)
    throw InvalidInput({}, {}, "page", "a JPEG image has 1 to 65500 pixels in each direction");
  const TurboHandle handle(tjInitCompress());
  if (!handle) throw std::bad_alloc();
  std::vector<char> bytes(tjBufSize(image.width, image.height, TJSAMP_444));
  auto* destination = reinterpret_cast<unsigned char*>(bytes.data());
  auto size = static_cast<unsigned long>(bytes.size());
  if (tjCompress2(handle.get(), &image.pixels[0].r, image.width, 0, image.height, TJPF_RGB, &destination, &size,
                  TJSAMP_444, quality, TJFLAG_NOREALLOC | TJFLAG_ACCURATEDCT) != 0)
    throw InvalidInput({}, {}, "page", std::string("cannot encode as JPEG: ") + tjGetErrorStr2(handle.get()));
  bytes.resize(size);
  bytes.shrink_to_fit();
  return bytes;
}

ColorImage decode_page(std::span<const char> bytes, const std::filesystem::path& file) {
  constexpr std::string_view kPng = "\x89PNG\r\n\x1a\n", kJpeg = "\xFF\xD8\xFF";
  const std::string_view text(bytes.data(), bytes.size());
  const Source source{file, {}};
  if (text.starts_with(kPng)) return decode_png(source, bytes);
  if (text.starts_with(kJpeg)) return decode_jpeg(source, bytes);
  throw InvalidInput(file, {}, "texture image", "this is neither a JPEG nor a PNG image");
}

}  // namespace lapseam
