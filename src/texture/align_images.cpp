// Based on: Q.-Y. Zhou, V. Koltun, Color Map Optimization for 3D Reconstruction with Consumer Depth Cameras, 2014, §4.

#include "texture/align_images.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <memory>
#include <span>

#include "core/parallel.h"
#include "lapseam/io.h"
#include "texture/spots.h"

namespace lapseam {
namespace {

constexpr std::size_t kSpots = 150'000;
constexpr int kLongSide = 10;  // cells of the lattice along the longer side of the image
// Flatter than this, errors of the surface displace its spots.
constexpr float kLeastCosine = 0.3f;
// Coarse to fine: radii of the means that smooth an image, and of those that are taken off.
struct Band {
  int smooth, mean;
};
constexpr std::array<Band, 2> kBands = {{{2, 8}, {0, 4}}};
constexpr int kRounds = 6;  // of poses, and then of lattices
// Neighbouring spots see the same edges: that share of observations counts as independent.
constexpr double kIndependent = 0.1;
// Of the spots, one in so many does for a pose.
constexpr std::uint32_t kPoseShare = 4;
// By how much neighbouring nodes may differ, as a share of the error that is expected.
constexpr double kBending = 0.5;
// The image of a triangle is a copy as long as it is affine to that.
constexpr float kLeastBend_px = 0.25f;
// 95 % efficiency for normal residuals (Cauchy), whose median is 0.6745 of their deviation.
constexpr double kCauchy = 2.385, kMedianOfNormal = 0.6745;
// Values are rounded: they are no better than that.
constexpr double kLeastDeviation = 0.5;
// Fewer observations say nothing of how sharp an image is.
constexpr std::size_t kLeastSharpness = 1000;

using Values = Image<std::int8_t>;

struct Seen {
  std::uint32_t spot;
  Eigen::Vector2f first_px;  // where the camera had it at first
  Eigen::Vector2f pixel;     // where it has it now, before the image is bent
  bool is_lost = false;      // it has it no longer
};

/// Means over windows of a radius along rows, then columns.
Image<float> smoothed(const Image<float>& in, int radius) {
  if (radius == 0) return in;
  Image<float> rows(in.width, in.height), out(in.width, in.height);
  const auto slide = [radius](int n, const auto& get, const auto& set) {
    float sum = 0;
    int count = 0;
    for (int i = 0; i < std::min(radius, n); ++i) sum += get(i), ++count;
    for (int i = 0; i < n; ++i) {
      if (i + radius < n) sum += get(i + radius), ++count;
      if (i > radius) sum -= get(i - radius - 1), --count;
      set(i, sum / float(count));
    }
  };
  for (int v = 0; v < in.height; ++v)
    slide(
        in.width, [&](int u) { return in.at(u, v); }, [&](int u, float x) { rows.at(u, v) = x; });
  for (int u = 0; u < in.width; ++u)
    slide(
        in.height, [&](int v) { return rows.at(u, v); }, [&](int v, float x) { out.at(u, v) = x; });
  return out;
}

/// Equalized brightness, one value for every stride × stride pixels.
Image<float> reduce(const ColorImage& image, const ColorCamera& camera, const ColorResponse& response, int stride) {
  Image<float> out((image.width + stride - 1) / stride, (image.height + stride - 1) / stride);
  for (int v = 0; v < out.height; ++v)
    for (int u = 0; u < out.width; ++u) {
      Eigen::Vector3f sum = Eigen::Vector3f::Zero();
      float count = 0;
      for (int y = v * stride; y < std::min((v + 1) * stride, image.height); ++y)
        for (int x = u * stride; x < std::min((u + 1) * stride, image.width); ++x) {
          const Rgb8 c = image.at(x, y);
          sum += Eigen::Vector3f(c.r, c.g, c.b);
          ++count;
        }
      const Eigen::Vector2f middle(float(u * stride), float(v * stride));
      out.at(u, v) = sum.cwiseProduct(response.factor(camera.squared_radius(middle))).sum() / (3 * count);
    }
  return out;
}

Values band_of(const Image<float>& image, const Band& band) {
  const Image<float> fine = smoothed(smoothed(image, band.smooth), band.smooth), mean = smoothed(image, band.mean);
  Values out(image.width, image.height);
  for (std::size_t i = 0; i < out.pixels.size(); ++i)
    out.pixels[i] = std::int8_t(std::lround(std::clamp(fine.pixels[i] - mean.pixels[i], -127.0f, 127.0f)));
  return out;
}

/// Bilinear, with the gradient per pixel of the image. False beyond the rim.
bool sample(const Values& values, int stride, const Eigen::Vector2f& pixel, float& value, Eigen::Vector2f& gradient) {
  const float x = (pixel.x() + 0.5f) / float(stride) - 0.5f, y = (pixel.y() + 0.5f) / float(stride) - 0.5f;
  const int u = int(std::floor(x)), v = int(std::floor(y));
  if (u < 0 || v < 0 || u + 1 >= values.width || v + 1 >= values.height) return false;
  const float fx = x - float(u), fy = y - float(v);
  const float a = values.at(u, v), b = values.at(u + 1, v), c = values.at(u, v + 1), d = values.at(u + 1, v + 1);
  value = (1 - fy) * ((1 - fx) * a + fx * b) + fy * ((1 - fx) * c + fx * d);
  gradient = Eigen::Vector2f((1 - fy) * (b - a) + fy * (d - c), (1 - fx) * (c - a) + fx * (d - b)) / float(stride);
  return true;
}

float median_of(std::vector<float>& some) {
  if (some.empty()) return 0;
  const auto middle = some.begin() + std::ptrdiff_t(some.size() / 2);
  std::nth_element(some.begin(), middle, some.end());
  return *middle;
}

class Aligning {
 public:
  Aligning(const Mesh& mesh, std::span<const ViewSource> sources, const ColorCameras& cameras,
           std::span<const DepthImage> depths, std::span<const ColorResponse> responses, double error_m,
           Context& context)
      : sources_(sources),
        depths_(depths),
        responses_(responses),
        error_m_(error_m),
        context_(context),
        cameras_(cameras.size()),
        spots_(choose_spots(mesh, kSpots)),
        sum_(spots_.size()),
        count_(spots_.size()),
        seen_(sources.size()),
        value_(sources.size()),
        bands_(sources.size()),
        warps_(sources.size()),
        twist_(sources.size(), Twist::Zero()) {
    for (std::size_t view = 0; view < cameras.size(); ++view)
      if (cameras[view]) cameras_[view] = std::make_unique<ColorCamera>(*cameras[view]);
    StageScope stage(context_, "texture: align", sources_.size());
    parallel_for(context_, sources_.size(), 1, [&](std::size_t view) {
      if (cameras_[view] && !cameras_[view]->wraps() && depths_[view].angle_rad > 0) observe(view);
      stage.advance();
    });
  }

  /// How far each image is from the mean of all along steep gradients, a residual over the gradient, as a deviation.
  std::vector<float> measure() {
    const std::size_t finest = kBands.size() - 1;
    average(finest);
    std::vector<float> displacement_px(sources_.size(), 0);
    parallel_for(context_, sources_.size(), 1, [&](std::size_t view) {
      std::vector<float> steepness, away;
      for_observations(finest, view,
                       [&](const Seen&, float, const Eigen::Vector2f& g) { steepness.push_back(g.norm()); });
      if (steepness.empty()) return;
      const auto tenth = steepness.begin() + std::ptrdiff_t(steepness.size() * 9 / 10);
      std::nth_element(steepness.begin(), tenth, steepness.end());
      for_observations(finest, view, [&](const Seen&, float r, const Eigen::Vector2f& g) {
        if (g.norm() >= *tenth && g.norm() > 0) away.push_back(std::abs(r) / g.norm());
      });
      displacement_px[view] = float(double(median_of(away)) / kMedianOfNormal);
    });
    return displacement_px;
  }

  /// How much of the contrast of the mean of all each image has, as a logarithm: blurred ones have less. NaN where too
  /// little is known.
  std::vector<float> measure_sharpness() {
    const std::size_t finest = kBands.size() - 1;
    average(finest);
    std::vector<float> sharpness(sources_.size(), std::numeric_limits<float>::quiet_NaN());
    parallel_for(context_, sources_.size(), 1, [&](std::size_t view) {
      double products = 0, squares = 0;
      std::size_t count = 0;
      for_observations(finest, view, [&](const Seen& seen, float r, const Eigen::Vector2f&) {
        const auto mean = double(sum_[seen.spot] / count_[seen.spot]);
        products += mean * (mean + double(r));
        squares += mean * mean;
        ++count;
      });
      if (count >= kLeastSharpness && products > 0 && squares > 0)
        sharpness[view] = float(std::log(products / squares));
    });
    return sharpness;
  }

  void align() {
    for (std::size_t level = 0; level < kBands.size(); ++level) {
      for (int round = 0; round < kRounds; ++round) {
        average(level);
        parallel_for(context_, sources_.size(), 1, [&](std::size_t view) { move(level, view); });
      }
      for (int round = 0; round < kRounds; ++round) {
        average(level);
        parallel_for(context_, sources_.size(), 1, [&](std::size_t view) { bend(level, view); });
      }
      recenter();
    }
  }

  /// Gives the cameras as they are aligned: how many images had to be bent.
  std::uint64_t take(ColorCameras& cameras) {
    std::uint64_t bent = 0;
    for (std::size_t view = 0; view < cameras_.size(); ++view) {
      float most = 0;
      for (const Eigen::Vector2f& node : warps_[view].nodes) most = std::max(most, node.norm());
      if (most < kLeastBend_px) continue;
      cameras_[view]->bend(std::move(warps_[view]));
      ++bent;
    }
    cameras = std::move(cameras_);
    return bent;
  }

 private:
  using Twist = Eigen::Matrix<double, 6, 1>;  // a small rotation about the place of a camera, and a translation
  using PixelTwist = Eigen::Matrix<double, 2, 6>;

  void observe(std::size_t view) {
    const ColorCamera& camera = *cameras_[view];
    const DepthImage& depth = depths_[view];
    for (std::uint32_t s = 0; s < spots_.size(); ++s) {
      Eigen::Vector2f pixel;
      if (!camera.may_see(spots_[s].position_m, 0) || !camera.project(spots_[s].position_m, pixel)) continue;
      const Eigen::Vector3f to = spots_[s].position_m - camera.ray_origin(pixel);
      const float distance = to.norm();
      if (-to.dot(spots_[s].normal) < kLeastCosine * distance) continue;
      if (!depth.is_visible(pixel, distance) || depth.is_fringe(pixel)) continue;
      seen_[view].push_back({s, pixel, pixel, false});
    }
    if (seen_[view].empty()) return;
    const ColorImage image = load_color(sources_[view]);
    const Image<float> reduced = reduce(image, camera, responses_[view], depth.stride);
    for (std::size_t k = 0; k < kBands.size(); ++k) bands_[view][k] = band_of(reduced, kBands[k]);
    warps_[view] = straight(camera);
    value_[view].resize(seen_[view].size());
  }

  static ImageWarp straight(const ColorCamera& camera) {
    ImageWarp warp;
    const auto width = float(camera.width() - 1), height = float(camera.height() - 1);
    const float cell = std::max(width, height) / float(kLongSide);
    warp.columns = std::max(2, 1 + int(std::lround(width / cell)));
    warp.rows = std::max(2, 1 + int(std::lround(height / cell)));
    warp.spacing_px = {width / float(warp.columns - 1), height / float(warp.rows - 1)};
    warp.nodes.assign(std::size_t(warp.columns) * std::size_t(warp.rows), Eigen::Vector2f::Zero());
    return warp;
  }

  double expected_px(std::size_t view) const {
    return std::min(error_m_ / double(depths_[view].pixel_m), double(kMostDisplacement_px));
  }

  /// Of every spot, the mean of what images show there.
  void average(std::size_t level) {
    parallel_for(context_, sources_.size(), 1, [&](std::size_t view) {
      Eigen::Vector2f gradient;
      for (std::size_t k = 0; k < seen_[view].size(); ++k) {
        const Eigen::Vector2f at = seen_[view][k].pixel + warps_[view].at(seen_[view][k].pixel);
        if (!sample(bands_[view][level], depths_[view].stride, at, value_[view][k], gradient))
          value_[view][k] = std::nanf("");
      }
    });
    std::fill(sum_.begin(), sum_.end(), 0.0f);
    std::fill(count_.begin(), count_.end(), 0.0f);
    for (std::size_t view = 0; view < sources_.size(); ++view)
      for (std::size_t k = 0; k < seen_[view].size(); ++k)
        if (!std::isnan(value_[view][k])) sum_[seen_[view][k].spot] += value_[view][k], ++count_[seen_[view][k].spot];
  }

  /// visit(what is seen, residual, gradient) where other images show the spot too.
  template <typename Visit>
  void for_observations(std::size_t level, std::size_t view, const Visit& visit) const {
    float value = 0;
    Eigen::Vector2f gradient;
    for (const Seen& seen : seen_[view]) {
      if (!(count_[seen.spot] > 1)) continue;
      const Eigen::Vector2f at = seen.pixel + warps_[view].at(seen.pixel);
      if (sample(bands_[view][level], depths_[view].stride, at, value, gradient))
        visit(seen, value - sum_[seen.spot] / count_[seen.spot], gradient);
    }
  }

  /// Of the residuals of a view, robustly; 0 where it has none.
  double deviation_of(std::size_t level, std::size_t view) const {
    std::vector<float> sizes;
    for_observations(level, view, [&](const Seen&, float r, const Eigen::Vector2f&) { sizes.push_back(std::abs(r)); });
    return sizes.empty() ? 0 : std::max(double(median_of(sizes)) / kMedianOfNormal, kLeastDeviation);
  }

  static double weight_of(float residual, double deviation) {
    const double t = double(residual) / (kCauchy * deviation);
    return kIndependent / (deviation * deviation * (1 + t * t));
  }

  // ---- poses

  /// How the pixel of a spot changes with a motion of the mesh before a camera.
  bool twist_of(std::size_t view, const Seen& seen, PixelTwist& change) const {
    const Eigen::Vector3f& position_m = spots_[seen.spot].position_m;
    const float step_m = 2 * depths_[view].pixel_m;
    Eigen::Matrix<double, 2, 3> slope;
    for (int axis = 0; axis < 3; ++axis) {
      Eigen::Vector2f there;
      if (!cameras_[view]->project_beyond(position_m + step_m * Eigen::Vector3f::Unit(axis), there)) return false;
      slope.col(axis) = (there - seen.pixel).cast<double>() / double(step_m);
    }
    const Eigen::Vector3d arm = (position_m - cameras_[view]->ray_origin(seen.pixel)).cast<double>();
    for (int axis = 0; axis < 3; ++axis) change.col(axis) = slope * Eigen::Vector3d::Unit(axis).cross(arm);
    change.rightCols<3>() = slope;
    return true;
  }

  void apply(std::size_t view, const Twist& twist) {
    ColorCamera& camera = *cameras_[view];
    const Eigen::Vector3d center = camera.ray_origin(Eigen::Vector2f::Zero()).cast<double>();
    const Eigen::Vector3d turn = twist.head<3>();
    Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
    const double angle = turn.norm();
    if (angle > 0) motion.linear() = Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix();
    motion.translation() = center - motion.linear() * center + twist.tail<3>();
    camera.move(motion);
    twist_[view] += twist;
    const Eigen::Vector2f nowhere(-1e6f, -1e6f);
    for (Seen& seen : seen_[view]) {
      seen.is_lost = !camera.project_beyond(spots_[seen.spot].position_m, seen.pixel);
      if (seen.is_lost) seen.pixel = nowhere;
    }
  }

  /// Of each of a twist's numbers, one over the square of what is expected.
  Twist pose_prior(std::size_t view) const {
    const double angle = expected_px(view) * double(depths_[view].angle_rad);
    const double length = expected_px(view) * double(depths_[view].pixel_m);
    Twist prior;
    prior << Eigen::Vector3d::Constant(1 / (angle * angle)), Eigen::Vector3d::Constant(1 / (length * length));
    return prior;
  }

  /// A Gauss-Newton step of a pose.
  void move(std::size_t level, std::size_t view) {
    const double deviation = deviation_of(level, view);
    if (!(deviation > 0)) return;
    Eigen::Matrix<double, 6, 6> normal = pose_prior(view).asDiagonal();
    Twist right = -pose_prior(view).cwiseProduct(twist_[view]);
    PixelTwist change;
    for_observations(level, view, [&](const Seen& seen, float r, const Eigen::Vector2f& g) {
      if (seen.spot % kPoseShare != 0 || !twist_of(view, seen, change)) return;
      const double weight = kPoseShare * weight_of(r, deviation);
      const Twist row = change.transpose() * g.cast<double>();
      normal += weight * row * row.transpose();
      right -= weight * double(r) * row;
    });
    apply(view, normal.ldlt().solve(right));
  }

  // ---- lattices

  /// A Gauss-Newton step of a lattice.
  void bend(std::size_t level, std::size_t view) {
    const double deviation = deviation_of(level, view);
    if (!(deviation > 0)) return;
    ImageWarp& warp = warps_[view];
    const auto n = Eigen::Index(2 * warp.nodes.size());
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
    for_observations(level, view, [&](const Seen& seen, float r, const Eigen::Vector2f& g) {
      const double weight = weight_of(r, deviation);
      const ImageWarp::Weights at = warp.weights_at(seen.pixel);
      std::array<double, 8> row;
      for (std::size_t k = 0; k < 4; ++k)
        row[2 * k] = double(at.weight[k] * g.x()), row[2 * k + 1] = double(at.weight[k] * g.y());
      const auto place = [&](std::size_t k) { return Eigen::Index(2 * at.node[k / 2] + k % 2); };
      for (std::size_t a = 0; a < 8; ++a) {
        right[place(a)] -= weight * row[a] * double(r);
        for (std::size_t b = 0; b <= a; ++b) normal(place(a), place(b)) += weight * row[a] * row[b];
      }
    });
    add_prior(warp, expected_px(view), normal, right);
    add(warp, normal.selfadjointView<Eigen::Lower>().ldlt().solve(right));
  }

  static void add(ImageWarp& warp, const Eigen::VectorXd& step) {
    for (std::size_t k = 0; k < warp.nodes.size(); ++k)
      warp.nodes[k] += step.segment<2>(Eigen::Index(2 * k)).cast<float>();
  }

  /// Nodes are displaced by about what is expected, and neighbours alike. Lower half only.
  static void add_prior(const ImageWarp& warp, double expected_px, Eigen::MatrixXd& normal, Eigen::VectorXd& right) {
    const double own = 1 / (expected_px * expected_px), between = own / (kBending * kBending);
    const auto at = [&](int u, int v) { return std::size_t(v) * std::size_t(warp.columns) + std::size_t(u); };
    const auto link = [&](std::size_t p, std::size_t q) {
      for (std::size_t c = 0; c < 2; ++c) {
        const auto i = Eigen::Index(2 * p + c), j = Eigen::Index(2 * q + c);  // p < q
        const auto difference = double(warp.nodes[p][Eigen::Index(c)] - warp.nodes[q][Eigen::Index(c)]);
        normal(i, i) += between, normal(j, j) += between, normal(j, i) -= between;
        right[i] -= between * difference, right[j] += between * difference;
      }
    };
    for (int v = 0; v < warp.rows; ++v)
      for (int u = 0; u < warp.columns; ++u) {
        for (std::size_t c = 0; c < 2; ++c) {
          const auto i = Eigen::Index(2 * at(u, v) + c);
          normal(i, i) += own;
          right[i] -= own * double(warp.nodes[at(u, v)][Eigen::Index(c)]);
        }
        if (u + 1 < warp.columns) link(at(u, v), at(u + 1, v));
        if (v + 1 < warp.rows) link(at(u, v), at(u, v + 1));
      }
  }

  // ---- what all have in common

  /// How an image moves with a spot along the surface: pixels per metre in two directions.
  bool motion_of(std::size_t view, const Seen& seen, Eigen::Matrix2f& motion) const {
    if (seen.is_lost) return false;
    const Spot& spot = spots_[seen.spot];
    const Eigen::Vector3f x = spot.normal.unitOrthogonal(), y = spot.normal.cross(x);
    const float step_m = 2 * depths_[view].pixel_m;
    Eigen::Vector2f a, b;
    if (!cameras_[view]->project_beyond(spot.position_m + step_m * x, a) ||
        !cameras_[view]->project_beyond(spot.position_m + step_m * y, b))
      return false;
    motion << (a - seen.pixel) / step_m, (b - seen.pixel) / step_m;
    return std::abs(motion.determinant()) > 0;
  }

  /// Of every spot, where its images have gone along the surface, in the mean.
  std::vector<Eigen::Vector2f> mean_drift() const {
    std::vector<std::vector<Eigen::Vector2f>> moved(sources_.size());
    parallel_for(context_, sources_.size(), 1, [&](std::size_t view) {
      Eigen::Matrix2f motion;
      for (const Seen& seen : seen_[view]) {
        moved[view].push_back(Eigen::Vector2f::Zero());
        if (motion_of(view, seen, motion))
          moved[view].back() = motion.inverse() * (seen.pixel + warps_[view].at(seen.pixel) - seen.first_px);
      }
    });
    std::vector<Eigen::Vector2f> mean(spots_.size(), Eigen::Vector2f::Zero());
    std::vector<float> count(spots_.size(), 0);
    for (std::size_t view = 0; view < sources_.size(); ++view)
      for (std::size_t k = 0; k < seen_[view].size(); ++k)
        if (!seen_[view][k].is_lost) mean[seen_[view][k].spot] += moved[view][k], ++count[seen_[view][k].spot];
    for (std::size_t s = 0; s < mean.size(); ++s)
      if (count[s] > 0) mean[s] /= count[s];
    return mean;
  }

  /// Images agree as well when all have gone the same way along the surface: that is taken off again, as far as poses
  /// and then lattices can follow it.
  void recenter() {
    const std::vector<Eigen::Vector2f> drift = mean_drift();
    parallel_for(context_, sources_.size(), 1, [&](std::size_t view) {
      if (seen_[view].empty()) return;
      Eigen::Matrix<double, 6, 6> of_pose = pose_prior(view).asDiagonal();
      Twist right_of_pose = Twist::Zero();
      ImageWarp common = straight(*cameras_[view]);
      const auto n = Eigen::Index(2 * common.nodes.size());
      Eigen::MatrixXd of_nodes = Eigen::MatrixXd::Zero(n, n);
      Eigen::VectorXd right_of_nodes = Eigen::VectorXd::Zero(n);
      add_prior(common, expected_px(view), of_nodes, right_of_nodes);
      Eigen::Matrix2f motion;
      PixelTwist change;
      const auto for_drifts = [&](const auto& visit) {
        for (const Seen& seen : seen_[view])
          if (seen.spot % kPoseShare == 0 && motion_of(view, seen, motion) && twist_of(view, seen, change))
            visit(seen, Eigen::Vector2d((motion * drift[seen.spot]).cast<double>()));
      };
      constexpr double kWeight = kPoseShare * kIndependent;
      for_drifts([&](const Seen&, const Eigen::Vector2d& d) {
        of_pose += kWeight * change.transpose() * change;
        right_of_pose += kWeight * change.transpose() * d;
      });
      const Twist twist = of_pose.ldlt().solve(right_of_pose);
      for_drifts([&](const Seen& seen, const Eigen::Vector2d& d) {
        const Eigen::Vector2d rest = d - change * twist;
        const ImageWarp::Weights at = common.weights_at(seen.pixel);
        for (std::size_t a = 0; a < 4; ++a)
          for (std::size_t c = 0; c < 2; ++c) {
            const auto i = Eigen::Index(2 * at.node[a] + c);
            right_of_nodes[i] += kWeight * double(at.weight[a]) * rest[Eigen::Index(c)];
            for (std::size_t b = 0; b <= a; ++b)
              of_nodes(i, Eigen::Index(2 * at.node[b] + c)) += kWeight * double(at.weight[a] * at.weight[b]);
          }
      });
      add(warps_[view], -of_nodes.selfadjointView<Eigen::Lower>().ldlt().solve(right_of_nodes));
      apply(view, -twist);
    });
  }

  std::span<const ViewSource> sources_;
  std::span<const DepthImage> depths_;
  std::span<const ColorResponse> responses_;
  double error_m_;
  Context& context_;
  ColorCameras cameras_;
  std::vector<Spot> spots_;
  std::vector<float> sum_, count_;  // of each spot
  std::vector<std::vector<Seen>> seen_;
  std::vector<std::vector<float>> value_;
  std::vector<std::array<Values, kBands.size()>> bands_;
  std::vector<ImageWarp> warps_;
  std::vector<Twist> twist_;  // of each view, what its steps add up to
};

/// Of what is known.
double median_displacement(const std::vector<float>& displacement_px) {
  std::vector<float> known;
  std::copy_if(displacement_px.begin(), displacement_px.end(), std::back_inserter(known),
               [](float d) { return d > 0; });
  return double(median_of(known));
}

}  // namespace

Alignment align_images(const Mesh& mesh, std::span<const ViewSource> sources, ColorCameras& cameras,
                       std::span<const DepthImage> depths, std::span<const ColorResponse> responses, double error_m,
                       Context& context) {
  Alignment out;
  out.displacement_px.assign(sources.size(), 0);
  if (!(error_m > 0)) return out;
  Aligning aligning(mesh, sources, cameras, depths, responses, error_m, context);
  out.displacement_px = aligning.measure();
  out.before_px = out.after_px = median_displacement(out.displacement_px);
  aligning.align();
  std::vector<float> after = aligning.measure();
  const double after_px = median_displacement(after);
  if (!(after_px > 0 && after_px < out.before_px)) return out;  // 0: nothing is known
  out.displacement_px = std::move(after);
  out.after_px = after_px;
  out.sharpness = aligning.measure_sharpness();
  out.bent = aligning.take(cameras);
  out.is_aligned = true;
  return out;
}

}  // namespace lapseam
