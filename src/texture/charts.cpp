#include "texture/charts.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>

#include "core/disjoint_sets.h"
#include "core/parallel.h"

namespace lapseam {
namespace {

// Root triangle of each triangle's region: same view, joined by edges.
std::vector<std::uint32_t> find_regions(const Mesh& mesh, const std::vector<std::uint32_t>& view_of_triangle) {
  struct Side {
    std::uint64_t edge;
    std::uint32_t triangle;
  };
  std::vector<Side> sides;
  for (std::uint32_t i = 0; i < mesh.triangle_count(); ++i) {
    if (view_of_triangle[i] == kInvalidIndex) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint64_t a = mesh.triangles[i][k], b = mesh.triangles[i][(k + 1) % 3];
      sides.push_back({a < b ? a << 32 | b : b << 32 | a, i});
    }
  }
  std::sort(sides.begin(), sides.end(),
            [](const Side& x, const Side& y) { return x.edge != y.edge ? x.edge < y.edge : x.triangle < y.triangle; });
  DisjointSets sets(mesh.triangle_count());
  for (std::size_t i = 0; i + 1 < sides.size(); ++i)
    if (sides[i].edge == sides[i + 1].edge &&
        view_of_triangle[sides[i].triangle] == view_of_triangle[sides[i + 1].triangle])
      sets.unite(sides[i].triangle, sides[i + 1].triangle);
  std::vector<std::uint32_t> root(mesh.triangle_count());
  for (std::uint32_t i = 0; i < root.size(); ++i) root[i] = sets.find(i);
  return root;
}

// Brings the corners of a triangle across the seam of a panorama to one side.
void unwrap(std::array<Eigen::Vector2f, 3>& p, int width) {
  const float half = 0.5f * float(width);
  const float right = std::max({p[0].x(), p[1].x(), p[2].x()});
  for (Eigen::Vector2f& q : p)
    if (right - q.x() > half) q.x() += float(width);
}

struct Box {
  float u0 = 3e38f, v0 = 3e38f, u1 = -3e38f, v1 = -3e38f;
  void extend(const std::array<Eigen::Vector2f, 3>& p) {
    for (const Eigen::Vector2f& q : p) {
      u0 = std::min(u0, q.x()), v0 = std::min(v0, q.y());
      u1 = std::max(u1, q.x()), v1 = std::max(v1, q.y());
    }
  }
};

}  // namespace

ColorProjection::ColorProjection(const ViewSource& source, const Eigen::Vector3d& mesh_origin_m)
    : camera_(source.color->camera),
      T_color_mesh_((source.T_world_view * source.color->T_view_color).inverse() * Eigen::Translation3d(mesh_origin_m)),
      width_(lapseam::width(camera_)),
      height_(lapseam::height(camera_)),
      wraps_(lapseam::wraps(camera_)) {}

bool ColorProjection::project(const Eigen::Vector3f& position_m, Eigen::Vector2f& pixel) const {
  const auto out = lapseam::project(camera_, T_color_mesh_ * position_m.cast<double>());
  if (!out || !(out->r > 0)) return false;
  pixel = {float(out->u), float(out->v)};
  return pixel.x() >= -0.5f && pixel.x() <= float(width_) - 0.5f && pixel.y() >= -0.5f &&
         pixel.y() <= float(height_) - 0.5f;
}

Charts make_charts(const Mesh& mesh, std::span<const ViewSource> sources, int padding_px, int largest_px,
                   Context& context) {
  Charts out;
  out.source_pixels.resize(mesh.triangle_count());
  out.chart_of_triangle.assign(mesh.triangle_count(), kInvalidIndex);
  std::vector<std::unique_ptr<ColorProjection>> projections(sources.size());
  for (std::size_t i = 0; i < sources.size(); ++i)
    if (sources[i].color) projections[i] = std::make_unique<ColorProjection>(sources[i], mesh.origin_m);

  out.view_of_triangle.assign(mesh.triangle_count(), kInvalidIndex);
  const auto try_view = [&](std::size_t i, std::uint32_t view) {
    if (view >= projections.size() || !projections[view]) return false;
    auto& p = out.source_pixels[i];
    for (std::size_t k = 0; k < 3; ++k)
      if (!projections[view]->project(mesh.positions_m[mesh.triangles[i][k]], p[k])) return false;
    if (projections[view]->wraps()) unwrap(p, projections[view]->width());
    out.view_of_triangle[i] = view;
    return true;
  };
  parallel_for(context, mesh.triangle_count(), 16384, [&](std::size_t i) {
    if (try_view(i, mesh.triangle_view[i])) return;
    for (const std::uint32_t v : mesh.triangles[i])
      if (!mesh.vertex_view.empty() && try_view(i, mesh.vertex_view[v])) return;
  });

  const std::vector<std::uint32_t> root = find_regions(mesh, out.view_of_triangle);
  std::vector<Box> region_box(mesh.triangle_count());
  for (std::size_t i = 0; i < root.size(); ++i)
    if (out.view_of_triangle[i] != kInvalidIndex) region_box[root[i]].extend(out.source_pixels[i]);

  // A region too large for a page is cut along a grid of half pages, by triangle centroid.
  const float room = float(largest_px - 2 * padding_px - 2);
  std::map<std::array<std::uint32_t, 3>, std::uint32_t> chart_of_piece;
  std::vector<Box> boxes;
  for (std::size_t i = 0; i < root.size(); ++i) {
    if (out.view_of_triangle[i] == kInvalidIndex) continue;
    const Box& box = region_box[root[i]];
    std::array<std::uint32_t, 3> piece = {root[i], 0, 0};
    if (box.u1 - box.u0 > room || box.v1 - box.v0 > room) {
      const auto& p = out.source_pixels[i];
      piece[1] = 1 + std::uint32_t((p[0].x() + p[1].x() + p[2].x()) / 3 / (room / 2) + 1);
      piece[2] = 1 + std::uint32_t((p[0].y() + p[1].y() + p[2].y()) / 3 / (room / 2) + 1);
    }
    const auto [it, is_new] = chart_of_piece.try_emplace(piece, std::uint32_t(boxes.size()));
    if (is_new) {
      boxes.emplace_back();
      out.charts.push_back({});
      out.charts.back().view = out.view_of_triangle[i];
    }
    boxes[it->second].extend(out.source_pixels[i]);
    out.chart_of_triangle[i] = it->second;
  }
  for (std::size_t c = 0; c < boxes.size(); ++c) {
    Chart& chart = out.charts[c];
    chart.u0 = int(std::floor(boxes[c].u0)) - padding_px;
    chart.v0 = int(std::floor(boxes[c].v0)) - padding_px;
    chart.width = int(std::ceil(boxes[c].u1)) + padding_px + 1 - chart.u0;
    chart.height = int(std::ceil(boxes[c].v1)) + padding_px + 1 - chart.v0;
  }
  return out;
}

}  // namespace lapseam
