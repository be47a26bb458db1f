// After Y. Chen, G. Medioni, Object modeling by registration of multiple range images, 1992 (projection, point to
// plane); S. Rusinkiewicz, A symmetric objective function for ICP, 2019; J. Park, Q.-Y. Zhou, V. Koltun, Colored point
// cloud registration revisited, 2017 (colour as a function on the tangent plane).

#include "register/associate.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"

namespace lapseam {
namespace {

// Normals of one surface in two views, at first under a wrong pose: 37°.
constexpr float kAlike = 0.8f;
// A closest surfel farther off sideways than this many spacings lies at the border of what b saw.
constexpr float kSideways = 1.0f;
// Fewest colours that a median and a spread can be had from.
constexpr std::size_t kFewestColors = 30;
// Gradients of colours hold for a part of a surfel: as long as views are farther off, geometry leads.
constexpr double kColorOnTheWay = 0.25;
// Share of the distance of a pair below which what is unexplained does not shrink further.
constexpr double kNearest = 0.5;
// Below, the errors of normals are not known.
constexpr double kLeastTilt_rad = 1e-3;

class Matcher {
 public:
  Matcher(const Posed& a, const Posed& b, const Gate& gate) : a_(*a.image), b_(*b.image), posed_b_(b), gate_(gate) {
    const Eigen::Isometry3d T_b_a = b.T_world_view.inverse(Eigen::Isometry) * a.T_world_view;
    R_ = T_b_a.linear().cast<float>();
    t_ = T_b_a.translation().cast<float>();
    if (b.box_in_view) {
      box_.min() = b.box_in_view->min().cast<float>().array() - float(gate.capture_m);
      box_.max() = b.box_in_view->max().cast<float>().array() + float(gate.capture_m);
    }
  }

  template <typename SensorModel>
  std::vector<Match> run(const SensorModel& sensor, std::size_t stride) {
    std::vector<Match> out;
    for (std::size_t k = 0; k < a_.usable.size(); k += stride) {
      const Surfel& surfel = a_.surfels[a_.usable[k]];
      const Eigen::Vector3f p = R_ * surfel.point + t_;
      if (!box_.contains(p)) continue;
      Match match;
      match.a = a_.usable[k];
      PixelRange at;
      std::int64_t i = -1;
      if (sensor.project(p.cast<double>(), at)) i = b_.index_at(at.u, at.v);
      if (i >= 0 && is_match(surfel, p, std::uint32_t(i), match))
        out.push_back(match);
      else if (posed_b_.tree && is_near(surfel, p, match))
        out.push_back(match);
    }
    return out;
  }

 private:
  bool is_match(const Surfel& a, const Eigen::Vector3f& p, std::uint32_t i, Match& out) const {
    const Surfel& b = b_.surfels[i];
    if (!b.is_usable()) return false;
    const Eigen::Vector3f normal_a = R_ * a.normal;
    if (normal_a.dot(b.normal) < kAlike) return false;
    const Eigen::Vector3f normal = (normal_a + b.normal).normalized();
    out.residual_m = normal.dot(p - b.point);
    out.variance_m2 = a.sigma_m * a.sigma_m + b.sigma_m * b.sigma_m;
    out.distance_m = std::sqrt(std::max(a.point.squaredNorm(), b.point.squaredNorm()));
    if (double(std::abs(out.residual_m)) > gate_.at(out)) return false;
    out.b = i;
    out.normal_in_b = normal;
    return true;
  }

  bool is_near(const Surfel& a, const Eigen::Vector3f& p, Match& out) {
    posed_b_.tree->find_nearest(p, 1, near_);
    if (near_.empty()) return false;
    const std::uint32_t i = b_.usable[near_.front().index];
    if (!is_match(a, p, i, out)) return false;
    const float sideways = near_.front().squared_distance - out.residual_m * out.residual_m;
    const float limit = kSideways * float(b_.spacing_m);
    return sideways <= limit * limit;
  }

  const SurfelImage& a_;
  const SurfelImage& b_;
  const Posed& posed_b_;
  const Gate& gate_;
  Eigen::Matrix3f R_;
  Eigen::Vector3f t_;
  Eigen::AlignedBox3f box_{Eigen::Vector3f::Constant(-3e38f), Eigen::Vector3f::Constant(3e38f)};
  std::vector<Neighbor> near_;
};

// Variance of one view's half of a match, with half of what noise does not explain.
double variance_of(float sigma_m, const Match& match, const Gate& gate) {
  return double(sigma_m) * double(sigma_m) + 0.5 * (gate.variance(match) - double(match.variance_m2));
}

// Of m views that show a spot, each pair tells what the others tell as well. All is counted once if a pair's weight,
// w v / (w + v) by itself, is w v over the sum of all views' weights: then the sum over the pairs is the information
// that is left when the spot's own place has been solved for.
double share_of(const Surfel& a, const Surfel& b, const Spot& spot, const Match& match, const Gate& gate) {
  const double of_pair = 1 / variance_of(a.sigma_m, match, gate) + 1 / variance_of(b.sigma_m, match, gate);
  return std::min(1.0, of_pair / double(spot.information_per_m2));
}

double median_of(std::vector<float>& values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return double(*middle);
}

}  // namespace

double Gate::relative_distance(const Match& match) const {
  return distance_m > 0 ? std::max(kNearest, double(match.distance_m) / distance_m) : 1;
}

double Gate::variance(const Match& match) const {
  const double scale = std::max(scale_m, unexplained_m * relative_distance(match));
  return double(match.variance_m2) + scale * scale;
}

double Gate::at(const Match& match) const { return std::min(capture_m, kTukey * std::sqrt(variance(match))); }

std::size_t thinning(const SurfelImage& image, std::size_t surfels) {
  return std::max<std::size_t>(1, image.usable.size() / surfels) | 1;
}

std::vector<Match> find_matches(const Posed& a, const Posed& b, const Gate& gate, std::size_t stride) {
  Matcher matcher(a, b, gate);
  return std::visit([&](const auto& sensor) { return matcher.run(sensor, stride); }, *b.sensor);
}

std::vector<std::vector<Spot>> find_spots(std::span<const Posed> posed, std::span<const GatedPair> pairs,
                                          Context& context) {
  std::vector<std::vector<Spot>> out(posed.size());
  parallel_for(context, posed.size(), 1, [&](std::size_t i) {
    const Posed& view = posed[i];
    const std::vector<Surfel>& surfels = view.image->surfels;
    std::vector<double> fits(surfels.size()), own(surfels.size()), others(surfels.size());
    for (const GatedPair& pair : pairs) {
      if (pair.a != i && pair.b != i) continue;
      const Posed& other = posed[pair.a == i ? pair.b : pair.a];
      for (const Match& match : find_matches(view, other, pair.gate)) {
        const double fit = tukey(double(match.residual_m), pair.gate.at(match));
        fits[match.a] += fit;
        own[match.a] += fit / variance_of(surfels[match.a].sigma_m, match, pair.gate);
        others[match.a] += fit / variance_of(other.image->surfels[match.b].sigma_m, match, pair.gate);
      }
    }
    out[i].resize(surfels.size());
    for (const std::uint32_t k : view.image->usable)
      if (fits[k] > 0) out[i][k] = {float(own[k] / fits[k] + others[k]), float(1 + fits[k])};
  });
  return out;
}

void add_geometry(const Posed& a, const Posed& b, const std::vector<Match>& matches, const Gate& gate,
                  const Eigen::Vector3d& center, double sign, PairSums& sums) {
  const Eigen::Isometry3d& T = b.T_world_view;
  const Eigen::Vector3d offset = T.translation() - center;
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  double weight_sum = 0, shared_sum = 0, tilt_sum = 0;
  Eigen::Vector3d first = Eigen::Vector3d::Zero();
  Eigen::Matrix3d second = Eigen::Matrix3d::Zero();
  for (const Match& match : matches) {
    const Surfel& sa = a.image->surfels[match.a];
    const Surfel& sb = b.image->surfels[match.b];
    const double r = double(match.residual_m), alone = tukey(r, gate.at(match)) / gate.variance(match);
    const double w = a.spots ? alone * share_of(sa, sb, (*a.spots)[match.a], match, gate) : alone;
    const Eigen::Vector3d x = T.linear() * sb.point.cast<double>() + offset;
    const Eigen::Vector3d n = T.linear() * match.normal_in_b.cast<double>();
    Vector6d J;
    J << x.cross(n), n;
    H.noalias() += (w * J) * J.transpose();
    g += (w * r) * J;
    const double tilt = std::max(kLeastTilt_rad, 0.5 * double(std::hypot(sa.tilt_rad, sb.tilt_rad)));
    weight_sum += w;
    shared_sum += alone > 0 ? w * w / alone : 0;
    tilt_sum += w * tilt * tilt;
    first += w * x;
    second += w * x * x.transpose();
  }
  sums.matches += matches.size();
  sums.weights += weight_sum;
  sums.shared_weights += shared_sum;
  if (!(weight_sum > 0)) return;
  sums.H += H;
  sums.g += sign * g;
  // Information of the same points, were each known in all directions; what exceeds H is along the surfaces.
  Matrix6d all = Matrix6d::Zero();
  all.topLeftCorner<3, 3>() = second.trace() * Eigen::Matrix3d::Identity() - second;
  Eigen::Matrix3d cross;
  cross << 0, -first.z(), first.y(), first.z(), 0, -first.x(), -first.y(), first.x(), 0;
  all.topRightCorner<3, 3>() = cross;
  all.bottomLeftCorner<3, 3>() = cross.transpose();
  all.bottomRightCorner<3, 3>() = weight_sum * Eigen::Matrix3d::Identity();
  sums.feigned += (tilt_sum / weight_sum) * (all - H);
}

void add_color(const Posed& a, const Posed& b, const std::vector<Match>& matches, const Gate& gate,
               const Eigen::Vector3d& center, double sign, PairSums& sums) {
  if (a.image->brightness.empty() || b.image->brightness.empty()) return;
  const Eigen::Isometry3d T_b_a = b.T_world_view.inverse(Eigen::Isometry) * a.T_world_view;
  const Eigen::Matrix3f R = T_b_a.linear().cast<float>();
  const Eigen::Vector3f t = T_b_a.translation().cast<float>();
  std::vector<float> differences;
  std::vector<std::size_t> used;
  for (std::size_t k = 0; k < matches.size(); ++k) {
    const Match& match = matches[k];
    const float ca = a.image->brightness[match.a], cb = b.image->brightness[match.b];
    if (!std::isfinite(ca) || !std::isfinite(cb)) continue;
    const Eigen::Vector3f p = R * a.image->surfels[match.a].point + t;
    const Eigen::Vector3f d = p - b.image->surfels[match.b].point;
    differences.push_back(cb + b.image->brightness_gradient_per_m[match.b].dot(d) - ca);
    used.push_back(k);
  }
  if (differences.size() < kFewestColors) return;
  std::vector<float> copy = differences;
  const double exposure = median_of(copy);
  for (float& c : copy) c = std::abs(c - float(exposure));
  const double spread = std::max(kNormalPerMedian * median_of(copy), 1.0 / 255);
  const double weight = 1 / (spread * spread);
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  for (std::size_t k = 0; k < used.size(); ++k) {
    const Match& match = matches[used[k]];
    const double r = double(differences[k]) - exposure;
    const double fit = tukey(double(match.residual_m), gate.at(match));
    const double share = a.spots ? std::min(1.0, 2 / double((*a.spots)[match.a].views)) : kColorOnTheWay;
    const double w = weight * share * fit * tukey(r, kTukey * spread);
    if (!(w > 0)) continue;
    const Eigen::Isometry3d& T = b.T_world_view;
    const Eigen::Vector3d x = T * b.image->surfels[match.b].point.cast<double>() - center;
    const Eigen::Vector3d d = T.linear() * b.image->brightness_gradient_per_m[match.b].cast<double>();
    Vector6d J;
    J << x.cross(d), d;
    H.noalias() += (w * J) * J.transpose();
    g += (w * r) * J;
  }
  sums.H += H;
  sums.g += sign * g;
}

double robust_spread(const std::vector<Match>& matches, const Gate& gate) {
  if (matches.empty()) return 0;
  std::vector<float> absolute;
  absolute.reserve(matches.size());
  for (const Match& match : matches)
    absolute.push_back(std::abs(match.residual_m) / float(gate.relative_distance(match)));
  return kNormalPerMedian * median_of(absolute);
}

}  // namespace lapseam
