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
// Of the spacing of surfels: what is seen as one colour at last.
constexpr float kColorSize = 0.5f;
// The steepest of the colours, which tell how well places are known.
constexpr double kSteepColors = 0.9;
// Cosine below which a ray meets a surface nowhere in particular.
constexpr float kLeastAlong = 0.1f;
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

double quantile_of(std::vector<float>& values, double share) {
  const auto at = values.begin() + std::ptrdiff_t(share * double(values.size()));
  std::nth_element(values.begin(), at, values.end());
  return double(*at);
}
double median_of(std::vector<float>& values) { return quantile_of(values, 0.5); }

// A colour of a on the surface of b.
struct ColorMatch {
  std::uint32_t match = 0;
  float difference = 0;  // b's less a's
  Eigen::Vector3f point_in_b = Eigen::Vector3f::Zero();
  Eigen::Vector3f per_m = Eigen::Vector3f::Zero();  // how b's changes along the surface
};

class ColorMatcher {
 public:
  ColorMatcher(const Posed& a, const Posed& b)
      : a_(a), b_(b), spacing_a_(spacing_line(*a.sensor)), spacing_b_(spacing_line(*b.sensor)) {
    const Eigen::Isometry3d T_b_a = b.T_world_view.inverse(Eigen::Isometry) * a.T_world_view;
    R_ = T_b_a.linear().cast<float>();
    t_ = T_b_a.translation().cast<float>();
  }

  std::vector<ColorMatch> run(const std::vector<Match>& matches) const {
    std::vector<ColorMatch> out;
    for (std::uint32_t k = 0; k < matches.size(); ++k) {
      const Match& match = matches[k];
      if (!std::isfinite(a_.image->brightness[match.a]) || !std::isfinite(b_.image->brightness[match.b])) continue;
      ColorMatch color;
      color.match = k;
      if (a_.brightness && b_.brightness ? look_up(match, color) : extrapolate(match, color)) out.push_back(color);
    }
    return out;
  }

 private:
  bool extrapolate(const Match& match, ColorMatch& out) const {
    out.point_in_b = b_.image->surfels[match.b].point;
    out.per_m = b_.image->brightness_gradient_per_m[match.b];
    const Eigen::Vector3f d = R_ * a_.image->surfels[match.a].point + t_ - out.point_in_b;
    out.difference = b_.image->brightness[match.b] + out.per_m.dot(d) - a_.image->brightness[match.a];
    return true;
  }

  // Where a's ray meets what both know of the surface: the noise of a's range alone would move the place in b's
  // picture.
  bool look_up(const Match& match, ColorMatch& out) const {
    const Surfel &sa = a_.image->surfels[match.a], &sb = b_.image->surfels[match.b];
    const auto at_a = project(*a_.sensor, sa.point.cast<double>()), at_b = project(*b_.sensor, sb.point.cast<double>());
    if (!at_a || !at_b) return false;
    const float size =
        kColorSize * std::max(spacing_of(a_, spacing_a_, sa, *at_a), spacing_of(b_, spacing_b_, sb, *at_b));
    // Parallel rays and those of measured grids do not meet at the origin.
    const Eigen::Vector3f ray = R_ * ray_direction(*a_.sensor, at_a->u, at_a->v).cast<float>();
    const Eigen::Vector3f normal = match.normal_in_b;
    const float along = normal.dot(ray), share = sa.sigma_m * sa.sigma_m / match.variance_m2;
    if (!(along < -kLeastAlong)) return false;
    const Eigen::Vector3f p = R_ * sa.point + t_ - (share * match.residual_m / along) * ray;
    const auto change = [&](const Eigen::Vector3f& e) {
      const Eigen::Vector3f half = 0.5f * size * e;
      return ((*b_.brightness)(p + half, size) - (*b_.brightness)(p - half, size)) / size * e;
    };
    const Eigen::Vector3f e = normal.unitOrthogonal();
    out.point_in_b = p;
    out.per_m = change(e) + change(normal.cross(e));
    out.difference = (*b_.brightness)(p, size) - (*a_.brightness)(sa.point, size);
    return std::isfinite(out.difference) && std::isfinite(out.per_m.squaredNorm());
  }

  // Of cameras it is the distance that counts and not the depth, so that what is looked up is wider towards the
  // corners: with the depth, poses of room_p100 were worse.
  static float spacing_of(const Posed& view, const SpacingLine& spacing, const Surfel& surfel, const PixelRange& at) {
    const bool is_camera = std::holds_alternative<PinholeSensor>(*view.sensor);
    return float(view.image->factor * spacing.at(is_camera ? double(surfel.point.norm()) : at.r));
  }

  const Posed& a_;
  const Posed& b_;
  const SpacingLine spacing_a_, spacing_b_;
  Eigen::Matrix3f R_;
  Eigen::Vector3f t_;
};

// What colours differ by, less the exposure: on plain surfaces, and more where brightness is steep, since places are
// uncertain. One spread for all would take it from the many on plain walls, and what tells most would be beyond the
// gate.
struct ColorSpread {
  double exposure = 0;
  double plain = 1;  // variance
  double place_m2 = 0;

  explicit ColorSpread(const std::vector<ColorMatch>& colors) {
    std::vector<float> values;
    for (const ColorMatch& color : colors) values.push_back(color.difference);
    exposure = median_of(values);
    values.clear();
    for (const ColorMatch& color : colors) values.push_back(color.per_m.norm());
    const double half = median_of(values), steep = quantile_of(values, kSteepColors);
    std::vector<float> on_plain, places;
    for (const ColorMatch& color : colors) {
      const float off = std::abs(color.difference - float(exposure)), per_m = color.per_m.norm();
      if (double(per_m) <= half) on_plain.push_back(off);
      if (double(per_m) >= steep && per_m > 0) places.push_back(off / per_m);
    }
    plain = std::pow(std::max(kNormalPerMedian * median_of(on_plain), 1.0 / 255), 2);
    if (!places.empty()) place_m2 = std::pow(kNormalPerMedian * median_of(places), 2);
  }
  double variance(const ColorMatch& color) const { return plain + place_m2 * double(color.per_m.squaredNorm()); }
};

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
  const std::vector<ColorMatch> colors = ColorMatcher(a, b).run(matches);
  if (colors.size() < kFewestColors) return;
  const ColorSpread spread(colors);
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  for (const ColorMatch& color : colors) {
    const Match& match = matches[color.match];
    const double r = double(color.difference) - spread.exposure, variance = spread.variance(color);
    const double fit = tukey(double(match.residual_m), gate.at(match));
    const double share = a.spots ? std::min(1.0, 2 / double((*a.spots)[match.a].views)) : kColorOnTheWay;
    const double w = share * fit * tukey(r, kTukey * std::sqrt(variance)) / variance;
    if (!(w > 0)) continue;
    const Eigen::Isometry3d& T = b.T_world_view;
    const Eigen::Vector3d x = T * color.point_in_b.cast<double>() - center;
    const Eigen::Vector3d d = T.linear() * color.per_m.cast<double>();
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
