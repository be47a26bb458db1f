// Small scenes for experiments, and scenes made of any mesh.

#include <algorithm>
#include <array>
#include <cmath>

#include "lapseam/error.h"
#include "lapseam/simulate.h"
#include "simulate/furniture.h"
#include "simulate/mesh_builder.h"

namespace lapseam {
namespace simulation {
namespace {

using Eigen::Vector3d;

/// A key light, a fill and a back light around a box, far enough to be even.
void add_studio_lights(SimulatedScene& scene) {
  Eigen::AlignedBox3f box;
  for (const auto& p : scene.mesh.positions_m) box.extend(p);
  const float size = std::max(box.diagonal().norm(), 1e-6f);
  const Eigen::Vector3f middle = scene.mesh.origin_m.cast<float>() + box.center();
  const std::array<Eigen::Vector3f, 4> directions{Eigen::Vector3f(0.6f, 0.5f, 0.8f), Eigen::Vector3f(-0.8f, 0.4f, 0.3f),
                                                  Eigen::Vector3f(0.1f, -0.9f, 0.5f),
                                                  Eigen::Vector3f(0.2f, 0.1f, -0.9f)};
  const std::array<float, 4> strengths{1.0f, 0.5f, 0.6f, 0.35f};
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const Eigen::Vector3f d = directions[i].normalized();
    const Eigen::Vector3f u = d.cross(Eigen::Vector3f(0.3f, 0.2f, 0.9f)).normalized() * (0.6f * size);
    const Eigen::Vector3f v = u.cross(d);  // so that u × v = −|u|² d, towards the middle
    scene.lights.push_back({middle + 3 * size * d, u, v, Eigen::Vector3f::Constant(strengths[i])});
  }
}

void add_bare_room(MeshBuilder& builder, double w, double d, double h, Dice& dice) {
  builder.set_frame(Frame::Identity());
  builder.use(make_material(Pattern::kTiles, 0xB7B0A3, 0x5E5A52, 0.33, dice));
  builder.add_quad({0, 0, 0}, {w, 0, 0}, {w, d, 0}, {0, d, 0});
  builder.use(make_material(Pattern::kPlain, 0xF0EEE8, 0xF0EEE8, 0.1, dice));
  builder.add_quad({0, 0, h}, {0, d, h}, {w, d, h}, {w, 0, h});
  const std::array<Vector3d, 4> corners{Vector3d(0, 0, 0), Vector3d(w, 0, 0), Vector3d(w, d, 0), Vector3d(0, d, 0)};
  constexpr std::array<Pattern, 4> kWalls{Pattern::kStripes, Pattern::kDots, Pattern::kChecker, Pattern::kMarble};
  const Vector3d up(0, 0, h);
  for (std::size_t i = 0; i < 4; ++i) {
    builder.use(make_material(kWalls[i], 0xCBBFA6, 0x9FAFB5, 0.25, dice));
    const Vector3d &a = corners[i], &b = corners[(i + 1) % 4];
    builder.add_quad(b, a, a + up, b + up);
  }
}

/// What is thin and seen from both sides beside the partition: a door leaf of 40 mm, ajar, and a book that stands open,
/// with boards of 3 mm.
void add_leaf_and_book(MeshBuilder& builder, Dice& dice) {
  builder.set_frame(standing_at(0.06, 3.2, -0.7));
  builder.use(make_material(Pattern::kWood, 0xC7A27A, 0x94683F, 0.2, dice));
  builder.add_box({0, 0, 0.01}, {0.85, 0.04, 2.0});
  builder.use(make_material(Pattern::kPlain, 0x943126, 0x943126, 0.1, dice));
  constexpr double kBoard_m = 0.003;
  for (const double side : {-1.0, 1.0}) {
    builder.set_frame(standing_at(1.0, 1.0, 0.5 * side));
    const double y = side * kBoard_m;  // outwards, so that the boards stay apart at the spine
    builder.add_box({0.004, std::min(0.0, y), 0.0005}, {0.17, std::max(0.0, y), 0.24});
  }
}

}  // namespace
}  // namespace simulation

SimulatedScene make_sphere_scene(double radius_m) {
  using namespace simulation;
  if (!(radius_m > 0)) throw InvalidInput({}, {}, "radius", "must be positive");
  Dice dice(1, Stream::kRoom);
  MeshBuilder builder;
  builder.use(make_material(Pattern::kMarble, 0xC0392B, 0xF4ECD8, 0.5 * radius_m, dice));
  builder.add_icosphere(radius_m, 7);
  SimulatedScene scene = builder.finish("sphere");
  add_studio_lights(scene);
  return scene;
}

SimulatedScene make_box_scene(const Eigen::Vector3d& size_m) {
  using namespace simulation;
  if (!(size_m.minCoeff() > 0)) throw InvalidInput({}, {}, "box size", "must be positive");
  Dice dice(2, Stream::kRoom);
  MeshBuilder builder;
  builder.use(make_material(Pattern::kChecker, 0x2874A6, 0xF4ECD8, 0.125 * size_m.maxCoeff(), dice));
  builder.add_box(-0.5 * size_m, 0.5 * size_m);
  SimulatedScene scene = builder.finish("box");
  add_studio_lights(scene);
  return scene;
}

SimulatedScene make_partition_scene(double thickness_m) {
  using namespace simulation;
  if (!(thickness_m > 0 && thickness_m <= 0.5))
    throw InvalidInput({}, {}, "partition thickness", "must be over 0 and at most 0.5 m");
  constexpr double kWidth = 4, kDepth = 4, kHeight = 2.5;
  Dice dice(3, Stream::kRoom);
  MeshBuilder builder;
  add_bare_room(builder, kWidth, kDepth, kHeight, dice);
  add_partition(builder, standing_at(2.0, 2.0, 1.5707963267948966), 2.0, 1.7, thickness_m, dice);
  add_leaf_and_book(builder, dice);
  constexpr std::array<double, 6> kDiameters_m{0.003, 0.005, 0.008, 0.010, 0.015, 0.020};
  for (std::size_t i = 0; i < kDiameters_m.size(); ++i) {
    builder.set_frame(standing_at(3.0, 0.9 + 0.4 * double(i)));
    builder.use(make_material(Pattern::kPlain, i % 2 ? 0xB03A2E : 0x1F618D, 0x808080, 0.1, dice));
    builder.add_rod({0, 0, 0}, {0, 0, 2.0}, kDiameters_m[i], 16);
  }
  SimulatedScene scene = builder.finish("partition");
  scene.is_interior = true;
  for (const float x : {1.0f, 3.0f})
    scene.lights.push_back({{x, 2.0f, float(kHeight) - 0.02f}, {0.3f, 0, 0}, {0, -0.5f, 0}, {1.2f, 1.15f, 1.05f}});
  return scene;
}

SimulatedScene make_mesh_scene(Mesh mesh, std::string name) {
  check_mesh(mesh);
  if (mesh.triangles.empty()) throw InvalidInput({}, name, "triangles", "the mesh has none");
  SimulatedScene scene;
  scene.name = std::move(name);
  scene.mesh = std::move(mesh);
  simulation::add_studio_lights(scene);
  return scene;
}

}  // namespace lapseam
