#pragma once

#include <cstdint>
#include <vector>

#include "core/parallel.h"
#include "sew_meshes/live_mesh.h"

namespace lapseam {

/// Living triangles of which `is_one` holds, in rising order. is_one must be thread-safe.
template <typename IsOne>
std::vector<std::uint32_t> living_triangles(const LiveMesh& mesh, Context& context, const IsOne& is_one) {
  constexpr std::size_t kAtOnce = 4096;
  std::vector<std::uint8_t> is_chosen(mesh.triangle_count(), 0);
  parallel_for(context, is_chosen.size(), kAtOnce,
               [&](std::size_t t) { is_chosen[t] = mesh.is_alive(std::uint32_t(t)) && is_one(std::uint32_t(t)); });
  std::vector<std::uint32_t> chosen;
  for (std::uint32_t t = 0; t < is_chosen.size(); ++t)
    if (is_chosen[t]) chosen.push_back(t);
  return chosen;
}

}  // namespace lapseam
