// Based on: Y. Sun, C. Dumont, M. Abidi, Mesh-based Integration of Range and Color Images, 2000, §2.2.

#include "lapseam/overlap.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/parallel.h"
#include "core/spill_file.h"
#include "lapseam/mesh.h"
#include "overlap/view_projection.h"
#include "patch/same_surface.h"
#include "patch/wide_normal.h"

namespace lapseam {
namespace {

// Surfaces this many tolerances apart are still one that the views disagree about: one of them must yield.
constexpr float kDisagreement = 2.0f;
constexpr float kClearanceFactor = 2.0f;  // to be empty, space must be clearer than to be the same surface
// Range images are smoothed: measurements of one spot differ by much less than the noise of a single sample. What
// differs by more than this share of it does so because a view blurs an edge, and would blur the mean.
constexpr float kConsensusGate = 0.5f;
// Poses and calibration, though, part whole views: all that they may be off by belongs into the mean.
constexpr float kRegistrationGate = 3.0f;
// The mean of what lies within the gate about the last mean, so often: it no longer depends on where the sample was.
constexpr int kConsensusSteps = 3;
// A sample is a phantom if more than this share of those that measured its spot look through it. One that does, where
// many agree, has a step beside it that is out of place by the error of its pose.
constexpr float kLookingThrough = 0.5f;
// Views with more than this many times the noise have no say: their weights are small, but they are many, and what
// smoothing did to their edges is no noise that a mean would take away.
constexpr double kLargestNoiseRatio = 2;
constexpr std::size_t kTilesAtOnce = 16;  // of one view: they have the same judges
constexpr float kSameSide = 0.7f;         // views this much alike in direction see the same side of a sheet

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

// Whether the judge's noise at a tile, given in its frame too, is not much more than the view's own there.
bool is_worth_asking(const Patch& judge, const Eigen::Vector3f& center, const Patch& patch, const PatchTile& tile) {
  const double there = judge.noise.sigma(double(center.norm()));
  return there <= kLargestNoiseRatio * patch.noise.sigma(double(tile.center_in_view.norm()));
}

// No sample of a tile is the judge's surface if it lies farther than this from it, along the judge's ray.
float largest_tolerance(const Judge& judge, const Eigen::Vector3f& center, const Patch& patch, const PatchTile& tile,
                        const OverlapOptions& options) {
  const float there = center.norm() + tile.radius_m, here = tile.center_in_view.norm() + tile.radius_m;
  const auto sigma = float(judge.patch->noise.largest_across(double(there)) + patch.noise.largest_across(double(here)));
  return (kDisagreement *
              (float(options.noise_factor) * sigma + kRegistrationFactor * float(options.registration_error_m)) +
          judge.spacing_per_m * there) /
         kGrazingCosine;
}

// Unit of the shift along a sample's ray, which is kept until those of all samples are known. None is over eight times
// what the sample may be off by.
float shift_unit_m(const Patch& patch, std::size_t pixel, double registration_error_m) {
  constexpr double kUnits = 4000;
  const float cosine = std::max(kGrazingCosine, float(patch.incidence.pixels[pixel]) / 255);
  return float(std::hypot(double(patch.sigma_across(pixel, cosine) / cosine), registration_error_m) / kUnits);
}

// Judges the samples of one tile of one view.
class TileClaims {
 public:
  TileClaims(const Patch& patch, const OverlapOptions& options, Image<std::uint8_t>& claims, Image<std::int16_t>& shift)
      : patch_(patch), options_(options), claims_(claims), shift_(shift) {}

  // Each sample of a coarse lattice is asked for. Between four of them on unbroken surface the others follow: each
  // takes the claim of the nearest, and moves by what lies between the four, for range images are smoothed over more
  // than that. Only the rest is asked for one by one.
  void run(const PatchTile& tile, const std::vector<const Judge*>& judges) {
    tile_ = &tile;
    samples_.clear();
    node_.fill({});
    for (int y = 0; y < kNodes; ++y)
      for (int x = 0; x < kNodes; ++x)
        if (const int u = tile.u0 + x * kLattice_px, v = tile.v0 + y * kLattice_px; gather(u, v))
          node_[std::size_t(y * kNodes + x)].sample = std::uint32_t(samples_.size() - 1);
    ask_all(judges);
    for (Node& node : node_) {
      if (node.sample == kInvalidIndex) continue;
      node.claim = samples_[node.sample].claim;
      node.shift = shift_of(samples_[node.sample]);
    }
    samples_.clear();
    for (int y = 0; y + 1 < kNodes; ++y)
      for (int x = 0; x + 1 < kNodes; ++x) fill(x, y);
    ask_all(judges);
    for (const Sample& sample : samples_) {
      claims_.pixels[sample.pixel] = code(sample.claim);
      if (sample.claim != Claim::kPhantom) shift_.pixels[sample.pixel] = coded_shift(sample.pixel, shift_of(sample));
    }
  }

 private:
  static constexpr int kLattice_px = 4, kNodes = kTile_px / kLattice_px + 1;

  struct Sample {
    Eigen::Vector3f point;  // in the view's frame
    std::uint32_t pixel = 0;
    float error_m = 0;
    float consensus_m = 0;  // along the normal, from where it was measured
    std::uint16_t agreeing = 0, looking_through = 0;
    std::uint8_t confidence = 0;
    Claim claim = Claim::kBest;
  };

  // What another view measured of a sample's spot, along the normal, and how far that may lie from the mean.
  struct Opinion {
    std::uint32_t sample;
    float off_m, weight, squared_gate;
  };

  struct Node {
    std::uint32_t sample = kInvalidIndex;
    float shift = 0;
    Claim claim = Claim::kNone;
  };

  // The square between the nodes (x, y) and (x + 1, y + 1).
  void fill(int x, int y) {
    const int u0 = tile_->u0 + x * kLattice_px, v0 = tile_->v0 + y * kLattice_px;
    const auto node = [&](int i, int j) -> const Node& { return node_[std::size_t((y + j) * kNodes + x + i)]; };
    bool is_even = is_unbroken(u0, v0);
    for (int k = 0; k < 4 && is_even; ++k) {
      const Claim claim = node(k & 1, k >> 1).claim;
      is_even = claim == Claim::kBest || claim == Claim::kYields;
    }
    const int u1 = std::min(u0 + kLattice_px, tile_->u1), v1 = std::min(v0 + kLattice_px, tile_->v1);
    for (int v = v0; v < v1; ++v)
      for (int u = u0; u < u1; ++u) {
        if (!is_even) {
          gather(u, v);
          continue;
        }
        const float s = float(u - u0) / kLattice_px, t = float(v - v0) / kLattice_px;
        const std::size_t pixel = claims_.index(u, v);
        claims_.pixels[pixel] = code(node(s > 0.5f, t > 0.5f).claim);
        const float shift = (1 - t) * ((1 - s) * node(0, 0).shift + s * node(1, 0).shift) +
                            t * ((1 - s) * node(0, 1).shift + s * node(1, 1).shift);
        shift_.pixels[pixel] = coded_shift(pixel, shift);
      }
  }

  // Along the ray, to the mean of all views.
  float shift_of(const Sample& sample) const {
    const float cosine = std::max(kGrazingCosine, float(patch_.incidence.pixels[sample.pixel]) / 255);
    return sample.consensus_m / cosine;
  }

  std::int16_t coded_shift(std::size_t pixel, float shift_m) const {
    const float unit_m = shift_unit_m(patch_, pixel, options_.registration_error_m);
    return std::int16_t(std::lround(std::clamp(shift_m / unit_m, -32767.0f, 32767.0f)));
  }

  // One judge after another, each over all samples. What they fall on lies scattered over the judge's image: it is
  // fetched ahead, first the ranges, by which most samples turn out to be hidden, then the rest.
  void ask_all(const std::vector<const Judge*>& judges) {
    for (const Judge* asked : judges) {
      const Judge& judge = *asked;
      seen_.clear();
      const Patch& other = *judge.patch;
      for (std::uint32_t i = 0; i < samples_.size(); ++i) {
        Seen seen{i, 0, {}};
        if (!find_pixel(judge, samples_[i].point, seen)) continue;
        __builtin_prefetch(&other.view.range.pixels[seen.pixel]);
        seen_.push_back(seen);
      }
      std::erase_if(seen_, [&](const Seen& seen) { return is_hidden(judge, samples_[seen.sample], seen); });
      for (const Seen& seen : seen_) {
        __builtin_prefetch(&other.confidence.pixels[seen.pixel]);
        __builtin_prefetch(&other.incidence.pixels[seen.pixel]);
        __builtin_prefetch(&other.grid.cells[seen.pixel]);
        __builtin_prefetch(&other.view.range.pixels[seen.pixel + std::size_t(other.grid.width)]);
      }
      for (const Seen& seen : seen_) ask(judge, samples_[seen.sample], seen);
    }
    find_consensus();
    for (Sample& sample : samples_)
      if (float(sample.looking_through) > kLookingThrough * float(1 + sample.agreeing)) sample.claim = Claim::kPhantom;
  }

  // Weighted means of the opinions, the sample's own among them.
  void find_consensus() {
    for (int step = 0; step < kConsensusSteps; ++step) {
      sums_.assign(samples_.size(), {});
      for (const Opinion& opinion : opinions_) {
        const float off = opinion.off_m - samples_[opinion.sample].consensus_m;
        if (off * off > opinion.squared_gate) continue;
        sums_[opinion.sample].weights += opinion.weight;
        sums_[opinion.sample].weighted_m += opinion.weight * opinion.off_m;
      }
      for (std::size_t i = 0; i < samples_.size(); ++i) {
        const float own_weight = 1 / (samples_[i].error_m * samples_[i].error_m + squared_registration());
        samples_[i].consensus_m = sums_[i].weighted_m / (sums_[i].weights + own_weight);
      }
    }
    opinions_.clear();
  }

  // Every cell from (u, v) to the next lattice points has both its triangles.
  bool is_unbroken(int u, int v) const {
    constexpr std::uint8_t kBoth = PatchGrid::kExists | PatchGrid::kExists << 1;
    if (u + kLattice_px >= patch_.grid.width || v + kLattice_px >= patch_.grid.height) return false;
    for (int y = v; y < v + kLattice_px; ++y)
      for (int x = u; x < u + kLattice_px; ++x)
        if ((patch_.grid.cells[patch_.confidence.index(x, y)] & kBoth) != kBoth) return false;
    return true;
  }

  // Of one view: what two disagree by is of both.
  float squared_registration() const {
    return 0.5f * float(options_.registration_error_m) * float(options_.registration_error_m);
  }

  bool gather(int u, int v) {
    if (u >= patch_.grid.width || v >= patch_.grid.height) return false;
    const std::size_t i = patch_.confidence.index(u, v);
    if (patch_.confidence.pixels[i] == 0) return false;
    Sample sample;
    sample.point = patch_.point_in_view(i);
    sample.pixel = std::uint32_t(i);
    sample.error_m = expected_error_m(patch_, i);
    sample.confidence = patch_.confidence.pixels[i];
    samples_.push_back(sample);
    return true;
  }

  // A sample in a judge's image.
  struct Seen {
    std::uint32_t sample;
    std::uint32_t pixel;
    Pixel at;
  };

  static bool find_pixel(const Judge& judge, const Eigen::Vector3f& point, Seen& seen) {
    Pixel& at = seen.at;
    if (!project_into(judge, point, at)) return false;
    const PatchGrid& grid = judge.patch->grid;
    if (!(at.u > -1e6f && at.u < 1e6f && at.v > 0.5f && at.v < float(grid.height) - 1.5f)) return false;
    int x = int(std::floor(at.u + 0.5f));
    if (grid.wraps)
      x = (x % grid.width + grid.width) % grid.width;
    else if (x < 1 || x >= grid.width - 1)
      return false;
    seen.pixel = std::uint32_t(int(at.v + 0.5f) * grid.width + x);
    return true;
  }

  // Behind something else, as most are: no more to ask.
  bool is_hidden(const Judge& judge, const Sample& sample, const Seen& seen) const {
    const float measured = judge.patch->view.range.pixels[seen.pixel];
    const auto sigma = float(judge.patch->noise.largest_across(double(measured)));
    const float registration = kRegistrationFactor * float(options_.registration_error_m);
    const float most = (kDisagreement * (float(options_.noise_factor) * (sigma + sample.error_m) + registration) +
                        judge.spacing_per_m * measured) /
                       kGrazingCosine;
    return !(measured > seen.at.r - most);
  }

  void ask(const Judge& judge, Sample& sample, const Seen& seen) {
    const Patch& other = *judge.patch;
    const std::size_t pixel = seen.pixel;
    const Pixel& at = seen.at;
    const float measured = other.view.range.pixels[pixel];
    const float spacing = judge.spacing_per_m * measured;
    const float registration = kRegistrationFactor * float(options_.registration_error_m);
    const std::uint8_t other_confidence = other.confidence.pixels[pixel];
    if (!(other_confidence > 0)) return;
    const float cosine = std::max(kGrazingCosine, float(other.incidence.pixels[pixel]) / 255);
    const float own = other.sigma_across(pixel, cosine);
    const float variance = own * own + sample.error_m * sample.error_m;
    const float along_normal = float(options_.noise_factor) * std::sqrt(variance) + registration;
    // The sample may lie up to half a pixel from the other view's: the surface's slope makes a difference of that.
    const float slack = 0.7f * spacing * std::sqrt(1 - cosine * cosine) / cosine;
    float between = measured;
    const bool is_smooth = interpolate(other, at, between);
    const float behind = between - at.r;
    if (std::abs(behind) <= kDisagreement * along_normal / cosine + slack) {
      if (!is_same_side(judge, pixel, sample)) return;
      ++sample.agreeing;
      // Both errors are taken along the normal, where they mean the same for both views.
      const float systematic = squared_registration();
      const float squared_gate =
          kConsensusGate * kConsensusGate * variance + kRegistrationGate * kRegistrationGate * systematic;
      if (is_smooth) opinions_.push_back({seen.sample, behind * cosine, 1 / (own * own + systematic), squared_gate});
      if (other_confidence > sample.confidence || (other_confidence == sample.confidence && judge.wins_ties))
        sample.claim = Claim::kYields;
    } else if (options_.remove_seen_through && behind > 0 &&
               is_seen_through(other, pixel, at.r, kClearanceFactor * along_normal)) {
      ++sample.looking_through;
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
  bool is_seen_through(const Patch& other, std::size_t center, float r, float clearance_m) const {
    const int w = other.grid.width, x = int(center) % w, y = int(center) / w;
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx) {
        const int u = other.grid.wraps ? ((x + dx) % w + w) % w : x + dx;
        const std::size_t pixel = other.confidence.index(u, y + dy);
        if (!(other.confidence.pixels[pixel] > 0)) return false;
        const float cosine = std::max(kGrazingCosine, float(other.incidence.pixels[pixel]) / 255);
        const float measured = other.view.range.pixels[pixel];
        if (measured - r < clearance_m / cosine + kClearanceFactor * other.sigma_across(pixel, cosine) / cosine)
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
  Image<std::int16_t>& shift_;
  const PatchTile* tile_ = nullptr;
  std::vector<Sample> samples_;
  std::vector<Seen> seen_;
  std::vector<Opinion> opinions_;
  struct Sum {
    float weights = 0, weighted_m = 0;
  };
  std::vector<Sum> sums_;  // of the opinions on each sample
  std::array<Node, std::size_t(kNodes* kNodes)> node_;
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
  std::vector<FarthestRanges> farthest(patches.size());
  std::vector<std::vector<PatchTile>> tiles(patches.size());
  std::vector<Image<std::uint8_t>> claims(patches.size());
  std::vector<Image<std::int16_t>> shifts(patches.size());
  struct Task {
    std::size_t view, first, last;  // tiles
  };
  parallel_for(context, patches.size(), 1, [&](std::size_t i) {
    cones[i] = make_cone(patches[i]);
    farthest[i] = FarthestRanges(patches[i]);
    tiles[i] = make_tiles(patches[i]);
    claims[i] = make_spilled_image<std::uint8_t>(patches[i].grid.width, patches[i].grid.height, context);
    shifts[i] = make_spilled_image<std::int16_t>(patches[i].grid.width, patches[i].grid.height, context);
  });
  std::vector<Task> tasks;
  for (std::size_t i = 0; i < patches.size(); ++i)
    for (std::size_t k = 0; k < tiles[i].size(); k += kTilesAtOnce)
      tasks.push_back({i, k, std::min(tiles[i].size(), k + kTilesAtOnce)});
  parallel_for(context, tasks.size(), 1, [&](std::size_t k) {
    const std::size_t i = tasks[k].view;
    std::vector<Judge> judges;
    for (std::size_t j = 0; j < patches.size(); ++j)
      if (j != i) judges.push_back(make_judge(patches[j], patches[i]));
    std::vector<const Judge*> asked;
    TileClaims tile_claims(patches[i], options, claims[i], shifts[i]);
    for (std::size_t place = tasks[k].first; place < tasks[k].last; ++place) {
      const PatchTile& tile = tiles[i][place];
      asked.clear();
      for (const Judge& judge : judges) {
        const auto j = std::size_t(judge.patch - patches.data());
        const Eigen::Vector3f center = judge.R * tile.center_in_view + judge.t;
        if (cones[j].can_see(center, tile.radius_m) && is_worth_asking(patches[j], center, patches[i], tile) &&
            !farthest[j].hide(center, tile.radius_m, largest_tolerance(judge, center, patches[i], tile, options)))
          asked.push_back(&judge);
      }
      tile_claims.run(tile, asked);
    }
  });
  parallel_for(context, patches.size(), 1, [&](std::size_t i) {
    for (std::size_t k = 0; options.consensus && k < shifts[i].size(); ++k)
      if (shifts[i].pixels[k] != 0)
        patches[i].view.range.pixels[k] +=
            float(shifts[i].pixels[k]) * shift_unit_m(patches[i], k, options.registration_error_m);
    ClaimCounts sum;
    sum.islands += give_islands(patches[i].grid, claims[i], Claim::kBest, Claim::kYields, options.smallest_island);
    sum.islands += give_islands(patches[i].grid, claims[i], Claim::kYields, Claim::kBest, options.smallest_island);
    for (const std::uint8_t c : claims[i].pixels) {
      sum.best += c == code(Claim::kBest);
      sum.yields += c == code(Claim::kYields);
      sum.phantom += c == code(Claim::kPhantom);
    }
    if (!counts.empty()) counts[i] = sum;
    shifts[i] = {};
  });
  return claims;
}

}  // namespace lapseam
