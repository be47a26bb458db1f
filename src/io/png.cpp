#include <spng.h>

#include <cstdlib>
#include <memory>

#include "io/codecs.h"
#include "io/output_file.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

// Deflate packs at most 1032 bytes into one (RFC 1951: 258 bytes from a length and a distance code of one bit each);
// the thinnest pixels have one bit.
constexpr std::uint64_t kMaxPixelsPerByte = 1032 * 8;
constexpr std::size_t kHeaderBytes = 33;

struct FreeContext {
  void operator()(spng_ctx* context) const { spng_ctx_free(context); }
};
using ContextPointer = std::unique_ptr<spng_ctx, FreeContext>;

ContextPointer make_context(int flags) {
  ContextPointer context(spng_ctx_new(flags));
  if (!context) throw std::bad_alloc();
  return context;
}

class Decoder {
 public:
  Decoder(const Source& source, std::span<const char> bytes) : source_(source), context_(make_context(0)) {
    check(spng_set_png_buffer(context_.get(), bytes.data(), bytes.size()));
    check(spng_get_ihdr(context_.get(), &header_));
    check_image_size(source, header_.width, header_.height, bytes.size(), kMaxPixelsPerByte);
  }

  ImageSize size() const { return {int(header_.width), int(header_.height)}; }
  bool is_gray16() const { return header_.color_type == SPNG_COLOR_TYPE_GRAYSCALE && header_.bit_depth == 16; }

  void decode(void* out, std::size_t out_bytes, spng_format format) {
    std::size_t needed_bytes = 0;
    check(spng_decoded_image_size(context_.get(), format, &needed_bytes));
    if (needed_bytes != out_bytes) source_.refuse({}, "the PNG image has an unexpected layout");
    check(spng_decode_image(context_.get(), out, out_bytes, format, 0));
  }

 private:
  void check(int error) const {
    if (error) source_.refuse({}, std::string("damaged PNG image: ") + spng_strerror(error));
  }

  const Source& source_;
  ContextPointer context_;
  spng_ihdr header_{};
};

/// file: to name in errors.
std::vector<char> encode(const std::filesystem::path& file, ImageSize size, spng_color_type color_type,
                         std::uint8_t bit_depth, const void* pixels, std::size_t pixels_bytes) {
  if (pixels_bytes == 0) throw InvalidInput(file, {}, "size", "an image without pixels cannot be written");
  const ContextPointer context = make_context(SPNG_CTX_ENCODER);
  const auto check = [&file](int error) {
    if (error) throw IoError(file, std::string("cannot encode PNG: ") + spng_strerror(error));
  };
  spng_ihdr header{};
  header.width = std::uint32_t(size.width);
  header.height = std::uint32_t(size.height);
  header.color_type = std::uint8_t(color_type);
  header.bit_depth = bit_depth;
  check(spng_set_ihdr(context.get(), &header));
  check(spng_set_option(context.get(), SPNG_ENCODE_TO_BUFFER, 1));
  // Level 6, the default, takes twice as long for two per cent.
  check(spng_set_option(context.get(), SPNG_IMG_COMPRESSION_LEVEL, 4));
  check(spng_encode_image(context.get(), pixels, pixels_bytes, SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE));

  std::size_t encoded_bytes = 0;
  int error = 0;
  const std::unique_ptr<void, decltype(&std::free)> encoded(spng_get_png_buffer(context.get(), &encoded_bytes, &error),
                                                            &std::free);
  check(error);
  const char* begin = static_cast<const char*>(encoded.get());
  return std::vector<char>(begin, begin + encoded_bytes);
}

void write_bytes(const std::filesystem::path& file, const std::vector<char>& bytes) {
  OutputFile output(file);
  output.write(bytes.data(), bytes.size());
  output.commit();
}

std::vector<char> encode_color(const std::filesystem::path& file, const ColorImage& image) {
  return encode(file, {image.width, image.height}, SPNG_COLOR_TYPE_TRUECOLOR, 8, image.pixels.data(),
                image.size() * sizeof(Rgb8));
}

std::uint32_t big_endian_32(const std::string& bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value = value << 8 | std::uint8_t(bytes[at + i]);
  return value;
}

}  // namespace

PngProbe probe_png(const Source& source) {
  const std::string start = read_file_start(source.file, kHeaderBytes);
  if (start.size() < kHeaderBytes || start.compare(12, 4, "IHDR") != 0)
    source.refuse({}, "damaged PNG image: no header");
  const std::uint32_t width = big_endian_32(start, 16), height = big_endian_32(start, 20);
  check_image_size(source, width, height, file_size_bytes(source.file), kMaxPixelsPerByte);
  const bool is_gray16 = start[24] == 16 && start[25] == 0;
  return {{int(width), int(height)}, is_gray16};
}

Image<std::uint16_t> decode_png16(const Source& source, std::span<const char> bytes) {
  Decoder decoder(source, bytes);
  if (!decoder.is_gray16()) source.refuse({}, "a PNG range image must be 16-bit greyscale");
  Image<std::uint16_t> image(decoder.size().width, decoder.size().height);
  decoder.decode(image.pixels.data(), image.size() * sizeof(std::uint16_t), SPNG_FMT_PNG);
  return image;
}

ColorImage decode_png(const Source& source, std::span<const char> bytes) {
  Decoder decoder(source, bytes);
  ColorImage image(decoder.size().width, decoder.size().height);
  static_assert(sizeof(Rgb8) == 3);
  decoder.decode(image.pixels.data(), image.size() * sizeof(Rgb8), SPNG_FMT_RGB8);
  return image;
}

void write_png(const std::filesystem::path& file, const ColorImage& image) {
  write_bytes(file, encode_color(file, image));
}

std::vector<char> encode_png(const ColorImage& image) { return encode_color("page", image); }

void write_png8(const std::filesystem::path& file, const Image<std::uint8_t>& image) {
  write_bytes(
      file, encode(file, {image.width, image.height}, SPNG_COLOR_TYPE_GRAYSCALE, 8, image.pixels.data(), image.size()));
}

void write_png16(const std::filesystem::path& file, const Image<std::uint16_t>& image) {
  write_bytes(file, encode(file, {image.width, image.height}, SPNG_COLOR_TYPE_GRAYSCALE, 16, image.pixels.data(),
                           image.size() * sizeof(std::uint16_t)));
}

}  // namespace lapseam
