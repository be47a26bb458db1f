// What a format rounds is all that it changes of the mesh that is integrated from it.

#include "lapseam/integrate.h"
#include "room_scene.h"
#include "spatial/ray_scene.h"

namespace lapseam::test {
namespace {

Mesh integrated(const Scene& scene) {
  Context context(2);
  IntegrateOptions options;
  options.color = ColorOutput::kNone;
  options.reduce_sigma = 0;  // which vertices go may hang on the last digit
  return integrate(scene, options, context).mesh;
}

/// How far the share `q` of a mesh's vertices is from the other's surface at most.
double distance_m(const Mesh& mesh, const Mesh& other, double q) {
  Context context(1);
  const RayScene surface(other.positions_m, other.triangles, context);
  const Eigen::Vector3d shift = mesh.origin_m - other.origin_m;
  std::vector<double> distances_m;
  for (const Eigen::Vector3f& p : mesh.positions_m)
    distances_m.push_back(double(surface.closest((p.cast<double>() + shift).cast<float>()).distance));
  std::sort(distances_m.begin(), distances_m.end());
  return distances_m.at(std::size_t(q * double(distances_m.size() - 1)));
}

struct Case {
  SceneFormat format;
  const char* name;
  double quantum_m;
};

std::string name_of(const testing::TestParamInfo<Case>& info) {
  const std::string name = info.param.name;
  return name.starts_with("a.") ? name.substr(2) : name;
}

class SameMesh : public testing::TestWithParam<Case> {};

TEST_P(SameMesh, WithinTheQuantum) {
  const TempFolder folder;
  Context context(2);
  Scene scene = room_scene(lens_camera(), 4, false);
  for (ViewSource& view : scene.views) view.noise = NoiseModel{.s0_m = 0.001};
  const auto& [format, name, quantum_m] = GetParam();
  convert_scene(scene, folder / name, {.format = format}, context);
  Scene back = read_scene(folder / name, {}, context);
  for (ViewSource& view : back.views) view.noise = NoiseModel{.s0_m = 0.001};
  const Mesh expected = integrated(scene), found = integrated(back);
  ASSERT_GT(expected.triangles.size(), 1000u);
  // Which triangles stand at a border, and which of two diagonals, may hang on the last digit; not where the surface
  // is.
  EXPECT_LE(distance_m(found, expected, 0.99), quantum_m);
  EXPECT_LE(distance_m(expected, found, 0.99), quantum_m);
}

INSTANTIATE_TEST_SUITE_P(Formats, SameMesh,
                         testing::Values(Case{SceneFormat::kManifest, "scene", 1e-7},
                                         Case{SceneFormat::kE57, "a.e57", 1e-6}, Case{SceneFormat::kPtx, "a.ptx", 2e-6},
                                         Case{SceneFormat::kPcd, "pcd", 2e-6}, Case{SceneFormat::kTum, "tum", 2e-4},
                                         Case{SceneFormat::kRedwood, "redwood", 1e-3},
                                         Case{SceneFormat::kNerfstudio, "nerfstudio", 1e-3}),
                         name_of);

}  // namespace
}  // namespace lapseam::test
