#include <turbojpeg.h>

#include <cstdio>
#include <memory>

#include "io/codecs.h"

namespace lapseam {
namespace {

// A scan may spend as little as one bit on a block of 8 × 8 pixels.
constexpr std::uint64_t kMaxPixelsPerByte = 64 * 8;

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

/// Big-endian 16 bits; negative at the end of the file.
int read_16(std::FILE* file) {
  const int high = std::fgetc(file), low = std::fgetc(file);
  return high < 0 || low < 0 ? -1 : high << 8 | low;
}

bool is_frame_header(int marker) {
  // SOF0 … SOF15, without DHT, JPG and DAC, which lie among them.
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

/// Goes from segment to segment up to the frame header (ITU T.81, annex B); no pixel data come before it.
bool find_size(std::FILE* file, ImageSize& size) {
  if (read_16(file) != 0xFFD8) return false;
  for (;;) {
    if (std::fgetc(file) != 0xFF) return false;
    int marker = std::fgetc(file);
    while (marker == 0xFF) marker = std::fgetc(file);  // fill bytes
    if (marker <= 0) return false;
    const int length = read_16(file);
    if (length < 2) return false;
    if (!is_frame_header(marker)) {
      if (std::fseek(file, length - 2, SEEK_CUR) != 0) return false;
      continue;
    }
    std::fgetc(file);  // bits a sample
    size.height = read_16(file);
    size.width = read_16(file);
    return size.width >= 0;
  }
}

struct DestroyHandle {
  void operator()(void* handle) const { tjDestroy(handle); }
};

}  // namespace

ImageSize probe_jpeg(const Source& source) {
  const std::unique_ptr<std::FILE, CloseFile> file(std::fopen(source.file.c_str(), "rb"));
  if (!file) throw IoError(source.file, "cannot read");
  ImageSize size;
  if (!find_size(file.get(), size)) source.refuse({}, "damaged JPEG image: no frame header");
  check_image_size(source, std::uint64_t(size.width), std::uint64_t(size.height), file_size_bytes(source.file),
                   kMaxPixelsPerByte);
  return size;
}

ColorImage decode_jpeg(const Source& source, std::span<const char> bytes) {
  const std::unique_ptr<void, DestroyHandle> handle(tjInitDecompress());
  if (!handle) throw std::bad_alloc();
  const auto* data = reinterpret_cast<const unsigned char*>(bytes.data());
  const auto data_bytes = static_cast<unsigned long>(bytes.size());
  const auto refuse = [&] { source.refuse({}, std::string("damaged JPEG image: ") + tjGetErrorStr2(handle.get())); };

  int width = 0, height = 0, subsampling = 0, colorspace = 0;
  if (tjDecompressHeader3(handle.get(), data, data_bytes, &width, &height, &subsampling, &colorspace) != 0) refuse();
  // A file that ends before its frame header comes back without a size, and without an error.
  if (width <= 0 || height <= 0) source.refuse({}, "damaged JPEG image: no frame header");
  check_image_size(source, std::uint64_t(width), std::uint64_t(height), bytes.size(), kMaxPixelsPerByte);
  ColorImage image(width, height);
  auto* out = reinterpret_cast<unsigned char*>(image.pixels.data());
  constexpr int kFlags = TJFLAG_ACCURATEDCT | TJFLAG_LIMITSCANS;
  if (tjDecompress2(handle.get(), data, data_bytes, out, width, 0, height, TJPF_RGB, kFlags) != 0) {
    // Warnings are damage too (a truncated file is one), but for stray bytes between segments, which cameras write.
    const bool is_harmless = tjGetErrorCode(handle.get()) == TJERR_WARNING &&
                             std::string(tjGetErrorStr2(handle.get())).find("extraneous bytes") != std::string::npos;
    if (!is_harmless) refuse();
  }
  return image;
}

}  // namespace lapseam
