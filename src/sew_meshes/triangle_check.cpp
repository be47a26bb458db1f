#include "sew_meshes/triangle_check.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "core/parallel.h"
#include "health/predicates.h"

namespace lapseam {
namespace {

// Triangles that face away from each other by more than this are two sides of a sheet, or a step: not one layer.
constexpr double kSameLayerCosine = 0.3;

using Flat = std::array<Eigen::Vector2d, 3>;

/// Whether two triangles of a plane overlap by more than a point or an edge: no edge of either parts them.
bool do_overlap(const Flat& a, const Flat& b) {
  for (const auto& [x, y] : {std::pair(&a, &b), std::pair(&b, &a)}) {
    const double turn =
        ((*x)[1] - (*x)[0]).x() * ((*x)[2] - (*x)[0]).y() - ((*x)[1] - (*x)[0]).y() * ((*x)[2] - (*x)[0]).x();
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector2d edge = (*x)[(k + 1) % 3] - (*x)[k];
      const Eigen::Vector2d outward =
          turn > 0 ? Eigen::Vector2d(edge.y(), -edge.x()) : Eigen::Vector2d(-edge.y(), edge.x());
      double nearest = outward.dot((*y)[0] - (*x)[k]);
      for (std::size_t i = 1; i < 3; ++i) nearest = std::min(nearest, outward.dot((*y)[i] - (*x)[k]));
      if (nearest >= 0) return false;
    }
  }
  return true;
}

}  // namespace

bool do_triangles_cross(std::span<const Eigen::Vector3f> positions_m, const Triangle& t, const Triangle& s) {
  std::size_t shared = 0, in_t = 0, in_s = 0;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      if (t[i] == s[j]) ++shared, in_t = i, in_s = j;
  if (shared > 1) return false;
  const auto p = [&](std::uint32_t v) -> const Eigen::Vector3f& { return positions_m[v]; };
  const std::array a = {p(t[0]), p(t[1]), p(t[2])}, b = {p(s[0]), p(s[1]), p(s[2])};
  if (shared == 0) return do_triangles_meet(a, b);
  return do_segment_and_triangle_meet(a[(in_t + 1) % 3], a[(in_t + 2) % 3], b) ||
         do_segment_and_triangle_meet(b[(in_s + 1) % 3], b[(in_s + 2) % 3], a);
}

Box box_of(const LiveMesh& mesh, const Triangle& t) {
  Box box;
  for (const std::uint32_t v : t) box.extend(mesh.position(v));
  return box;
}

TriangleCheck::TriangleCheck(LiveMesh& mesh, std::span<const Eigen::Vector3f> vertex_normals, Context& context)
    : mesh_(mesh), normals_(vertex_normals) {
  std::vector<BoxEntry> entries;
  entries.reserve(mesh.triangle_count());
  for (std::uint32_t t = 0; t < mesh.triangle_count(); ++t)
    if (mesh.is_alive(t)) entries.push_back({box_of(mesh, mesh.triangle(t)), t});
  context.throw_if_cancelled();
  boxes_.add(std::move(entries));
}

bool TriangleCheck::is_valid(const Triangle& t, const TriangleRule& rule) const {
  return may_fit(t, rule) && is_clear(t, rule);
}

bool TriangleCheck::does_fit(const Triangle& t, const TriangleRule& rule) const {
  const auto p = [&](std::size_t k) -> const Eigen::Vector3f& { return mesh_.position(t[k]); };
  if (!(mesh_.area_normal(t).norm() > 0) || smallest_sine(p(0), p(1), p(2)) < rule.smallest_sine) return false;
  if (dominant_plane(p(0), p(1), p(2)) < 0) return false;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint32_t a = t[k], b = t[(k + 1) % 3];
    if (mesh_.find(a, b) != kInvalidIndex) return false;
    const std::uint32_t across = mesh_.find(b, a);
    if (across != kInvalidIndex && mesh_.apex(across, a, b) == t[(k + 2) % 3]) return false;  // two sides of one
  }
  if (rule.corner_cosine >= -1)
    for (std::size_t k = 0; k < 3; ++k)
      if (double(normals_[t[k]].dot(normals_[t[(k + 1) % 3]])) < rule.corner_cosine) return false;
  if (fold_of(t) < rule.fold_cosine) return false;
  return rule.facing_cosine < -1 || facing_of(t) >= rule.facing_cosine;
}

double TriangleCheck::fold_of(const Triangle& t) const {
  double fold = 1;
  const Eigen::Vector3d normal = mesh_.area_normal(t).stableNormalized();
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint32_t across = mesh_.find(t[(k + 1) % 3], t[k]);
    if (across == kInvalidIndex) continue;
    const Eigen::Vector3d other = mesh_.area_normal(across);
    if (!other.isZero(0)) fold = std::min(fold, normal.dot(other.stableNormalized()));
  }
  return fold;
}

double TriangleCheck::facing_of(const Triangle& t) const {
  if (normals_.empty()) return 1;
  const Eigen::Vector3d around =
      (normals_[t[0]].cast<double>() + normals_[t[1]].cast<double>() + normals_[t[2]].cast<double>())
          .stableNormalized();
  return mesh_.area_normal(t).stableNormalized().dot(around);
}

bool TriangleCheck::does_overlap(const Triangle& t, const Triangle& s, const Eigen::Vector3d& normal,
                                 const TriangleRule& rule) const {
  const Eigen::Vector3d other = mesh_.area_normal(s);
  if (normal.dot(other) < kSameLayerCosine * other.norm()) return false;
  const Eigen::Vector3d origin = mesh_.position(t[0]).cast<double>();
  const Eigen::Vector3d x = (mesh_.position(t[1]).cast<double>() - origin).normalized(), y = normal.cross(x);
  double low = 3e38, high = -3e38;
  Flat a, b;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3d p = mesh_.position(t[k]).cast<double>() - origin;
    const Eigen::Vector3d q = mesh_.position(s[k]).cast<double>() - origin;
    a[k] = {x.dot(p), y.dot(p)};
    b[k] = {x.dot(q), y.dot(q)};
    low = std::min(low, normal.dot(q)), high = std::max(high, normal.dot(q));
  }
  if (low > double(rule.layer_m) || high < -double(rule.layer_m)) return false;
  const Eigen::Vector2d center = (a[0] + a[1] + a[2]) / 3;
  for (Eigen::Vector2d& p : a) p += rule.slack * (center - p);
  return do_overlap(a, b);
}

bool TriangleCheck::is_clear(const Triangle& t, const TriangleRule& rule) const {
  const Eigen::Vector3d normal = mesh_.area_normal(t).stableNormalized();
  Box box = box_of(mesh_, t);
  box.low.array() -= rule.layer_m;
  box.high.array() += rule.layer_m;
  return !is_any_near(box, [&](const Triangle& s) {
    if (do_triangles_cross(mesh_.positions(), t, s)) return true;
    return rule.layer_m > 0 && does_overlap(t, s, normal, rule);
  });
}

std::vector<std::uint32_t> TriangleCheck::find_near(const Box& box) const {
  std::vector<std::uint32_t> near;
  find_boxes(box, [&](std::uint32_t id) {
    if (mesh_.is_alive(id)) near.push_back(id);
    return false;
  });
  std::sort(near.begin(), near.end());
  return near;
}

std::uint32_t TriangleCheck::add(const Triangle& t, TriangleTag tag) {
  const std::uint32_t id = mesh_.add(t, tag);
  boxes_.add({box_of(mesh_, t), id});
  return id;
}

}  // namespace lapseam
