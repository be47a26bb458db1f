// Based on: S. W. Sloan, A fast algorithm for generating constrained Delaunay triangulations, 1993.

#include "sew/planar_triangulation.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <deque>

namespace lapseam {
namespace {

__extension__ using Int128 = __int128;

constexpr int next(int k) { return k == 2 ? 0 : k + 1; }
constexpr int previous(int k) { return k == 0 ? 2 : k - 1; }

int sign(std::int64_t x) { return (x > 0) - (x < 0); }

int orientation(const GridPoint& a, const GridPoint& b, const GridPoint& c) {
  return sign((std::int64_t(b.x) - a.x) * (std::int64_t(c.y) - a.y) -
              (std::int64_t(b.y) - a.y) * (std::int64_t(c.x) - a.x));
}

template <typename Int>
bool is_in_circle_as(std::int64_t ax, std::int64_t ay, std::int64_t bx, std::int64_t by, std::int64_t cx,
                     std::int64_t cy) {
  const Int a2 = Int(ax) * ax + Int(ay) * ay, b2 = Int(bx) * bx + Int(by) * by, c2 = Int(cx) * cx + Int(cy) * cy;
  const Int det =
      Int(ax) * (Int(by) * c2 - b2 * cy) - Int(ay) * (Int(bx) * c2 - b2 * cx) + a2 * (Int(bx) * cy - Int(by) * cx);
  return det > 0;
}

// Whether d lies inside the circle through a, b, c (counter-clockwise).
bool is_in_circle(const GridPoint& a, const GridPoint& b, const GridPoint& c, const GridPoint& d) {
  const std::int64_t ax = std::int64_t(a.x) - d.x, ay = std::int64_t(a.y) - d.y, bx = std::int64_t(b.x) - d.x,
                     by = std::int64_t(b.y) - d.y, cx = std::int64_t(c.x) - d.x, cy = std::int64_t(c.y) - d.y;
  const std::int64_t largest =
      std::max({std::abs(ax), std::abs(ay), std::abs(bx), std::abs(by), std::abs(cx), std::abs(cy)});
  return largest < (1 << 14) ? is_in_circle_as<std::int64_t>(ax, ay, bx, by, cx, cy)
                             : is_in_circle_as<Int128>(ax, ay, bx, by, cx, cy);
}

// Points near each other in the order are near each other in the plane: rows of square blocks, back and forth.
std::vector<std::uint32_t> insertion_order(const std::vector<GridPoint>& points, std::uint32_t count) {
  std::vector<std::uint32_t> order(count);
  if (count == 0) return order;
  GridPoint low = points[0], high = points[0];
  for (std::uint32_t i = 0; i < count; ++i) {
    low = {std::min(low.x, points[i].x), std::min(low.y, points[i].y)};
    high = {std::max(high.x, points[i].x), std::max(high.y, points[i].y)};
    order[i] = i;
  }
  const double area = (double(high.x) - low.x + 1) * (double(high.y) - low.y + 1);
  const double block = std::max(1.0, std::sqrt(area * 4 / count));
  std::vector<std::uint64_t> key(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    const auto row = std::uint64_t((double(points[i].y) - low.y) / block);
    auto column = std::uint64_t((double(points[i].x) - low.x) / block);
    if (row & 1) column = 0x7FFFFFFF - column;
    key[i] = row << 32 | column;
  }
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t a, std::uint32_t b) { return key[a] != key[b] ? key[a] < key[b] : a < b; });
  return order;
}

}  // namespace

PlanarTriangulation::PlanarTriangulation(std::vector<GridPoint> points) : points_(std::move(points)) {
  const auto count = std::uint32_t(points_.size());
  const std::int32_t far = 4 * GridPoint::kLargest;
  points_.push_back({-far, -far});
  points_.push_back({far, -far});
  points_.push_back({0, far});
  face_of_.assign(points_.size(), kNone);
  faces_.reserve(std::size_t(count) * 2 + 1);
  faces_.push_back({});
  set_face(0, {count, count + 1, count + 2}, {kNone, kNone, kNone}, {false, false, false});
  for (const std::uint32_t i : insertion_order(points_, count)) insert(i);
}

bool PlanarTriangulation::is_real(const Face& face) const {
  const auto count = std::uint32_t(points_.size() - 3);
  return face.corner[0] < count && face.corner[1] < count && face.corner[2] < count;
}

int PlanarTriangulation::side(std::uint32_t a, std::uint32_t b, std::uint32_t c) const {
  return orientation(points_[a], points_[b], points_[c]);
}

void PlanarTriangulation::set_face(std::uint32_t f, std::array<std::uint32_t, 3> corner,
                                   std::array<std::uint32_t, 3> neighbor, std::array<bool, 3> constrained) {
  Face& face = faces_[f];
  face.corner = corner;
  face.neighbor = neighbor;
  face.constrained = std::uint8_t(int(constrained[0]) | (int(constrained[1]) << 1) | (int(constrained[2]) << 2));
  for (const std::uint32_t c : corner) face_of_[c] = f;
}

void PlanarTriangulation::replace_neighbor(std::uint32_t f, std::uint32_t old_neighbor, std::uint32_t new_neighbor) {
  if (f == kNone) return;
  for (std::uint32_t& n : faces_[f].neighbor)
    if (n == old_neighbor) {
      n = new_neighbor;
      return;
    }
}

// The face that holds p; edge: k when p lies on the edge opposite corner k, 3 + k when p is corner k, else −1.
std::uint32_t PlanarTriangulation::locate(const GridPoint& p, int& edge) const {
  std::uint32_t f = last_;
  for (;;) {
    const Face& face = faces_[f];
    edge = -1;
    bool moved = false;
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t a = face.corner[std::size_t(next(k))], b = face.corner[std::size_t(previous(k))];
      const int s = orientation(points_[a], points_[b], p);
      if (s < 0) {
        f = face.neighbor[std::size_t(k)];
        moved = true;
        break;
      }
      if (s == 0) edge = k;
    }
    if (moved) continue;
    for (int k = 0; k < 3; ++k)
      if (points_[face.corner[std::size_t(k)]] == p) edge = 3 + k;
    return f;
  }
}

void PlanarTriangulation::insert(std::uint32_t p) {
  int edge;
  const std::uint32_t f = locate(points_[p], edge);
  last_ = f;
  if (edge >= 3) return;
  if (edge >= 0)
    split_edge(f, edge, p);
  else
    split_face(f, p);
  legalize(p);
}

void PlanarTriangulation::split_face(std::uint32_t f, std::uint32_t p) {
  const auto [a, b, c] = faces_[f].corner;
  const auto [na, nb, nc] = faces_[f].neighbor;
  const auto f1 = std::uint32_t(faces_.size()), f2 = f1 + 1;
  faces_.resize(faces_.size() + 2);
  set_face(f, {p, b, c}, {na, f1, f2}, {false, false, false});
  set_face(f1, {p, c, a}, {nb, f2, f}, {false, false, false});
  set_face(f2, {p, a, b}, {nc, f, f1}, {false, false, false});
  replace_neighbor(nb, f, f1);
  replace_neighbor(nc, f, f2);
  stack_ = {f, f1, f2};
}

// Constraints are inserted after all points: no edge that is split is one.
void PlanarTriangulation::split_edge(std::uint32_t f, int k, std::uint32_t p) {
  const std::uint32_t g = faces_[f].neighbor[std::size_t(k)];
  const std::uint32_t a = faces_[f].corner[std::size_t(k)], b = faces_[f].corner[std::size_t(next(k))],
                      c = faces_[f].corner[std::size_t(previous(k))];
  const std::uint32_t fb = faces_[f].neighbor[std::size_t(next(k))],  // across c–a
      fc = faces_[f].neighbor[std::size_t(previous(k))];              // across a–b
  std::size_t j = 0;
  while (faces_[g].neighbor[j] != f) ++j;
  const std::uint32_t d = faces_[g].corner[j];
  // g: d, then c, then b, counter-clockwise
  const std::uint32_t gc = faces_[g].neighbor[std::size_t(next(int(j)))],  // across b–d
      gb = faces_[g].neighbor[std::size_t(previous(int(j)))];              // across d–c
  const auto f1 = std::uint32_t(faces_.size()), g1 = f1 + 1;
  faces_.resize(faces_.size() + 2);
  const std::array<bool, 3> free = {false, false, false};
  set_face(f, {p, a, b}, {fc, g, f1}, free);
  set_face(f1, {p, c, a}, {fb, f, g1}, free);
  set_face(g, {p, b, d}, {gc, g1, f}, free);
  set_face(g1, {p, d, c}, {gb, f1, g}, free);
  replace_neighbor(fb, f, f1);
  replace_neighbor(gb, g, g1);
  stack_ = {f, f1, g, g1};
}

// The two faces at the edge opposite corner k of f, (a, b, c) and (d, c, b), become (a, b, d) and (a, d, c).
void PlanarTriangulation::swap_diagonal(std::uint32_t f, int k) {
  const Face x = faces_[f];
  const std::uint32_t g = x.neighbor[std::size_t(k)];
  const Face y = faces_[g];
  std::size_t j = 0;
  while (y.neighbor[j] != f) ++j;
  const auto at = [](const auto& array, int i) { return array[std::size_t(i)]; };
  const auto bit = [](const Face& face, int i) { return (face.constrained >> i & 1) != 0; };
  const int kn = next(k), kp = previous(k), jn = next(int(j)), jp = previous(int(j));
  const std::uint32_t a = at(x.corner, k), b = at(x.corner, kn), c = at(x.corner, kp), d = y.corner[j];
  // y: d, c, b. Its edge opposite c (jn) is b–d, opposite b (jp) is d–c.
  const std::uint32_t across_ca = at(x.neighbor, kn), across_ab = at(x.neighbor, kp);
  const std::uint32_t across_bd = at(y.neighbor, jn), across_dc = at(y.neighbor, jp);
  set_face(f, {a, b, d}, {across_bd, g, across_ab}, {bit(y, jn), false, bit(x, kp)});
  set_face(g, {a, d, c}, {across_dc, across_ca, f}, {bit(y, jp), bit(x, kn), false});
  replace_neighbor(across_bd, g, f);
  replace_neighbor(across_ca, f, g);
}

bool PlanarTriangulation::is_swappable(std::uint32_t f, int k) const {
  const Face& x = faces_[f];
  const std::uint32_t g = x.neighbor[std::size_t(k)];
  if (g == kNone || (x.constrained >> k & 1)) return false;
  std::size_t j = 0;
  while (faces_[g].neighbor[j] != f) ++j;
  const std::uint32_t a = x.corner[std::size_t(k)], b = x.corner[std::size_t(next(k))],
                      c = x.corner[std::size_t(previous(k))], d = faces_[g].corner[j];
  return side(a, b, d) > 0 && side(a, d, c) > 0;
}

bool PlanarTriangulation::should_swap(std::uint32_t f, int k) const {
  if (!is_swappable(f, k)) return false;
  const Face& x = faces_[f];
  const std::uint32_t g = x.neighbor[std::size_t(k)];
  std::size_t j = 0;
  while (faces_[g].neighbor[j] != f) ++j;
  return is_in_circle(points_[x.corner[0]], points_[x.corner[1]], points_[x.corner[2]], points_[faces_[g].corner[j]]);
}

// Every face on the stack has p as corner 0; swaps keep that.
void PlanarTriangulation::legalize(std::uint32_t p) {
  while (!stack_.empty()) {
    const std::uint32_t f = stack_.back();
    stack_.pop_back();
    int k = 0;
    while (k < 3 && faces_[f].corner[std::size_t(k)] != p) ++k;
    if (k == 3 || !should_swap(f, k)) continue;
    const std::uint32_t g = faces_[f].neighbor[std::size_t(k)];
    swap_diagonal(f, k);
    stack_.push_back(f);
    stack_.push_back(g);
  }
}

bool PlanarTriangulation::find_edge(std::uint32_t a, std::uint32_t b, std::uint32_t& face, int& k) const {
  const std::uint32_t start = face_of_[a];
  // Around a counter-clockwise; a is never on the outside, since the frame is around all points.
  std::uint32_t f = start;
  do {
    const Face& x = faces_[f];
    int i = 0;
    while (x.corner[std::size_t(i)] != a) ++i;
    if (x.corner[std::size_t(next(i))] == b) {
      face = f;
      k = previous(i);
      return true;
    }
    f = x.neighbor[std::size_t(next(i))];
  } while (f != start && f != kNone);
  return false;
}

std::uint32_t PlanarTriangulation::face_left_of(std::uint32_t a, std::uint32_t b) const {
  std::uint32_t face = kNone;
  int k;
  return is_in(a) && is_in(b) && find_edge(a, b, face, k) ? face : kNone;
}

// Edges between a and b, as pairs of points. False when a point lies on the way, or a constraint.
bool PlanarTriangulation::find_crossed_edges(std::uint32_t a, std::uint32_t b,
                                             std::vector<std::uint64_t>& crossed) const {
  const std::uint32_t start = face_of_[a];
  std::uint32_t f = start;
  int k = 0;
  bool found = false;
  do {
    const Face& x = faces_[f];
    k = 0;
    while (x.corner[std::size_t(k)] != a) ++k;
    const std::uint32_t p = x.corner[std::size_t(next(k))], q = x.corner[std::size_t(previous(k))];
    const int sp = side(a, b, p), sq = side(a, b, q);
    // p to the right of the way, q to its left, and both ahead
    if (sp < 0 && sq > 0 && side(p, q, b) < 0) {
      found = true;
      break;
    }
    if (sp == 0) {  // p lies on the line: is it on the way?
      const GridPoint &A = points_[a], &B = points_[b], &P = points_[p];
      if ((std::int64_t(B.x) - A.x) * (std::int64_t(P.x) - A.x) +
              (std::int64_t(B.y) - A.y) * (std::int64_t(P.y) - A.y) >
          0)
        return false;
    }
    f = x.neighbor[std::size_t(next(k))];
  } while (f != start && f != kNone);
  if (!found) return false;
  for (;;) {
    const Face& x = faces_[f];
    const std::uint32_t p = x.corner[std::size_t(next(k))], q = x.corner[std::size_t(previous(k))];
    if (x.constrained >> k & 1) return false;
    crossed.push_back(std::uint64_t(p) << 32 | q);
    const std::uint32_t g = x.neighbor[std::size_t(k)];
    std::size_t j = 0;
    while (faces_[g].neighbor[j] != f) ++j;
    const std::uint32_t d = faces_[g].corner[j];
    if (d == b) return true;
    const int s = side(a, b, d);
    if (s == 0) return false;
    // g: d, q, p counter-clockwise. The way leaves through q–d or d–p.
    f = g;
    k = s > 0 ? next(int(j)) : previous(int(j));
  }
}

bool PlanarTriangulation::constrain(std::uint32_t a, std::uint32_t b) {
  if (a == b || !is_in(a) || !is_in(b)) return false;
  const auto mark = [&] {
    std::uint32_t f;
    int k;
    if (!find_edge(a, b, f, k)) return false;
    faces_[f].constrained |= std::uint8_t(1 << k);
    if (find_edge(b, a, f, k)) faces_[f].constrained |= std::uint8_t(1 << k);
    return true;
  };
  if (mark()) return true;
  std::vector<std::uint64_t> crossed;
  if (!find_crossed_edges(a, b, crossed)) return false;
  std::deque<std::uint64_t> queue(crossed.begin(), crossed.end());
  std::vector<std::uint64_t> made;
  while (!queue.empty()) {
    const std::uint64_t edge = queue.front();
    queue.pop_front();
    std::uint32_t f;
    int k;
    if (!find_edge(std::uint32_t(edge >> 32), std::uint32_t(edge), f, k)) continue;
    if (!is_swappable(f, k)) {
      queue.push_back(edge);
      continue;
    }
    swap_diagonal(f, k);
    // The new diagonal is corner 0 (of f) to corner 2 of f.
    const std::uint32_t p = faces_[f].corner[0], q = faces_[f].corner[2];
    const bool touches = p == a || p == b || q == a || q == b;
    if (!touches && side(a, b, p) * side(a, b, q) < 0)
      queue.push_back(std::uint64_t(p) << 32 | q);
    else
      made.push_back(std::uint64_t(p) << 32 | q);
  }
  mark();
  for (bool changed = true; changed;) {
    changed = false;
    for (std::uint64_t& edge : made) {
      std::uint32_t f;
      int k;
      if (!find_edge(std::uint32_t(edge >> 32), std::uint32_t(edge), f, k)) continue;
      if (!should_swap(f, k)) continue;
      swap_diagonal(f, k);
      edge = std::uint64_t(faces_[f].corner[0]) << 32 | faces_[f].corner[2];
      changed = true;
    }
  }
  return true;
}

}  // namespace lapseam
