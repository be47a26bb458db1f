#include "sew/covering.h"

#include <algorithm>
#include <atomic>
#include <functional>

#include "core/parallel.h"
#include "overlap/view_projection.h"

namespace lapseam {
namespace {

constexpr float kShrink = 0.9f;  // neighbours that share an edge or a corner do not overlap

// Whether an edge of a has all of b on its outer side.
bool is_separated(const std::array<Eigen::Vector2f, 3>& a, const std::array<Eigen::Vector2f, 3>& b) {
  const auto cross = [](const Eigen::Vector2f& p, const Eigen::Vector2f& r, const Eigen::Vector2f& x) {
    return (r.x() - p.x()) * (x.y() - p.y()) - (r.y() - p.y()) * (x.x() - p.x());
  };
  const float side = cross(a[0], a[1], a[2]) >= 0 ? 1.0f : -1.0f;
  for (std::size_t i = 0; i < 3; ++i) {
    const Eigen::Vector2f &p = a[i], &r = a[(i + 1) % 3];
    if (side * cross(p, r, b[0]) <= 0 && side * cross(p, r, b[1]) <= 0 && side * cross(p, r, b[2]) <= 0) return true;
  }
  return false;
}

}  // namespace

// Whether some of the chunk may lie at the depth that the view measured, and in focus.
bool Covering::may_matter(const Chunk& chunk) const {
  const CanvasPoint at = in_.canvas.project(chunk.center);
  if (!at.is_in || !(at.r > 2 * chunk.radius_m)) return true;
  const float size = in_.pixel_size_m(at);
  const float reach = 2 * chunk.radius_m / size;
  if (!(size > 0) || reach > float(in_.width) / 4) return true;
  if (!in_.is_in_focus(at.u - reach, at.u + reach, at.v - reach, at.v + reach)) return false;
  return in_.is_at_measured_depth(std::max(0, int(at.u - reach)), std::min(in_.width - 1, int(at.u + reach)),
                                  std::max(0, int(at.v - reach)), std::min(in_.height - 1, int(at.v + reach)),
                                  at.r - 2 * chunk.radius_m, at.r + 2 * chunk.radius_m, chunk.error_m);
}

void Covering::mark(Context& context) {
  if (in_.model.chunks.empty()) return;
  const ViewCone cone = make_cone(in_.patch);
  std::vector<std::size_t> seen;
  for (std::size_t i = 0; i < in_.model.chunks.size(); ++i)
    if (cone.can_see(in_.canvas.T_view_model() * in_.model.chunks[i].center, in_.model.chunks[i].radius_m) &&
        may_matter(in_.model.chunks[i]))
      seen.push_back(i);
  std::vector<std::vector<Beneath>> beneath(seen.size());
  parallel_for(context, seen.size(), 32, [&](std::size_t i) {
    const Chunk& chunk = in_.model.chunks[seen[i]];
    // Neighbouring triangles share corners: each is projected about once.
    constexpr std::uint32_t kCache = 512;
    std::array<std::uint32_t, kCache> cached;
    std::array<CanvasPoint, kCache> points;
    cached.fill(kInvalidIndex);
    for (std::size_t t = chunk.first; t < chunk.last; ++t) {
      std::array<CanvasPoint, 3> p;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t v = in_.model.mesh.triangles[t][k], slot = v % kCache;
        if (cached[slot] != v) {
          cached[slot] = v;
          points[slot] = in_.canvas.project(in_.model.mesh.positions_m[v]);
        }
        p[k] = points[slot];
      }
      if (!in_.patch.grid.wraps || is_apart(p)) {
        cover(t, p, beneath[i]);
        continue;
      }
      // Across the cut of a panorama: once at either side.
      for (CanvasPoint& q : p) q.u += q.u < 0.5f * float(in_.width) ? float(in_.width) : 0.0f;
      cover(t, p, beneath[i]);
      for (CanvasPoint& q : p) q.u -= float(in_.width);
      cover(t, p, beneath[i]);
    }
  });
  for (const auto& list : beneath) beneath_.insert(beneath_.end(), list.begin(), list.end());
  parallel_sort(context, beneath_.begin(), beneath_.end(), std::less<>());
}

// Not across the cut of a panorama.
bool Covering::is_apart(const std::array<CanvasPoint, 3>& p) const {
  const auto [low, high] = std::minmax({p[0].u, p[1].u, p[2].u});
  return high - low <= 0.5f * float(in_.width);
}

void Covering::cover(std::size_t t, const std::array<CanvasPoint, 3>& p, std::vector<Beneath>& beneath) {
  if (!(p[0].r > 0) || !(p[1].r > 0) || !(p[2].r > 0)) return;
  const auto [u_low, u_high] = std::minmax({p[0].u, p[1].u, p[2].u});
  const auto [v_low, v_high] = std::minmax({p[0].v, p[1].v, p[2].v});
  const float bulge = in_.bulge_of(std::max(u_high - u_low, v_high - v_low));
  const int u_first = std::max(0, int(std::floor(u_low - bulge))),
            v_first = std::max(0, int(std::floor(v_low - bulge)));
  const int u_last = std::min(in_.width - 1, int(std::floor(u_high + bulge)));
  const int v_last = std::min(in_.height - 1, int(std::floor(v_high + bulge)));
  if (u_first > u_last || v_first > v_last) return;
  if (!in_.is_in_focus(u_low - bulge, u_high + bulge, v_low - bulge, v_high + bulge)) return;
  const Triangle& corners = in_.model.mesh.triangles[t];
  int facing = 0;
  float error = 0;
  for (const std::uint32_t v : corners) {
    facing += in_.is_front(in_.model.mesh.positions_m[v], in_.model.normal[v]);
    error = std::max(error, in_.model.error_m[v]);
  }
  if (facing < 2) return;
  const float low_r = std::min({p[0].r, p[1].r, p[2].r}), high_r = std::max({p[0].r, p[1].r, p[2].r});
  if (!in_.is_at_measured_depth(u_first, u_last, v_first, v_last, low_r, high_r, error)) return;
  for (int v = v_first; v <= v_last; ++v)
    for (int u = u_first; u <= u_last; ++u)
      if (in_.cell.at(u, v) && in_.is_focused(u, v))
        beneath.push_back({std::uint32_t(in_.cell.index(u, v)), std::uint32_t(t)});
  const int u0 = std::max(0, int(std::ceil(u_low - bulge))), u1 = u_last;
  const int v0 = std::max(0, int(std::ceil(v_low - bulge))), v1 = v_last;
  if (u0 > u1 || v0 > v1) return;
  const float area = in_.turn(p[0], p[1], p[2]);
  if (area == 0) return;
  // The plane of the triangle, for the range where a pixel's ray meets it.
  const Eigen::Vector3f a = in_.canvas.T_view_model() * in_.model.mesh.positions_m[corners[0]];
  const Eigen::Vector3f ab = in_.canvas.T_view_model().linear() *
                             (in_.model.mesh.positions_m[corners[1]] - in_.model.mesh.positions_m[corners[0]]);
  const Eigen::Vector3f ac = in_.canvas.T_view_model().linear() *
                             (in_.model.mesh.positions_m[corners[2]] - in_.model.mesh.positions_m[corners[0]]);
  const Eigen::Vector3f n = ab.cross(ac);
  const float sign = area > 0 ? 1.0f : -1.0f;
  const bool is_curved = bulge > 0;
  const std::array<Eigen::Vector3f, 3> corner = {a, a + ab, a + ac};
  for (int v = v0; v <= v1; ++v)
    for (int u = u0; u <= u1; ++u) {
      const std::size_t pixel = in_.canvas.pixel(u, v);
      const float measured = in_.patch.view.range.pixels[pixel];
      if (!(in_.patch.confidence.pixels[pixel] > 0)) continue;
      const Eigen::Vector3f& d = in_.patch.rays->directions[pixel];
      if (is_curved) {
        if (!ModelInView::passes_through(corner, d)) continue;
      } else {
        CanvasPoint q;
        q.u = float(u), q.v = float(v);
        if (sign * in_.turn(p[0], p[1], q) < 0 || sign * in_.turn(p[1], p[2], q) < 0 ||
            sign * in_.turn(p[2], p[0], q) < 0)
          continue;
      }
      const Eigen::Vector3f o =
          in_.patch.rays->origins.empty() ? Eigen::Vector3f(Eigen::Vector3f::Zero()) : in_.patch.rays->origins[pixel];
      const float along = n.dot(d);
      float r = along != 0 ? n.dot(a - o) / along : low_r;
      r = std::clamp(r, low_r, high_r);
      const float slack = in_.canvas.tolerance(pixel, error);
      const float difference = std::abs(measured - r);
      if (difference <= ModelInView::kShadowFactor * slack)
        std::atomic_ref<std::uint8_t>(in_.sample.at(u, v))
            .fetch_or(difference <= slack ? ModelInView::kCovered | ModelInView::kShadowed : ModelInView::kShadowed,
                      std::memory_order_relaxed);
    }
}

// Whether the ray through a corner or the middle of a face meets a model triangle.
bool Covering::meets_curved(const Triangle& t, const std::array<Eigen::Vector2f, 3>& face,
                            const Eigen::Vector2f& middle) const {
  std::array<Eigen::Vector3f, 3> corner;
  for (std::size_t k = 0; k < 3; ++k) corner[k] = in_.canvas.T_view_model() * in_.model.mesh.positions_m[t[k]];
  for (const Eigen::Vector2f& p : {face[0], face[1], face[2], middle})
    if (ModelInView::passes_through(corner, in_.canvas.direction(p.x(), in_.patch.grid.is_mirrored ? p.y() : -p.y())))
      return true;
  return false;
}

bool Covering::overlaps(const Face& face) const {
  std::array<Eigen::Vector2f, 3> q = face.corner;
  const Eigen::Vector2f middle = (q[0] + q[1] + q[2]) / 3;
  float low_u = 1e9f, low_v = 1e9f, high_u = -1e9f, high_v = -1e9f;
  for (Eigen::Vector2f& c : q) {
    c = middle + kShrink * (c - middle);
    const float v = in_.patch.grid.is_mirrored ? c.y() : -c.y();
    low_u = std::min(low_u, c.x()), high_u = std::max(high_u, c.x());
    low_v = std::min(low_v, v), high_v = std::max(high_v, v);
  }
  for (int v = std::max(0, int(std::floor(low_v))); v <= std::min(in_.height - 1, int(std::floor(high_v))); ++v)
    for (int u = std::max(0, int(std::floor(low_u))); u <= std::min(in_.width - 1, int(std::floor(high_u))); ++u) {
      const auto cell = std::uint32_t(in_.cell.index(u, v));
      for (auto it = std::lower_bound(beneath_.begin(), beneath_.end(), Beneath{cell, 0});
           it != beneath_.end() && it->cell == cell; ++it) {
        const Triangle& t = in_.model.mesh.triangles[it->triangle];
        std::array<Eigen::Vector2f, 3> c;
        float low = 1e9f, high = 0, error = 0;
        int facing = 0;
        for (std::size_t k = 0; k < 3; ++k) {
          const CanvasPoint p = in_.canvas.project(in_.model.mesh.positions_m[t[k]]);
          c[k] = Eigen::Vector2f(p.u, in_.patch.grid.is_mirrored ? p.v : -p.v);
          low = std::min(low, p.r), high = std::max(high, p.r);
          error = std::max(error, in_.model.error_m[t[k]]);
          facing += in_.is_front(in_.model.mesh.positions_m[t[k]], in_.model.normal[t[k]]);
        }
        if (facing < 2) continue;
        const float slack = in_.canvas.tolerance(in_.canvas.pixel(u, v), error);
        if (low > face.high_r + slack || high < face.low_r - slack) continue;
        const auto [c_low, c_high] = std::minmax({c[0].x(), c[1].x(), c[2].x()});
        const auto [d_low, d_high] = std::minmax({c[0].y(), c[1].y(), c[2].y()});
        if (in_.bulge_of(std::max(c_high - c_low, d_high - d_low)) > 0.05f) {
          if (meets_curved(t, q, middle)) return true;
        } else if (!is_separated(q, c) && !is_separated(c, q)) {
          return true;
        }
      }
    }
  return false;
}

}  // namespace lapseam
