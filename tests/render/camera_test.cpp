#include <gtest/gtest.h>

#include <numbers>

#include "lapseam/error.h"
#include "lapseam/render.h"

namespace lapseam {
namespace {

constexpr double kRight = std::numbers::pi / 2;

/// A box of these half sizes, all six sides facing outwards (or inwards, as a room).
Mesh box(const Eigen::Vector3f& half, bool is_room = false) {
  Mesh mesh;
  for (int corner = 0; corner < 8; ++corner)
    mesh.positions_m.emplace_back(corner & 1 ? half.x() : -half.x(), corner & 2 ? half.y() : -half.y(),
                                  corner & 4 ? half.z() : -half.z());
  const std::uint32_t sides[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                     {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
  for (const auto& s : sides) {
    mesh.triangles.push_back({s[0], s[1], s[2]});
    mesh.triangles.push_back({s[0], s[2], s[3]});
  }
  if (is_room)
    for (Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
  return mesh;
}

PixelRange project_world(const RenderCamera& camera, const Eigen::Vector3d& p) {
  const auto pixel = project(camera.sensor, camera.T_world_camera.inverse() * p);
  EXPECT_TRUE(pixel.has_value());
  return pixel.value_or(PixelRange{});
}

TEST(LookAtCamera, TargetIsInTheMiddleAndUpIsUp) {
  const RenderCamera camera = look_at_camera(
      {.eye_m = {1, 2, 3}, .target_m = {4, 2, 1}, .up = {0, 0, 1}, .fov_rad = kRight, .width = 101, .height = 51});
  const PixelRange middle = project_world(camera, {4, 2, 1});
  EXPECT_NEAR(middle.u, 50, 1e-9);
  EXPECT_NEAR(middle.v, 25, 1e-9);
  EXPECT_LT(project_world(camera, {4, 2, 1.1}).v, 25) << "higher is nearer to the top";
  EXPECT_LT(project_world(camera, {4, 2.1, 1}).u, 50) << "looking along +x with z up, +y is on the left";
  EXPECT_NEAR(camera.T_world_camera.linear().determinant(), 1, 1e-12);
  // 90 degrees: the upper edge of the picture is as far from the axis as the target plane from the eye.
  const auto& pinhole = std::get<PinholeSensor>(camera.sensor);
  EXPECT_NEAR(pinhole.fy, 25.5, 1e-9);
}

TEST(LookAtCamera, StraightDownIsAllowedAndNowhereIsNot) {
  const RenderCamera camera = look_at_camera({.eye_m = {0, 0, 5}, .target_m = {0, 0, 0}, .up = {0, 0, 1}});
  EXPECT_TRUE(camera.T_world_camera.matrix().allFinite());
  EXPECT_THROW(look_at_camera({.eye_m = {1, 1, 1}, .target_m = {1, 1, 1}}), InvalidInput);
  EXPECT_THROW(look_at_camera({.target_m = {1, 1, 1}, .fov_rad = 4}), InvalidInput);
  EXPECT_THROW(look_at_camera({.target_m = {1, 1, 1}, .width = 0}), InvalidInput);
}

TEST(OrbitCamera, AllIsInThePictureAndFillsIt) {
  Mesh mesh = box({1, 0.5f, 3});
  mesh.origin_m = {100000, 200000, -50};
  for (const double azimuth : {0.0, 0.7, 2.0, -3.0})
    for (const double elevation : {-1.2, 0.0, 0.3, kRight}) {
      const RenderCamera camera = orbit_camera(mesh, {.azimuth_rad = azimuth, .elevation_rad = elevation});
      double least_u = 1e9, most_u = -1e9, least_v = 1e9, most_v = -1e9;
      for (const Eigen::Vector3f& p : mesh.positions_m) {
        const PixelRange pixel = project_world(camera, mesh.origin_m + p.cast<double>());
        least_u = std::min(least_u, pixel.u), most_u = std::max(most_u, pixel.u);
        least_v = std::min(least_v, pixel.v), most_v = std::max(most_v, pixel.v);
      }
      EXPECT_GE(least_u, -0.5);
      EXPECT_LE(most_u, 1279.5);
      EXPECT_GE(least_v, -0.5);
      EXPECT_LE(most_v, 959.5);
      const double fill = std::max((most_u - least_u) / 1280, (most_v - least_v) / 960);
      EXPECT_GT(fill, 0.85) << "as near as it can be";
    }
}

TEST(OrbitCamera, AzimuthAndElevationAreWhereTheyShouldBe) {
  const Mesh mesh = box({1, 1, 1});
  const auto eye_at = [&](double azimuth, double elevation, const Eigen::Vector3d& up) {
    const RenderCamera camera = orbit_camera(mesh, {.azimuth_rad = azimuth, .elevation_rad = elevation, .up = up});
    return Eigen::Vector3d(camera.T_world_camera.translation().normalized());
  };
  EXPECT_LT((eye_at(0, 0, {0, 1, 0}) - Eigen::Vector3d::UnitZ()).norm(), 1e-6);
  EXPECT_LT((eye_at(kRight, 0, {0, 1, 0}) - Eigen::Vector3d::UnitX()).norm(), 1e-6);
  EXPECT_LT((eye_at(0, 0, {0, 0, 1}) + Eigen::Vector3d::UnitY()).norm(), 1e-6);
  EXPECT_LT((eye_at(0, kRight, {0, 0, 2}) - Eigen::Vector3d::UnitZ()).norm(), 1e-6);
  EXPECT_GT(eye_at(0.3, 0.5, {1, 0, 0}).x(), 0.4);
}

TEST(OrbitCamera, ZoomMagnifies) {
  const Mesh mesh = box({1, 1, 1});
  const auto near = std::get<PinholeSensor>(orbit_camera(mesh, {.zoom = 3}).sensor);
  const auto far = std::get<PinholeSensor>(orbit_camera(mesh, {}).sensor);
  EXPECT_NEAR(near.fx, 3 * far.fx, 1e-9);
  EXPECT_THROW(orbit_camera(mesh, {.zoom = 0}), InvalidInput);
  EXPECT_THROW(orbit_camera(Mesh{}, {}), InvalidInput);
}

TEST(GuessUp, FloorsDecideElseY) {
  EXPECT_EQ(guess_up(box({3, 2.5f, 1.4f}, true)), Eigen::Vector3d::UnitZ());
  EXPECT_EQ(guess_up(box({3, 1.4f, 2.5f})), Eigen::Vector3d::UnitY());
  // Only a floor, seen from above, in a camera's frame where y points down.
  Mesh floor;
  floor.positions_m = {{0, 1, 0}, {1, 1, 0}, {0, 1, 1}};
  floor.triangles = {{0, 1, 2}};
  EXPECT_EQ(guess_up(floor), Eigen::Vector3d(-Eigen::Vector3d::UnitY()));
  Mesh slope = floor;
  slope.positions_m[2] = {0, 2, 1};
  EXPECT_EQ(guess_up(slope), Eigen::Vector3d::UnitY());
}

}  // namespace
}  // namespace lapseam
