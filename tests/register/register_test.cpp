#include "lapseam/register.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/poses.h"
#include "support/analytic_views.h"

namespace lapseam {
namespace {

constexpr double kSigma_m = 0.002;
constexpr double kDeg = 3.14159265358979 / 180;

// A room with three balls in it, from places along a line; poses are true.
std::vector<View> room_views(int count = 6) {
  const auto shape = test::nearest({test::box_room({-2, -2, -1.2}, {2, 2, 1.4}), test::sphere({0.4, 1.2, -0.4}, 0.5),
                                    test::sphere({-0.8, 1.4, 0.2}, 0.3), test::sphere({1.3, 0.8, 0.3}, 0.25)});
  const Sensor sensor = PinholeSensor{240, 180, 200, 200, 119.5, 89.5, {}};
  std::vector<View> views;
  for (int i = 0; i < count; ++i) {
    const Eigen::Isometry3d T = test::look_at({-1.2 + 0.4 * i, -1.2, 0.1 * i - 0.3}, {0.3 - 0.1 * i, 1.8, 0});
    views.push_back(test::make_view("v" + std::to_string(i), sensor, T, shape, kSigma_m, unsigned(i + 1)));
  }
  return views;
}

std::vector<Eigen::Isometry3d> poses_of(const std::vector<View>& views) {
  std::vector<Eigen::Isometry3d> poses;
  for (const View& view : views) poses.push_back(view.T_world_view);
  return poses;
}

std::vector<View> perturbed(std::vector<View> views, double translation_m, double rotation_rad,
                            std::uint64_t seed = 1) {
  const auto moved = perturb_poses(poses_of(views), {translation_m, rotation_rad, seed});
  for (std::size_t i = 0; i < views.size(); ++i) views[i].T_world_view = moved[i];
  return views;
}

RegisterResult run(const std::vector<View>& views, const RegisterOptions& options = {}, int threads = 2) {
  Context context(threads);
  const std::vector<NoiseModel> noise(views.size(), NoiseModel{kSigma_m, 0, 0, 0});
  return register_views(views, noise, {}, options, context);
}

PoseErrors errors_of(const RegisterResult& result, const std::vector<View>& truth) {
  std::vector<Eigen::Isometry3d> poses;
  for (const PlacedView& view : result.views) poses.push_back(view.T_world_view);
  return compare_poses(poses, poses_of(truth));
}

TEST(Register, PutsPerturbedViewsBack) {
  const std::vector<View> truth = room_views();
  for (const auto& [shift, turn] : {std::pair(0.01, 0.5), std::pair(0.05, 2.0), std::pair(0.1, 5.0)}) {
    const RegisterResult result = run(perturbed(truth, shift, turn * kDeg));
    const PoseErrors errors = errors_of(result, truth);
    // 2,700 surfels of σ/4 to σ/2 in each view: a tenth of σ and little more for the weakest direction.
    EXPECT_LT(errors.max_translation_m, 0.5 * kSigma_m) << shift;
    EXPECT_LT(errors.max_rotation_rad, 0.02 * kDeg) << shift;
    for (std::size_t i = 1; i < truth.size(); ++i) EXPECT_EQ(result.views[i].placement, ViewPlacement::kPlaced);
  }
}

TEST(Register, CovarianceIsOfTheSizeOfTheError) {
  const std::vector<View> truth = room_views();
  double sum = 0;
  int count = 0;
  for (const std::uint64_t seed : {1, 2, 3}) {
    const RegisterResult result = run(perturbed(truth, 0.01, 0.5 * kDeg, seed));
    for (std::size_t i = 1; i < truth.size(); ++i, ++count) {
      const Eigen::Vector3d error = truth[i].T_world_view.translation() - result.views[i].T_world_view.translation();
      const Eigen::Matrix3d covariance = result.views[i].covariance.topLeftCorner<3, 3>();
      sum += error.dot(covariance.inverse() * error) / 3;
    }
  }
  // 1 if the errors were what it says, give or take a tenth: 15 errors along three axes, and all seeds share the noise
  // of the ranges. What six views show must not count as if each of 15 pairs had measured it anew.
  EXPECT_LT(sum / count, 2.5);
  EXPECT_GT(sum / count, 0.1);
  EXPECT_EQ(run(truth).views[0].covariance, PoseCovariance(PoseCovariance::Zero()));
}

TEST(Register, GivenViewsStay) {
  const std::vector<View> truth = room_views();
  std::vector<View> views = perturbed(truth, 0.02, 1 * kDeg);
  views[0].T_world_view.pretranslate(Eigen::Vector3d(0.01, 0.01, -0.01));
  for (const std::size_t i : {2, 4}) views[i].T_world_view = truth[i].T_world_view;
  const RegisterResult result = run(views, {.fixed = {2, 4}});
  for (const std::size_t i : {2, 4}) {
    EXPECT_EQ(result.views[i].placement, ViewPlacement::kFixed);
    EXPECT_EQ(result.views[i].T_world_view.matrix(), views[i].T_world_view.matrix());
  }
  EXPECT_LT(errors_of(result, truth).max_translation_m, 0.5 * kSigma_m);
}

TEST(Register, AViewThatMeetsNoOtherStays) {
  std::vector<View> views = perturbed(room_views(4), 0.01, 0.5 * kDeg);
  views.push_back(views[1]);
  views.back().T_world_view.pretranslate(Eigen::Vector3d(100, 0, 0));
  const RegisterResult result = run(views);
  EXPECT_EQ(result.views[4].placement, ViewPlacement::kUnlinked);
  EXPECT_EQ(result.views[4].T_world_view.matrix(), views[4].T_world_view.matrix());
  EXPECT_FALSE(result.views[4].problem.empty());
  EXPECT_EQ(result.report.parts, 1u);
}

TEST(Register, AViewFartherOffThanTheCaptureRangeIsNotMovedFarther) {
  std::vector<View> views = perturbed(room_views(), 0.005, 0.2 * kDeg);
  // Nothing that a range of 20 mm allows could bring it back.
  views[3].T_world_view.pretranslate(Eigen::Vector3d(0.03, 0.3, 0.2));
  const RegisterResult result = run(views, {.fixed = {}, .capture_m = 0.02});
  EXPECT_LT(result.views[3].moved_m, 0.02);
  EXPECT_LT(result.views[1].moved_m, 0.02);
}

// A wall by itself: sideways and about its normal nothing holds the views.
std::vector<View> wall_views() {
  const Sensor sensor = PinholeSensor{240, 180, 200, 200, 119.5, 89.5, {}};
  std::vector<View> views;
  for (int i = 0; i < 2; ++i)
    views.push_back(test::make_view("w" + std::to_string(i), sensor, test::look_at({0.2 * i, 0, 0}, {0.2 * i, 2, 0}),
                                    test::plane({0, 2, 0}, {0, 1, 0}), kSigma_m, unsigned(i + 7)));
  return views;
}

TEST(Register, DoesNotSlideAlongAWall) {
  std::vector<View> views = wall_views();
  views[1].T_world_view.pretranslate(Eigen::Vector3d(0.012, 0.01, -0.009));
  const RegisterResult result = run(views);
  const Eigen::Vector3d motion = result.views[1].T_world_view.translation() - views[1].T_world_view.translation();
  EXPECT_NEAR(motion.y(), -0.01, 0.2 * kSigma_m);  // back to the wall
  EXPECT_LT(std::hypot(motion.x(), motion.z()), 0.5 * kSigma_m);
  ASSERT_EQ(result.report.sliding.size(), 3u);  // two shifts and a turn
  for (const Sliding& sliding : result.report.sliding) {
    EXPECT_EQ(sliding.views, std::vector<std::uint32_t>{1});
    EXPECT_LT(sliding.certainty, 2);
    EXPECT_LT(std::abs(sliding.translation.y()), 0.1);
  }
  // What is not known, the covariance says: sideways as far as the capture range, across the wall not.
  EXPECT_GT(result.views[1].covariance(0, 0), 100 * result.views[1].covariance(1, 1));
}

ColorImage paint(const View& view) {
  ColorImage image(view.range.width, view.range.height);
  for (int v = 0; v < image.height; ++v)
    for (int u = 0; u < image.width; ++u) {
      const Eigen::Vector3d p = view.T_world_view * unproject(view.sensor, u, v, double(view.range.at(u, v)));
      const double x = std::sin(9 * p.x() + 2 * std::sin(5 * p.z())) + std::sin(7 * p.z() + 3 * p.x());
      const auto c = std::uint8_t(std::clamp(128 + 50 * x, 0.0, 255.0));
      image.at(u, v) = {c, c, c};
    }
  return image;
}

TEST(Register, APictureOnTheWallHoldsIt) {
  const std::vector<View> truth = wall_views();
  std::vector<View> views = truth;
  views[1].T_world_view.pretranslate(Eigen::Vector3d(0.012, 0.01, -0.009));
  Context context(2);
  const std::vector<NoiseModel> noise(2, NoiseModel{kSigma_m, 0, 0, 0});
  const PictureOf pictures = [&](std::size_t i) {
    return ViewPicture{paint(truth[i]), truth[i].sensor, Eigen::Isometry3d::Identity()};
  };
  const RegisterResult result = register_views(views, noise, pictures, {}, context);
  // A tenth of the distance between surfels, 40 mm.
  EXPECT_LT(errors_of(result, truth).max_translation_m, 0.004);
  EXPECT_TRUE(result.report.sliding.empty());
  const RegisterResult without = register_views(views, noise, pictures, {.fixed = {}, .use_color = false}, context);
  EXPECT_EQ(without.report.sliding.size(), 3u);
}

TEST(Register, ViewsInPlaceStay) {
  const std::vector<View> truth = room_views();
  EXPECT_LT(errors_of(run(truth), truth).max_translation_m, 0.5 * kSigma_m);
}

TEST(Register, SameForAnyNumberOfThreads) {
  const std::vector<View> views = perturbed(room_views(), 0.02, 1 * kDeg);
  const RegisterResult one = run(views, {}, 1);
  allow_threads(8);
  for (const int threads : {2, 3, 8}) {
    const RegisterResult other = run(views, {}, threads);
    for (std::size_t i = 0; i < views.size(); ++i) {
      EXPECT_EQ(one.views[i].T_world_view.matrix(), other.views[i].T_world_view.matrix()) << threads;
      EXPECT_EQ(one.views[i].covariance, other.views[i].covariance) << threads;
    }
    for (std::size_t k = 0; k < one.report.pairs.size(); ++k)
      EXPECT_EQ(one.report.pairs[k].tension, other.report.pairs[k].tension) << threads;
  }
}

// A depth camera whose inverse range is off by a wave across its image, 6 mm at most from 2 m away.
double offset_at(const View& view, int u) { return 0.0015 * std::sin(2 * 3.14159265358979 * u / view.range.width); }

std::vector<View> distorted(std::vector<View> views) {
  for (View& view : views) {
    view.sensor_id = "camera";
    for (int v = 0; v < view.range.height; ++v)
      for (int u = 0; u < view.range.width; ++u)
        if (float& r = view.range.at(u, v); r > 0) r = float(1 / (1 / double(r) - offset_at(view, u)));
  }
  return views;
}

// Places all around, so that no part of the camera's image always sees what it saw before.
std::vector<View> views_around(int count) {
  const auto shape = test::nearest({test::box_room({-2, -2, -1.2}, {2, 2, 1.4}), test::sphere({0.4, 1.2, -0.4}, 0.5),
                                    test::sphere({-0.8, 1.4, 0.2}, 0.3), test::sphere({1.3, 0.8, 0.3}, 0.25)});
  const Sensor sensor = PinholeSensor{120, 90, 100, 100, 59.5, 44.5, {}};
  std::vector<View> views;
  for (int i = 0; i < count; ++i) {
    const Eigen::Isometry3d T = test::look_at({-1 + 0.2 * i, -1.2 + 0.1 * (i % 3), 0.15 * (i % 4) - 0.3},
                                              {0.9 - 0.17 * i, 1.8, 0.2 - 0.1 * (i % 5)});
    views.push_back(test::make_view("c" + std::to_string(i), sensor, T, shape, kSigma_m, unsigned(i + 1)));
  }
  return views;
}

double misfit(const RegisterResult& result) {
  std::vector<double> medians;
  for (const RegisteredPair& pair : result.report.pairs) medians.push_back(pair.after.median_m);
  std::nth_element(medians.begin(), medians.begin() + std::ptrdiff_t(medians.size() / 2), medians.end());
  return medians[medians.size() / 2];
}

TEST(Register, FindsWhatACameraIsOffBy) {
  const std::vector<View> views = perturbed(distorted(views_around(12)), 0.005, 0.2 * kDeg);
  const RegisterResult without = run(views), with = run(views, {.calibrate = true});
  ASSERT_EQ(with.corrections.size(), 1u);
  EXPECT_TRUE(without.corrections.empty());
  EXPECT_LT(misfit(with), 0.7 * misfit(without));
  // Where the wave is highest, against where it is lowest: 3 per km. Poses take up a part of it, and what is left at
  // last is within the noise.
  const RangeCorrection& correction = with.corrections.at("camera");
  const std::size_t quarter = std::size_t(correction.columns - 1) / 4, row = std::size_t(correction.rows) / 2;
  const double* middle_row = &correction.offset_per_m[row * std::size_t(correction.columns)];
  EXPECT_NEAR(middle_row[quarter] - middle_row[3 * quarter], 0.0022, 0.001);
  // And ranges are nearer to the truth.
  const View& view = views[0];
  const RangeImage range = corrected(view.range, correction);
  double before = 0, after = 0;
  const std::vector<View> truth = views_around(12);
  for (std::size_t i = 0; i < range.size(); ++i) {
    if (!(range.pixels[i] > 0)) continue;
    before += std::abs(double(view.range.pixels[i] - truth[0].range.pixels[i]));
    after += std::abs(double(range.pixels[i] - truth[0].range.pixels[i]));
  }
  EXPECT_LT(after, 0.9 * before);
}

TEST(Register, FindsNothingOfACameraThatIsRight) {
  std::vector<View> views = perturbed(views_around(12), 0.005, 0.2 * kDeg);
  for (View& view : views) view.sensor_id = "camera";
  const RegisterResult without = run(views), with = run(views, {.calibrate = true});
  EXPECT_TRUE(with.corrections.empty());
  for (std::size_t i = 0; i < views.size(); ++i)
    EXPECT_EQ(with.views[i].T_world_view.matrix(), without.views[i].T_world_view.matrix());
}

TEST(Register, CalibratesAlikeForAnyNumberOfThreads) {
  const std::vector<View> views = perturbed(distorted(views_around(8)), 0.005, 0.2 * kDeg);
  const RegisterResult one = run(views, {.calibrate = true}, 1);
  ASSERT_EQ(one.corrections.size(), 1u);
  allow_threads(8);
  const RegisterResult many = run(views, {.calibrate = true}, 8);
  EXPECT_EQ(one.corrections.at("camera").offset_per_m, many.corrections.at("camera").offset_per_m);
  for (std::size_t i = 0; i < views.size(); ++i)
    EXPECT_EQ(one.views[i].T_world_view.matrix(), many.views[i].T_world_view.matrix());
}

// A laser that measures in a plane and tilts it about its x axis (the pole of its sensor), from three places in a room.
// Its lines are counted, 0.8 degrees each; what they really are is given.
constexpr int kLines = 140, kOfALine = 120;
std::vector<double> counted_lines() {
  std::vector<double> azimuth_rad;
  for (int i = 0; i < kLines; ++i) azimuth_rad.push_back((0.8 * i - 52) * kDeg);
  return azimuth_rad;
}

std::vector<View> tilting_views(const std::vector<std::vector<double>>& azimuth_rad) {
  const auto shape = test::nearest({test::box_room({-2, -1, -3}, {2, 1.4, 4}), test::sphere({0.9, -0.8, -1}, 0.4),
                                    test::sphere({-1.3, 0.2, 0.5}, 0.3), test::sphere({1.2, 0.6, 1}, 0.35)});
  std::vector<View> views;
  for (int i = 0; i < 3; ++i) {
    SphericalSensor sensor = SphericalSensor::from_limits(kLines, kOfALine, 0, 1, -89 * kDeg, 89 * kDeg);
    sensor.azimuth_rad = azimuth_rad[std::size_t(i)];
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() << 0, 0, 1, 0, 1, 0, -1, 0, 0;  // azimuth 0 is along -z, the pole along x, y is up
    T.translation() = Eigen::Vector3d(0.2 * i, 0.05 * i, 3 - 0.6 * i);
    views.push_back(test::make_view("t" + std::to_string(i), sensor, T, shape, kSigma_m, unsigned(i + 1)));
    std::get<SphericalSensor>(views.back().sensor).azimuth_rad = counted_lines();
  }
  return views;
}

// An uneven drive, and two lines that were lost: elsewhere in each scan.
std::vector<std::vector<double>> uneven_lines() {
  std::vector<std::vector<double>> out;
  for (int i = 0; i < 3; ++i) {
    std::vector<double> azimuth_rad = counted_lines();
    for (int k = 0; k < kLines; ++k)
      azimuth_rad[std::size_t(k)] += (0.5 * std::sin(0.5 * k + i) + (k > 30 + 25 * i ? 1.2 : 0) - 0.01 * k) * kDeg;
    out.push_back(std::move(azimuth_rad));
  }
  return out;
}

// Error of the angles of lines that are steep, against those of ten lines either side; root mean square. Lines that
// face a wall tell little of their angle, and how deep a floor is, against how steep its lines are, none does.
double line_error(const std::vector<double>& offset_rad, const std::vector<double>& truth_rad) {
  constexpr int kReach = 10, kSteep = 35;
  std::vector<double> error = counted_lines();
  for (std::size_t k = 0; k < error.size(); ++k) error[k] += (offset_rad.empty() ? 0 : offset_rad[k]) - truth_rad[k];
  double square = 0;
  int count = 0;
  for (int k = kReach; k < kLines - kReach; ++k) {
    if (k >= kSteep - kReach && k < kLines - kSteep + kReach) continue;
    double mean = 0;
    for (int j = k - kReach; j <= k + kReach; ++j) mean += error[std::size_t(j)] / (2 * kReach + 1);
    square += (error[std::size_t(k)] - mean) * (error[std::size_t(k)] - mean);
    ++count;
  }
  return std::sqrt(square / count);
}

TEST(Register, FindsTheAnglesOfLines) {
  const std::vector<std::vector<double>> truth = uneven_lines();
  const std::vector<View> views = perturbed(tilting_views(truth), 0.01, 0.2 * kDeg);
  const RegisterResult without = run(views), with = run(views, {.calibrate = true});
  EXPECT_LT(misfit(with), 0.7 * misfit(without));
  for (std::size_t i = 0; i < views.size(); ++i) {
    EXPECT_TRUE(without.views[i].line_offset_rad.empty());
    ASSERT_EQ(with.views[i].line_offset_rad.size(), std::size_t(kLines));
    EXPECT_LT(line_error(with.views[i].line_offset_rad, truth[i]), 0.25 * line_error({}, truth[i]));
    // A sensor's columns stay in order.
    const SphericalSensor sensor = corrected(std::get<SphericalSensor>(views[i].sensor), with.views[i].line_offset_rad);
    EXPECT_TRUE(std::is_sorted(sensor.azimuth_rad.begin(), sensor.azimuth_rad.end()));
  }
}

TEST(Register, FindsNothingOfLinesThatAreRight) {
  const std::vector<View> views =
      perturbed(tilting_views(std::vector<std::vector<double>>(3, counted_lines())), 0.01, 0.2 * kDeg);
  const RegisterResult without = run(views), with = run(views, {.calibrate = true});
  for (std::size_t i = 0; i < views.size(); ++i) {
    EXPECT_TRUE(with.views[i].line_offset_rad.empty());
    EXPECT_EQ(with.views[i].T_world_view.matrix(), without.views[i].T_world_view.matrix());
  }
}

TEST(Register, FindsLinesAlikeForAnyNumberOfThreads) {
  const std::vector<View> views = perturbed(tilting_views(uneven_lines()), 0.01, 0.2 * kDeg);
  const RegisterResult one = run(views, {.calibrate = true}, 1);
  allow_threads(8);
  const RegisterResult many = run(views, {.calibrate = true}, 8);
  for (std::size_t i = 0; i < views.size(); ++i) {
    EXPECT_EQ(one.views[i].line_offset_rad, many.views[i].line_offset_rad);
    EXPECT_EQ(one.views[i].T_world_view.matrix(), many.views[i].T_world_view.matrix());
  }
}

TEST(Register, RefusesWhatCannotBe) {
  const std::vector<View> views = room_views(2);
  Context context(1);
  EXPECT_THROW(register_views(views, {}, {}, {}, context), InvalidInput);
  EXPECT_THROW(run(views, {.fixed = {2}}), InvalidInput);
  EXPECT_TRUE(register_views({}, {}, {}, {}, context).views.empty());
}

TEST(Register, ObjectsScannedInParallelRays) {
  // Two half-covered sides of a ball with a nose, seen by parallel rays; 5 % of the size and 5 degrees off.
  const auto shape = test::nearest({test::sphere({0, 0, 0}, 0.1), test::sphere({0.07, 0.05, 0.06}, 0.05),
                                    test::sphere({-0.06, 0.03, 0.07}, 0.04), test::sphere({0.02, -0.08, 0.05}, 0.05)});
  const Sensor sensor = OrthographicSensor{200, 200, 0.0015, 0.0015, 99.5, 99.5};
  std::vector<View> truth;
  for (int i = 0; i < 5; ++i)
    truth.push_back(test::make_view("o" + std::to_string(i), sensor,
                                    test::look_at({0.6 * std::sin(0.5 * i), 0.1, 0.6 * std::cos(0.5 * i)}, {0, 0, 0}),
                                    shape, 0.0001, unsigned(i + 1)));
  const std::vector<View> views = perturbed(truth, 0.005, 0.5 * kDeg);
  Context context(2);
  const std::vector<NoiseModel> noise(views.size(), NoiseModel{0.0001, 0, 0, 0});
  const RegisterResult result = register_views(views, noise, {}, {}, context);
  EXPECT_LT(errors_of(result, truth).max_translation_m, 0.0003);  // at 0.6 m from the object: a fiftieth of a degree
}

}  // namespace
}  // namespace lapseam
