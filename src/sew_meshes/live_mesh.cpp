#include "sew_meshes/live_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace lapseam {

LiveMesh::LiveMesh(Mesh& mesh)
    : mesh_(mesh),
      alive_(mesh.triangle_count(), 1),
      head_(mesh.vertex_count(), kInvalidIndex),
      next_(3 * mesh.triangle_count(), kInvalidIndex),
      is_touched_(mesh.vertex_count(), 0) {
  for (std::uint32_t t = 0; t < mesh.triangle_count(); ++t) link(t);
}

LiveMesh::LiveMesh(const LiveMesh* original)
    : mesh_(original->mesh_), original_(original), first_drafted_(std::uint32_t(original->triangle_count())) {}

std::vector<std::uint32_t> LiveMesh::removed() const {
  std::vector<std::uint32_t> removed(is_removed_.begin(), is_removed_.end());
  std::sort(removed.begin(), removed.end());
  return removed;
}

void LiveMesh::set_head(std::uint32_t v, std::uint32_t corner) {
  if (original_)
    changed_head_[v] = corner;
  else
    head_[v] = corner;
}

void LiveMesh::set_next(std::uint32_t corner, std::uint32_t to) {
  if (!original_)
    next_[corner] = to;
  else if (corner / 3 >= first_drafted_)
    drafted_[corner / 3 - first_drafted_].next[corner % 3] = to;
  else
    changed_next_[corner] = to;
}

void LiveMesh::set_alive(std::uint32_t t, bool is_alive) {
  if (!original_)
    alive_[t] = is_alive;
  else if (t >= first_drafted_)
    drafted_[t - first_drafted_].is_alive = is_alive;
  else if (is_alive)
    is_removed_.erase(t);
  else
    is_removed_.insert(t);
}

void LiveMesh::link(std::uint32_t t) {
  for (std::uint32_t k = 0; k < 3; ++k) {
    const std::uint32_t v = triangle(t)[k];
    set_next(3 * t + k, head(v));
    set_head(v, 3 * t + k);
  }
}

void LiveMesh::unlink(std::uint32_t t) {
  for (std::uint32_t k = 0; k < 3; ++k) {
    const std::uint32_t v = triangle(t)[k], gone = 3 * t + k, after = next(gone);
    std::uint32_t before = head(v);
    if (before == gone) {
      set_head(v, after);
      continue;
    }
    while (next(before) != gone) before = next(before);
    set_next(before, after);
  }
}

std::uint32_t LiveMesh::find(std::uint32_t a, std::uint32_t b) const {
  for (std::uint32_t corner = head(a); corner != kInvalidIndex; corner = next(corner))
    if (triangle(corner / 3)[(corner % 3 + 1) % 3] == b) return corner / 3;
  return kInvalidIndex;
}

std::uint32_t LiveMesh::apex(std::uint32_t t, std::uint32_t a, std::uint32_t b) const {
  for (const std::uint32_t v : triangle(t))
    if (v != a && v != b) return v;
  return kInvalidIndex;
}

void LiveMesh::open_out(std::uint32_t v, std::vector<std::uint32_t>& out) const {
  out.clear();
  for (std::uint32_t corner = head(v); corner != kInvalidIndex; corner = next(corner)) {
    const std::uint32_t to = triangle(corner / 3)[(corner % 3 + 1) % 3];
    if (find(to, v) == kInvalidIndex) out.push_back(to);
  }
  std::sort(out.begin(), out.end());
}

void LiveMesh::open_in(std::uint32_t v, std::vector<std::uint32_t>& in) const {
  in.clear();
  for (std::uint32_t corner = head(v); corner != kInvalidIndex; corner = next(corner)) {
    const std::uint32_t from = triangle(corner / 3)[(corner % 3 + 2) % 3];
    if (find(v, from) == kInvalidIndex) in.push_back(from);
  }
  std::sort(in.begin(), in.end());
}

bool LiveMesh::is_on_border(std::uint32_t v) const {
  for (std::uint32_t corner = head(v); corner != kInvalidIndex; corner = next(corner))
    if (find(triangle(corner / 3)[(corner % 3 + 1) % 3], v) == kInvalidIndex) return true;
  return false;
}

std::size_t LiveMesh::count_fans(std::uint32_t v) const {
  std::size_t corners = 0, open = 0, reached = 0;
  for (std::uint32_t corner = head(v); corner != kInvalidIndex; corner = next(corner)) {
    ++corners;
    open += find(triangle(corner / 3)[(corner % 3 + 1) % 3], v) == kInvalidIndex;
  }
  if (corners == 0 || open > 1) return corners == 0 ? 0 : open;
  // At most one open fan: whatever a walk from it does not reach is a closed one.
  std::uint32_t t = head(v) / 3;
  for (std::uint32_t corner = head(v); corner != kInvalidIndex; corner = next(corner))
    if (find(triangle(corner / 3)[(corner % 3 + 1) % 3], v) == kInvalidIndex) t = corner / 3;
  const std::uint32_t first = t;
  do {
    ++reached;
    const Triangle& c = triangle(t);
    const std::size_t k = c[0] == v ? 0 : c[1] == v ? 1 : 2;
    t = find(v, c[(k + 2) % 3]);
  } while (t != kInvalidIndex && t != first && reached < corners);
  return reached == corners ? 1 : 2;
}

Eigen::Vector3d LiveMesh::area_normal(const Triangle& t) const {
  const Eigen::Vector3d a = position(t[0]).cast<double>();
  return (position(t[1]).cast<double>() - a).cross(position(t[2]).cast<double>() - a);
}

void LiveMesh::remove(std::uint32_t t) {
  unlink(t);
  set_alive(t, false);
  if (original_) return;
  const Triangle& c = triangle(t);
  for (std::size_t k = 0; k < 3; ++k) {
    cut_.insert(key(c[(k + 1) % 3], c[k]));
    is_touched_[c[k]] = 1;
  }
}

void LiveMesh::restore(std::uint32_t t) {
  set_alive(t, true);
  link(t);
}

std::uint32_t LiveMesh::append(const Triangle& t, TriangleTag tag) {
  const auto id = std::uint32_t(triangle_count());
  if (original_) {
    drafted_.push_back({t, tag, true, {}});
    return id;
  }
  mesh_.triangles.push_back(t);
  mesh_.triangle_tag.push_back(tag);
  if (!mesh_.triangle_view.empty()) {
    const auto view = [&](std::size_t k) {
      return mesh_.vertex_view.empty() ? kInvalidIndex : mesh_.vertex_view[t[k]];
    };
    mesh_.triangle_view.push_back(view(1) == view(2) ? view(1) : view(0));
  }
  alive_.push_back(1);
  next_.resize(next_.size() + 3, kInvalidIndex);
  for (std::size_t k = 0; k < 3; ++k) {
    cut_.insert(key(t[k], t[(k + 1) % 3]));
    is_touched_[t[k]] = 1;
  }
  return id;
}

std::uint32_t LiveMesh::add(const Triangle& t, TriangleTag tag) {
  const std::uint32_t id = append(t, tag);
  link(id);
  return id;
}

std::vector<std::array<std::uint32_t, 2>> LiveMesh::cut_edges() const {
  std::vector<std::array<std::uint32_t, 2>> edges;
  std::vector<std::uint32_t> out;
  for (std::uint32_t a = 0; a < is_touched_.size(); ++a) {
    if (!is_touched_[a]) continue;
    open_out(a, out);
    for (const std::uint32_t b : out)
      if (is_cut(a, b)) edges.push_back({a, b});
  }
  return edges;
}

double smallest_sine(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c) {
  const Eigen::Vector3d p = a.cast<double>(), q = b.cast<double>(), r = c.cast<double>();
  const double area2 = (q - p).cross(r - p).norm();
  double sides[3] = {(q - p).norm(), (r - q).norm(), (p - r).norm()};
  std::sort(sides, sides + 3);
  // The smallest angle lies between the two longer sides.
  const double product = sides[1] * sides[2];
  return product > 0 ? area2 / product : 0;
}

}  // namespace lapseam
