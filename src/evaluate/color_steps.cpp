#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "health/percentile.h"
#include "lapseam/evaluate_novel.h"

namespace lapseam {
namespace {

// Coordinates that differ by less than this many texels are one place on a page: floats of a large page hold no more.
constexpr float kSamePlace_px = 0.01f;

struct Side {
  std::uint32_t low, high;  // vertices of the edge
  std::uint32_t triangle;
  std::uint8_t corner;  // where it begins in the triangle
};

/// The edge as one of its triangles shows it, from its vertex of lower index to the other.
struct Strip {
  const ColorImage* page;          // null: the vertices' colours
  Eigen::Vector2f from_px, to_px;  // pixel centres at integers
  Eigen::Vector3f from_color, to_color;
};

Eigen::Vector3f to_vector(Rgb8 c) { return {float(c.r), float(c.g), float(c.b)}; }

Strip strip_of(const Mesh& model, const Side& side) {
  Strip strip{nullptr, Eigen::Vector2f::Zero(), Eigen::Vector2f::Zero(), Eigen::Vector3f::Zero(),
              Eigen::Vector3f::Zero()};
  if (model.triangle_page[side.triangle] == kInvalidIndex) {
    strip.from_color = to_vector(model.colors[side.low]);
    strip.to_color = to_vector(model.colors[side.high]);
    return strip;
  }
  strip.page = &model.pages[model.triangle_page[side.triangle]];
  const auto place = [&](std::size_t corner) -> Eigen::Vector2f {
    const Eigen::Vector2f& uv = model.texcoords[side.triangle][corner];
    return {uv.x() * float(strip.page->width) - 0.5f, uv.y() * float(strip.page->height) - 0.5f};
  };
  const std::size_t a = side.corner, b = (side.corner + 1u) % 3;
  const bool is_forward = model.triangles[side.triangle][a] == side.low;
  strip.from_px = place(is_forward ? a : b);
  strip.to_px = place(is_forward ? b : a);
  return strip;
}

bool is_same_place(const Strip& a, const Strip& b) {
  return a.page == b.page && (a.from_px - b.from_px).norm() < kSamePlace_px &&
         (a.to_px - b.to_px).norm() < kSamePlace_px;
}

Eigen::Vector3f color_at(const Strip& strip, float share) {
  if (!strip.page) return strip.from_color + share * (strip.to_color - strip.from_color);
  const ColorImage& page = *strip.page;
  const Eigen::Vector2f p = strip.from_px + share * (strip.to_px - strip.from_px);
  const float x = std::clamp(p.x(), 0.0f, float(page.width - 1)), y = std::clamp(p.y(), 0.0f, float(page.height - 1));
  const int x0 = int(x), y0 = int(y), x1 = std::min(x0 + 1, page.width - 1), y1 = std::min(y0 + 1, page.height - 1);
  const auto at = [&](int u, int v) { return to_vector(page.at(u, v)); };
  const float fx = x - float(x0), fy = y - float(y0);
  return (1 - fy) * ((1 - fx) * at(x0, y0) + fx * at(x1, y0)) + fy * ((1 - fx) * at(x0, y1) + fx * at(x1, y1));
}

/// Sides of triangles that have a colour, those of one edge beside each other.
std::vector<Side> sorted_sides(const Mesh& model, Context& context) {
  std::vector<Side> sides;
  for (std::uint32_t i = 0; i < model.triangle_count(); ++i) {
    if (model.triangle_page[i] == kInvalidIndex && model.colors.empty()) continue;
    for (std::uint8_t k = 0; k < 3; ++k) {
      const std::uint32_t a = model.triangles[i][k], b = model.triangles[i][(k + 1u) % 3];
      sides.push_back({std::min(a, b), std::max(a, b), i, k});
    }
  }
  parallel_sort(context, sides.begin(), sides.end(), [](const Side& x, const Side& y) {
    if (x.low != y.low) return x.low < y.low;
    return x.high != y.high ? x.high < y.high : x.triangle < y.triangle;
  });
  return sides;
}

}  // namespace

ColorStepFigures measure_color_steps(const Mesh& model, Context& context) {
  ColorStepFigures figures;
  if (model.triangle_page.empty() || model.pages.empty()) return figures;
  const std::vector<Side> sides = sorted_sides(model, context);
  std::vector<float> steps, vertex_color_steps;
  for (std::size_t i = 0; i + 1 < sides.size(); ++i) {
    const Side &one = sides[i], &other = sides[i + 1];
    if (one.low != other.low || one.high != other.high) continue;
    const Strip a = strip_of(model, one), b = strip_of(model, other);
    if (is_same_place(a, b)) continue;
    const bool are_on_pages = a.page && b.page;
    if (are_on_pages) {
      ++figures.edges;
      figures.length_m += double((model.positions_m[one.low] - model.positions_m[one.high]).norm());
    }
    const float length_px = std::max((a.to_px - a.from_px).norm(), (b.to_px - b.from_px).norm());
    const int count = std::max(1, int(std::ceil(length_px)));
    for (int k = 0; k < count; ++k) {
      const float share = (float(k) + 0.5f) / float(count);
      (are_on_pages ? steps : vertex_color_steps)
          .push_back((color_at(a, share) - color_at(b, share)).norm() / std::sqrt(3.0f));
    }
  }
  figures.samples = steps.size();
  figures.vertex_color_samples = vertex_color_steps.size();
  for (std::vector<float>* some : {&steps, &vertex_color_steps})
    parallel_sort(context, some->begin(), some->end(), std::less<>());
  if (!steps.empty()) figures.median = percentile(steps, 50), figures.p95 = percentile(steps, 95);
  if (!vertex_color_steps.empty()) {
    figures.vertex_color_median = percentile(vertex_color_steps, 50);
    figures.vertex_color_p95 = percentile(vertex_color_steps, 95);
  }
  return figures;
}

}  // namespace lapseam
