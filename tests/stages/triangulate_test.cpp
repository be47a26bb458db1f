#include "lapseam/triangulate.h"

#include <gtest/gtest.h>

#include "lapseam/context.h"
#include "support/analytic_views.h"

namespace lapseam {
namespace {

constexpr NoiseModel kNoise{0.001, 0, 0, 0};

PatchGrid triangulate_view(const View& view, const NoiseModel& noise = kNoise) {
  Context context(2);
  return triangulate(view, *make_ray_table(view.sensor, context), make_step_threshold(view.sensor, noise), context);
}

// Ranges of a 2×2 image seen by a camera whose samples are 1 cm apart at 1 m: 0.5 m is a step, nothing is no sample.
View four_samples(float r00, float r10, float r01, float r11) {
  View view{"four", "test", PinholeSensor{2, 2, 100, 100, 0.5, 0.5, {}}, RangeImage(2, 2),
            Eigen::Isometry3d::Identity()};
  view.range.pixels = {r00, r10, r01, r11};
  return view;
}

TEST(Triangulate, PlaneIsCoveredByTwoTrianglesPerCell) {
  const View view = test::make_view("plane", test::small_camera(), Eigen::Isometry3d::Identity(),
                                    test::plane({0, 0, 2}, Eigen::Vector3d(0.3, 0.2, 1).normalized()));
  EXPECT_EQ(triangulate_view(view).triangle_count(), 119u * 119u * 2u);
}

TEST(Triangulate, GrazingPlaneIsOneSurface) {
  // 82° from frontal: neighbours in a column differ by far more than their spacing, but in line with one another.
  const double angle = 82 * M_PI / 180;
  const View view = test::make_view("grazing", test::small_camera(100, 3000), Eigen::Isometry3d::Identity(),
                                    test::plane({0, 0, 2}, {0, std::sin(angle), std::cos(angle)}));
  EXPECT_EQ(triangulate_view(view).triangle_count(), 99u * 99u * 2u);
}

TEST(Triangulate, SixConfigurations) {
  EXPECT_EQ(triangulate_view(four_samples(1, 1, 1, 1)).triangle_count(), 2u);
  // The farther corner makes its diagonal longer, so the other one splits the cell.
  EXPECT_EQ(triangulate_view(four_samples(1.01f, 1, 1, 1)).cells[0] & PatchGrid::kAntiDiagonal,
            PatchGrid::kAntiDiagonal);
  EXPECT_EQ(triangulate_view(four_samples(1, 1.01f, 1, 1)).cells[0] & PatchGrid::kAntiDiagonal, 0);
  // Exactly three on one surface, or valid: one triangle that leaves the fourth out.
  for (int missing = 0; missing < 4; ++missing)
    for (const float other : {kInvalidRange, 1.5f}) {
      std::array<float, 4> r = {1, 1, 1, 1};
      r[std::size_t(missing)] = other;
      const PatchGrid grid = triangulate_view(four_samples(r[0], r[1], r[2], r[3]));
      ASSERT_EQ(grid.triangle_count(), 1u) << missing;
      for (const std::uint32_t corner : grid.corners(0, grid.exists(0, 0) ? 0 : 1)) EXPECT_NE(int(corner), missing);
    }
  EXPECT_EQ(triangulate_view(four_samples(1, 1, 1.5f, 1.5f)).triangle_count(), 0u);
  EXPECT_EQ(triangulate_view(four_samples(1, 0, 0, 1)).triangle_count(), 0u);
}

TEST(Triangulate, StepIsNotBridged) {
  const View view =
      test::make_view("step", test::small_camera(), Eigen::Isometry3d::Identity(),
                      test::nearest({test::rectangle(1.5, -0.3, 0.2, -0.3, 0.2), test::plane({0, 0, 2}, {0, 0, 1})}));
  const PatchGrid grid = triangulate_view(view);
  for (std::size_t cell = 0; cell < grid.cells.size(); ++cell)
    for (int slot = 0; slot < 2; ++slot)
      if (grid.exists(cell, slot)) {
        const auto c = grid.corners(cell, slot);
        EXPECT_NEAR(view.range.pixels[c[0]], view.range.pixels[c[1]], 0.1);
        EXPECT_NEAR(view.range.pixels[c[0]], view.range.pixels[c[2]], 0.1);
      }
  EXPECT_GT(grid.triangle_count(), 100u * 100u * 2u);
}

TEST(Triangulate, NoiseDoesNotTearAPlane) {
  const double sigma = 0.02;
  const View view = test::make_view("noisy", test::small_camera(), Eigen::Isometry3d::Identity(),
                                    test::plane({0, 0, 3}, {0, 0, 1}), sigma);
  const double share = double(triangulate_view(view, {sigma, 0, 0, 0}).triangle_count()) / (119.0 * 119.0 * 2.0);
  EXPECT_GT(share, 0.99);
}

// Every triangle must turn its front to the sensor, whatever the sensor's handedness.
TEST(Triangulate, TrianglesFaceTheSensor) {
  const std::vector<Sensor> sensors = {test::small_camera(40, 40), OrthographicSensor{40, 40, 0.01, 0.01, 19.5, 19.5},
                                       SphericalSensor::from_limits(90, 40, -M_PI, M_PI, 1.2, -1.2),
                                       SphericalSensor::from_limits(90, 40, M_PI, -M_PI, 1.2, -1.2),
                                       SphericalSensor::from_limits(60, 40, -1, 1, -0.8, 0.8)};
  for (const Sensor& sensor : sensors) {
    const View view =
        test::make_view("s", sensor, Eigen::Isometry3d::Identity(), test::box_room({-1, -2, -1.5}, {2, 1, 1.2}));
    Context context(2);
    const auto rays = make_ray_table(sensor, context);
    const PatchGrid grid = triangulate_view(view);
    ASSERT_GT(grid.triangle_count(), 1000u);
    for (std::size_t cell = 0; cell < grid.cells.size(); ++cell)
      for (int slot = 0; slot < 2; ++slot)
        if (grid.exists(cell, slot)) {
          const auto c = grid.corners(cell, slot);
          std::array<Eigen::Vector3f, 3> p;
          for (std::size_t k = 0; k < 3; ++k) p[k] = rays->point(c[k], view.range.pixels[c[k]]);
          const Eigen::Vector3f normal = (p[1] - p[0]).cross(p[2] - p[0]);
          ASSERT_LT(normal.dot(rays->directions[c[0]]), 0) << kind_name(sensor);
        }
  }
}

TEST(Triangulate, PanoramaClosesOnItself) {
  const Sensor sensor = SphericalSensor::from_limits(90, 30, -M_PI, M_PI, 0.8, -0.8);
  const View view = test::make_view("pano", sensor, Eigen::Isometry3d::Identity(), test::sphere({0, 0, 0}, 2));
  EXPECT_EQ(triangulate_view(view).triangle_count(), 90u * 29u * 2u);
}

}  // namespace
}  // namespace lapseam
