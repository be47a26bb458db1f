#include <cmath>
#include <limits>

#include "io_support.h"
#include "lapseam/io.h"

namespace lapseam::test {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

ViewSource png_view(const std::filesystem::path& file, int width, int height) {
  ViewSource source;
  source.name = "front";
  source.sensor = PinholeSensor{width, height, 20, 21, 5, 4, {}};
  source.range.file = file;
  source.range.scale_m = 0.001;
  return source;
}

TEST(LoadView, ScalesAndLeavesOutInvalidValues) {
  const TempFolder folder;
  Image<std::uint16_t> image(4, 1);
  image.pixels = {0, 1234, 65535, 7};
  write_png16(folder / "a.png", image);
  ViewSource source = png_view(folder / "a.png", 4, 1);
  source.range.invalid_values = {65535};
  const View view = load_view(source);
  EXPECT_EQ(view.name, "front");
  EXPECT_EQ(view.range.pixels, (Pixels<float>{0.0f, 1.234f, 0.0f, 0.007f}));
}

TEST(LoadView, IntensitiesOfTheirOwnFile) {
  const TempFolder folder;
  write_png16(folder / "a.png", Image<std::uint16_t>(4, 2, 1000));
  Image<std::uint8_t> intensity(4, 2, 7);
  intensity.at(3, 1) = 250;
  write_png8(folder / "i.png", intensity);
  write_png8(folder / "small.png", Image<std::uint8_t>(3, 2, 7));
  ViewSource source = png_view(folder / "a.png", 4, 2);
  EXPECT_TRUE(load_view(source).intensity.pixels.empty());
  source.range.intensity_file = folder / "i.png";
  EXPECT_EQ(load_view(source).intensity.pixels, intensity.pixels);
  source.range.intensity_file = folder / "small.png";
  expect_refused([&] { load_view(source); }, {"small.png", "'front'", "range.intensity", "3 x 2", "4 x 2"});
}

TEST(LoadView, NoSampleIsEverNegativeOrNotFinite) {
  auto range = std::make_shared<RangeImage>(6, 1);
  range->pixels = {-1.0f, kNan, kInfinity, 2.0f, 1e-44f, 3e38f};
  ViewSource source = png_view("memory", 6, 1);
  source.range.format = RangeFormat::kMemory;
  source.range.memory = range;
  source.range.scale_m = 10;
  EXPECT_EQ(load_view(source).range.pixels, (Pixels<float>{0, 0, 0, 20, 0, 0}));
}

TEST(LoadView, DistanceAlongTheRayBecomesZ) {
  auto range = std::make_shared<RangeImage>(11, 9, 3.0f);
  ViewSource source = png_view("memory", 11, 9);
  source.range.format = RangeFormat::kMemory;
  source.range.memory = range;
  source.range.quantity = RangeQuantity::kDistance;
  source.range.scale_m = 1;
  const View view = load_view(source);
  for (int v = 0; v < 9; ++v) {
    for (int u = 0; u < 11; ++u) {
      const Eigen::Vector3d p = unproject(view.sensor, u, v, double(view.range.at(u, v)));
      EXPECT_NEAR(p.norm(), 3.0, 1e-6);  // a float's rounding
    }
  }
}

TEST(LoadView, RefusesWhatIsNoView) {
  const TempFolder folder;
  write_png16(folder / "a.png", Image<std::uint16_t>(4, 3, 0));
  expect_refused([&] { load_view(png_view(folder / "a.png", 4, 3)); },
                 {"a.png", "'front'", "range", "no valid sample"});
  write_png16(folder / "a.png", Image<std::uint16_t>(4, 3, 9));
  expect_refused([&] { load_view(png_view(folder / "a.png", 5, 3)); }, {"a.png", "'front'", "4 x 3", "5 x 3"});
  write_png(folder / "c.png", make_color(4, 3));
  expect_refused([&] { load_view(png_view(folder / "c.png", 4, 3)); }, {"c.png", "'front'", "16-bit"});
}

TEST(LoadColor, ChecksTheCamera) {
  const TempFolder folder;
  write_png(folder / "c.png", make_color(6, 5));
  ViewSource source = png_view(folder / "a.png", 4, 3);
  expect_refused([&] { load_color(source); }, {"'front'", "no colour"});
  source.color.emplace();
  source.color->file = folder / "c.png";
  source.color->camera = PinholeSensor{6, 5, 9, 9, 3, 3, {}};
  EXPECT_EQ(load_color(source).pixels, make_color(6, 5).pixels);
  source.color->camera = PinholeSensor{5, 5, 9, 9, 3, 3, {}};
  expect_refused([&] { load_color(source); }, {"c.png", "'front'", "6 x 5", "5 x 5"});
  source.color->memory = std::make_shared<ColorImage>(make_color(5, 5));
  EXPECT_EQ(load_color(source).size(), 25u);
}

}  // namespace
}  // namespace lapseam::test
