// STL, binary: triangles and nothing else. Floats, and no word for an origin: coordinates are relative to the mesh's,
// which the free text of the header tells.

#include <Eigen/Geometry>
#include <cstdio>
#include <limits>

#include "io/mesh_formats.h"
#include "io/output_file.h"
#include "lapseam/error.h"

namespace lapseam {

void write_stl(const Mesh& mesh, const std::filesystem::path& file, const WriteMeshOptions&) {
  if (mesh.triangle_count() > std::numeric_limits<std::uint32_t>::max())
    throw InvalidInput(file, {}, {}, "an STL file holds no more than 2^32 - 1 triangles");
  char header[81] = {};
  const Eigen::Vector3d& o = mesh.origin_m;
  std::snprintf(header, sizeof header, "lapseam; metres; origin_m %.4f %.4f %.4f", o.x(), o.y(), o.z());
  OutputFile out(file);
  out.write(header, 80);
  out.put(std::uint32_t(mesh.triangle_count()));
  for (const Triangle& triangle : mesh.triangles) {
    const Eigen::Vector3f &a = mesh.positions_m[triangle[0]], &b = mesh.positions_m[triangle[1]],
                          &c = mesh.positions_m[triangle[2]];
    const Eigen::Vector3f normal = (b - a).cast<double>().cross((c - a).cast<double>()).normalized().cast<float>();
    for (const Eigen::Vector3f& vector : {normal, a, b, c}) out.write(vector.data(), 3 * sizeof(float));
    out.put(std::uint16_t(0));
  }
  out.commit();
}

}  // namespace lapseam
