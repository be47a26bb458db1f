#pragma once

// Points spread over a surface, and random numbers that depend on nothing but their place.

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/mesh.h"

namespace lapseam {

class Context;

/// SplitMix64's mixing step (Steele, Lea & Flood 2014): a good hash of 64 bits.
inline std::uint64_t mix_bits(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15ull;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ull;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBull;
  return x ^ (x >> 31);
}
/// The index-th random word of a stream.
inline std::uint64_t random_bits(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
  return mix_bits(mix_bits(mix_bits(seed) ^ stream) ^ index);
}
/// In [0, 1).
inline double random_unit(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
  return double(random_bits(seed, stream, index) >> 11) * 0x1p-53;
}

/// A triangle surface without the rest of a mesh.
struct Surface {
  std::vector<Eigen::Vector3f> positions_m;
  std::vector<Triangle> triangles;
  std::vector<Eigen::Vector3f> normals;  ///< unit length; zero for triangles without area
};
void compute_normals(Surface& surface, Context& context);
/// The welded mesh relative to origin_m, without triangles of no area: they have no normal to tell, and their edges are
/// those of others.
Surface make_surface(const Mesh& mesh, const Eigen::Vector3d& origin_m, Context& context);

struct SurfaceSamples {
  std::vector<Eigen::Vector3f> positions_m;
  std::vector<std::uint32_t> triangle;
};
/// count points, evenly by area: one in each count-th part of it, at random there. Empty when there is no area.
SurfaceSamples sample_surface(const Surface& surface, std::size_t count, std::uint64_t seed, std::uint64_t stream,
                              Context& context);

}  // namespace lapseam
