#include "render/edge_overlay.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "core/parallel.h"

namespace lapseam {
namespace {

struct HalfEdge {
  std::uint32_t low, high;
  std::uint32_t triangle;
  bool is_upward;  ///< runs from low to high in its triangle
};

struct Dot {
  float x, y;
  bool is_faulty;
};

/// Dots along one edge, about half a pixel apart, where it shows.
class EdgeTracer {
 public:
  EdgeTracer(const Mesh& mesh, const RayMaker& rays, const EdgeShows& shows)
      : mesh_(mesh), rays_(rays), shows_(shows) {}

  void trace(const MarkedEdge& edge, std::vector<Dot>& out) const {
    const Eigen::Vector3d a = mesh_.positions_m[edge.a].cast<double>(), b = mesh_.positions_m[edge.b].cast<double>();
    const std::size_t steps = count_steps(a, b);
    for (std::size_t i = 0; i <= steps; ++i) {
      const double t = double(i) / double(steps);
      const auto point = rays_.project((1 - t) * a + t * b);
      if (point && is_visible(*point, edge.triangle)) out.push_back({float(point->x), float(point->y), edge.is_faulty});
    }
  }

 private:
  std::size_t count_steps(const Eigen::Vector3d& a, const Eigen::Vector3d& b) const {
    constexpr double kMostSteps = 8192, kStep_px = 0.5;
    const auto first = rays_.project(a), last = rays_.project(b);
    if (first && last) {
      const double length_px = std::hypot(first->x - last->x, first->y - last->y);
      return std::size_t(std::clamp(std::ceil(length_px / kStep_px), 1.0, kMostSteps));
    }
    // One end is out of sight: as many steps as the picture could need if all of the edge were near.
    const auto seen = first ? first : last;
    if (!seen) return std::size_t(64);
    const double length_px = (b - a).norm() / rays_.pixel_width_m(seen->x, seen->y, seen->distance_m);
    return std::size_t(std::clamp(std::ceil(2 * length_px / kStep_px), 1.0, kMostSteps));
  }

  bool is_visible(const PicturePoint& point, std::uint32_t triangle) const {
    const double tolerance_m =
        std::max(2 * rays_.pixel_width_m(point.x, point.y, point.distance_m), 1e-4 * point.distance_m);
    return shows_(rays_.ray(point.x, point.y), point.distance_m - tolerance_m, triangle);
  }

  const Mesh& mesh_;
  const RayMaker& rays_;
  const EdgeShows& shows_;
};

void stamp(Image<float>& image, const Dot& dot, float radius_px) {
  const float reach = radius_px + 0.5f;
  const int x0 = std::max(0, int(std::ceil(dot.x - reach))), x1 = std::min(image.width - 1, int(dot.x + reach));
  const int y0 = std::max(0, int(std::ceil(dot.y - reach))), y1 = std::min(image.height - 1, int(dot.y + reach));
  for (int y = y0; y <= y1; ++y)
    for (int x = x0; x <= x1; ++x) {
      const float distance = std::hypot(float(x) - dot.x, float(y) - dot.y);
      image.at(x, y) = std::max(image.at(x, y), std::clamp(reach - distance, 0.0f, 1.0f));
    }
}

}  // namespace

std::vector<MarkedEdge> find_marked_edges(const Mesh& mesh, Context& context) {
  std::vector<HalfEdge> half_edges;
  half_edges.reserve(3 * mesh.triangle_count());
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = mesh.triangles[i][k], b = mesh.triangles[i][(k + 1) % 3];
      if (a != b) half_edges.push_back({std::min(a, b), std::max(a, b), std::uint32_t(i), a < b});
    }
  }
  parallel_sort(context, half_edges.begin(), half_edges.end(), [](const HalfEdge& x, const HalfEdge& y) {
    return std::tie(x.low, x.high, x.triangle, x.is_upward) < std::tie(y.low, y.high, y.triangle, y.is_upward);
  });
  std::vector<MarkedEdge> marked;
  for (std::size_t begin = 0, end = 0; begin < half_edges.size(); begin = end) {
    const HalfEdge& first = half_edges[begin];
    while (end < half_edges.size() && half_edges[end].low == first.low && half_edges[end].high == first.high) ++end;
    const bool is_whole = end - begin == 2 && first.is_upward != half_edges[begin + 1].is_upward;
    if (!is_whole) marked.push_back({first.low, first.high, first.triangle, end - begin > 1});
  }
  return marked;
}

EdgeCoverage cover_edges(const Mesh& mesh, const std::vector<MarkedEdge>& edges, const RayMaker& rays,
                         const EdgeShows& shows, double width_px, Context& context) {
  constexpr std::size_t kGrain = 256;
  const EdgeTracer tracer(mesh, rays, shows);
  std::vector<std::vector<Dot>> dots((edges.size() + kGrain - 1) / kGrain);
  parallel_blocks(context, edges.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) tracer.trace(edges[i], dots[begin / kGrain]);
  });
  EdgeCoverage coverage{Image<float>(rays.width(), rays.height()), Image<float>(rays.width(), rays.height())};
  for (const std::vector<Dot>& block : dots)
    for (const Dot& dot : block) stamp(dot.is_faulty ? coverage.faulty : coverage.boundary, dot, float(0.5 * width_px));
  return coverage;
}

}  // namespace lapseam
