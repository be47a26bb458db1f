#include "sew/gap_faces.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/parallel.h"

namespace lapseam {
namespace {

constexpr float kGridPerPixel = 1024;      // resolution of the planar triangulation
constexpr float kLongest_px = 6;           // edges of seams, unless the border itself has longer ones
constexpr float kInteriorStep_px = 0.25f;  // sampling of a face's interior

std::int64_t cross(const GridPoint& p, const GridPoint& q, std::int64_t x, std::int64_t y) {
  return (std::int64_t(q.x) - p.x) * (y - p.y) - (std::int64_t(q.y) - p.y) * (x - p.x);
}

}  // namespace

std::uint32_t GapFaces::add_point(const Point& point, float u, float v) {
  const auto x = std::int32_t(std::lround(u * kGridPerPixel)), y = std::int32_t(std::lround(v * kGridPerPixel));
  // Counter-clockwise as seen is counter-clockwise here.
  grid_.push_back({x, in_.patch.grid.is_mirrored ? y : -y});
  points_.push_back(point);
  return std::uint32_t(points_.size() - 1);
}

std::array<CanvasPoint, 2> GapFaces::ends_of(std::size_t fence) const {
  const auto at = [&](std::uint32_t i) {
    return CanvasPoint{float(grid_[i].x) / kGridPerPixel, float(std::abs(grid_[i].y)) / kGridPerPixel, 1, true};
  };
  return {at(fences_[fence].from), at(fences_[fence].to)};
}

std::vector<std::array<std::uint32_t, 3>> GapFaces::fill(const std::function<void(std::size_t fence)>& on_lost,
                                                         Context& context) {
  PlanarTriangulation made(grid_);
  longest_fence_.assign(grid_.size(), 0);
  for (const Fence& fence : fences_) {
    const GridPoint &p = grid_[fence.from], &q = grid_[fence.to];
    const float length = std::hypot(float(p.x - q.x), float(p.y - q.y)) / kGridPerPixel;
    for (const std::uint32_t end : {fence.from, fence.to}) longest_fence_[end] = std::max(longest_fence_[end], length);
  }
  for (std::size_t i = 0; i < fences_.size(); ++i) {
    if (made.constrain(fences_[i].from, fences_[i].to)) continue;
    on_lost(i);
    fences_[i].from = fences_[i].to;
  }
  // Which edges of a face are borders seen from the gap: a face at the other side of one stands on what is there.
  std::vector<std::uint8_t> gap_side(made.faces().size(), 0), is_seen(made.faces().size(), 0);
  std::vector<std::uint32_t> queue, seeds;
  for (const Fence& fence : fences_) {
    if (fence.from == fence.to) continue;
    const std::uint32_t face = made.face_left_of(fence.from, fence.to);
    if (face == PlanarTriangulation::kNone) continue;
    const auto& corner = made.faces()[face].corner;
    for (int k = 0; k < 3; ++k)
      if (corner[std::size_t(k)] != fence.from && corner[std::size_t(k)] != fence.to)
        gap_side[face] |= std::uint8_t(1 << k);
    seeds.push_back(face);
  }
  // Face by face into the gap, all of one distance from its borders at once.
  std::vector<std::uint32_t> front;
  const auto meet = [&](std::uint32_t face) {
    if (face == PlanarTriangulation::kNone || is_seen[face]) return;
    is_seen[face] = 1;
    if (!(made.faces()[face].constrained & ~gap_side[face])) front.push_back(face);
  };
  for (const std::uint32_t face : seeds) meet(face);
  std::vector<std::uint8_t> valid;
  while (!front.empty()) {
    valid.assign(front.size(), 0);
    parallel_for(context, front.size(), 16, [&](std::size_t i) { valid[i] = is_valid(made.faces()[front[i]]); });
    const std::vector<std::uint32_t> met = std::exchange(front, {});
    for (std::size_t i = 0; i < met.size(); ++i) {
      if (!valid[i]) continue;
      queue.push_back(met[i]);
      const Face& face = made.faces()[met[i]];
      for (std::size_t k = 0; k < 3; ++k)
        if (!(face.constrained >> k & 1)) meet(face.neighbor[k]);
    }
  }
  std::sort(queue.begin(), queue.end());
  std::vector<std::array<std::uint32_t, 3>> faces;
  faces.reserve(queue.size());
  for (const std::uint32_t face : queue) faces.push_back(made.faces()[face].corner);
  return faces;
}

bool GapFaces::is_valid(const Face& face) const {
  for (const std::uint32_t c : face.corner)
    if (c >= points_.size()) return false;
  const GridPoint& c = grid_[face.corner[2]];
  if (cross(grid_[face.corner[0]], grid_[face.corner[1]], c.x, c.y) <= 0) return false;
  return has_only_idle_samples(face) && is_measured(face) && !overlaps_model(face) && !has_edge_of_model(face);
}

// Samples inside or on its edges: none that is covered, and none that ought to be a vertex.
bool GapFaces::has_only_idle_samples(const Face& face) const {
  const GridPoint &a = grid_[face.corner[0]], &b = grid_[face.corner[1]], &c = grid_[face.corner[2]];
  const auto one = std::int32_t(kGridPerPixel);
  const auto [x_low, x_high] = std::minmax({a.x, b.x, c.x});
  const auto [y_low, y_high] = std::minmax({a.y, b.y, c.y});
  const auto low_cell = [&](std::int32_t x) { return int(std::floor(float(x) / kGridPerPixel)); };
  for (int y = low_cell(y_low); y <= low_cell(y_high) + 1; ++y)
    for (int u = low_cell(x_low); u <= low_cell(x_high) + 1; ++u) {
      const std::int64_t px = std::int64_t(u) * one, py = std::int64_t(y) * one;
      const std::array<std::int64_t, 3> side = {cross(b, c, px, py), cross(c, a, px, py), cross(a, b, px, py)};
      if (side[0] < 0 || side[1] < 0 || side[2] < 0) continue;
      const GridPoint here{u * one, y * one};
      if (here == a || here == b || here == c || is_on_fence(face, side)) continue;
      const int v = in_.patch.grid.is_mirrored ? y : -y;
      if (u < 0 || v < 0 || u >= in_.width || v >= in_.height) return false;
      if (!in_.canvas.has_sample(u, v)) return false;
      if (in_.sample.at(u, v) & ModelInView::kCovered) return false;
      if (!(in_.sample.at(u, v) & (ModelInView::kNear | ModelInView::kShadowed))) return false;
    }
  return true;
}

// Cells beneath: everywhere the view measured one surface.
bool GapFaces::is_measured(const Face& face) const {
  const GridPoint &a = grid_[face.corner[0]], &b = grid_[face.corner[1]], &c = grid_[face.corner[2]];
  const float sign = in_.patch.grid.is_mirrored ? 1.0f : -1.0f;
  const float ax = float(a.x) / kGridPerPixel, ay = sign * float(a.y) / kGridPerPixel;
  const float bx = float(b.x) / kGridPerPixel, by = sign * float(b.y) / kGridPerPixel;
  const float cx = float(c.x) / kGridPerPixel, cy = sign * float(c.y) / kGridPerPixel;
  const float extent =
      std::max({std::hypot(ax - bx, ay - by), std::hypot(bx - cx, by - cy), std::hypot(cx - ax, cy - ay)});
  if (extent > kLongest_px && !is_as_long_as_border(face, extent)) return false;
  const int n = std::clamp(int(std::ceil(extent / kInteriorStep_px)), 3, 64);
  const Point &p0 = points_[face.corner[0]], &p1 = points_[face.corner[1]], &p2 = points_[face.corner[2]];
  const float error = std::max({p0.error_m, p1.error_m, p2.error_m});
  for (int i = 0; i <= n; ++i)
    for (int j = 0; i + j <= n; ++j) {
      const int k = n - i - j;
      if (i == n || j == n || k == n) continue;  // the corners agree with the view already
      const float s = float(i) / float(n), t = float(j) / float(n), r = float(k) / float(n);
      const float u = s * ax + t * bx + r * cx, v = s * ay + t * by + r * cy;
      const float range = s * p0.range + t * p1.range + r * p2.range;
      if (!in_.is_surface(u, v, range, error)) return false;
    }
  return true;
}

// An edge that the model has already cannot get a third triangle.
bool GapFaces::has_edge_of_model(const Face& face) const {
  for (std::size_t k = 0; k < 3; ++k) {
    if (face.constrained >> k & 1) continue;
    const Point &p = points_[face.corner[(k + 1) % 3]], &q = points_[face.corner[(k + 2) % 3]];
    if (p.vertex != kInvalidIndex && q.vertex != kInvalidIndex &&
        in_.model.border_edges.contains(undirected(p.vertex, q.vertex)))
      return true;
  }
  return false;
}

// Whether a point, by its doubled areas with the edges opposite the corners, lies on an edge that is a border: what
// covers it there is the triangle at the border's other side.
bool GapFaces::is_on_fence(const Face& face, const std::array<std::int64_t, 3>& side) const {
  constexpr double kOn_px = 0.05;
  for (std::size_t k = 0; k < 3; ++k) {
    if (!(face.constrained >> k & 1)) continue;
    const GridPoint &p = grid_[face.corner[(k + 1) % 3]], &q = grid_[face.corner[(k + 2) % 3]];
    const double length = std::hypot(double(p.x - q.x), double(p.y - q.y));
    if (double(side[k]) < kOn_px * double(kGridPerPixel) * length) return true;
  }
  return false;
}

bool GapFaces::overlaps_model(const Face& face) const {
  Covering::Face seen{{}, 3e38f, 0};
  for (std::size_t k = 0; k < 3; ++k) {
    const GridPoint& p = grid_[face.corner[k]];
    seen.corner[k] = Eigen::Vector2f(float(p.x), float(p.y)) / kGridPerPixel;
    const float range = points_[face.corner[k]].range;
    seen.low_r = std::min(seen.low_r, range), seen.high_r = std::max(seen.high_r, range);
  }
  return covering_.overlaps(seen);
}

// Long edges come from a coarse border, not from across the view.
bool GapFaces::is_as_long_as_border(const Face& face, float extent) const {
  float border = 0;
  for (const std::uint32_t c : face.corner) border = std::max(border, longest_fence_[c]);
  return extent < 1.5f * border;
}

}  // namespace lapseam
