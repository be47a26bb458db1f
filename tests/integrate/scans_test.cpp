// The real scans of LAPSEAM_DATA (default ../shared/data, from the project's folder); skipped where they are missing.

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "lapseam/context.h"
#include "lapseam/integrate.h"
#include "lapseam/io.h"
#include "spatial/ray_scene.h"
#include "support/expect_valid_mesh.h"

namespace lapseam {
namespace {

std::filesystem::path data_folder() {
  const char* folder = std::getenv("LAPSEAM_DATA");
  return folder ? folder : "../shared/data";
}

#define SKIP_WITHOUT(path) \
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "no " << (path).string() << "; set LAPSEAM_DATA"

TEST(Scans, BunnyIsWhole) {
  const auto file = data_folder() / "bunny/bun.conf";
  SKIP_WITHOUT(file);
  Context context(2);
  const Scene scene = read_scene(file, {}, context);
  const IntegrateResult result = integrate(scene, {.check_self_intersections = true}, context);
  expect_valid_mesh(result.mesh);
  EXPECT_GE(result.report.health.largest_component_share, 0.98);

  // Of the reference's vertices, those that some scan measured: a sample within half a sample spacing's reach (0.5 mm).
  const Mesh reference = read_mesh(data_folder() / "bunny/bun_zipper.ply");
  Mesh samples;
  for (const ViewSource& source : scene.views) {
    const View view = load_view(source);
    for (int v = 0; v < view.range.height; ++v)
      for (int u = 0; u < view.range.width; ++u)
        if (view.range.at(u, v) > 0) {
          const Eigen::Vector3d p = view.T_world_view * unproject(view.sensor, u, v, double(view.range.at(u, v)));
          const auto i = std::uint32_t(samples.vertex_count());
          samples.positions_m.push_back(p.cast<float>());
          samples.triangles.push_back({i, i, i});
        }
  }
  const RayScene sample_points(samples.positions_m, samples.triangles, context);
  const RayScene surface(result.mesh.positions_m, result.mesh.triangles, context);
  std::size_t measured = 0, near = 0;
  for (const Eigen::Vector3f& p : reference.positions_m) {
    if (sample_points.closest(p, 0.0007f).triangle == kInvalidIndex) continue;
    ++measured;
    near += surface.closest(p, 0.001f).triangle != kInvalidIndex;
  }
  EXPECT_GT(double(measured), 0.8 * double(reference.vertex_count()));
  EXPECT_GE(double(near), 0.999 * double(measured));
}

TEST(Scans, DragonIsWhole) {
  const auto file = data_folder() / "dragon/dragonStandRight.conf";
  SKIP_WITHOUT(file);
  Context context(2);
  const IntegrateResult result = integrate(read_scene(file, {}, context), {}, context);
  expect_valid_mesh(result.mesh);
  // Fifteen scans at one height: what they see only between the legs stays apart.
  EXPECT_GE(result.report.health.largest_component_share, 0.9);
}

TEST(Scans, KitchenFramesMakeOneMesh) {
  const auto folder = data_folder() / "redkitchen";
  SKIP_WITHOUT(folder);
  Context context(2);
  Scene scene = read_scene(folder, {}, context);
  scene.views.resize(8);  // enough to cross the paths of drift, few enough for a test
  const IntegrateResult result = integrate(scene, {}, context);
  expect_valid_mesh(result.mesh);
  EXPECT_GT(result.mesh.triangle_count(), 100'000u);
  EXPECT_GT(result.report.triangles_before_reduction, 200'000u);
  EXPECT_GT(result.report.texture.pages, 0u);
}

}  // namespace
}  // namespace lapseam
