// What a user of the library would write first: two views in memory, integrated, written, and read again.

#include <lapseam/lapseam.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>

namespace {

/// A camera at (x, 0, 0) that looks along z at the wave z = 2 + 0.1 sin(4 x).
lapseam::ViewSource see_wave(const std::string& name, const lapseam::PinholeSensor& camera, double x_m) {
  auto range = std::make_shared<lapseam::RangeImage>(camera.width, camera.height);
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      double z = 2;
      for (int i = 0; i < 50; ++i) z = 2 + 0.1 * std::sin(4 * (x_m + (u - camera.cx) / camera.fx * z));
      range->at(u, v) = float(z);
    }
  }
  lapseam::ViewSource view;
  view.name = name;
  view.sensor = camera;
  view.sensor_id = "camera";
  view.T_world_view.translation() = Eigen::Vector3d(x_m, 0, 0);
  view.range.format = lapseam::RangeFormat::kMemory;
  view.range.memory = range;
  return view;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  try {
    const lapseam::PinholeSensor camera{.width = 64, .height = 48, .fx = 60, .fy = 60, .cx = 31.5, .cy = 23.5};
    lapseam::Scene scene;
    scene.views = {see_wave("left", camera, -0.3), see_wave("right", camera, 0.3)};

    lapseam::Context context;
    const lapseam::IntegrateResult result = lapseam::integrate(scene, {.color = lapseam::ColorOutput::kNone}, context);
    const std::filesystem::path file = std::filesystem::path(argv[1]) / "wave.ply";
    lapseam::write_mesh(result.mesh, file);
    const lapseam::Mesh mesh = lapseam::read_mesh(file);
    lapseam::check_mesh(mesh);
    if (mesh.triangles != result.mesh.triangles) return 1;
    std::printf("lapseam %s: %zu triangles\n", lapseam::kVersion, mesh.triangle_count());
  } catch (const lapseam::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
