#include <gtest/gtest.h>

#include <array>
#include <map>
#include <set>

#include "lapseam/error.h"
#include "simulate/coverage.h"
#include "simulate/free_space.h"
#include "simulate/mesh_builder.h"
#include "simulate/pattern.h"
#include "support.h"

namespace lapseam {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

double signed_volume(const Mesh& mesh) {
  double volume = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const auto& p = mesh.positions_m;
    volume += p[a].cast<double>().dot(p[b].cast<double>().cross(p[c].cast<double>())) / 6;
  }
  return volume;
}

/// Open edges after vertices at the same place are made one: 0 for closed shapes.
std::size_t count_open_edges(const Mesh& mesh) {
  std::map<std::array<float, 3>, std::uint32_t> place;
  std::vector<std::uint32_t> at(mesh.vertex_count());
  for (std::size_t i = 0; i < at.size(); ++i) {
    const Vector3f& p = mesh.positions_m[i];
    at[i] = place.try_emplace({p.x(), p.y(), p.z()}, std::uint32_t(place.size())).first->second;
  }
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> directed;
  for (const Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) ++directed[{at[t[k]], at[t[(k + 1) % 3]]}];
  std::size_t open = 0;
  for (const auto& [edge, count] : directed) {
    const auto back = directed.find({edge.second, edge.first});
    if (count != 1 || back == directed.end() || back->second != 1) ++open;
  }
  return open;
}

TEST(MeshBuilder, SolidsAreClosedAndTurnOutward) {
  using simulation::MeshBuilder;
  constexpr double kPi = 3.14159265358979323846;
  const auto build = [](const auto& add) {
    MeshBuilder builder;
    // A frame that is neither at the origin nor upright.
    builder.set_frame(
        Eigen::Isometry3d(Eigen::Translation3d(3, -2, 1) * Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized())));
    builder.use({});
    add(builder);
    return builder.finish("solid").mesh;
  };
  struct Solid {
    const char* name;
    Mesh mesh;
    double volume;
    double tolerance;  // relative; what tessellation leaves out
  };
  const std::array<Eigen::Vector2d, 4> cone{{{0, 0}, {0.5, 0}, {0.25, 1}, {0, 1}}};
  const std::array<Vector3d, 3> bent{Vector3d(0, 0, 0), Vector3d(1, 0, 0), Vector3d(2, 0.5, 0.3)};
  const std::array<Eigen::Vector2d, 3> line{{{0, 0}, {1, 0}, {2, 0}}};
  const Solid solids[] = {
      {"box", build([](auto& b) {
         b.add_box({0, 0, 0}, {1, 2, 3});
       }),
       6, 1e-5},
      {"torus", build([](auto& b) {
         b.add_torus({0, 0, 0}, 1, 0.25, 128, 64);
       }),
       2 * kPi * kPi * 0.0625, 0.01},
      {"ellipsoid", build([](auto& b) {
         b.add_superellipsoid({0, 0, 0}, {1, 2, 0.5}, 1, 1, 128);
       }),
       4 * kPi / 3, 0.01},
      {"icosphere", build([](auto& b) { b.add_icosphere(1, 5); }), 4 * kPi / 3, 0.002},
      {"cone", build([&](auto& b) { b.add_revolution(cone, 256); }), kPi / 3 * (0.25 + 0.125 + 0.0625), 0.001},
      {"rod", build([](auto& b) {
         b.add_rod({0, 0, 0}, {0, 0, 2}, 0.01, 64);
       }),
       2 * kPi * 25e-6, 0.01},
      // A bent tube's rings stand across the bisector, which thins the legs a little.
      {"tube", build([&](auto& b) { b.add_tube(bent, 0.02, 64); }), kPi * 1e-4 * (1 + std::sqrt(1.34)), 0.1},
      {"curtain", build([&](auto& b) { b.add_curtain(line, 0.1, 0, 3); }), 0.6, 1e-4},
  };
  for (const Solid& solid : solids) {
    EXPECT_NEAR(signed_volume(solid.mesh) / solid.volume, 1, solid.tolerance) << solid.name;
    // The curtain's narrow sides are not divided as its faces are.
    if (std::string(solid.name) == "curtain") continue;
    EXPECT_EQ(count_open_edges(solid.mesh), 0u) << solid.name;
  }
}

TEST(Pattern, EachHasContrastAndStaysInRange) {
  for (int kind = 0; kind <= int(Pattern::kSpine); ++kind) {
    Material material;
    material.pattern = Pattern(kind);
    material.color_a = Vector3f(0.8f, 0.7f, 0.6f);
    material.color_b = Vector3f(0.1f, 0.15f, 0.3f);
    material.scale_m = 0.2f;
    float low = 2, high = -1;
    for (int i = 0; i < 4000; ++i) {
      const Vector3f p(0.013f * float(i % 63), 0.5f, 0.017f * float(i / 63));
      const Vector3f color = simulation::albedo(material, p, Vector3f::UnitY());
      ASSERT_TRUE(color.allFinite());
      low = std::min(low, color.minCoeff()), high = std::max(high, color.maxCoeff());
    }
    EXPECT_GE(low, 0) << kind;
    EXPECT_LE(high, 1.25f) << kind;
    EXPECT_GT(high, low * 1.05f) << kind;
  }
}

class Room : public testing::TestWithParam<std::uint64_t> {};

TEST_P(Room, HasOnlyTrianglesWithAreaInsideItsWalls) {
  const RoomOptions options{.width_m = 6, .depth_m = 5, .height_m = 2.8, .seed = GetParam()};
  const SimulatedScene room = make_room(options);
  check_mesh(room.mesh);
  ASSERT_EQ(room.triangle_material.size(), room.mesh.triangle_count());
  const auto& p = room.mesh.positions_m;
  for (const auto& [a, b, c] : room.mesh.triangles) EXPECT_GT((p[b] - p[a]).cross(p[c] - p[a]).norm(), 0);
  for (const Vector3f& q : p) {
    // The window's recess is the only thing outside the box, by 22 cm.
    EXPECT_TRUE(q.x() >= -0.0601f && q.x() <= 6.0001f && q.y() >= -1e-4f && q.y() <= 5.2201f && q.z() >= -1e-4f &&
                q.z() <= 2.8001f)
        << q.transpose();
  }
  std::set<Pattern> patterns;
  for (const std::uint32_t m : room.triangle_material) patterns.insert(room.materials[m].pattern);
  EXPECT_EQ(patterns.size(), 12u);
}

/// From anywhere in free space, in any direction, one sees fronts.
TEST_P(Room, ShowsNoBackFacesToFreeSpace) {
  Context context;
  const SimulatedScene room = make_room({.seed = GetParam()});
  const RayScene rays(room.mesh.positions_m, room.mesh.triangles, context);
  const simulation::FreeSpace space(rays, Eigen::AlignedBox3f(Vector3f(0.3f, 0.3f, 0.3f), Vector3f(5.7f, 4.7f, 2.5f)),
                                    0.2f, context);
  ASSERT_GT(space.cells().size(), 5000u);
  std::size_t cast = 0, missed = 0, back = 0;
  for (std::size_t i = 0; i < space.cells().size(); i += 40) {
    const Vector3f eye = space.center(space.cells()[i]);
    for (int k = 0; k < 200; ++k) {
      const float z = -1 + 2 * (float(k) + 0.5f) / 200, angle = 2.399963f * float(k) + 0.37f * float(i);
      const float ring = std::sqrt(1 - z * z);
      const Vector3f d(ring * std::cos(angle), ring * std::sin(angle), z);
      const RayHit hit = rays.cast(eye, d);
      ++cast;
      if (!hit) {
        ++missed;
        continue;
      }
      const auto& [a, b, c] = room.mesh.triangles[hit.triangle];
      const auto& p = room.mesh.positions_m;
      if ((p[b] - p[a]).cross(p[c] - p[a]).dot(d) > 0) ++back;
    }
  }
  EXPECT_EQ(missed, 0u) << "of " << cast;
  EXPECT_EQ(back, 0u) << "of " << cast;
}

/// The thin parts are there: rods whose two sides are 5 and 10 mm apart, and a panel of 15 mm.
TEST_P(Room, HoldsThinParts) {
  Context context;
  const SimulatedScene room = make_room({.seed = GetParam()});
  const RayScene rays(room.mesh.positions_m, room.mesh.triangles, context);
  std::map<int, std::size_t> thickness_mm;
  const auto samples = simulation::sample_surface(room.mesh, 400000, 5);
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    const Vector3f inward = -samples.normals[i];
    const RayHit hit = rays.cast(samples.points[i] + 1e-4f * inward, inward, 0, 0.05f);
    if (hit) ++thickness_mm[int(std::lround((hit.t + 1e-4f) * 1000))];
  }
  for (const int mm : {5, 10, 15}) EXPECT_GT(thickness_mm[mm], 50u) << mm << " mm";
}

TEST_P(Room, FollowsFromItsSeed) {
  const SimulatedScene a = make_room({.seed = GetParam()}), b = make_room({.seed = GetParam()});
  const SimulatedScene other = make_room({.seed = GetParam() + 100});
  EXPECT_EQ(a.mesh.positions_m, b.mesh.positions_m);
  EXPECT_EQ(a.mesh.triangles, b.mesh.triangles);
  EXPECT_NE(a.mesh.positions_m, other.mesh.positions_m);
}

INSTANTIATE_TEST_SUITE_P(Seeds, Room, testing::Values(1, 2, 3));

TEST(RoomOptions, SizesFromSmallToHall) {
  for (const auto& [w, d, h] : {std::array{4.5, 4.0, 2.4}, std::array{9.0, 7.0, 3.0}, std::array{20.0, 12.0, 4.0}}) {
    const SimulatedScene room = make_room({.width_m = w, .depth_m = d, .height_m = h, .seed = 4});
    Eigen::AlignedBox3f box;
    for (const Vector3f& p : room.mesh.positions_m) box.extend(p);
    EXPECT_NEAR(double(box.sizes().x()), w, 0.061);
    EXPECT_NEAR(double(box.sizes().y()), d, 0.221);
    EXPECT_NEAR(double(box.sizes().z()), h, 1e-4);
  }
  EXPECT_THROW(make_room({.width_m = 2}), InvalidInput);
  EXPECT_THROW(make_room({.height_m = std::nan("")}), InvalidInput);
  EXPECT_THROW(make_room({.depth_m = 100}), InvalidInput);
}

TEST(Scenes, PartitionAndDoorLeafAreSeenFromBothSides) {
  Context context;
  const SimulatedScene scene = make_partition_scene(0.015);
  SensorRig rig = make_rgbd_rig(80, 60);
  rig.effects = scaled(rig.effects, 0);
  rig.color.reset();
  const auto plan = make_trajectory(scene, rig, {.kind = Trajectory::kWalk, .views = 24}, context);
  const Simulator simulator(scene, 1, context, false);
  // The partition stands at x = 2; the leaf's frame is at its hinge, x along it.
  const Eigen::Isometry3d T_leaf_world =
      (Eigen::Translation3d(0.06, 3.2, 0) * Eigen::AngleAxisd(-0.7, Vector3d::UnitZ())).inverse();
  std::array<int, 2> partition{}, leaf{};
  for (std::uint32_t i = 0; i < plan.size(); ++i) {
    const SimulatedView view = simulator.simulate(plan[i], i, rig.effects, context);
    for (int v = 0; v < 60; ++v)
      for (int u = 0; u < 80; ++u) {
        const auto r = double(view.true_range.at(u, v));
        if (!(r > 0)) continue;
        const Vector3d p = view.T_world_view_true * unproject(view.view.sensor, u, v, r);
        const Vector3d q = T_leaf_world * p;
        if (std::abs(p.y() - 2) < 0.9 && p.z() > 0.1 && p.z() < 1.6 && std::abs(p.x() - 2) < 0.009)
          ++partition[p.x() > 2];
        if (q.x() > 0.1 && q.x() < 0.8 && q.z() > 0.1 && q.z() < 1.9 && std::abs(q.y() - 0.02) < 0.021)
          ++leaf[q.y() > 0.02];
      }
  }
  for (const int side : {0, 1}) {
    EXPECT_GT(partition[std::size_t(side)], 500);
    EXPECT_GT(leaf[std::size_t(side)], 50);
  }
}

TEST(Scenes, RefuseNonsense) {
  EXPECT_THROW(make_sphere_scene(0), InvalidInput);
  EXPECT_THROW(make_box_scene({1, -1, 1}), InvalidInput);
  EXPECT_THROW(make_partition_scene(2), InvalidInput);
  EXPECT_THROW(make_mesh_scene({}, "empty"), InvalidInput);
}

}  // namespace
}  // namespace lapseam
