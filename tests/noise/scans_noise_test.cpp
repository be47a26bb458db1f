// Noise of scans whose noise is known, where they are there (LAPSEAM_DATA, default ../shared/data).

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "lapseam/context.h"
#include "lapseam/io.h"
#include "lapseam/noise.h"

namespace lapseam {
namespace {

std::filesystem::path data_folder() {
  const char* given = std::getenv("LAPSEAM_DATA");
  return given ? given : "../shared/data";
}

std::vector<View> load_room(const std::filesystem::path& folder, const std::string& key) {
  std::ifstream in(folder / "dataset.json");
  const nlohmann::json json = nlohmann::json::parse(in);
  std::vector<View> views;
  for (const auto& entry : json["views"]) {
    ViewSource source;
    source.name = entry[key];
    source.sensor = PinholeSensor{json["width"], json["height"], json["fx"], json["fy"], json["cx"], json["cy"], {}};
    source.range.format = RangeFormat::kPng16;
    source.range.file = folder / std::string(entry[key]);
    source.range.scale_m = 1 / double(json["depth_scale"]);
    views.push_back(load_view(source));
  }
  return views;
}

NoiseModel estimate(const std::vector<View>& views) {
  Context context;
  std::vector<const View*> pointers;
  for (const View& view : views) pointers.push_back(&view);
  return estimate_noise(pointers, context);
}

TEST(ScansNoise, FurnishedRoomIsRecovered) {
  const std::filesystem::path folder = data_folder() / "room_p16";
  if (!std::filesystem::exists(folder / "dataset.json"))
    GTEST_SKIP() << "no room_p16 in LAPSEAM_DATA or ../shared/data";
  const NoiseModel found = estimate(load_room(folder, "depth"));
  for (double z = 0.8; z <= 4.0; z += 0.1) {
    const double truth = 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4);
    EXPECT_NEAR(found.sigma(z) / truth, 1, 0.15) << "z " << z;
  }
}

TEST(ScansNoise, NoiselessRoomShowsOnlyItsRounding) {
  const std::filesystem::path folder = data_folder() / "room_p16";
  if (!std::filesystem::exists(folder / "dataset.json"))
    GTEST_SKIP() << "no room_p16 in LAPSEAM_DATA or ../shared/data";
  const NoiseModel found = estimate(load_room(folder, "depth_true"));
  // Steps of 0.2 mm.
  EXPECT_NEAR(found.floor_m, 0.0002 / std::sqrt(12.0), 2e-6);
  for (double z = 0.8; z <= 4.0; z += 0.1) EXPECT_LT(found.sigma(z), 0.0003) << "z " << z;
}

}  // namespace
}  // namespace lapseam
