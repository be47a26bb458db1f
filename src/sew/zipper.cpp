// Based on: G. Turk, M. Levoy, Zippered Polygon Meshes from Range Images, 1994, §4; and Y. Sun, C. Dumont, M. Abidi,
// Mesh-based Integration of Range and Color Images, 2000, §2.2 (overlap in the new view's image) and §2.3 (gaps).

#include "lapseam/sew.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <unordered_map>
#include <unordered_set>

#include "core/parallel.h"
#include "overlap/view_projection.h"
#include "patch/wide_normal.h"
#include "sew/planar_triangulation.h"
#include "sew/view_canvas.h"
#include "triangulate/adaptive_triangles.h"

namespace lapseam {
namespace {

constexpr float kGridPerPixel = 1024;  // resolution of the planar triangulation
constexpr float kNearWall_px = 0.3f;   // samples nearer to the model's border than this would make slivers
constexpr float kLongest_px = 6;       // edges of seams, unless the border itself has longer ones
constexpr float kWallStep_px = 0.25f;  // sampling of borders and of triangle interiors
// A sample may be left out when it is this close to the surface without it, in standard deviations of its range.
constexpr float kFlatness = 0.3f;
// Beyond the outline's triangles a face must agree with the nearest sample to this share of the tolerance: about a
// standard deviation. With all of it, faces lean out over steps.
constexpr float kFootprintTolerance = 0.4f;
// A sample this many tolerances from the model is still no new surface, but one that views disagree about.
constexpr float kShadowFactor = 2;
constexpr std::size_t kChunk = 256;         // triangles that are culled together
constexpr double kFarFromOrigin_m = 100.0;  // floats hold a millimetre's hundredth up to here

struct OpenEdge {
  std::uint32_t a, b, triangle;
};

// Triangles [first, last), all inside a sphere.
struct Chunk {
  std::size_t first, last;
  Eigen::Vector3f center;
  float radius_m;
  float error_m;  // largest of its vertices
};

std::uint64_t undirected(std::uint32_t a, std::uint32_t b) {
  return a < b ? std::uint64_t(a) << 32 | b : std::uint64_t(b) << 32 | a;
}

// Sides of one edge next to each other.
bool is_before(const OpenEdge& x, const OpenEdge& y) {
  const std::uint64_t kx = undirected(x.a, x.b), ky = undirected(y.a, y.b);
  return kx != ky ? kx < ky : x.triangle < y.triangle;
}

// In the world's directions, × 127.
Eigen::Matrix<std::int8_t, 3, 1> normal_at(const Patch& patch, std::size_t pixel) {
  const auto w = std::size_t(patch.grid.width);
  const Eigen::Vector3f normal =
      patch.view.T_world_view.linear().cast<float>() * WideNormal(patch).at(int(pixel % w), int(pixel / w));
  return (normal * 127).array().round().matrix().cast<std::int8_t>();
}

// Which places of its image a view works at.
enum class Where : std::uint8_t {
  kWanted,  // at wanted samples
  kBorder,  // at the model's border
};

}  // namespace

struct Zipper::Impl {
  std::span<const Patch> patches;
  OverlapOptions options;
  Mesh mesh;
  std::vector<float> error_m;                            // per vertex, along its normal
  std::vector<Eigen::Matrix<std::int8_t, 3, 1>> normal;  // per vertex, × 127
  std::vector<OpenEdge> open;
  std::vector<Chunk> chunks;
  std::unordered_set<std::uint64_t> border_edges;  // edges between vertices that were on the border when made
  std::vector<std::uint32_t> local_of_vertex;      // scratch, all kInvalidIndex between calls
  ZipperReport report;
  std::vector<std::uint8_t> times_added;

  void add(std::uint32_t index, const Image<std::uint8_t>& wanted, Where where, Context& context);
  void find_border();
  void add_chunks(std::size_t begin);

  class Step;
};

// One view's turn.
class Zipper::Impl::Step {
 public:
  Step(Impl& model, std::uint32_t index, const Image<std::uint8_t>& wanted, int shift, Where where, Context& context)
      : m_(model),
        index_(index),
        patch_(model.patches[index]),
        wanted_(wanted),
        where_(where),
        context_(context),
        canvas_(patch_, model.mesh.origin_m, model.options, shift),
        w_(canvas_.width()),
        h_(canvas_.height()),
        sample_(w_, h_, 0),
        cell_(w_, h_, 0),
        local_of_sample_(w_, h_, kInvalidIndex) {
    const std::size_t middle = patch_.rays->directions.size() / 2;
    pixel_angle_ =
        (patch_.rays->directions[middle].normalized() - patch_.rays->directions[middle + 1].normalized()).norm();
  }

  void run() {
    focus_ = Image<std::uint8_t>(w_ / kTile_px + 1, h_ / kTile_px + 1, where_ == Where::kBorder);
    if (where_ == Where::kWanted && !focus_on_wanted()) return;
    find_depth_blocks();
    find_walls();
    if (where_ == Where::kBorder && !focus_on_border()) return;
    block_out_of_focus();
    mark_walls();
    mark_covered();
    emit_grid();
    triangulate_gaps();
    update_border();
  }

 private:
  // bits of sample_
  static constexpr std::uint8_t kCovered = 1, kNear = 2, kEmitted = 4, kShadowed = 8;
  // bits of cell_
  static constexpr std::uint8_t kWall = 1, kBlocked = 2;

  enum class WallKind : std::uint8_t { kElsewhere, kWall, kBlocked };
  struct Wall {
    std::uint32_t open;  // index into m_.open
    CanvasPoint a, b;
  };

  bool is_front(const Eigen::Vector3f& position, const Eigen::Matrix<std::int8_t, 3, 1>& normal) const {
    return canvas_.ray_to(position).dot(normal.cast<float>()) < 0;
  }

  float turn(const CanvasPoint& a, const CanvasPoint& b, const CanvasPoint& c) const {
    const float area = (b.u - a.u) * (c.v - a.v) - (b.v - a.v) * (c.u - a.u);
    return patch_.grid.is_mirrored ? area : -area;  // rows run down
  }

  // ---- where to work
  static constexpr int kTile_px = 8;
  static constexpr float kFocusMargin_px = 6;

  bool is_focused(int u, int v) const { return focus_.at(u / kTile_px, v / kTile_px) != 0; }

  void focus_around(float u, float v, float radius_px) {
    const auto tile = [](float x, int size) { return std::clamp(int(x), 0, size - 1) / kTile_px; };
    for (int y = tile(v - radius_px, h_); y <= tile(v + radius_px, h_); ++y)
      for (int x = tile(u - radius_px, w_); x <= tile(u + radius_px, w_); ++x) focus_.at(x, y) = 1;
  }

  // Tiles with wanted samples, and those around them.
  bool focus_on_wanted() {
    Image<std::uint8_t> has(focus_.width, focus_.height, 0);
    bool any = false;
    for (int v = 0; v < h_; ++v)
      for (int u = 0; u < w_; ++u)
        if (wanted_.pixels[canvas_.pixel(u, v)]) has.at(u / kTile_px, v / kTile_px) = any = true;
    for (int y = 0; y < has.height; ++y)
      for (int x = 0; x < has.width; ++x)
        if (has.at(x, y))
          for (int j = std::max(0, y - 1); j <= std::min(has.height - 1, y + 1); ++j)
            for (int i = std::max(0, x - 1); i <= std::min(has.width - 1, x + 1); ++i) focus_.at(i, j) = 1;
    return any;
  }

  bool focus_on_border() {
    std::fill(focus_.pixels.begin(), focus_.pixels.end(), std::uint8_t(0));
    for (const Wall& wall : walls_)
      for (const CanvasPoint& end : {wall.a, wall.b}) focus_around(end.u, end.v, kFocusMargin_px);
    return !walls_.empty();
  }

  void block_out_of_focus() {
    for (int v = 0; v < h_; ++v)
      for (int u = 0; u < w_; ++u)
        if (!is_focused(u, v)) cell_.at(u, v) = kBlocked;
  }

  // Distance between neighbouring rays at a point.
  float pixel_size_m(const CanvasPoint& at) const {
    const int u = std::clamp(int(at.u), 0, w_ - 2), v = std::clamp(int(at.v), 0, h_ - 1);
    const std::size_t a = canvas_.pixel(u, v), b = canvas_.pixel(u + 1, v);
    return (patch_.rays->point(a, at.r) - patch_.rays->point(b, at.r)).norm();
  }

  bool is_in_focus(float u_low, float u_high, float v_low, float v_high) const {
    const auto tile = [](float x, int size) { return std::clamp(int(std::floor(x)), 0, size - 1) / kTile_px; };
    for (int v = tile(v_low, h_); v <= tile(v_high, h_); ++v)
      for (int u = tile(u_low, w_); u <= tile(u_high, w_); ++u)
        if (focus_.at(u, v)) return true;
    return false;
  }

  // Whether some of the chunk may lie at the depth that the view measured, and where mending goes on.
  bool may_matter(const Chunk& chunk) const {
    const CanvasPoint at = canvas_.project(chunk.center);
    if (!at.is_in || !(at.r > 2 * chunk.radius_m)) return true;
    const float size = pixel_size_m(at);
    const float reach = 2 * chunk.radius_m / size;
    if (!(size > 0) || reach > float(w_) / 4) return true;
    if (!is_in_focus(at.u - reach, at.u + reach, at.v - reach, at.v + reach)) return false;
    return is_at_measured_depth(std::max(0, int(at.u - reach)), std::min(w_ - 1, int(at.u + reach)),
                                std::max(0, int(at.v - reach)), std::min(h_ - 1, int(at.v + reach)),
                                at.r - 2 * chunk.radius_m, at.r + 2 * chunk.radius_m, chunk.error_m);
  }

  // ---- what the model covers already
  void mark_covered() {
    if (m_.chunks.empty()) return;
    const ViewCone cone = make_cone(patch_);
    std::vector<std::size_t> seen;
    for (std::size_t i = 0; i < m_.chunks.size(); ++i)
      if (cone.can_see(canvas_.T_view_model() * m_.chunks[i].center, m_.chunks[i].radius_m) && may_matter(m_.chunks[i]))
        seen.push_back(i);
    std::vector<std::vector<Beneath>> beneath(seen.size());
    parallel_for(context_, seen.size(), 32, [&](std::size_t i) {
      const Chunk& chunk = m_.chunks[seen[i]];
      // Neighbouring triangles share corners: each is projected about once.
      constexpr std::uint32_t kCache = 512;
      std::array<std::uint32_t, kCache> cached;
      std::array<CanvasPoint, kCache> points;
      cached.fill(kInvalidIndex);
      for (std::size_t t = chunk.first; t < chunk.last; ++t) {
        std::array<CanvasPoint, 3> p;
        for (std::size_t k = 0; k < 3; ++k) {
          const std::uint32_t v = m_.mesh.triangles[t][k], slot = v % kCache;
          if (cached[slot] != v) {
            cached[slot] = v;
            points[slot] = canvas_.project(m_.mesh.positions_m[v]);
          }
          p[k] = points[slot];
        }
        if (!patch_.grid.wraps || is_apart(p)) {
          cover(t, p, beneath[i]);
          continue;
        }
        // Across the cut of a panorama: once at either side.
        for (CanvasPoint& q : p) q.u += q.u < 0.5f * float(w_) ? float(w_) : 0.0f;
        cover(t, p, beneath[i]);
        for (CanvasPoint& q : p) q.u -= float(w_);
        cover(t, p, beneath[i]);
      }
    });
    for (const auto& list : beneath) beneath_.insert(beneath_.end(), list.begin(), list.end());
    std::sort(beneath_.begin(), beneath_.end());
  }

  // Not across the cut of a panorama.
  bool is_apart(const std::array<CanvasPoint, 3>& p) const {
    const auto [low, high] = std::minmax({p[0].u, p[1].u, p[2].u});
    return high - low <= 0.5f * float(w_);
  }

  // Straight edges are curved in the images of sensors that are no plain pinhole: by up to this much, in pixels.
  float bulge_of(float extent_px) const {
    if (canvas_.is_pinhole() || !canvas_.is_central() || extent_px < 4) return 0;
    return 0.25f * extent_px * extent_px * pixel_angle_;
  }

  // Whether a ray from the sensor meets a triangle given in the sensor's frame.
  static bool passes_through(const std::array<Eigen::Vector3f, 3>& corner, const Eigen::Vector3f& ray) {
    const float s0 = ray.dot(corner[0].cross(corner[1])), s1 = ray.dot(corner[1].cross(corner[2])),
                s2 = ray.dot(corner[2].cross(corner[0]));
    return (s0 >= 0 && s1 >= 0 && s2 >= 0) || (s0 <= 0 && s1 <= 0 && s2 <= 0);
  }

  // Ranges in blocks of the image, widened by the largest tolerance there: most of what a view could see of the model
  // is hidden from it, and need not be drawn.
  struct DepthBlock {
    float low = 3e38f, high = 0;
  };
  static constexpr int kDepthBlock_px = 8;

  void find_depth_blocks() {
    depth_ = Image<DepthBlock>(w_ / kDepthBlock_px + 1, h_ / kDepthBlock_px + 1);
    for (int v = 0; v < h_; ++v)
      for (int u = 0; u < w_; ++u) {
        const std::size_t pixel = canvas_.pixel(u, v);
        const float r = patch_.view.range.pixels[pixel];
        if (!(r > 0)) continue;
        DepthBlock& block = depth_.at(u / kDepthBlock_px, v / kDepthBlock_px);
        block.low = std::min(block.low, r);
        block.high = std::max(block.high, r);
      }
    for (DepthBlock& block : depth_.pixels) {
      const float slack = kShadowFactor * canvas_.largest_tolerance(block.high, 0);
      block.low -= slack;
      block.high += slack;
    }
  }

  bool is_at_measured_depth(int u0, int u1, int v0, int v1, float low_r, float high_r, float error_m) const {
    const float slack = kShadowFactor * canvas_.largest_tolerance(0, error_m);
    for (int v = v0 / kDepthBlock_px; v <= v1 / kDepthBlock_px; ++v)
      for (int u = u0 / kDepthBlock_px; u <= u1 / kDepthBlock_px; ++u) {
        const DepthBlock& block = depth_.at(u, v);
        if (low_r <= block.high + slack && high_r >= block.low - slack) return true;
      }
    return false;
  }

  // A model triangle in a cell that the model's border passes through.
  struct Beneath {
    std::uint32_t cell, triangle;
    auto operator<=>(const Beneath&) const = default;
  };

  void cover(std::size_t t, const std::array<CanvasPoint, 3>& p, std::vector<Beneath>& beneath) {
    if (!(p[0].r > 0) || !(p[1].r > 0) || !(p[2].r > 0)) return;
    const auto [u_low, u_high] = std::minmax({p[0].u, p[1].u, p[2].u});
    const auto [v_low, v_high] = std::minmax({p[0].v, p[1].v, p[2].v});
    const float bulge = bulge_of(std::max(u_high - u_low, v_high - v_low));
    const int u_first = std::max(0, int(std::floor(u_low - bulge))),
              v_first = std::max(0, int(std::floor(v_low - bulge)));
    const int u_last = std::min(w_ - 1, int(std::floor(u_high + bulge)));
    const int v_last = std::min(h_ - 1, int(std::floor(v_high + bulge)));
    if (u_first > u_last || v_first > v_last) return;
    if (!is_in_focus(u_low - bulge, u_high + bulge, v_low - bulge, v_high + bulge)) return;
    const Triangle& corners = m_.mesh.triangles[t];
    int facing = 0;
    float error = 0;
    for (const std::uint32_t v : corners) {
      facing += is_front(m_.mesh.positions_m[v], m_.normal[v]);
      error = std::max(error, m_.error_m[v]);
    }
    if (facing < 2) return;
    const float low_r = std::min({p[0].r, p[1].r, p[2].r}), high_r = std::max({p[0].r, p[1].r, p[2].r});
    if (!is_at_measured_depth(u_first, u_last, v_first, v_last, low_r, high_r, error)) return;
    for (int v = v_first; v <= v_last; ++v)
      for (int u = u_first; u <= u_last; ++u)
        if (cell_.at(u, v) && is_focused(u, v)) beneath.push_back({std::uint32_t(cell_.index(u, v)), std::uint32_t(t)});
    const int u0 = std::max(0, int(std::ceil(u_low - bulge))), u1 = u_last;
    const int v0 = std::max(0, int(std::ceil(v_low - bulge))), v1 = v_last;
    if (u0 > u1 || v0 > v1) return;
    const float area = turn(p[0], p[1], p[2]);
    if (area == 0) return;
    // The plane of the triangle, for the range where a pixel's ray meets it.
    const Eigen::Vector3f a = canvas_.T_view_model() * m_.mesh.positions_m[corners[0]];
    const Eigen::Vector3f ab =
        canvas_.T_view_model().linear() * (m_.mesh.positions_m[corners[1]] - m_.mesh.positions_m[corners[0]]);
    const Eigen::Vector3f ac =
        canvas_.T_view_model().linear() * (m_.mesh.positions_m[corners[2]] - m_.mesh.positions_m[corners[0]]);
    const Eigen::Vector3f n = ab.cross(ac);
    const float sign = area > 0 ? 1.0f : -1.0f;
    const bool is_curved = bulge > 0;
    const std::array<Eigen::Vector3f, 3> corner = {a, a + ab, a + ac};
    for (int v = v0; v <= v1; ++v)
      for (int u = u0; u <= u1; ++u) {
        const std::size_t pixel = canvas_.pixel(u, v);
        const float measured = patch_.view.range.pixels[pixel];
        if (!(patch_.confidence.pixels[pixel] > 0)) continue;
        const Eigen::Vector3f& d = patch_.rays->directions[pixel];
        if (is_curved) {
          if (!passes_through(corner, d)) continue;
        } else {
          CanvasPoint q;
          q.u = float(u), q.v = float(v);
          if (sign * turn(p[0], p[1], q) < 0 || sign * turn(p[1], p[2], q) < 0 || sign * turn(p[2], p[0], q) < 0)
            continue;
        }
        const Eigen::Vector3f o =
            patch_.rays->origins.empty() ? Eigen::Vector3f(Eigen::Vector3f::Zero()) : patch_.rays->origins[pixel];
        const float along = n.dot(d);
        float r = along != 0 ? n.dot(a - o) / along : low_r;
        r = std::clamp(r, low_r, high_r);
        const float slack = canvas_.tolerance(pixel, error);
        const float difference = std::abs(measured - r);
        if (difference <= kShadowFactor * slack)
          std::atomic_ref<std::uint8_t>(sample_.at(u, v))
              .fetch_or(difference <= slack ? kCovered | kShadowed : kShadowed, std::memory_order_relaxed);
      }
  }

  // ---- the model's border as the view sees it
  WallKind classify(const OpenEdge& edge, CanvasPoint& a, CanvasPoint& b) const {
    a = canvas_.project(m_.mesh.positions_m[edge.a]);
    b = canvas_.project(m_.mesh.positions_m[edge.b]);
    if (!a.is_in && !b.is_in) return WallKind::kElsewhere;
    if (!is_in_focus(std::min(a.u, b.u), std::max(a.u, b.u), std::min(a.v, b.v), std::max(a.v, b.v)))
      return WallKind::kElsewhere;
    const Agreement at_a = canvas_.compare(a, m_.error_m[edge.a]), at_b = canvas_.compare(b, m_.error_m[edge.b]);
    const bool a_agrees = at_a == Agreement::kAgrees, b_agrees = at_b == Agreement::kAgrees;
    if (!a_agrees && !b_agrees) return WallKind::kElsewhere;
    const bool a_front = is_front(m_.mesh.positions_m[edge.a], m_.normal[edge.a]);
    const bool b_front = is_front(m_.mesh.positions_m[edge.b], m_.normal[edge.b]);
    if (!a_front && !b_front) return WallKind::kElsewhere;  // the other side of a sheet
    if (patch_.grid.wraps && std::abs(a.u - b.u) > 0.5f * float(w_)) return WallKind::kElsewhere;
    if (!a_agrees || !b_agrees) return WallKind::kBlocked;
    std::uint32_t c = 0;
    for (const std::uint32_t v : m_.mesh.triangles[edge.triangle])
      if (v != edge.a && v != edge.b) c = v;
    const CanvasPoint third = canvas_.project(m_.mesh.positions_m[c]);
    if (!(third.r > 0) || !(turn(a, b, third) > 0)) return WallKind::kBlocked;
    return WallKind::kWall;
  }

  void find_walls() {
    constexpr std::size_t kBlock = 4096;
    const std::size_t blocks = (m_.open.size() + kBlock - 1) / kBlock;
    std::vector<std::vector<Wall>> walls(blocks), blocked(blocks);
    parallel_for(context_, blocks, 1, [&](std::size_t block) {
      for (std::size_t i = block * kBlock; i < std::min(m_.open.size(), (block + 1) * kBlock); ++i) {
        Wall wall{std::uint32_t(i), {}, {}};
        const WallKind found = classify(m_.open[i], wall.a, wall.b);
        if (found == WallKind::kWall) walls[block].push_back(wall);
        if (found == WallKind::kBlocked) blocked[block].push_back(wall);
      }
    });
    for (std::size_t block = 0; block < blocks; ++block) {
      walls_.insert(walls_.end(), walls[block].begin(), walls[block].end());
      blocked_.insert(blocked_.end(), blocked[block].begin(), blocked[block].end());
    }
  }

  template <typename Visit>
  void walk(const CanvasPoint& a, const CanvasPoint& b, const Visit& visit) const {
    const float length = std::hypot(b.u - a.u, b.v - a.v);
    const int steps = std::max(1, int(std::ceil(length / kWallStep_px)));
    for (int i = 0; i <= steps; ++i) {
      const float t = float(i) / float(steps);
      const int u = int(std::floor(a.u + t * (b.u - a.u))), v = int(std::floor(a.v + t * (b.v - a.v)));
      if (u >= 0 && v >= 0 && u < w_ && v < h_) visit(u, v);
    }
  }

  void mark_near(const CanvasPoint& a, const CanvasPoint& b) {
    const int u0 = std::max(0, int(std::ceil(std::min(a.u, b.u) - kNearWall_px)));
    const int u1 = std::min(w_ - 1, int(std::floor(std::max(a.u, b.u) + kNearWall_px)));
    const int v0 = std::max(0, int(std::ceil(std::min(a.v, b.v) - kNearWall_px)));
    const int v1 = std::min(h_ - 1, int(std::floor(std::max(a.v, b.v) + kNearWall_px)));
    const Eigen::Vector2f p(a.u, a.v), d(b.u - a.u, b.v - a.v);
    const float squared = d.squaredNorm();
    for (int v = v0; v <= v1; ++v)
      for (int u = u0; u <= u1; ++u) {
        const Eigen::Vector2f q(float(u) - p.x(), float(v) - p.y());
        const float t = squared > 0 ? std::clamp(q.dot(d) / squared, 0.0f, 1.0f) : 0.0f;
        if ((q - t * d).squaredNorm() < kNearWall_px * kNearWall_px) sample_.at(u, v) |= kNear;
      }
  }

  void mark_walls() {
    for (const Wall& wall : walls_) {
      walk(wall.a, wall.b, [&](int u, int v) { cell_.at(u, v) |= kWall; });
      mark_near(wall.a, wall.b);
    }
    for (const Wall& wall : blocked_) block(wall);
  }

  void block(const Wall& wall) {
    walk(wall.a, wall.b, [&](int u, int v) { cell_.at(u, v) |= kBlocked; });
    mark_near(wall.a, wall.b);
  }

  // ---- samples that the view adds
  bool is_usable(int u, int v) const {
    if (!is_focused(u, v)) return false;
    const std::size_t pixel = canvas_.pixel(u, v);
    return wanted_.pixels[pixel] != 0 && patch_.confidence.pixels[pixel] > 0 &&
           !(sample_.at(u, v) & (kShadowed | kNear));
  }
  bool is_cell_in(int u, int v) const { return u >= 0 && v >= 0 && u < w_ - 1 && v < h_ - 1; }
  std::uint8_t grid_cell(int u, int v) const { return patch_.grid.cells[canvas_.pixel(u, v)]; }
  bool exists(int u, int v, int slot) const { return grid_cell(u, v) & (PatchGrid::kExists << slot); }

  // Corners of a triangle as (u, v), counter-clockwise seen from the sensor.
  std::array<Eigen::Vector2i, 3> corners_of(int u, int v, int slot) const {
    std::array<Eigen::Vector2i, 3> c;
    const Eigen::Vector2i p00(u, v), p10(u + 1, v), p01(u, v + 1), p11(u + 1, v + 1);
    if (grid_cell(u, v) & PatchGrid::kAntiDiagonal)
      c = slot == 0 ? std::array{p00, p01, p10} : std::array{p10, p01, p11};
    else
      c = slot == 0 ? std::array{p00, p01, p11} : std::array{p00, p11, p10};
    if (patch_.grid.is_mirrored) std::swap(c[1], c[2]);
    return c;
  }

  std::uint32_t vertex_of(int u, int v) {
    std::uint32_t& id = vertex_of_sample_.at(u, v);
    if (id == kInvalidIndex) {
      id = std::uint32_t(m_.mesh.positions_m.size());
      const std::size_t pixel = canvas_.pixel(u, v);
      m_.mesh.positions_m.push_back(canvas_.position(pixel));
      m_.mesh.vertex_view.push_back(index_);
      m_.mesh.vertex_pixel.push_back(std::uint32_t(pixel));
      m_.error_m.push_back(expected_error_m(patch_, pixel));
      m_.normal.push_back(normal_at(patch_, pixel));
    }
    return id;
  }

  void emit_grid() {
    vertex_of_sample_ = Image<std::uint32_t>(w_, h_, kInvalidIndex);
    emitted_ = Image<std::uint8_t>(w_, h_, 0);
    first_new_triangle_ = m_.mesh.triangles.size();
    Image<std::uint8_t> is_full(w_, h_, 0);
    for (int v = 0; v + 1 < h_; ++v)
      for (int u = 0; u + 1 < w_; ++u) {
        if (cell_.at(u, v)) continue;
        for (int slot = 0; slot < 2; ++slot) {
          if (!exists(u, v, slot)) continue;
          const auto corners = corners_of(u, v, slot);
          if (!std::all_of(corners.begin(), corners.end(), [&](const auto& c) { return is_usable(c.x(), c.y()); }))
            continue;
          emitted_.at(u, v) |= std::uint8_t(1 << slot);
          for (const auto& c : corners) sample_.at(c.x(), c.y()) |= kEmitted;
        }
        is_full.at(u, v) = emitted_.at(u, v) == 3;
      }
    const auto deviation = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t m) {
      return deviation_from_plane(a, b, c, m);
    };
    for (const SampleTriangle& t : adaptive_triangles(is_full, deviation)) {
      Triangle corners;
      for (std::size_t k = 0; k < 3; ++k)
        corners[k] = vertex_of(int(t[k] % std::uint32_t(w_)), int(t[k] / std::uint32_t(w_)));
      if (patch_.grid.is_mirrored) std::swap(corners[1], corners[2]);
      add_triangle(corners, TriangleTag::kMeasured);
    }
    for (int v = 0; v + 1 < h_; ++v)
      for (int u = 0; u + 1 < w_; ++u)
        for (int slot = 0; slot < 2; ++slot) {
          if (is_full.at(u, v) || !is_emitted(u, v, slot)) continue;
          const auto corners = corners_of(u, v, slot);
          add_triangle({vertex_of(corners[0].x(), corners[0].y()), vertex_of(corners[1].x(), corners[1].y()),
                        vertex_of(corners[2].x(), corners[2].y())},
                       TriangleTag::kMeasured);
        }
    m_.report.measured_triangles += m_.mesh.triangles.size() - first_new_triangle_;
  }

  // Of sample m from the plane through three others, along its ray, in units of what noise explains.
  float deviation_from_plane(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t m) const {
    const auto pixel = [&](std::uint32_t i) {
      return canvas_.pixel(int(i % std::uint32_t(w_)), int(i / std::uint32_t(w_)));
    };
    const std::size_t pm = pixel(m);
    const Eigen::Vector3f pa = patch_.point_in_view(pixel(a));
    const Eigen::Vector3f normal = (patch_.point_in_view(pixel(b)) - pa).cross(patch_.point_in_view(pixel(c)) - pa);
    const Eigen::Vector3f origin =
        patch_.rays->origins.empty() ? Eigen::Vector3f(Eigen::Vector3f::Zero()) : patch_.rays->origins[pm];
    const float along = normal.dot(patch_.rays->directions[pm]), r = patch_.view.range.pixels[pm];
    if (along == 0) return 2;
    const float off = std::abs(normal.dot(pa - origin) / along - r);
    return off / (kFlatness * float(patch_.noise.sigma(double(r))));
  }

  void add_triangle(const Triangle& t, TriangleTag tag) {
    m_.mesh.triangles.push_back(t);
    m_.mesh.triangle_tag.push_back(tag);
    m_.mesh.triangle_view.push_back(index_);
  }

  bool is_emitted(int u, int v, int slot) const { return is_cell_in(u, v) && (emitted_.at(u, v) >> slot & 1); }

  // Whether the triangle across the edge p–q of an emitted triangle was emitted too.
  bool is_neighbor_emitted(int u, int v, int slot, const Eigen::Vector2i& p, const Eigen::Vector2i& q) const {
    const Eigen::Vector2i low = p.cwiseMin(q), d = (p - q).cwiseAbs();
    const auto is_anti = [&](int x, int y) { return (grid_cell(x, y) & PatchGrid::kAntiDiagonal) != 0; };
    if (d.x() == 1 && d.y() == 1) return is_emitted(u, v, 1 - slot);
    if (d.x() == 0) return low.x() == u ? is_emitted(u - 1, v, 1) : is_emitted(u + 1, v, 0);
    if (low.y() == v) return v > 0 && is_emitted(u, v - 1, is_anti(u, v - 1) ? 1 : 0);
    return is_cell_in(u, v + 1) && is_emitted(u, v + 1, is_anti(u, v + 1) ? 0 : 1);
  }

  // ---- gaps
  struct Local {
    std::uint32_t vertex;  // of the model; kInvalidIndex: the sample is not in it yet
    std::uint32_t sample;  // frame index v·w + u; kInvalidIndex: not of this view
    float range, error_m;
  };

  GridPoint grid_point(float u, float v) const {
    const auto x = std::int32_t(std::lround(u * kGridPerPixel)), y = std::int32_t(std::lround(v * kGridPerPixel));
    return {x, patch_.grid.is_mirrored ? y : -y};  // counter-clockwise as seen is counter-clockwise here
  }

  std::uint32_t local_of_wall(std::uint32_t vertex, const CanvasPoint& at) {
    std::uint32_t& local = m_.local_of_vertex[vertex];
    if (local == kInvalidIndex) {
      local = std::uint32_t(locals_.size());
      locals_.push_back({vertex, kInvalidIndex, at.r, m_.error_m[vertex]});
      points_.push_back(grid_point(at.u, at.v));
    }
    return local;
  }

  std::uint32_t local_of(int u, int v) {
    std::uint32_t& local = local_of_sample_.at(u, v);
    if (local == kInvalidIndex) {
      local = std::uint32_t(locals_.size());
      locals_.push_back({vertex_of_sample_.at(u, v), std::uint32_t(sample_.index(u, v)),
                         patch_.view.range.pixels[canvas_.pixel(u, v)], 0});
      points_.push_back(grid_point(float(u), float(v)));
    }
    return local;
  }

  void triangulate_gaps() {
    m_.local_of_vertex.resize(m_.mesh.positions_m.size(), kInvalidIndex);
    for (const Wall& wall : walls_) {
      const OpenEdge& edge = m_.open[wall.open];
      fences_.push_back({local_of_wall(edge.b, wall.b), local_of_wall(edge.a, wall.a)});
    }
    for (int v = 0; v + 1 < h_; ++v)
      for (int u = 0; u + 1 < w_; ++u)
        for (int slot = 0; slot < 2; ++slot) {
          if (!is_emitted(u, v, slot)) continue;
          const auto c = corners_of(u, v, slot);
          for (std::size_t k = 0; k < 3; ++k) {
            const auto &p = c[k], &q = c[(k + 1) % 3];
            if (is_neighbor_emitted(u, v, slot, p, q)) continue;
            const std::uint32_t a = local_of(p.x(), p.y()), b = local_of(q.x(), q.y());
            fences_.push_back({b, a});
            new_border_.push_back({locals_[a].vertex, locals_[b].vertex, kInvalidIndex});
          }
        }
    find_border_triangles();
    for (int v = 0; v < h_; ++v)
      for (int u = 0; u < w_; ++u)
        if (!(sample_.at(u, v) & kEmitted) && is_usable(u, v) && touches_gap(u, v)) local_of(u, v);
    if (!fences_.empty()) fill_gaps();
    for (const Local& local : locals_)
      if (local.sample == kInvalidIndex && local.vertex != kInvalidIndex)
        m_.local_of_vertex[local.vertex] = kInvalidIndex;
  }

  void find_border_triangles() {
    const auto key = [](std::uint32_t a, std::uint32_t b) { return std::uint64_t(a) << 32 | b; };
    std::unordered_map<std::uint64_t, std::size_t> at;
    at.reserve(new_border_.size());
    for (std::size_t i = 0; i < new_border_.size(); ++i) at.emplace(key(new_border_[i].a, new_border_[i].b), i);
    for (std::size_t t = first_new_triangle_; t < m_.mesh.triangles.size(); ++t)
      for (std::size_t k = 0; k < 3; ++k) {
        const auto found = at.find(key(m_.mesh.triangles[t][k], m_.mesh.triangles[t][(k + 1) % 3]));
        if (found != at.end()) new_border_[found->second].triangle = std::uint32_t(t);
      }
  }

  // A sample that could not be part of a grid triangle, because of the model's border or of samples not wanted.
  bool touches_gap(int u, int v) const {
    for (int y = v - 1; y <= v; ++y)
      for (int x = u - 1; x <= u; ++x)
        if (is_cell_in(x, y) && (grid_cell(x, y) & (PatchGrid::kExists | PatchGrid::kExists << 1))) return true;
    return false;
  }

  void fill_gaps() {
    PlanarTriangulation made(points_);
    longest_fence_.assign(points_.size(), 0);
    for (const Fence& fence : fences_) {
      const GridPoint &p = points_[fence.from], &q = points_[fence.to];
      const float length = std::hypot(float(p.x - q.x), float(p.y - q.y)) / kGridPerPixel;
      for (const std::uint32_t end : {fence.from, fence.to})
        longest_fence_[end] = std::max(longest_fence_[end], length);
    }
    for (std::size_t i = 0; i < fences_.size(); ++i) {
      if (made.constrain(fences_[i].from, fences_[i].to)) continue;
      if (i < walls_.size()) {
        block(walls_[i]);
      } else {
        const GridPoint &a = points_[fences_[i].from], &b = points_[fences_[i].to];
        const auto at = [&](const GridPoint& p) {
          return CanvasPoint{float(p.x) / kGridPerPixel, float(std::abs(p.y)) / kGridPerPixel, 1, true};
        };
        block({0, at(a), at(b)});
      }
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
    const auto push = [&](std::uint32_t face) {
      if (face == PlanarTriangulation::kNone || is_seen[face]) return;
      is_seen[face] = 1;
      if (made.faces()[face].constrained & ~gap_side[face]) return;
      if (is_valid(made.faces()[face])) queue.push_back(face);
    };
    for (const std::uint32_t face : seeds) push(face);
    for (std::size_t i = 0; i < queue.size(); ++i) {
      const PlanarTriangulation::Face face = made.faces()[queue[i]];
      for (std::size_t k = 0; k < 3; ++k)
        if (!(face.constrained >> k & 1)) push(face.neighbor[k]);
    }
    std::sort(queue.begin(), queue.end());
    for (const std::uint32_t face : queue) add_face(made.faces()[face]);
  }

  bool is_valid(const PlanarTriangulation::Face& face) const {
    const std::uint32_t count = std::uint32_t(points_.size());
    for (const std::uint32_t c : face.corner)
      if (c >= count) return false;
    const GridPoint &a = points_[face.corner[0]], &b = points_[face.corner[1]], &c = points_[face.corner[2]];
    const auto cross = [](const GridPoint& p, const GridPoint& q, std::int64_t x, std::int64_t y) {
      return (std::int64_t(q.x) - p.x) * (y - p.y) - (std::int64_t(q.y) - p.y) * (x - p.x);
    };
    if (cross(a, b, c.x, c.y) <= 0) return false;
    // Samples inside or on its edges: none that is covered, and none that ought to be a vertex.
    const std::int32_t one = std::int32_t(kGridPerPixel);
    const float sign = patch_.grid.is_mirrored ? 1.0f : -1.0f;
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
        const int v = patch_.grid.is_mirrored ? y : -y;
        if (u < 0 || v < 0 || u >= w_ || v >= h_) return false;
        if (!canvas_.has_sample(u, v)) return false;
        if (sample_.at(u, v) & kCovered) return false;
        if (!(sample_.at(u, v) & (kNear | kShadowed))) return false;
      }
    // Cells beneath: everywhere the view measured one surface.
    const float ax = float(a.x) / kGridPerPixel, ay = sign * float(a.y) / kGridPerPixel;
    const float bx = float(b.x) / kGridPerPixel, by = sign * float(b.y) / kGridPerPixel;
    const float cx = float(c.x) / kGridPerPixel, cy = sign * float(c.y) / kGridPerPixel;
    const float extent =
        std::max({std::hypot(ax - bx, ay - by), std::hypot(bx - cx, by - cy), std::hypot(cx - ax, cy - ay)});
    if (extent > kLongest_px && !is_as_long_as_border(face, extent)) return false;
    const int n = std::clamp(int(std::ceil(extent / kWallStep_px)), 3, 64);
    const Local &p0 = locals_[face.corner[0]], &p1 = locals_[face.corner[1]], &p2 = locals_[face.corner[2]];
    const float error = std::max({p0.error_m, p1.error_m, p2.error_m});
    for (int i = 0; i <= n; ++i)
      for (int j = 0; i + j <= n; ++j) {
        const int k = n - i - j;
        if (i == n || j == n || k == n) continue;  // the corners agree with the view already
        const float s = float(i) / float(n), t = float(j) / float(n), r = float(k) / float(n);
        const float u = s * ax + t * bx + r * cx, v = s * ay + t * by + r * cy;
        const float range = s * p0.range + t * p1.range + r * p2.range;
        if (!is_surface(u, v, range, error)) return false;
      }
    if (overlaps_model(face)) return false;
    // An edge that the model has already cannot get a third triangle.
    for (std::size_t k = 0; k < 3; ++k) {
      if (face.constrained >> k & 1) continue;
      const Local &p = locals_[face.corner[(k + 1) % 3]], &q = locals_[face.corner[(k + 2) % 3]];
      if (p.vertex != kInvalidIndex && q.vertex != kInvalidIndex &&
          m_.border_edges.count(undirected(p.vertex, q.vertex)))
        return false;
    }
    return true;
  }

  // Whether a point, by its doubled areas with the edges opposite the corners, lies on an edge that is a border: what
  // covers it there is the triangle at the border's other side.
  bool is_on_fence(const PlanarTriangulation::Face& face, const std::array<std::int64_t, 3>& side) const {
    constexpr double kOn_px = 0.05;
    for (std::size_t k = 0; k < 3; ++k) {
      if (!(face.constrained >> k & 1)) continue;
      const GridPoint &p = points_[face.corner[(k + 1) % 3]], &q = points_[face.corner[(k + 2) % 3]];
      const double length = std::hypot(double(p.x - q.x), double(p.y - q.y));
      if (double(side[k]) < kOn_px * double(kGridPerPixel) * length) return true;
    }
    return false;
  }

  // Whether, in this image, the face lies over or under a model triangle that is the same surface.
  bool overlaps_model(const PlanarTriangulation::Face& face) const {
    constexpr float kShrink = 0.9f;  // neighbours that share an edge or a corner do not overlap
    std::array<Eigen::Vector2f, 3> q;
    std::array<const Local*, 3> local;
    Eigen::Vector2f middle(0, 0);
    for (std::size_t k = 0; k < 3; ++k) {
      const GridPoint& p = points_[face.corner[k]];
      q[k] = Eigen::Vector2f(float(p.x), float(p.y)) / kGridPerPixel;
      local[k] = &locals_[face.corner[k]];
      middle += q[k] / 3;
    }
    float low_u = 1e9f, low_v = 1e9f, high_u = -1e9f, high_v = -1e9f;
    for (Eigen::Vector2f& c : q) {
      c = middle + kShrink * (c - middle);
      const float v = patch_.grid.is_mirrored ? c.y() : -c.y();
      low_u = std::min(low_u, c.x()), high_u = std::max(high_u, c.x());
      low_v = std::min(low_v, v), high_v = std::max(high_v, v);
    }
    const float low_r = std::min({local[0]->range, local[1]->range, local[2]->range});
    const float high_r = std::max({local[0]->range, local[1]->range, local[2]->range});
    for (int v = std::max(0, int(std::floor(low_v))); v <= std::min(h_ - 1, int(std::floor(high_v))); ++v)
      for (int u = std::max(0, int(std::floor(low_u))); u <= std::min(w_ - 1, int(std::floor(high_u))); ++u) {
        const auto cell = std::uint32_t(cell_.index(u, v));
        for (auto it = std::lower_bound(beneath_.begin(), beneath_.end(), Beneath{cell, 0});
             it != beneath_.end() && it->cell == cell; ++it) {
          const Triangle& t = m_.mesh.triangles[it->triangle];
          std::array<Eigen::Vector2f, 3> c;
          float low = 1e9f, high = 0, error = 0;
          int facing = 0;
          for (std::size_t k = 0; k < 3; ++k) {
            const CanvasPoint p = canvas_.project(m_.mesh.positions_m[t[k]]);
            c[k] = Eigen::Vector2f(p.u, patch_.grid.is_mirrored ? p.v : -p.v);
            low = std::min(low, p.r), high = std::max(high, p.r);
            error = std::max(error, m_.error_m[t[k]]);
            facing += is_front(m_.mesh.positions_m[t[k]], m_.normal[t[k]]);
          }
          if (facing < 2) continue;
          const float slack = canvas_.tolerance(canvas_.pixel(u, v), error);
          if (low > high_r + slack || high < low_r - slack) continue;
          const auto [c_low, c_high] = std::minmax({c[0].x(), c[1].x(), c[2].x()});
          const auto [d_low, d_high] = std::minmax({c[0].y(), c[1].y(), c[2].y()});
          if (bulge_of(std::max(c_high - c_low, d_high - d_low)) > 0.05f) {
            if (meets_curved(t, q, middle)) return true;
          } else if (!is_separated(q, c) && !is_separated(c, q)) {
            return true;
          }
        }
      }
    return false;
  }

  // Whether the ray through a corner or the middle of a face (in grid coordinates) meets a model triangle.
  bool meets_curved(const Triangle& t, const std::array<Eigen::Vector2f, 3>& face,
                    const Eigen::Vector2f& middle) const {
    std::array<Eigen::Vector3f, 3> corner;
    for (std::size_t k = 0; k < 3; ++k) corner[k] = canvas_.T_view_model() * m_.mesh.positions_m[t[k]];
    for (const Eigen::Vector2f& p : {face[0], face[1], face[2], middle})
      if (passes_through(corner, canvas_.direction(p.x(), patch_.grid.is_mirrored ? p.y() : -p.y()))) return true;
    return false;
  }

  // Whether an edge of a has all of b on its outer side.
  static bool is_separated(const std::array<Eigen::Vector2f, 3>& a, const std::array<Eigen::Vector2f, 3>& b) {
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

  // Long edges come from a coarse border, not from across the view.
  bool is_as_long_as_border(const PlanarTriangulation::Face& face, float extent) const {
    float border = 0;
    for (const std::uint32_t c : face.corner) border = std::max(border, longest_fence_[c]);
    return extent < 1.5f * border;
  }

  // Whether the view measured a surface here, without a step, and about at this range.
  bool is_surface(float u, float v, float range, float error_m) const {
    const int x = int(std::floor(u)), y = int(std::floor(v));
    if (!is_cell_in(x, y)) return false;
    if (cell_.at(x, y) & kBlocked) return false;
    const float s = u - float(x), t = v - float(y);
    const bool is_anti = (grid_cell(x, y) & PatchGrid::kAntiDiagonal) != 0;
    const int slot = is_anti ? (s + t > 1 ? 1 : 0) : (s > t ? 1 : 0);
    if (!exists(x, y, slot)) return is_in_footprint(u, v, range, error_m);
    const auto at = [&](int i, int j) { return patch_.view.range.pixels[canvas_.pixel(x + i, y + j)]; };
    float measured;
    if (is_anti)
      measured = slot == 0 ? at(0, 0) + s * (at(1, 0) - at(0, 0)) + t * (at(0, 1) - at(0, 0))
                           : at(1, 1) + (1 - s) * (at(0, 1) - at(1, 1)) + (1 - t) * (at(1, 0) - at(1, 1));
    else
      measured = slot == 0 ? at(0, 0) + s * (at(1, 1) - at(0, 1)) + t * (at(0, 1) - at(0, 0))
                           : at(0, 0) + s * (at(1, 0) - at(0, 0)) + t * (at(1, 1) - at(1, 0));
    const int nx = x + (s > 0.5f ? 1 : 0), ny = y + (t > 0.5f ? 1 : 0);
    const std::size_t nearest = canvas_.has_sample(nx, ny) ? canvas_.pixel(nx, ny) : canvas_.pixel(x, y);
    const float slope = std::max({std::abs(at(1, 0) - at(0, 0)), std::abs(at(0, 1) - at(0, 0)),
                                  std::abs(at(1, 1) - at(0, 1)), std::abs(at(1, 1) - at(1, 0))});
    const float slack = exists(x, y, 0) && exists(x, y, 1) ? slope : 0.0f;
    return std::abs(measured - range) <= canvas_.tolerance(nearest, error_m) + slack;
  }

  // Beyond the triangles of the outline: a sample stands for half a spacing around it.
  bool is_in_footprint(float u, float v, float range, float error_m) const {
    const int x = int(std::lround(u)), y = int(std::lround(v));
    if (!canvas_.has_sample(x, y)) return false;
    const std::size_t nearest = canvas_.pixel(x, y);
    return std::abs(patch_.view.range.pixels[nearest] - range) <=
           kFootprintTolerance * canvas_.tolerance(nearest, error_m);
  }

  void add_face(const PlanarTriangulation::Face& face) {
    Triangle t;
    bool is_own = true;
    for (std::size_t k = 0; k < 3; ++k) {
      Local& local = locals_[face.corner[k]];
      if (local.vertex == kInvalidIndex) {
        const int u = int(local.sample % std::uint32_t(w_)), v = int(local.sample / std::uint32_t(w_));
        local.vertex = vertex_of(u, v);
      }
      is_own &= m_.mesh.vertex_view[local.vertex] == index_;
      t[k] = local.vertex;
    }
    const auto id = std::uint32_t(m_.mesh.triangles.size());
    add_triangle(t, is_own ? TriangleTag::kMeasured : TriangleTag::kSeam);
    ++(is_own ? m_.report.measured_triangles : m_.report.seam_triangles);
    for (std::size_t k = 0; k < 3; ++k) filled_edges_.push_back({t[k], t[(k + 1) % 3], id});
  }

  // ---- which edges are open now
  void update_border() {
    std::vector<OpenEdge> edges;
    std::vector<std::uint8_t> is_wall(m_.open.size(), 0);
    for (const Wall& wall : walls_) is_wall[wall.open] = 1;
    std::vector<OpenEdge> still_open;
    still_open.reserve(m_.open.size() + new_border_.size());
    for (std::size_t i = 0; i < m_.open.size(); ++i) (is_wall[i] ? edges : still_open).push_back(m_.open[i]);
    edges.insert(edges.end(), new_border_.begin(), new_border_.end());
    edges.insert(edges.end(), filled_edges_.begin(), filled_edges_.end());
    std::sort(edges.begin(), edges.end(), is_before);
    for (std::size_t i = 0; i < edges.size();) {
      const std::uint64_t key = undirected(edges[i].a, edges[i].b);
      std::size_t end = i + 1;
      while (end < edges.size() && undirected(edges[end].a, edges[end].b) == key) ++end;
      if (end == i + 1) still_open.push_back(edges[i]);
      m_.border_edges.insert(key);
      i = end;
    }
    m_.open = std::move(still_open);
    m_.add_chunks(first_new_triangle_);
    remember_chords();
  }

  // Grid edges between two samples that both lie on the border of what was added.
  void remember_chords() {
    std::unordered_set<std::uint32_t> on_border;
    for (const OpenEdge& edge : new_border_) on_border.insert(edge.a);
    for (std::size_t t = first_new_triangle_; t < m_.mesh.triangles.size(); ++t)
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = m_.mesh.triangles[t][k], b = m_.mesh.triangles[t][(k + 1) % 3];
        if (on_border.count(a) && on_border.count(b)) m_.border_edges.insert(undirected(a, b));
      }
  }

  struct Fence {
    std::uint32_t from, to;  // points; the gap lies to the left
  };

  Impl& m_;
  std::uint32_t index_;
  const Patch& patch_;
  const Image<std::uint8_t>& wanted_;
  Where where_;
  Context& context_;
  ViewCanvas canvas_;
  int w_, h_;
  float pixel_angle_ = 0;
  Image<std::uint8_t> sample_, cell_, emitted_;
  Image<std::uint32_t> local_of_sample_, vertex_of_sample_;
  std::vector<Wall> walls_, blocked_;
  std::vector<Beneath> beneath_;  // sorted
  Image<std::uint8_t> focus_;     // tiles
  Image<DepthBlock> depth_;
  std::vector<Fence> fences_;
  std::vector<Local> locals_;
  std::vector<GridPoint> points_;
  std::vector<float> longest_fence_;  // at each point, pixels
  std::vector<OpenEdge> new_border_, filled_edges_;
  std::size_t first_new_triangle_ = 0;
};

Zipper::Zipper(std::span<const Patch> patches, const OverlapOptions& options) : impl_(std::make_unique<Impl>()) {
  impl_->patches = patches;
  impl_->options = options;
  impl_->times_added.assign(patches.size(), 0);
  for (const Patch& patch : patches) {
    const Eigen::Vector3d t = patch.view.T_world_view.translation();
    if (t.norm() <= kFarFromOrigin_m) continue;
    impl_->mesh.origin_m = {std::round(t.x()), std::round(t.y()), std::round(t.z())};
    break;
  }
}
Zipper::~Zipper() = default;

void Zipper::Impl::add(std::uint32_t index, const Image<std::uint8_t>& wanted, Where where, Context& context) {
  if (patches[index].grid.width < 2 || patches[index].grid.height < 2) return;  // no cell, no triangle
  // A panorama is cut somewhere; every second time on the other side, so that the cut is closed too.
  const bool turns = patches[index].grid.wraps && (times_added[index] & 1);
  ++times_added[index];
  Step(*this, index, wanted, turns ? patches[index].grid.width / 2 : 0, where, context).run();
}

void Zipper::add(std::uint32_t index, const Image<std::uint8_t>& wanted, Context& context) {
  impl_->add(index, wanted, Where::kWanted, context);
}

void Zipper::revisit(std::uint32_t index, const Image<std::uint8_t>& wanted, Context& context) {
  impl_->add(index, wanted, Where::kBorder, context);
}

// Everything that is known of the border, from the triangles alone.
void Zipper::Impl::find_border() {
  std::vector<OpenEdge> edges;
  edges.reserve(mesh.triangle_count() * 3);
  for (std::uint32_t t = 0; t < mesh.triangle_count(); ++t)
    for (std::size_t k = 0; k < 3; ++k) edges.push_back({mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3], t});
  std::sort(edges.begin(), edges.end(), is_before);
  open.clear();
  std::vector<std::uint8_t> on_border(mesh.vertex_count(), 0);
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const std::uint64_t key = undirected(edges[i].a, edges[i].b);
    const bool is_paired = (i > 0 && undirected(edges[i - 1].a, edges[i - 1].b) == key) ||
                           (i + 1 < edges.size() && undirected(edges[i + 1].a, edges[i + 1].b) == key);
    if (is_paired) continue;
    open.push_back(edges[i]);
    on_border[edges[i].a] = on_border[edges[i].b] = 1;
  }
  border_edges.clear();
  for (const OpenEdge& edge : edges)
    if (on_border[edge.a] && on_border[edge.b]) border_edges.insert(undirected(edge.a, edge.b));
  chunks.clear();
  add_chunks(0);
}

void Zipper::Impl::add_chunks(std::size_t begin) {
  for (std::size_t first = begin; first < mesh.triangles.size(); first += kChunk) {
    Chunk chunk{first, std::min(first + kChunk, mesh.triangles.size()), Eigen::Vector3f::Zero(), 0, 0};
    Eigen::AlignedBox3f box;
    for (std::size_t t = chunk.first; t < chunk.last; ++t)
      for (const std::uint32_t v : mesh.triangles[t]) {
        box.extend(mesh.positions_m[v]);
        chunk.error_m = std::max(chunk.error_m, error_m[v]);
      }
    chunk.center = box.center();
    chunk.radius_m = 0.5f * box.diagonal().norm();
    chunks.push_back(chunk);
  }
}

void Zipper::replace_mesh(Mesh mesh, Context& context) {
  impl_->mesh = std::move(mesh);
  const Mesh& now = impl_->mesh;
  impl_->error_m.resize(now.vertex_count());
  impl_->normal.resize(now.vertex_count());
  parallel_for(context, now.vertex_count(), 4096, [&](std::size_t v) {
    const Patch& patch = impl_->patches[now.vertex_view[v]];
    impl_->error_m[v] = expected_error_m(patch, now.vertex_pixel[v]);
    impl_->normal[v] = normal_at(patch, now.vertex_pixel[v]);
  });
  impl_->local_of_vertex.assign(now.vertex_count(), kInvalidIndex);
  impl_->find_border();
}

std::span<const float> Zipper::vertex_errors_m() const { return impl_->error_m; }

const Mesh& Zipper::mesh() const { return impl_->mesh; }

ZipperReport Zipper::report() const {
  ZipperReport report = impl_->report;
  report.open_edges = impl_->open.size();
  return report;
}

Mesh Zipper::take() {
  Mesh mesh = std::move(impl_->mesh);
  impl_->open.clear();
  impl_->chunks.clear();
  return mesh;
}

}  // namespace lapseam
