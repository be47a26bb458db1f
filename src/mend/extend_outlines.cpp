#include "mend/extend_outlines.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/parallel.h"
#include "mesh/outline_sizes.h"
#include "patch/by_view.h"
#include "sew/view_canvas.h"

namespace lapseam {
namespace {

constexpr float kFootprint_px = 0.5f;
constexpr float kLowestCosine = 0.3f;  // where a surface turns away from the view, half a spacing is far on it
constexpr int kLook_px = 3;            // mixed samples at a step are left out: what is beyond may begin later
constexpr float kStepFactor = 0.5f;    // tolerances off, to be something else: ranges are smooth

// Of each vertex at open edges, the way out: the sum over its open edges, as long as these. Not of slits.
std::vector<Eigen::Vector3f> find_ways_out(const Mesh& mesh, std::uint32_t shortest_outline, Context& context) {
  struct Side {
    std::uint64_t edge;
    std::uint32_t triangle, corner;
  };
  std::vector<Side> sides;
  sides.reserve(3 * mesh.triangle_count());
  for (std::uint32_t t = 0; t < mesh.triangle_count(); ++t)
    for (std::uint32_t k = 0; k < 3; ++k) {
      const std::uint64_t a = mesh.triangles[t][k], b = mesh.triangles[t][(k + 1) % 3];
      sides.push_back({std::min(a, b) << 32 | std::max(a, b), t, k});
    }
  parallel_sort(context, sides.begin(), sides.end(), [](const Side& a, const Side& b) {
    return a.edge != b.edge ? a.edge < b.edge : a.triangle < b.triangle;
  });
  struct Open {
    std::uint32_t a, b, apex;  // of its triangle, in this order
  };
  std::vector<Open> open;
  for (std::size_t i = 0; i < sides.size(); ++i) {
    if ((i > 0 && sides[i - 1].edge == sides[i].edge) || (i + 1 < sides.size() && sides[i + 1].edge == sides[i].edge))
      continue;
    const Triangle& c = mesh.triangles[sides[i].triangle];
    const std::uint32_t k = sides[i].corner;
    open.push_back({c[k], c[(k + 1) % 3], c[(k + 2) % 3]});
  }
  const std::vector<std::uint32_t> size_at = outline_sizes(mesh.vertex_count(), open);
  std::vector<Eigen::Vector3f> out(mesh.vertex_count(), Eigen::Vector3f::Zero());
  for (const auto& [a, b, apex] : open) {
    if (size_at[a] < shortest_outline) continue;
    const Eigen::Vector3f edge = mesh.positions_m[b] - mesh.positions_m[a];
    const Eigen::Vector3f normal = edge.cross(mesh.positions_m[apex] - mesh.positions_m[a]);
    const Eigen::Vector3f outward = edge.cross(normal).stableNormalized() * edge.norm();
    out[a] += outward;
    out[b] += outward;
  }
  return out;
}

// Whether, in the image, what is next in this direction is not the same surface.
bool ends_here(const ViewCanvas& canvas, const CanvasPoint& at, const Eigen::Vector2f& direction) {
  for (int k = 1; k <= kLook_px; ++k) {
    int u = int(std::lround(at.u + float(k) * direction.x()));
    const int v = int(std::lround(at.v + float(k) * direction.y()));
    if (canvas.patch().grid.wraps) u = (u + canvas.width()) % canvas.width();
    if (u < 0 || v < 0 || u >= canvas.width() || v >= canvas.height()) return true;
    if (!canvas.has_sample(u, v)) continue;
    const std::size_t pixel = canvas.pixel(u, v);
    const float off = std::abs(canvas.patch().view.range.pixels[pixel] - at.r);
    return off > kStepFactor * canvas.tolerance(pixel, 0) + canvas.slope_slack(u, v);
  }
  return true;
}

}  // namespace

std::uint64_t extend_outlines(Mesh& mesh, std::span<const Patch> patches, const OverlapOptions& options,
                              std::uint32_t shortest_outline, Context& context) {
  std::vector<ViewCanvas> canvases;
  canvases.reserve(patches.size());
  for (const Patch& patch : patches) canvases.emplace_back(patch, mesh.origin_m, options, 0);
  const std::vector<Eigen::Vector3f> out = find_ways_out(mesh, shortest_outline, context);
  std::vector<std::uint8_t> has_moved(mesh.vertex_count(), 0);
  const auto extend = [&](std::size_t v) {
    if (out[v].isZero()) return;
    const ViewCanvas& canvas = canvases[mesh.vertex_view[v]];
    Eigen::Vector3f& p = mesh.positions_m[v];
    const Eigen::Vector3f outward = out[v].stableNormalized();
    const CanvasPoint at = canvas.project(p);
    if (!at.is_in) return;
    const auto& directions = canvas.patch().rays->directions;
    const std::size_t middle = directions.size() / 2;
    const float step = at.r * (directions[middle] - directions[middle + 1]).norm();
    const CanvasPoint next = canvas.project(p + step * outward);
    const Eigen::Vector2f moved(next.u - at.u, next.v - at.v);
    const float pixels = moved.norm();
    if (!(next.r > 0) || !(pixels > kLowestCosine) || pixels > 4) return;
    if (!ends_here(canvas, at, moved / pixels)) return;
    p += kFootprint_px / pixels * step * outward;
    has_moved[v] = 1;
  };
  const VerticesByView vertices(mesh, patches.size());
  parallel_for(context, patches.size(), 1, [&](std::size_t i) {
    for (const std::uint32_t v : vertices.of(i)) extend(v);
    relieve(patches[i]);
  });
  std::uint64_t count = 0;
  for (const std::uint8_t has : has_moved) count += has;
  return count;
}

}  // namespace lapseam
