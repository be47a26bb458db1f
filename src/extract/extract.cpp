#include "lapseam/extract.h"

#include <cmath>

#include "core/parallel.h"

namespace lapseam {
namespace {

// Floats hold a millimetre's hundredth up to here; scenes farther out get an origin of their own.
constexpr double kFarFromOrigin_m = 100.0;

struct PatchExtent {
  std::vector<std::uint32_t> vertex_of_pixel;
  std::uint32_t vertex_count = 0, triangle_count = 0;
  std::uint32_t first_vertex = 0, first_triangle = 0;
  std::vector<BoundaryEdge> active;
};

void number_samples(const Patch& patch, PatchExtent& extent) {
  extent.vertex_of_pixel.assign(patch.grid.cells.size(), kInvalidIndex);
  for (std::size_t cell = 0; cell < patch.grid.cells.size(); ++cell)
    for (int slot = 0; slot < 2; ++slot)
      if (patch.grid.is_alive(cell, slot)) {
        ++extent.triangle_count;
        for (const std::uint32_t p : patch.grid.corners(cell, slot)) extent.vertex_of_pixel[p] = 0;
      }
  for (std::uint32_t& v : extent.vertex_of_pixel)
    if (v != kInvalidIndex) v = extent.vertex_count++;
}

Eigen::Vector3d choose_origin(std::span<const Patch> patches) {
  for (const Patch& patch : patches) {
    const Eigen::Vector3d t = patch.view.T_world_view.translation();
    if (t.norm() > kFarFromOrigin_m) return {std::round(t.x()), std::round(t.y()), std::round(t.z())};
  }
  return Eigen::Vector3d::Zero();
}

void fill_patch(const Patch& patch, std::uint32_t view, PatchExtent& extent, Mesh& mesh) {
  const Eigen::Isometry3d& T = patch.view.T_world_view;
  for (std::size_t pixel = 0; pixel < extent.vertex_of_pixel.size(); ++pixel) {
    if (extent.vertex_of_pixel[pixel] == kInvalidIndex) continue;
    const std::size_t i = extent.first_vertex + extent.vertex_of_pixel[pixel];
    mesh.positions_m[i] = (T * patch.point_in_view(pixel).cast<double>() - mesh.origin_m).cast<float>();
    mesh.vertex_view[i] = view;
    mesh.vertex_pixel[i] = std::uint32_t(pixel);
  }
  std::uint32_t triangle = extent.first_triangle;
  for (std::size_t cell = 0; cell < patch.grid.cells.size(); ++cell)
    for (int slot = 0; slot < 2; ++slot) {
      if (!patch.grid.is_alive(cell, slot)) continue;
      const auto corners = patch.grid.corners(cell, slot);
      Triangle& t = mesh.triangles[triangle];
      for (std::size_t k = 0; k < 3; ++k) t[k] = extent.first_vertex + extent.vertex_of_pixel[corners[k]];
      mesh.triangle_view[triangle] = view;
      for (std::size_t k = 0; k < 3; ++k) {
        const auto neighbor = patch.grid.neighbor_across(cell, slot, corners[k], corners[(k + 1) % 3]);
        if (neighbor && patch.grid.exists(neighbor->cell, neighbor->slot) &&
            !patch.grid.is_alive(neighbor->cell, neighbor->slot))
          extent.active.push_back({t[k], t[(k + 1) % 3], triangle});
      }
      ++triangle;
    }
}

}  // namespace

ExtractedMesh extract(std::span<const Patch> patches, Context& context) {
  std::vector<PatchExtent> extents(patches.size());
  parallel_for(context, patches.size(), 1, [&](std::size_t i) { number_samples(patches[i], extents[i]); });
  std::uint32_t vertices = 0, triangles = 0;
  for (PatchExtent& extent : extents) {
    extent.first_vertex = vertices;
    extent.first_triangle = triangles;
    vertices += extent.vertex_count;
    triangles += extent.triangle_count;
  }
  ExtractedMesh out;
  out.mesh.origin_m = choose_origin(patches);
  out.mesh.positions_m.resize(vertices);
  out.mesh.vertex_view.resize(vertices);
  out.mesh.vertex_pixel.resize(vertices);
  out.mesh.triangles.resize(triangles);
  out.mesh.triangle_view.resize(triangles);
  out.mesh.triangle_tag.assign(triangles, TriangleTag::kMeasured);
  parallel_for(context, patches.size(), 1,
               [&](std::size_t i) { fill_patch(patches[i], std::uint32_t(i), extents[i], out.mesh); });
  for (const PatchExtent& extent : extents)
    out.active_edges.insert(out.active_edges.end(), extent.active.begin(), extent.active.end());
  return out;
}

}  // namespace lapseam
