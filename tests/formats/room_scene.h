#pragma once

// A small scene in memory, to be written in every format and read back: a ball in a box, seen by cameras or scanners
// that stand at odd places, with colours that tell every pixel.

#include <memory>

#include "io/io_support.h"
#include "lapseam/context.h"
#include "lapseam/convert.h"
#include "lapseam/io.h"
#include "support/analytic_views.h"

namespace lapseam::test {

inline Eigen::Isometry3d odd_pose(int i) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Quaterniond(0.9, 0.1 + 0.05 * i, -0.2, 0.3 - 0.1 * i).normalized().toRotationMatrix();
  T.translation() = Eigen::Vector3d(0.123456789 + 0.1 * i, -0.2, 0.3);
  return T;
}

inline Shape ball_in_box() {
  return [](const Eigen::Vector3d& o, const Eigen::Vector3d& d) -> std::optional<double> {
    const auto ball = sphere({1, 0.5, 0.4}, 0.5)(o, d);
    return ball ? ball : box_room({-2, -2.5, -1.5}, {2.5, 2, 1.6})(o, d);
  };
}

/// Views of the box by one sensor, held in memory. Every 11th pixel has no sample.
inline Scene room_scene(const Sensor& sensor, int views, bool has_color = true,
                        const Eigen::Vector3d& offset_m = Eigen::Vector3d::Zero()) {
  Scene scene;
  scene.name = "room";
  scene.file = "room";
  for (int i = 0; i < views; ++i) {
    View view = make_view("view" + std::to_string(i), sensor, odd_pose(i), ball_in_box());
    for (std::size_t k = 3; k < view.range.size(); k += 11) view.range.pixels[k] = kInvalidRange;
    ViewSource source;
    source.name = view.name;
    source.sensor = sensor;
    source.sensor_id = "camera";
    source.T_world_view = view.T_world_view;
    source.T_world_view.translation() += offset_m;
    source.range.format = RangeFormat::kMemory;
    source.range.memory = std::make_shared<RangeImage>(view.range);
    if (has_color) {
      source.color.emplace();
      source.color->camera = sensor;
      source.color->memory = std::make_shared<ColorImage>(make_color(width(sensor), height(sensor)));
    }
    scene.views.push_back(std::move(source));
  }
  return scene;
}

inline PinholeSensor lens_camera() { return {64, 48, 50.25, 51.5, 30.75, 24.125, {}}; }
inline SphericalSensor small_scanner() { return SphericalSensor::from_limits(90, 40, 3.14159, -3.14159, 1.2, -0.9); }

/// Writes the scene, reads it back, and compares names of views, poses, samples (as points), and colours.
/// quantum_m: how far a point may be off.
inline void expect_round_trip(const Scene& scene, SceneFormat format, const std::string& name, double quantum_m,
                              bool are_names_kept = true) {
  const TempFolder folder;
  Context context(2);
  ConvertOptions options;
  options.format = format;
  convert_scene(scene, folder / name, options, context);
  const Scene back = read_scene(folder / name, {}, context);
  ASSERT_EQ(back.views.size(), scene.views.size());
  for (std::size_t i = 0; i < scene.views.size(); ++i) {
    const View expected = load_view(scene.views[i]), found = load_view(back.views[i]);
    if (are_names_kept) {
      EXPECT_EQ(found.name, expected.name);
    }
    ASSERT_EQ(found.range.width, expected.range.width);
    ASSERT_EQ(found.range.height, expected.range.height);
    EXPECT_LT((found.T_world_view.matrix() - expected.T_world_view.matrix()).cwiseAbs().maxCoeff(), 1e-12);
    double worst_m = 0;
    for (int v = 0; v < expected.range.height; ++v) {
      for (int u = 0; u < expected.range.width; ++u) {
        const float a = expected.range.at(u, v), b = found.range.at(u, v);
        ASSERT_EQ(a > 0, b > 0) << u << ' ' << v;
        if (!(a > 0)) continue;
        const Eigen::Vector3d p = unproject(expected.sensor, u, v, double(a));
        worst_m = std::max(worst_m, (unproject(found.sensor, u, v, double(b)) - p).norm());
      }
    }
    EXPECT_LE(worst_m, quantum_m);
    ASSERT_EQ(back.views[i].color.has_value(), scene.views[i].color.has_value());
    if (!scene.views[i].color) continue;
    const ColorImage color = load_color(back.views[i]);
    for (std::size_t k = 0; k < color.size(); ++k) {
      if (!(expected.range.pixels[k] > 0)) continue;
      ASSERT_EQ(color.pixels[k], scene.views[i].color->memory->pixels[k]) << k;
    }
  }
}

}  // namespace lapseam::test
