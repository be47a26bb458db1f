// reduce_with_meshoptimizer IN OUT TRIANGLES: the simplifier of meshoptimizer, to compare `lapseam reduce` with.
// Prints the seconds that it takes without files. See docs/reduction.md.

#include <fmt/format.h>
#include <meshoptimizer.h>

#include <chrono>
#include <cstdlib>

#include "lapseam/error.h"
#include "lapseam/io.h"

namespace {

lapseam::Mesh simplify(const lapseam::Mesh& mesh, std::size_t triangles) {
  lapseam::Mesh out;
  out.origin_m = mesh.origin_m;
  out.positions_m = mesh.positions_m;
  std::vector<unsigned> indices(3 * mesh.triangle_count());
  const std::size_t left =
      meshopt_simplify(indices.data(), mesh.triangles.front().data(), indices.size(), mesh.positions_m.front().data(),
                       mesh.vertex_count(), sizeof(Eigen::Vector3f), 3 * triangles, 1.f, 0, nullptr);
  for (std::size_t i = 0; i < left; i += 3) out.triangles.push_back({indices[i], indices[i + 1], indices[i + 2]});
  return lapseam::compact(out, std::vector<std::uint8_t>(out.triangle_count(), 1));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    fmt::print(stderr, "usage: reduce_with_meshoptimizer IN OUT TRIANGLES\n");
    return 2;
  }
  try {
    const lapseam::Mesh mesh = lapseam::read_mesh(argv[1]);
    if (mesh.triangles.empty()) throw lapseam::InvalidInput(argv[1], {}, "faces", "there are none");
    const auto start = std::chrono::steady_clock::now();
    const lapseam::Mesh out = simplify(mesh, std::size_t(std::strtoull(argv[3], nullptr, 10)));
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    lapseam::write_mesh(out, argv[2]);
    fmt::print("{}: {} triangles of {}, {:.2f} s\n", argv[2], out.triangle_count(), mesh.triangle_count(),
               seconds.count());
  } catch (const std::exception& error) {
    fmt::print(stderr, "reduce_with_meshoptimizer: error: {}\n", error.what());
    return 1;
  }
  return 0;
}
