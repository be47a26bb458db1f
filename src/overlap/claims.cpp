// Based on: Y. Sun, C. Dumont, M. Abidi, Mesh-based Integration of Range and Color Images, 2000, §2.2.

#include "lapseam/overlap.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "core/parallel.h"
#include "overlap/view_projection.h"
#include "patch/wide_normal.h"

namespace lapseam {
namespace {

constexpr float kRegistrationFactor = 2.0f;  // twice the median disagreement covers most of it
// Surfaces this many tolerances apart are still one that the views disagree about: one of them must yield.
constexpr float kDisagreement = 2.0f;
constexpr float kClearanceFactor = 2.0f;  // to be empty, space must be clearer than to be the same surface
constexpr float kLowestCosine = 0.15f;    // 81°: beyond, a range says nothing about a normal distance
// Range images are smoothed: measurements of one spot differ by much less than the noise of a single sample. What
// differs by more than this share of it does so because a view blurs an edge, and would blur the mean.
constexpr float kConsensusGate = 0.5f;
constexpr float kSameSide = 0.7f;  // views this much alike in direction see the same side of a sheet

std::uint8_t code(Claim claim) { return static_cast<std::uint8_t>(claim); }

// What another view needs to be asked about a sample.
struct Judge {
  const Patch* patch;
  const PinholeSensor* pinhole;  // without distortion
  Eigen::Isometry3d T_judge_view;
  Eigen::Matrix3f R;
  Eigen::Vector3f t;
  float spacing_per_m;  // between neighbouring rays, at a range of one metre
  bool wins_ties;
};

Judge make_judge(const Patch& judge, const Patch& view) {
  Judge j;
  j.patch = &judge;
  j.pinhole = std::get_if<PinholeSensor>(&judge.view.sensor);
  if (j.pinhole && !j.pinhole->distortion.is_zero()) j.pinhole = nullptr;
  j.T_judge_view = judge.view.T_world_view.inverse() * view.view.T_world_view;
  j.R = j.T_judge_view.linear().cast<float>();
  j.t = j.T_judge_view.translation().cast<float>();
  const auto& rays = judge.rays->directions;
  const std::size_t middle = rays.size() / 2;
  j.spacing_per_m = (rays[middle] - rays[middle + 1 < rays.size() ? middle + 1 : 0]).norm();
  j.wins_ties = &judge < &view;
  return j;
}

struct Pixel {
  float u, v, r;
};

bool project_into(const Judge& judge, const Eigen::Vector3f& p_view, Pixel& out) {
  if (judge.pinhole) {
    const Eigen::Vector3f p = judge.R * p_view + judge.t;
    if (!(p.z() > 0)) return false;
    const float inverse = 1 / p.z();
    out = {float(judge.pinhole->fx) * p.x() * inverse + float(judge.pinhole->cx),
           float(judge.pinhole->fy) * p.y() * inverse + float(judge.pinhole->cy), p.z()};
    return true;
  }
  const auto at = project(judge.patch->view.sensor, judge.T_judge_view * p_view.cast<double>());
  if (!at) return false;
  out = {float(at->u), float(at->v), float(at->r)};
  return true;
}

// Judges the samples of one tile of one view.
class TileClaims {
 public:
  TileClaims(const Patch& patch, const OverlapOptions& options, Image<std::uint8_t>& claims, Image<float>& shift)
      : patch_(patch), options_(options), claims_(claims), shift_(shift) {}

  // Where a coarse lattice of samples yields all around a piece of unbroken surface, so do the samples between: only
  // the rest is asked for one by one. What yields needs no consensus, for it is not kept.
  void run(const PatchTile& tile, const std::vector<Judge>& judges) {
    samples_.clear();
    for (int v = tile.v0; v <= tile.v1; v += kLattice_px)
      for (int u = tile.u0; u <= tile.u1; u += kLattice_px) gather(u, v);
    ask_all(judges);
    for (const Sample& sample : samples_) lattice_[sample.pixel] = sample.claim;
    samples_.clear();
    for (int v = tile.v0; v < tile.v1; v += kLattice_px)
      for (int u = tile.u0; u < tile.u1; u += kLattice_px) {
        const bool yields = is_unbroken(u, v) && yields_at(u, v) && yields_at(u + kLattice_px, v) &&
                            yields_at(u, v + kLattice_px) && yields_at(u + kLattice_px, v + kLattice_px);
        for (int y = v; y < std::min(v + kLattice_px, tile.v1); ++y)
          for (int x = u; x < std::min(u + kLattice_px, tile.u1); ++x) {
            if (yields)
              claims_.at(x, y) = code(Claim::kYields);
            else
              gather(x, y);
          }
      }
    lattice_.clear();
    ask_all(judges);
    const float systematic = squared_registration();
    for (const Sample& sample : samples_) {
      claims_.pixels[sample.pixel] = code(sample.claim);
      if (!(sample.sum > 0) || sample.claim == Claim::kPhantom) continue;
      const float own_weight = 1 / (sample.error_m * sample.error_m + systematic);
      const float cosine = std::max(kLowestCosine, float(patch_.incidence.pixels[sample.pixel]) / 255);
      shift_.pixels[sample.pixel] = sample.weighted / (sample.sum + own_weight) / cosine;
    }
  }

 private:
  static constexpr int kLattice_px = 4;

  struct Sample {
    Eigen::Vector3f point;  // in the view's frame
    std::uint32_t pixel;
    float confidence, error_m;
    float sum = 0, weighted = 0;  // of the consensus: weights, and what the others say times weight, along the normal
    Claim claim = Claim::kBest;
  };

  // One judge after another, each over all samples: what they fall on stays in the cache.
  void ask_all(const std::vector<Judge>& judges) {
    for (const Judge& judge : judges)
      for (Sample& sample : samples_)
        if (sample.claim != Claim::kPhantom) ask(judge, sample);
  }

  bool yields_at(int u, int v) const {
    const auto found = lattice_.find(std::uint32_t(patch_.confidence.index(u, v)));
    return found != lattice_.end() && found->second == Claim::kYields;
  }

  // Every cell from (u, v) to the next lattice points has both its triangles.
  bool is_unbroken(int u, int v) const {
    if (u + kLattice_px >= patch_.grid.width || v + kLattice_px >= patch_.grid.height) return false;
    for (int y = v; y < v + kLattice_px; ++y)
      for (int x = u; x < u + kLattice_px; ++x) {
        const std::size_t cell = patch_.confidence.index(x, y);
        if (!patch_.grid.exists(cell, 0) || !patch_.grid.exists(cell, 1)) return false;
      }
    return true;
  }

  float squared_registration() const {
    return float(options_.registration_error_m) * float(options_.registration_error_m);
  }

  void gather(int u, int v) {
    if (u >= patch_.grid.width || v >= patch_.grid.height) return;
    const std::size_t i = patch_.confidence.index(u, v);
    if (!(patch_.confidence.pixels[i] > 0)) return;
    const float error = float(patch_.noise.sigma(double(patch_.view.range.pixels[i]))) *
                        std::max(0.05f, float(patch_.incidence.pixels[i]) / 255);
    samples_.push_back({patch_.point_in_view(i), std::uint32_t(i), patch_.confidence.pixels[i], error});
  }

  void ask(const Judge& judge, Sample& sample) const {
    Pixel at;
    if (!project_into(judge, sample.point, at)) return;
    const Patch& other = *judge.patch;
    const int w = other.grid.width, h = other.grid.height;
    if (!(at.u > -1e6f && at.u < 1e6f && at.v > 0.5f && at.v < float(h) - 1.5f)) return;
    int x = int(std::floor(at.u + 0.5f));
    const int y = int(at.v + 0.5f);
    if (other.grid.wraps)
      x = (x % w + w) % w;
    else if (x < 1 || x >= w - 1)
      return;
    const std::size_t pixel = other.confidence.index(x, y);
    const float measured = other.view.range.pixels[pixel];
    // Hidden behind something else, as most are: no more to ask.
    const auto sigma = float(other.noise.sigma(double(measured)));
    const float spacing = judge.spacing_per_m * measured;
    const float registration = kRegistrationFactor * float(options_.registration_error_m);
    const float most =
        (kDisagreement * (float(options_.noise_factor) * (sigma + sample.error_m) + registration) + spacing) /
        kLowestCosine;
    if (!(measured > at.r - most)) return;
    const float other_confidence = other.confidence.pixels[pixel];
    if (!(other_confidence > 0)) return;
    const float cosine = std::max(kLowestCosine, float(other.incidence.pixels[pixel]) / 255);
    const float own = sigma * cosine;
    const float variance = own * own + sample.error_m * sample.error_m;
    const float along_normal = float(options_.noise_factor) * std::sqrt(variance) + registration;
    // The sample may lie up to half a pixel from the other view's: the surface's slope makes a difference of that.
    const float slack = 0.7f * spacing * std::sqrt(1 - cosine * cosine) / cosine;
    float between = measured;
    const bool is_smooth = interpolate(other, at, between);
    const float behind = between - at.r;
    if (std::abs(behind) <= kDisagreement * along_normal / cosine + slack) {
      if (!is_same_side(judge, pixel, sample)) return;
      // Both errors are taken along the normal, where they mean the same for both views.
      const float off = behind * cosine, systematic = squared_registration();
      if (is_smooth && off * off <= kConsensusGate * kConsensusGate * (variance + systematic)) {
        const float weight = 1 / (own * own + systematic);
        sample.sum += weight;
        sample.weighted += weight * off;
      }
      if (other_confidence > sample.confidence || (other_confidence == sample.confidence && judge.wins_ties))
        sample.claim = Claim::kYields;
    } else if (options_.remove_seen_through && behind > 0 &&
               is_seen_through(other, x, y, at.r, kClearanceFactor * along_normal)) {
      sample.claim = Claim::kPhantom;
    }
  }

  // Range of the other view's surface between its samples; where they part, that of the nearest.
  static bool interpolate(const Patch& other, const Pixel& at, float& out) {
    const int u = int(std::floor(at.u)), v = int(std::floor(at.v)), w = other.grid.width;
    if (v < 0 || v + 1 >= other.grid.height || (!other.grid.wraps && (u < 0 || u + 1 >= w))) return false;
    const int u0 = other.grid.wraps ? (u % w + w) % w : u, u1 = u0 + 1 < w ? u0 + 1 : 0;
    const std::size_t cell = other.confidence.index(u0, v);
    if (!other.grid.exists(cell, 0) || !other.grid.exists(cell, 1)) return false;
    const auto& range = other.view.range;
    const float s = at.u - float(u), t = at.v - float(v);
    out = (1 - t) * ((1 - s) * range.at(u0, v) + s * range.at(u1, v)) +
          t * ((1 - s) * range.at(u0, v + 1) + s * range.at(u1, v + 1));
    return true;
  }

  // In every sample around: clearly behind.
  bool is_seen_through(const Patch& other, int x, int y, float r, float clearance_m) const {
    const int w = other.grid.width;
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx) {
        const int u = other.grid.wraps ? ((x + dx) % w + w) % w : x + dx;
        const std::size_t pixel = other.confidence.index(u, y + dy);
        if (!(other.confidence.pixels[pixel] > 0)) return false;
        const float cosine = std::max(kLowestCosine, float(other.incidence.pixels[pixel]) / 255);
        const float measured = other.view.range.pixels[pixel];
        if (measured - r < clearance_m / cosine + kClearanceFactor * float(other.noise.sigma(double(measured))))
          return false;
      }
    return true;
  }

  // Whether the other view, by its pixel, looks at the side of the surface that this one measured.
  bool is_same_side(const Judge& judge, std::size_t pixel, const Sample& sample) const {
    const bool is_central = patch_.rays->origins.empty(), is_judge_central = judge.patch->rays->origins.empty();
    const Eigen::Vector3f turned = judge.R * (is_central ? sample.point : patch_.rays->directions[sample.pixel]);
    const Eigen::Vector3f ray =
        is_judge_central ? Eigen::Vector3f(judge.R * sample.point + judge.t) : judge.patch->rays->directions[pixel];
    const float alike = turned.dot(ray);
    if (alike > 0 && alike * alike > kSameSide * kSameSide * turned.squaredNorm() * ray.squaredNorm()) return true;
    const auto w = std::uint32_t(patch_.grid.width);
    const Eigen::Vector3f normal = judge.R * WideNormal(patch_).at(int(sample.pixel % w), int(sample.pixel / w));
    return normal.dot(ray) < 0;
  }

  const Patch& patch_;
  const OverlapOptions& options_;
  Image<std::uint8_t>& claims_;
  Image<float>& shift_;
  std::vector<Sample> samples_;
  std::unordered_map<std::uint32_t, Claim> lattice_;
};

// Connected samples of one claim that are fewer than `smallest` and border on the other claim change sides.
std::uint64_t give_islands(const PatchGrid& grid, Image<std::uint8_t>& claims, Claim from, Claim to,
                           std::uint64_t smallest) {
  const int w = grid.width, h = grid.height;
  std::vector<std::uint8_t> visited(claims.size(), 0);
  std::vector<std::uint32_t> piece;
  std::uint64_t given = 0;
  for (std::size_t seed = 0; seed < claims.size(); ++seed) {
    if (visited[seed] || claims.pixels[seed] != code(from)) continue;
    piece.assign(1, std::uint32_t(seed));
    visited[seed] = 1;
    bool borders = false;
    for (std::size_t k = 0; k < piece.size(); ++k) {
      const int u = int(piece[k] % std::uint32_t(w)), v = int(piece[k] / std::uint32_t(w));
      const auto visit = [&](int x, int y) {
        if (y < 0 || y >= h) return;
        if (x < 0 || x >= w) {
          if (!grid.wraps) return;
          x = (x + w) % w;
        }
        const std::size_t i = claims.index(x, y);
        borders |= claims.pixels[i] == code(to);
        if (visited[i] || claims.pixels[i] != code(from)) return;
        visited[i] = 1;
        piece.push_back(std::uint32_t(i));
      };
      visit(u - 1, v), visit(u + 1, v), visit(u, v - 1), visit(u, v + 1);
    }
    if (!borders || piece.size() >= smallest) continue;
    for (const std::uint32_t i : piece) claims.pixels[i] = code(to);
    given += piece.size();
  }
  return given;
}

}  // namespace

std::vector<Image<std::uint8_t>> claim_samples(std::span<Patch> patches, const OverlapOptions& options,
                                               std::span<ClaimCounts> counts, Context& context) {
  std::vector<ViewCone> cones(patches.size());
  std::vector<std::vector<PatchTile>> tiles(patches.size());
  std::vector<Image<std::uint8_t>> claims(patches.size());
  std::vector<Image<float>> shifts(patches.size());
  struct Task {
    std::size_t view, tile;
  };
  parallel_for(context, patches.size(), 1, [&](std::size_t i) {
    cones[i] = make_cone(patches[i]);
    tiles[i] = make_tiles(patches[i]);
    claims[i] = Image<std::uint8_t>(patches[i].grid.width, patches[i].grid.height, 0);
    shifts[i] = Image<float>(patches[i].grid.width, patches[i].grid.height, 0.0f);
  });
  std::vector<Task> tasks;
  for (std::size_t i = 0; i < patches.size(); ++i)
    for (std::size_t k = 0; k < tiles[i].size(); ++k) tasks.push_back({i, k});
  parallel_for(context, tasks.size(), 4, [&](std::size_t k) {
    const std::size_t i = tasks[k].view;
    const PatchTile& tile = tiles[i][tasks[k].tile];
    std::vector<Judge> judges;
    for (std::size_t j = 0; j < patches.size(); ++j) {
      if (j == i) continue;
      const Judge judge = make_judge(patches[j], patches[i]);
      if (cones[j].can_see(judge.R * tile.center_in_view + judge.t, tile.radius_m)) judges.push_back(judge);
    }
    TileClaims(patches[i], options, claims[i], shifts[i]).run(tile, judges);
  });
  parallel_for(context, patches.size(), 1, [&](std::size_t i) {
    for (std::size_t k = 0; options.consensus && k < shifts[i].size(); ++k)
      patches[i].view.range.pixels[k] += shifts[i].pixels[k];
    ClaimCounts sum;
    sum.islands += give_islands(patches[i].grid, claims[i], Claim::kBest, Claim::kYields, options.smallest_island);
    sum.islands += give_islands(patches[i].grid, claims[i], Claim::kYields, Claim::kBest, options.smallest_island);
    for (const std::uint8_t c : claims[i].pixels) {
      sum.best += c == code(Claim::kBest);
      sum.yields += c == code(Claim::kYields);
      sum.phantom += c == code(Claim::kPhantom);
    }
    if (!counts.empty()) counts[i] = sum;
  });
  return claims;
}

}  // namespace lapseam
