// Based on: Y. Sun, C. Dumont, M. Abidi, Mesh-based Integration of Range and Color Images, 2000, §2.2.

#include "lapseam/overlap.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>

#include "core/parallel.h"
#include "overlap/view_projection.h"

namespace lapseam {
namespace {

using Vec2 = Eigen::Vector2f;

// A new triangle must be this much more confident to drive out the model's: where two views are about equally good, the
// winner must not change from triangle to triangle.
constexpr float kLead = 1.1f;
constexpr float kNearness_px2 = 0.02f;       // squared distance below which one overlapped triangle decides alone
constexpr float kCellRadius_px = 0.7072f;    // half a cell's diagonal
constexpr float kCellReach_px = 0.21f;       // a cell's circle reaches this far beyond the cell
constexpr float kRegistrationFactor = 2.0f;  // twice the median disagreement covers most of it
constexpr float kClearanceFactor = 2.0f;     // to be empty, space must be clearer than to be the same surface
constexpr float kLowestCosine = 0.15f;       // 81°: beyond, a range says nothing about a normal distance
constexpr double kEdgeOnCosine = 0.05;
constexpr int kWideBaseline_px = 4;
constexpr float kLargestFootprint_px = 24;  // a triangle that covers more is not a stray one

// Bits of a cell's two slots that were decided to die in the pass under way.
using KillMap = std::vector<std::uint8_t>;

void mark_killed(KillMap& kills, std::size_t cell, int slot) {
  std::atomic_ref<std::uint8_t>(kills[cell]).fetch_or(std::uint8_t(1 << slot), std::memory_order_relaxed);
}

std::uint64_t apply_kills(PatchGrid& grid, const KillMap& kills) {
  std::uint64_t count = 0;
  for (std::size_t cell = 0; cell < kills.size(); ++cell) {
    if (!kills[cell]) continue;
    for (int slot = 0; slot < 2; ++slot)
      if ((kills[cell] >> slot & 1) && grid.is_alive(cell, slot)) {
        grid.cells[cell] &= std::uint8_t(~(PatchGrid::kAlive << slot));
        ++count;
      }
  }
  return count;
}

// One triangle as another view sees it: pixel coordinates and range of its corners there.
struct ProjectedTriangle {
  std::array<Vec2, 3> p;
  std::array<float, 3> r;
  float confidence = 0;
  float sigma_normal_m = 0;  ///< its own noise along its normal
};

float cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

float signed_area2(const std::array<Vec2, 3>& p) { return cross(p[1] - p[0], p[2] - p[0]); }

// The smallest circle around a triangle: the paper's removing circle (circumscribed circle) where the triangle is
// acute, and the circle over the longest edge where it is not, so that slivers do not remove half the image.
struct Circle {
  Vec2 center;
  float squared_radius;
  bool contains(const Vec2& q) const { return (q - center).squaredNorm() <= squared_radius; }
};

Circle removing_circle(const std::array<Vec2, 3>& p) {
  for (int i = 0; i < 3; ++i) {
    const Vec2 &a = p[std::size_t(i)], &b = p[std::size_t((i + 1) % 3)], &c = p[std::size_t((i + 2) % 3)];
    if ((a - c).dot(b - c) <= 0) return {0.5f * (a + b), 0.25f * (a - b).squaredNorm()};
  }
  const Vec2 ab = p[1] - p[0], ac = p[2] - p[0];
  const float d = 2 * cross(ab, ac), bb = ab.squaredNorm(), cc = ac.squaredNorm();
  const Vec2 offset((ac.y() * bb - ab.y() * cc) / d, (ab.x() * cc - ac.x() * bb) / d);
  return {p[0] + offset, offset.squaredNorm()};
}

// Exact overlap of two triangles in the plane: point-in-triangle and edge crossing in one, by separating axes.
bool are_separated_by_edge_of(const std::array<Vec2, 3>& a, const std::array<Vec2, 3>& b) {
  const float side = signed_area2(a) >= 0 ? 1.0f : -1.0f;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec2 edge = a[(i + 1) % 3] - a[i];
    if (side * cross(edge, b[0] - a[i]) < 0 && side * cross(edge, b[1] - a[i]) < 0 &&
        side * cross(edge, b[2] - a[i]) < 0)
      return true;
  }
  return false;
}

bool overlap_2d(const std::array<Vec2, 3>& a, const Circle& circle_a, const std::array<Vec2, 3>& b,
                const Circle& circle_b) {
  for (const Vec2& q : b)
    if (circle_a.contains(q)) return true;
  for (const Vec2& q : a)
    if (circle_b.contains(q)) return true;
  return !are_separated_by_edge_of(a, b) && !are_separated_by_edge_of(b, a);
}

// Range of the triangle at pixel q; outside of it, at the nearest of its barycentric neighbours.
float range_at(const ProjectedTriangle& t, const Vec2& q) {
  const float area = signed_area2(t.p);
  if (area == 0) return (t.r[0] + t.r[1] + t.r[2]) / 3;
  float b0 = cross(t.p[1] - q, t.p[2] - q) / area, b1 = cross(t.p[2] - q, t.p[0] - q) / area;
  b0 = std::clamp(b0, 0.0f, 1.0f);
  b1 = std::clamp(b1, 0.0f, 1.0f);
  const float b2 = std::clamp(1 - b0 - b1, 0.0f, 1.0f);
  return (b0 * t.r[0] + b1 * t.r[1] + b2 * t.r[2]) / (b0 + b1 + b2);
}

// Compares triangles of one patch with another patch, in the image of the other one.
class PairTest {
 public:
  PairTest(const Patch& from, const Patch& onto, const OverlapOptions& options)
      : from_(from),
        onto_(onto),
        options_(options),
        T_onto_from_(onto.view.T_world_view.inverse() * from.view.T_world_view),
        width_(onto.grid.width),
        height_(onto.grid.height) {}

  const Eigen::Isometry3d& T_onto_from() const { return T_onto_from_; }

  struct Outcome {
    std::uint64_t tested = 0, seen_through = 0;
  };

  /// Judges every alive triangle of a tile of `from`. Losers are marked in kills_from, what they beat in kills_onto.
  Outcome judge_tile(const PatchTile& tile, KillMap& kills_from, KillMap& kills_onto) {
    project_tile(tile);
    Outcome outcome;
    for (int v = tile.v0; v < tile.v1; ++v)
      for (int u = tile.u0; u < tile.u1; ++u) {
        const std::size_t cell = from_.confidence.index(u, v);
        if (!from_.grid.has_alive(cell)) continue;
        for (int slot = 0; slot < 2; ++slot)
          if (from_.grid.is_alive(cell, slot)) judge(cell, slot, kills_from, kills_onto, outcome);
      }
    return outcome;
  }

 private:
  struct Candidate {
    std::size_t cell;
    int slot;
  };

  void project_tile(const PatchTile& tile) {
    u0_ = tile.u0;
    v0_ = tile.v0;
    const int columns = kTile_px + 1;
    projected_.assign(std::size_t(columns * columns), {});
    std::visit(
        [&](const auto& sensor) {
          for (int v = tile.v0; v <= std::min(tile.v1, from_.grid.height - 1); ++v)
            for (int u = tile.u0; u <= tile.u1; ++u) {
              const int u_wrapped = u < from_.grid.width ? u : u - from_.grid.width;
              const std::size_t pixel = from_.confidence.index(u_wrapped, v);
              if (!(from_.confidence.pixels[pixel] > 0)) continue;
              PixelRange out;
              if (!sensor.project(T_onto_from_ * from_.point_in_view(pixel).template cast<double>(), out)) continue;
              if (!(out.r > 0)) continue;
              projected_[std::size_t((v - v0_) * columns + (u - u0_))] = {float(out.u), float(out.v), float(out.r)};
            }
        },
        onto_.view.sensor);
  }

  // Where a corner of a cell of the tile under way falls in `onto`; r is 0 if nowhere.
  Eigen::Vector3f projected(std::uint32_t pixel) const {
    int u = int(pixel % std::uint32_t(from_.grid.width)) - u0_;
    const int v = int(pixel / std::uint32_t(from_.grid.width)) - v0_;
    if (u < 0) u += from_.grid.width;
    return projected_[std::size_t(v * (kTile_px + 1) + u)];
  }

  bool make_projected(std::size_t cell, int slot, ProjectedTriangle& t) const {
    const auto corners = from_.grid.corners(cell, slot);
    t.confidence = 0;
    float cosine = 0, range = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const Eigen::Vector3f q = projected(corners[i]);
      if (!(q.z() > 0)) return false;
      t.p[i] = q.head<2>();
      t.r[i] = q.z();
      t.confidence += from_.confidence.pixels[corners[i]] / 3;
      cosine += float(from_.incidence.pixels[corners[i]]) / (3 * 255);
      range += from_.view.range.pixels[corners[i]] / 3;
    }
    // A triangle across the seam of a panorama is moved to one side of it.
    if (onto_.grid.wraps)
      for (std::size_t i = 1; i < 3; ++i) {
        if (t.p[i].x() - t.p[0].x() > 0.5f * float(width_)) t.p[i].x() -= float(width_);
        if (t.p[0].x() - t.p[i].x() > 0.5f * float(width_)) t.p[i].x() += float(width_);
      }
    t.sigma_normal_m = float(from_.noise.sigma(double(range))) * cosine;
    return true;
  }

  void judge(std::size_t cell, int slot, KillMap& kills_from, KillMap& kills_onto, Outcome& outcome) {
    ProjectedTriangle t;
    if (!make_projected(cell, slot, t)) return;
    const Circle circle = removing_circle(t.p);
    const float reach = std::sqrt(circle.squared_radius) + kCellReach_px;
    const int u_begin = int(std::floor(circle.center.x() - reach)), u_end = int(std::floor(circle.center.x() + reach));
    const int v_begin = std::max(0, int(std::floor(circle.center.y() - reach)));
    const int v_end = std::min(height_ - 2, int(std::floor(circle.center.y() + reach)));
    if (v_end < v_begin || (!onto_.grid.wraps && (u_end < 0 || u_begin > width_ - 2))) return;
    ++outcome.tested;
    if (is_front_facing(cell, slot, t)) {
      const float mean = gather_overlapped(t, circle, u_begin, u_end, v_begin, v_end);
      if (!candidates_.empty()) {
        const bool loses = is_newer(from_, onto_) ? kLead * mean >= t.confidence : mean > kLead * t.confidence;
        if (loses)
          mark_killed(kills_from, cell, slot);
        else
          for (const Candidate& c : candidates_) mark_killed(kills_onto, c.cell, c.slot);
        return;
      }
    }
    if (options_.remove_seen_through && is_seen_through(t)) {
      mark_killed(kills_from, cell, slot);
      ++outcome.seen_through;
    }
  }

  // Patches lie in one array in the order they were added.
  static bool is_newer(const Patch& a, const Patch& b) { return &a > &b; }

  // The triangle's own winding decides; where noise may have turned it over, the surface around it does.
  bool is_front_facing(std::size_t cell, int slot, const ProjectedTriangle& t) const {
    // Rows run down, so counter-clockwise as seen has a negative area in an ordinary image.
    const float sign = onto_.grid.is_mirrored ? 1.0f : -1.0f;
    if (sign * signed_area2(t.p) > 0) return true;
    const auto corners = from_.grid.corners(cell, slot);
    const Eigen::Vector3f normal = wide_normal(int(corners[0] % std::uint32_t(from_.grid.width)),
                                               int(corners[0] / std::uint32_t(from_.grid.width)));
    const Eigen::Vector3d p = T_onto_from_ * from_.point_in_view(corners[0]).cast<double>();
    const auto u = std::clamp(int(std::lround(t.p[0].x())), 0, width_ - 1);
    const auto v = std::clamp(int(std::lround(t.p[0].y())), 0, height_ - 1);
    const std::size_t pixel = onto_.confidence.index(u, v);
    const Eigen::Vector3d ray = onto_.rays->origins.empty() ? p : onto_.rays->directions[pixel].cast<double>();
    const Eigen::Vector3d n = T_onto_from_.linear() * normal.cast<double>();
    return n.dot(ray) < -kEdgeOnCosine * n.norm() * ray.norm();
  }

  // Normal over a wider baseline, towards the sensor.
  Eigen::Vector3f wide_normal(int u, int v) const {
    const auto sample = [&](int x, int y) { return from_.point_in_view(from_.confidence.index(x, y)); };
    const auto reach = [&](int du, int dv) {
      Eigen::Vector2i best(u, v);
      for (int k = 1; k <= kWideBaseline_px; ++k) {
        const int x = u + k * du, y = v + k * dv;
        if (x < 0 || y < 0 || x >= from_.grid.width || y >= from_.grid.height) break;
        if (!(from_.confidence.at(x, y) > 0)) break;
        best = {x, y};
      }
      return best;
    };
    const Eigen::Vector2i e = reach(1, 0), w = reach(-1, 0), s = reach(0, 1), n = reach(0, -1);
    const Eigen::Vector3f along_u = sample(e.x(), e.y()) - sample(w.x(), w.y());
    const Eigen::Vector3f along_v = sample(s.x(), s.y()) - sample(n.x(), n.y());
    const Eigen::Vector3f normal = along_v.cross(along_u);
    return from_.grid.is_mirrored ? Eigen::Vector3f(-normal) : normal;
  }

  // Fills candidates_ with the alive triangles of `onto` that t overlaps; returns their mean confidence. Nearer ones
  // weigh more: at a rim, where confidence falls, a plain mean would let two equal views drive each other out.
  float gather_overlapped(const ProjectedTriangle& t, const Circle& circle, int u_begin, int u_end, int v_begin,
                          int v_end) {
    candidates_.clear();
    if (!onto_.grid.wraps) u_begin = std::max(0, u_begin), u_end = std::min(width_ - 2, u_end);
    const float reach = std::sqrt(circle.squared_radius) + kCellRadius_px;
    const Vec2 middle = (t.p[0] + t.p[1] + t.p[2]) / 3;
    float sum = 0, weight_sum = 0;
    for (int v = v_begin; v <= v_end; ++v)
      for (int u = u_begin; u <= u_end; ++u) {
        const Circle cell_circle{Vec2(float(u) + 0.5f, float(v) + 0.5f), 0.5f};
        if ((cell_circle.center - circle.center).squaredNorm() > reach * reach) continue;
        const int u_wrapped = onto_.grid.wraps ? (u % width_ + width_) % width_ : u;
        const std::size_t cell = onto_.confidence.index(u_wrapped, v);
        if (!onto_.grid.has_alive(cell)) continue;
        const std::size_t right = u_wrapped + 1 < width_ ? cell + 1 : cell + 1 - std::size_t(width_);
        const Corners corners{
            {cell, right, cell + std::size_t(width_), right + std::size_t(width_)}, float(u), float(v)};
        const bool is_anti = onto_.grid.cells[cell] & PatchGrid::kAntiDiagonal;
        for (int slot = 0; slot < 2; ++slot) {
          if (!onto_.grid.is_alive(cell, slot)) continue;
          const auto& chosen = kCornersOfSlot[is_anti][std::size_t(slot)];
          float confidence = 0;
          if (!overlaps(t, circle, cell_circle, corners, chosen, confidence)) continue;
          Vec2 centroid{float(u), float(v)};
          for (const std::uint8_t k : chosen) centroid += Vec2(float(k & 1), float(k >> 1)) / 3;
          const float weight = 1 / (kNearness_px2 + (centroid - middle).squaredNorm());
          sum += weight * confidence;
          weight_sum += weight;
          candidates_.push_back({cell, slot});
        }
      }
    return candidates_.empty() ? 0.0f : sum / weight_sum;
  }

  // The four samples of a cell and the place of its first one in the unwrapped image.
  struct Corners {
    std::array<std::size_t, 4> pixel;
    float u, v;
  };
  // Which of them make which triangle; the order does not matter here.
  static constexpr std::array<std::uint8_t, 3> kCornersOfSlot[2][2] = {{{0, 2, 3}, {0, 3, 1}}, {{0, 2, 1}, {1, 2, 3}}};

  bool overlaps(const ProjectedTriangle& t, const Circle& circle, const Circle& cell_circle, const Corners& corners,
                const std::array<std::uint8_t, 3>& chosen, float& confidence) const {
    float sum = 0, low = 3e38f, high = 0, cosine = 0;
    for (const std::uint8_t k : chosen) {
      const float r = onto_.view.range.pixels[corners.pixel[k]];
      sum += r;
      low = std::min(low, r);
      high = std::max(high, r);
      cosine += float(onto_.incidence.pixels[corners.pixel[k]]);
    }
    const float r = sum / 3;
    cosine /= 3 * 255;
    // Overlap in the image is overlap in space only if the surfaces are this close along the ray. Corners of t and of
    // the candidate are up to a sample apart: high − low is what the candidate's slope makes of that.
    const float own = float(onto_.noise.sigma(double(r))) * cosine;
    const float along_normal =
        float(options_.noise_factor) * std::sqrt(own * own + t.sigma_normal_m * t.sigma_normal_m) +
        kRegistrationFactor * float(options_.registration_error_m);
    const float tolerance = along_normal / std::max(cosine, kLowestCosine) + (high - low);
    if (r < std::min({t.r[0], t.r[1], t.r[2]}) - tolerance || r > std::max({t.r[0], t.r[1], t.r[2]}) + tolerance)
      return false;
    std::array<Vec2, 3> q;
    confidence = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      q[i] = Vec2(corners.u + float(chosen[i] & 1), corners.v + float(chosen[i] >> 1));
      confidence += onto_.confidence.pixels[corners.pixel[chosen[i]]] / 3;
    }
    if (!overlap_2d(t.p, circle, q, cell_circle)) return false;
    return std::abs(range_at(t, (q[0] + q[1] + q[2]) / 3) - r) <= tolerance;
  }

  // Whether `onto` measured, in every sample around t, something clearly behind it.
  bool is_seen_through(const ProjectedTriangle& t) const {
    const float r = std::max({t.r[0], t.r[1], t.r[2]});
    const float low_r = std::min({t.r[0], t.r[1], t.r[2]});
    const auto [u_low, u_high] = std::minmax({t.p[0].x(), t.p[1].x(), t.p[2].x()});
    const auto [v_low, v_high] = std::minmax({t.p[0].y(), t.p[1].y(), t.p[2].y()});
    if (std::max(u_high - u_low, v_high - v_low) > kLargestFootprint_px) return false;
    // Nearly all triangles are hidden or on the measured surface: one look at the nearest sample tells.
    const int u_near = std::clamp(int(std::lround(t.p[0].x())), 0, width_ - 1);
    const int v_near = std::clamp(int(std::lround(t.p[0].y())), 0, height_ - 1);
    if (!(onto_.view.range.at(u_near, v_near) > r)) return false;
    const auto& directions = onto_.rays->directions;
    const float spacing = (directions[0] - directions[1]).norm() * low_r;
    const float slack = 1.0f + (onto_.rays->origins.empty() && spacing > 0
                                    ? std::min(8.0f, 2 * float(options_.registration_error_m) / spacing)
                                    : 0.0f);
    const int u_begin = int(std::floor(u_low - slack)), u_end = int(std::ceil(u_high + slack));
    const int v_begin = int(std::floor(v_low - slack)), v_end = int(std::ceil(v_high + slack));
    if (v_begin < 0 || v_end >= height_ || (!onto_.grid.wraps && (u_begin < 0 || u_end >= width_))) return false;
    const float noise_m = std::hypot(float(onto_.noise.sigma(double(r))), t.sigma_normal_m);
    const float clearance = kClearanceFactor * (float(options_.noise_factor) * noise_m +
                                                kRegistrationFactor * float(options_.registration_error_m)) +
                            (r - low_r);
    for (int v = v_begin; v <= v_end; ++v)
      for (int u = u_begin; u <= u_end; ++u) {
        const std::size_t pixel = onto_.confidence.index(onto_.grid.wraps ? (u % width_ + width_) % width_ : u, v);
        const float measured = onto_.view.range.pixels[pixel];
        if (!(onto_.confidence.pixels[pixel] > 0)) return false;
        const float behind = measured - r;
        // A grazing surface runs away from its own samples: what lies just in front of it is not empty.
        const float cosine = std::max(kLowestCosine, float(onto_.incidence.pixels[pixel]) / 255);
        if (behind < clearance / cosine + float(onto_.noise.sigma(double(measured))) * kClearanceFactor) return false;
      }
    return true;
  }

  const Patch& from_;
  const Patch& onto_;
  const OverlapOptions& options_;
  Eigen::Isometry3d T_onto_from_;
  int width_, height_;
  int u0_ = 0, v0_ = 0;
  std::vector<Eigen::Vector3f> projected_;
  std::vector<Candidate> candidates_;
};

// One tile of one patch, to be judged in the image of another.
struct TileTask {
  std::size_t from, onto;
  PatchTile tile;
};

PairTest::Outcome judge_all(std::span<Patch> patches, const std::vector<TileTask>& tasks, std::vector<KillMap>& kills,
                            const OverlapOptions& options, Context& context) {
  return parallel_reduce(
      context, tasks.size(), 4, PairTest::Outcome{},
      [&](std::size_t begin, std::size_t end, PairTest::Outcome sum) {
        for (std::size_t i = begin; i != end; ++i) {
          const TileTask& task = tasks[i];
          PairTest test(patches[task.from], patches[task.onto], options);
          const PairTest::Outcome one = test.judge_tile(task.tile, kills[task.from], kills[task.onto]);
          sum.tested += one.tested;
          sum.seen_through += one.seen_through;
        }
        return sum;
      },
      [](PairTest::Outcome a, const PairTest::Outcome& b) {
        a.tested += b.tested;
        a.seen_through += b.seen_through;
        return a;
      });
}

bool can_see(const ViewCone& cone, const Patch& onto, const Patch& from, const PatchTile& tile) {
  const Eigen::Isometry3d T_onto_from = onto.view.T_world_view.inverse() * from.view.T_world_view;
  return cone.can_see((T_onto_from * tile.center_in_view.cast<double>()).cast<float>(), tile.radius_m);
}

}  // namespace

bool is_seen_through(const Patch& patch, const Eigen::Vector3d& point_world_m, const OverlapOptions& options) {
  const auto at = project(patch.view.sensor, patch.view.T_world_view.inverse() * point_world_m);
  if (!at) return false;
  const int w = patch.grid.width, h = patch.grid.height;
  const int u0 = int(std::floor(at->u)), v0 = int(std::floor(at->v));
  for (int v = v0; v <= v0 + 1; ++v)
    for (int u = u0; u <= u0 + 1; ++u) {
      if (v < 0 || v >= h || (!patch.grid.wraps && (u < 0 || u >= w))) return false;
      const std::size_t pixel = patch.confidence.index((u % w + w) % w, v);
      if (!(patch.confidence.pixels[pixel] > 0)) return false;
      const auto measured = double(patch.view.range.pixels[pixel]);
      const double cosine = std::max(double(kLowestCosine), double(patch.incidence.pixels[pixel]) / 255);
      const double clearance = double(kClearanceFactor) * (options.noise_factor * patch.noise.sigma(measured) +
                                                           double(kRegistrationFactor) * options.registration_error_m);
      if (measured - at->r < clearance / cosine) return false;
    }
  return true;
}

struct OverlapRemoval::Impl {
  OverlapOptions options;
  std::vector<ViewCone> cones;
  std::vector<std::vector<PatchTile>> tiles;  // of each patch, those with triangles alive
  std::vector<TileTask> tasks;
  std::vector<KillMap> kills;  // empty where no task looks

  void plan(std::span<Patch> patches, std::size_t from, std::size_t onto) {
    const auto want_kills = [&](std::size_t i) {
      if (kills[i].empty()) kills[i].assign(patches[i].grid.cells.size(), 0);
    };
    for (const PatchTile& tile : tiles[from])
      if (can_see(cones[onto], patches[onto], patches[from], tile)) {
        tasks.push_back({from, onto, tile});
        want_kills(from);
        want_kills(onto);
      }
  }

  // Runs the planned tasks, then lets their decisions take effect.
  void carry_out(std::span<Patch> patches, OverlapCounts& counts, Context& context) {
    const PairTest::Outcome outcome = judge_all(patches, tasks, kills, options, context);
    counts.tested += outcome.tested;
    counts.removed_seen_through += outcome.seen_through;
    std::vector<std::uint64_t> killed(patches.size(), 0);
    parallel_for(context, patches.size(), 1, [&](std::size_t i) {
      killed[i] = apply_kills(patches[i].grid, kills[i]);
      if (killed[i]) tiles[i] = make_tiles(patches[i]);
    });
    for (std::size_t i = 0; i + 1 < patches.size(); ++i) counts.removed_old += killed[i];
    counts.removed_new += killed.back();
    kills.assign(patches.size(), {});
    tasks.clear();
  }
};

OverlapRemoval::OverlapRemoval(const OverlapOptions& options) : impl_(std::make_unique<Impl>()) {
  impl_->options = options;
}
OverlapRemoval::~OverlapRemoval() = default;

OverlapCounts OverlapRemoval::add(std::span<Patch> patches, Context& context) {
  OverlapCounts counts;
  const std::size_t added = patches.size() - 1;
  impl_->cones.push_back(make_cone(patches[added]));
  impl_->tiles.push_back(make_tiles(patches[added]));
  impl_->kills.assign(patches.size(), {});
  for (std::size_t old = 0; old < added; ++old) impl_->plan(patches, old, added);
  impl_->carry_out(patches, counts, context);
  for (std::size_t old = 0; old < added; ++old) impl_->plan(patches, added, old);
  impl_->carry_out(patches, counts, context);
  return counts;
}

}  // namespace lapseam
