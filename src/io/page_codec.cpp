#include "io/page_codec.h"

#include <turbojpeg.h>
#include <webp/decode.h>
#include <webp/encode.h>

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

struct WebpDeleter {
  void operator()(std::uint8_t* bytes) const { WebPFree(bytes); }
};
using WebpBytes = std::unique_ptr<std::uint8_t, WebpDeleter>;

std::vector<char> encode_webp(const ColorImage& image, int quality) {
  if (quality < 1 || quality > 100) throw InvalidInput({}, {}, "texture_quality", "must be 1 to 100");
  if (image.empty() || image.width > WEBP_MAX_DIMENSION || image.height > WEBP_MAX_DIMENSION)
    throw InvalidInput({}, {}, "page", "a WebP image has 1 to 16383 pixels in each direction");
  std::uint8_t* encoded = nullptr;
  const std::size_t size =
      WebPEncodeRGB(&image.pixels[0].r, image.width, image.height, 3 * image.width, float(quality), &encoded);
  const WebpBytes owner(encoded);
  if (size == 0) throw InvalidInput({}, {}, "page", "cannot encode as WebP");
  const char* begin = reinterpret_cast<const char*>(encoded);
  return std::vector<char>(begin, begin + size);
}

ColorImage decode_webp(const Source& source, std::span<const char> bytes) {
  // A block of 16 × 16 pixels takes some bits at least; a picture of one colour is the densest.
  constexpr std::uint64_t kMaxPixelsPerByte = 16384;
  const auto* data = reinterpret_cast<const std::uint8_t*>(bytes.data());
  int width = 0, height = 0;
  if (!WebPGetInfo(data, bytes.size(), &width, &height)) source.refuse({}, "damaged WebP image: no header");
  check_image_size(source, std::uint64_t(width), std::uint64_t(height), bytes.size(), kMaxPixelsPerByte);
  ColorImage image(width, height);
  if (!WebPDecodeRGBInto(data, bytes.size(), &image.pixels[0].r, 3 * image.size(), 3 * width))
    source.refuse({}, "damaged WebP image");
  return image;
}

}  // namespace

std::vector<char> encode_jpeg(const ColorImage& image, int quality) {
  constexpr int kMostPixelsWide = 65500;
  if (quality < 1 || quality > 100) throw InvalidInput({}, {}, "texture_quality", "must be 1 to 100");
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

std::vector<char> encode_page(const ColorImage& image, TextureFormat format, int quality) {
  switch (format) {
    case TextureFormat::kPng:
      return encode_png(image);
    case TextureFormat::kWebp:
      return encode_webp(image, quality);
    case TextureFormat::kJpeg:
      break;
  }
  return encode_jpeg(image, quality);
}

const char* mime_type(TextureFormat format) {
  return format == TextureFormat::kPng ? "image/png" : format == TextureFormat::kWebp ? "image/webp" : "image/jpeg";
}

const char* file_ending(TextureFormat format) {
  return format == TextureFormat::kPng ? ".png" : format == TextureFormat::kWebp ? ".webp" : ".jpg";
}

ColorImage decode_page(std::span<const char> bytes, const std::filesystem::path& file) {
  constexpr std::string_view kPng = "\x89PNG\r\n\x1a\n", kJpeg = "\xFF\xD8\xFF";
  const std::string_view text(bytes.data(), bytes.size());
  const Source source{file, {}};
  if (text.starts_with(kPng)) return decode_png(source, bytes);
  if (text.starts_with(kJpeg)) return decode_jpeg(source, bytes);
  if (text.starts_with("RIFF") && text.substr(0, 12).ends_with("WEBP")) return decode_webp(source, bytes);
  throw InvalidInput(file, {}, "texture image", "this is no JPEG, PNG or WebP image");
}

}  // namespace lapseam
