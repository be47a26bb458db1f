#include <turbojpeg.h>

#include <cmath>
#include <memory>
#include <random>

#include "io/codecs.h"
#include "io_support.h"
#include "lapseam/io.h"

namespace lapseam::test {
namespace {

TEST(Png, ColourComesBackUnchanged) {
  const TempFolder folder;
  const ColorImage image = make_color(37, 23);
  write_png(folder / "a.png", image);
  const ColorImage again = read_color_image(folder / "a.png");
  EXPECT_EQ(again.width, 37);
  EXPECT_EQ(again.height, 23);
  EXPECT_EQ(again.pixels, image.pixels);
}

TEST(Png, SixteenBitsComeBackUnchanged) {
  const TempFolder folder;
  Image<std::uint16_t> image(256, 256);
  for (std::size_t i = 0; i < image.size(); ++i) image.pixels[i] = std::uint16_t(i);
  write_png16(folder / "a.png", image);
  EXPECT_EQ(read_png16(folder / "a.png").pixels, image.pixels);
}

TEST(Png, SixteenBitsAreBigEndianInTheFile) {
  // A value whose bytes differ, in the only uncompressed form there is to look at: another decoder's view of it.
  const TempFolder folder;
  write_png16(folder / "a.png", Image<std::uint16_t>(1, 1, 0xAB12));
  // Read as 8-bit colour, the high byte is what remains of grey.
  EXPECT_EQ(read_color_image(folder / "a.png").pixels[0].r, 0xAB);
}

TEST(Png, AnImageWithoutPixelsIsNotWritten) {
  const TempFolder folder;
  expect_refused([&] { write_png(folder / "a.png", ColorImage()); }, {"a.png", "without pixels"});
  EXPECT_FALSE(std::filesystem::exists(folder / "a.png"));
}

TEST(Png, WritingToAMissingFolderNamesThePath) {
  const TempFolder folder;
  try {
    write_png(folder / "none/a.png", make_color(4, 4));
    FAIL() << "nothing was thrown";
  } catch (const IoError& error) {
    EXPECT_NE(std::string(error.what()).find("none/a.png"), std::string::npos);
  }
}

TEST(Images, AMissingFileIsAnIoErrorWithItsPath) {
  const TempFolder folder;
  for (const char* name : {"a.png", "a.jpg", "a.exr"}) {
    try {
      read_color_image(folder / name);
      FAIL() << "nothing was thrown";
    } catch (const IoError& error) {
      EXPECT_NE(std::string(error.what()).find(name), std::string::npos);
    }
  }
}

void write_jpeg(const std::filesystem::path& file, const ColorImage& image) {
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  const tjhandle handle = tjInitCompress();
  const auto* pixels = reinterpret_cast<const unsigned char*>(image.pixels.data());
  ASSERT_EQ(tjCompress2(handle, pixels, image.width, 0, image.height, TJPF_RGB, &bytes, &size, TJSAMP_444, 98, 0), 0);
  write_bytes(file, {reinterpret_cast<const char*>(bytes), size});
  tjFree(bytes);
  tjDestroy(handle);
}

TEST(Jpeg, ColoursComeBackNearly) {
  const TempFolder folder;
  ColorImage image(48, 32);
  for (int v = 0; v < 32; ++v)
    for (int u = 0; u < 48; ++u) image.at(u, v) = {std::uint8_t(u * 4), std::uint8_t(v * 6), 90};
  write_jpeg(folder / "a.jpg", image);
  const ColorImage again = read_color_image(folder / "a.jpg");
  ASSERT_EQ(again.size(), image.size());
  for (std::size_t i = 0; i < image.size(); ++i) {
    // Quality 98 quantises the coefficients to a few steps.
    EXPECT_NEAR(again.pixels[i].r, image.pixels[i].r, 8);
    EXPECT_NEAR(again.pixels[i].g, image.pixels[i].g, 8);
    EXPECT_NEAR(again.pixels[i].b, image.pixels[i].b, 8);
  }
}

TEST(Jpeg, ATruncatedFileIsRefusedAtEveryLength) {
  const TempFolder folder;
  write_jpeg(folder / "a.jpg", make_color(64, 64));
  const std::string bytes = read_bytes(folder / "a.jpg");
  for (std::size_t length = 3; length + 2 < bytes.size(); length += 41) {
    write_bytes(folder / "b.jpg", bytes.substr(0, length));
    expect_refused([&] { read_color_image(folder / "b.jpg"); }, {"b.jpg", "JPEG"});
  }
  // Reading the size alone needs the frame header only.
  EXPECT_EQ(probe_jpeg({folder / "a.jpg", {}}), (ImageSize{64, 64}));
  write_bytes(folder / "b.jpg", bytes.substr(0, bytes.find("\xFF\xC0") + 7));
  expect_refused([&] { probe_jpeg({folder / "b.jpg", {}}); }, {"b.jpg", "no frame header"});
}

TEST(Jpeg, AbsurdSizesAreRefusedBeforeAnythingIsAllocated) {
  const TempFolder folder;
  write_jpeg(folder / "a.jpg", make_color(64, 64));
  std::string bytes = read_bytes(folder / "a.jpg");
  const std::size_t frame = bytes.find("\xFF\xC0");
  ASSERT_NE(frame, std::string::npos);
  for (const auto& [size, text] : {std::pair("\xFF\xDC", "65500 x 65500"), {"\x40\x10", "16400 x 16400"}}) {
    bytes.replace(frame + 5, 4, std::string(size, 2) + std::string(size, 2));  // height and width
    write_bytes(folder / "b.jpg", bytes);
    expect_refused([&] { read_color_image(folder / "b.jpg"); }, {"b.jpg", "size", text});
    expect_refused([&] { probe_jpeg({folder / "b.jpg", "v"}); }, {"b.jpg", "'v'", "size", text});
  }
}

TEST(ColorImages, AnythingElseIsRefusedByContent) {
  const TempFolder folder;
  write_bytes(folder / "a.png", "GIF89a, whatever the name says");
  expect_refused([&] { read_color_image(folder / "a.png"); }, {"a.png", "PNG, JPEG or EXR"});
  write_png(folder / "b.png", make_color(5, 5));
  expect_refused([&] { read_png16(folder / "b.png"); }, {"b.png", "16-bit"});
}

}  // namespace
}  // namespace lapseam::test
