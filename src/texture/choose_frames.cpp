// Based on: Y. Boykov, O. Veksler, R. Zabih, Fast Approximate Energy Minimization via Graph Cuts, 2001.

#include "texture/choose_frames.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "lapseam/context.h"
#include "texture/blocks.h"
#include "texture/min_cut.h"
#include "texture/stretch.h"

namespace lapseam {
namespace {

constexpr int kCycles = 2;
// How far a frame can go at once beyond what it has: over all of a small region, and along the rim of a large one,
// which has its image for a reason. Without it, cuts would be over whole scenes.
constexpr float kReach_px = 96;
// Pixels that surfaces next to each other in a frame may be apart along its rays.
constexpr float kSameSurface_px = 8;

/// What lies at each pixel of a frame, which reaches beyond its image.
class Canvas {
 public:
  explicit Canvas(const ColorCamera& camera)
      : wraps_(camera.wraps()),
        x0_(wraps_ ? 0 : -camera.margin_x()),
        y0_(-camera.margin_y()),
        distance_m_(camera.width() - 2 * x0_, camera.height() - 2 * y0_, 0.0f) {}

  /// Distance along the ray of what has been put there; 0: nothing.
  float& at(int x, int y) {
    x -= x0_;
    y -= y0_;
    x = wraps_ ? (x % distance_m_.width + distance_m_.width) % distance_m_.width
               : std::clamp(x, 0, distance_m_.width - 1);
    return distance_m_.at(x, std::clamp(y, 0, distance_m_.height - 1));
  }

 private:
  bool wraps_;
  int x0_, y0_;
  Image<float> distance_m_;
};

/// A cell as a plane.
struct Facet {
  Eigen::Vector3f middle_m = Eigen::Vector3f::Zero(), normal = Eigen::Vector3f::Zero();
  Eigen::Vector3f along_m, across_m;  // a step on it
  float area_m2 = 0;
};

class FrameChoice {
 public:
  FrameChoice(const Mesh& mesh, const Cells& cells, const std::vector<SharedEdge>& edges, const ColorCameras& cameras,
              const std::vector<std::uint32_t>& view, Context& context)
      : mesh_(mesh), cells_(cells), cameras_(cameras), view_(view), frame_(view), context_(context) {
    facets_.resize(cells.count());
    area_px_.assign(cells.count(), 0);
    density_px_.assign(cells.count(), 0);
    is_slender_.assign(cells.count(), 0);
    for (std::uint32_t c = 0; c < cells.count(); ++c)
      if (view[c] != kInvalidIndex) measure(c);
    join_cells(edges);
    cost_.assign(cells.count(), 0);
    node_.assign(cells.count(), kInvalidIndex);
  }

  std::vector<std::uint32_t> run() {
    for (int cycle = 0; cycle < kCycles; ++cycle) {
      // Large frames first.
      std::vector<double> area_px(cameras_.size(), 0);
      for (std::uint32_t c = 0; c < frame_.size(); ++c)
        if (frame_[c] != kInvalidIndex) area_px[frame_[c]] += double(area_px_[c]);
      std::vector<std::uint32_t> order(cameras_.size());
      std::iota(order.begin(), order.end(), 0u);
      std::stable_sort(order.begin(), order.end(),
                       [&](std::uint32_t a, std::uint32_t b) { return area_px[a] > area_px[b]; });
      for (const std::uint32_t frame : order) {
        context_.throw_if_cancelled();
        if (area_px[frame] > 0) expand(frame);
      }
    }
    return std::move(frame_);
  }

 private:
  std::array<Eigen::Vector3f, 3> corners_of(std::uint32_t i) const {
    const Triangle& t = mesh_.triangles[i];
    return {mesh_.positions_m[t[0]], mesh_.positions_m[t[1]], mesh_.positions_m[t[2]]};
  }

  void measure(std::uint32_t c) {
    Facet& facet = facets_[c];
    for (const std::uint32_t i : cells_.of(c)) {
      const auto p = corners_of(i);
      const Eigen::Vector3f normal = 0.5f * (p[1] - p[0]).cross(p[2] - p[0]);
      const float area_m2 = normal.norm();
      facet.normal += normal;
      facet.middle_m += area_m2 * (p[0] + p[1] + p[2]) / 3;
      facet.area_m2 += area_m2;
    }
    if (!(facet.area_m2 > 0)) return;
    facet.middle_m /= facet.area_m2;
    facet.normal.normalize();
    const float step_m = 0.5f * std::sqrt(facet.area_m2);
    facet.along_m = step_m * facet.normal.unitOrthogonal();
    facet.across_m = facet.normal.cross(facet.along_m);
    float longest_px = 0, longest_m = 0;
    for (const std::uint32_t i : cells_.of(c)) {
      std::array<Eigen::Vector2f, 3> p;
      if (!lay_out(i, *cameras_[view_[c]], p)) continue;
      const Eigen::Vector2f ab = p[1] - p[0], ac = p[2] - p[0];
      area_px_[c] += 0.5f * std::abs(ab.x() * ac.y() - ab.y() * ac.x());
      longest_px = std::max({longest_px, ab.norm(), ac.norm(), (ac - ab).norm()});
      const auto q = corners_of(i);
      longest_m = std::max({longest_m, (q[1] - q[0]).norm(), (q[2] - q[0]).norm(), (q[2] - q[1]).norm()});
    }
    area_px_[c] = std::max(area_px_[c], 1e-6f);
    is_slender_[c] = 2 * area_px_[c] < kSlender_px * longest_px;
    // The area of a sliver tells little.
    density_px_[c] = is_slender_[c] ? longest_px / longest_m : std::sqrt(area_px_[c] / facet.area_m2);
  }

  /// Of the steps on the facet, the steps in the image.
  static bool steps_in(const Facet& facet, const ColorCamera& camera, Eigen::Matrix2f& steps) {
    Eigen::Vector2f middle, end;
    if (!camera.project_beyond(facet.middle_m, middle)) return false;
    for (const int k : {0, 1}) {
      if (!camera.project_beyond(facet.middle_m + (k == 0 ? facet.along_m : facet.across_m), end)) return false;
      end -= middle;
      if (camera.wraps()) end.x() -= float(camera.width()) * std::round(end.x() / float(camera.width()));
      steps.col(k) = end;
    }
    return true;
  }

  void join_cells(const std::vector<SharedEdge>& edges) {
    std::vector<std::uint8_t> is_shown(cells_.count());
    std::transform(area_px_.begin(), area_px_.end(), is_shown.begin(), [](float a) { return std::uint8_t(a > 0); });
    borders_ = find_borders(mesh_, cells_, edges, is_shown);
    for (const CellBorder& border : borders_.all)
      padding_px_.push_back(kPadding * border.length_m * 0.5f * (density_px_[border.a] + density_px_[border.b]));
  }

  /// Lets one frame take over any of the cells that lie next to its own, and next to these, such that the sum falls the
  /// most.
  void expand(std::uint32_t frame) {
    const ColorCamera& camera = *cameras_[frame];
    Canvas canvas(camera);
    std::vector<std::uint32_t> reached;  // cells of the frame, then those that can go over
    std::vector<std::uint8_t> is_tried(cells_.count(), 0);
    for (std::uint32_t c = 0; c < frame_.size(); ++c) {
      if (frame_[c] != frame || !(area_px_[c] > 0)) continue;
      draw(c, camera, canvas);
      reached.push_back(c);
      is_tried[c] = 1;
    }
    const std::size_t own = reached.size();
    std::vector<float> cost, way_px(own, 0);
    for (std::size_t next = 0; next < reached.size(); ++next) {
      if (way_px[next] >= kReach_px) continue;
      for (const std::uint32_t e : borders_.of(reached[next])) {
        const std::uint32_t other = borders_.across(reached[next], e);
        if (is_tried[other]) continue;
        is_tried[other] = 1;
        float layout = 0;
        if (!cost_of(other, frame, layout) || !is_free(other, camera, canvas)) continue;
        draw(other, camera, canvas);
        node_[other] = std::uint32_t(reached.size() - own);
        reached.push_back(other);
        way_px.push_back(way_px[next] + std::sqrt(area_px_[other]));
        cost.push_back(layout);
      }
    }
    MinCut cut(cost.size());
    for (std::uint32_t k = 0; k < cost.size(); ++k) {
      const std::uint32_t c = reached[own + k];
      cut.add_cost(k, double(cost[k] - cost_[c]));
      for (const std::uint32_t e : borders_.of(c)) {
        const std::uint32_t other = borders_.across(c, e), m = node_[other];
        const double padding = double(padding_px_[e]);
        const double now = frame_[c] == frame_[other] ? 0 : padding;
        if (m == kInvalidIndex) {
          cut.add_cost(k, (frame_[other] == frame ? 0 : padding) - now);
        } else if (c < other) {
          // Both keep theirs: now; one goes over: padding; both: none.
          cut.add_cost(k, padding - now);
          cut.add_cost(m, -padding);
          cut.add_link(k, m, 2 * padding - now, 0);
        }
      }
    }
    const std::vector<std::uint8_t> is_taken = cut.solve();
    for (std::uint32_t k = 0; k < cost.size(); ++k) {
      const std::uint32_t c = reached[own + k];
      if (is_taken[k]) frame_[c] = frame, cost_[c] = cost[k];
      node_[c] = kInvalidIndex;
    }
  }

  /// Of laying a cell out in a frame instead of its own image's. False where it would be too coarse or too large there.
  bool cost_of(std::uint32_t c, std::uint32_t frame, float& cost) const {
    cost = 0;
    if (frame == view_[c] || is_slender_[c]) return true;
    const Facet& facet = facets_[c];
    Eigen::Matrix2f own, there;
    if (!steps_in(facet, *cameras_[frame], there) || !steps_in(facet, *cameras_[view_[c]], own)) return false;
    const Eigen::Matrix2f map = there * own.inverse();
    return cost_of_stretch(map, area_px_[c], cost);
  }

  /// Corners of a triangle in a frame.
  bool lay_out(std::uint32_t i, const ColorCamera& camera, std::array<Eigen::Vector2f, 3>& p) const {
    const auto corners = corners_of(i);
    for (std::size_t k = 0; k < 3; ++k)
      if (!camera.project_beyond(corners[k], p[k])) return false;
    if (camera.wraps()) unwrap(p, camera.width());
    return true;
  }

  static float distance_m(const Eigen::Vector3f& point_m, const Eigen::Vector2f& pixel, const ColorCamera& camera) {
    return (point_m - camera.ray_origin(pixel)).norm();
  }

  /// Whether all of a cell faces a frame, and nothing else lies there; no other surface beside it where corners are.
  bool is_free(std::uint32_t c, const ColorCamera& camera, Canvas& canvas) const {
    constexpr float kHair_px = 0.01f;
    for (const std::uint32_t i : cells_.of(c)) {
      std::array<Eigen::Vector2f, 3> p;
      if (!lay_out(i, camera, p)) return false;
      const auto corners = corners_of(i);
      const Eigen::Vector3f normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
      if (!is_slender_[c] && !(normal.dot(corners[0] - camera.ray_origin(p[0])) < 0)) return false;
      bool is_clear = true;
      if (!is_slender_[c])
        for_pixels(p, -kHair_px, [&](int x, int y, float, float) { is_clear = is_clear && canvas.at(x, y) == 0; });
      const float tolerance_m = kSameSurface_px / density_px_[c];
      for (std::size_t k = 0; k < 3; ++k) {
        const float there_m = canvas.at(int(std::lround(p[k].x())), int(std::lround(p[k].y())));
        is_clear = is_clear && (there_m == 0 || std::abs(there_m - distance_m(corners[k], p[k], camera)) < tolerance_m);
      }
      if (!is_clear) return false;
    }
    return true;
  }

  void draw(std::uint32_t c, const ColorCamera& camera, Canvas& canvas) const {
    if (is_slender_[c]) return;
    for (const std::uint32_t i : cells_.of(c)) {
      std::array<Eigen::Vector2f, 3> p;
      if (!lay_out(i, camera, p)) continue;
      const auto corners = corners_of(i);
      for_pixels(p, 0, [&](int x, int y, float b1, float b2) {
        const Eigen::Vector3f point = (1 - b1 - b2) * corners[0] + b1 * corners[1] + b2 * corners[2];
        canvas.at(x, y) = distance_m(point, Eigen::Vector2f(float(x), float(y)), camera);
      });
    }
  }

  const Mesh& mesh_;
  const Cells& cells_;
  const ColorCameras& cameras_;
  const std::vector<std::uint32_t>& view_;
  std::vector<std::uint32_t> frame_;
  Context& context_;
  std::vector<Facet> facets_;
  std::vector<float> area_px_;     // in the image that a cell shows; 0: left alone
  std::vector<float> density_px_;  // there, pixels per metre
  std::vector<std::uint8_t> is_slender_;
  std::vector<float> cost_;  // of the frame that a cell has
  CellBorders borders_;
  std::vector<float> padding_px_;    // of a border between frames
  std::vector<std::uint32_t> node_;  // of each cell in the cut at hand
};

}  // namespace

std::vector<std::uint32_t> choose_frames(const Mesh& mesh, const Cells& cells, const std::vector<SharedEdge>& edges,
                                         const ColorCameras& cameras, const std::vector<std::uint32_t>& view_of_cell,
                                         Context& context) {
  return FrameChoice(mesh, cells, edges, cameras, view_of_cell, context).run();
}

}  // namespace lapseam
