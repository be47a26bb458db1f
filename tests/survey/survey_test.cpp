#include "lapseam/survey.h"

#include <gtest/gtest.h>

#include <numbers>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "support/analytic_views.h"

namespace lapseam {
namespace {

// Three cameras side by side before a wall at z = 0: the second sees half of what the first sees, the third the far
// wall.
Scene wall_scene() {
  const Sensor sensor = PinholeSensor{200, 200, 200, 200, 99.5, 99.5, {}};
  const auto wall = test::plane({0, 0, 0}, Eigen::Vector3d::UnitZ());
  const auto camera_at = [](double x, double z) { return test::look_at({x, 0, z}, {x, 0, 0}); };
  Scene scene;
  scene.views.push_back(test::as_source(test::make_view("first", sensor, camera_at(0, 2), wall, 0.001, 1)));
  scene.views.push_back(test::as_source(test::make_view("second", sensor, camera_at(1, 2), wall, 0.001, 2)));
  scene.views.push_back(test::as_source(test::make_view("far", sensor, camera_at(50, 2), wall, 0.001, 3)));
  return scene;
}

Survey run(const Scene& scene, const SurveyOptions& options = {}, int threads = 2) {
  Context context(threads);
  return survey(scene, options, context);
}

const PairSurvey* find(const Survey& s, std::uint32_t a, std::uint32_t b) {
  for (const PairSurvey& pair : s.pairs)
    if (pair.a == a && pair.b == b) return &pair;
  return nullptr;
}

TEST(Survey, DescribesViewsAndSensors) {
  const Survey found = run(wall_scene());
  ASSERT_EQ(found.views.size(), 3u);
  EXPECT_EQ(found.usable_views(), 3u);
  const ViewSurvey& view = found.views[0];
  EXPECT_EQ(view.name, "first");
  EXPECT_EQ(view.sensor_kind, "pinhole");
  EXPECT_EQ(view.width, 200);
  EXPECT_EQ(view.samples, 40000u);
  EXPECT_EQ(view.valid_share, 1);
  EXPECT_NEAR(view.range_min_m, 2, 0.01);
  EXPECT_NEAR(view.range_median_m, 2, 0.001);
  EXPECT_NEAR(view.range_max_m, 2, 0.01);
  EXPECT_NEAR(view.spacing_m, 0.01, 1e-5);
  ASSERT_EQ(found.sensors.size(), 1u);
  EXPECT_EQ(found.sensors[0].views, 3u);
  EXPECT_NEAR(found.sensors[0].noise.sigma(2), 0.001, 0.0001);
  EXPECT_FALSE(found.sensors[0].given);
}

TEST(Survey, MeasuresOverlapAndDisagreement) {
  Scene scene = wall_scene();
  // The second camera is said to be 20 mm nearer to the wall than it is: what it sees lies 20 mm behind the wall.
  scene.views[1].T_world_view.pretranslate(Eigen::Vector3d(0, 0, -0.02));
  const Survey found = run(scene);
  ASSERT_EQ(found.pairs.size(), 2u);
  for (const auto& [a, b, sign] : {std::tuple(0u, 1u, -1.0), std::tuple(1u, 0u, 1.0)}) {
    const PairSurvey* pair = find(found, a, b);
    ASSERT_TRUE(pair);
    // The images are 2 m wide, the cameras 1 m apart.
    EXPECT_NEAR(pair->overlap, 0.5, 0.03);
    EXPECT_GT(pair->compared, 300u);
    EXPECT_NEAR(pair->median_m, sign * 0.02, 0.0005);
    EXPECT_NEAR(pair->median_absolute_m, 0.02, 0.0005);
    // 20 mm and 1.3 standard deviations of two samples' noise.
    EXPECT_NEAR(pair->p90_absolute_m, 0.0216, 0.0005);
  }
  EXPECT_NEAR(found.distance_m, 0.02, 0.0005);
  EXPECT_NEAR(found.registration.median_m, 0.02, 0.01);
  EXPECT_EQ(found.registration.pairs, 2u);
}

TEST(Survey, DistancesAreAcrossSurfaces) {
  // From the side a wall is not farther off; along rays it would be by 1 / cos 45 degrees.
  const Sensor sensor = PinholeSensor{200, 200, 400, 400, 99.5, 99.5, {}};
  const auto wall = test::plane({0, 0, 0}, Eigen::Vector3d::UnitZ());
  Scene scene;
  for (int i = 0; i < 3; ++i)
    scene.views.push_back(test::as_source(test::make_view("v" + std::to_string(i), sensor,
                                                          test::look_at({0.1 * i, 0, 2}, {0.1 * i + 2, 0, 0}), wall,
                                                          0.001, unsigned(i + 1))));
  scene.views[2].T_world_view.pretranslate(Eigen::Vector3d(0, 0, -0.02));
  const Survey found = run(scene);
  ASSERT_TRUE(find(found, 0, 2));
  EXPECT_NEAR(find(found, 0, 2)->median_m, -0.02, 0.001);
  EXPECT_NEAR(find(found, 2, 1)->median_absolute_m, 0.02, 0.001);
  // Four of the six ordered pairs are 20 mm apart.
  EXPECT_NEAR(found.distance_m, 0.02, 0.002);
}

TEST(Survey, ViewsInPlaceAgree) {
  const Survey found = run(wall_scene());
  EXPECT_EQ(found.registration.median_m, 0);
  const PairSurvey* pair = find(found, 0, 1);
  ASSERT_TRUE(pair);
  EXPECT_NEAR(pair->median_m, 0, 0.0003);
}

TEST(Survey, SaysWhyAViewIsUnusable) {
  Scene scene = wall_scene();
  scene.views[0].range.memory = std::make_shared<RangeImage>(200, 200);
  scene.views[2].range.format = RangeFormat::kPng16;
  scene.views[2].range.file = "no/such/file.png";
  const Survey found = run(scene);
  EXPECT_EQ(found.usable_views(), 1u);
  EXPECT_FALSE(found.views[0].is_usable());
  EXPECT_NE(found.views[2].problem.find("no/such/file.png"), std::string::npos) << found.views[2].problem;
  EXPECT_TRUE(found.pairs.empty());
}

TEST(Survey, NothingUsableIsAnAnswer) {
  Scene scene = wall_scene();
  for (auto& view : scene.views) view.range.memory = std::make_shared<RangeImage>(200, 200);
  const Survey found = run(scene);
  EXPECT_EQ(found.usable_views(), 0u);
  EXPECT_TRUE(found.sensors.empty());
}

TEST(Survey, GivenNoiseIsReportedBesideTheEstimate) {
  Scene scene = wall_scene();
  scene.views[1].noise = NoiseModel{0.005, 0, 0, 0};
  const Survey found = run(scene);
  ASSERT_TRUE(found.sensors.at(0).given);
  EXPECT_EQ(found.sensors[0].given->s0_m, 0.005);
  EXPECT_NEAR(found.sensors[0].noise.sigma(2), 0.001, 0.0001);
}

TEST(Survey, PairsCanBeLeftOut) { EXPECT_TRUE(run(wall_scene(), {.with_pairs = false}).pairs.empty()); }

void expect_same(const Survey& one, const Survey& other) {
  ASSERT_EQ(one.pairs.size(), other.pairs.size());
  for (std::size_t i = 0; i < one.pairs.size(); ++i) {
    EXPECT_EQ(one.pairs[i].a, other.pairs[i].a);
    EXPECT_EQ(one.pairs[i].overlap, other.pairs[i].overlap);
    EXPECT_EQ(one.pairs[i].compared, other.pairs[i].compared);
    EXPECT_EQ(one.pairs[i].p90_absolute_m, other.pairs[i].p90_absolute_m);
  }
  EXPECT_EQ(one.sensors.at(0).noise.s0_m, other.sensors.at(0).noise.s0_m);
  EXPECT_EQ(one.registration.median_m, other.registration.median_m);
}

TEST(Survey, SameForAnyNumberOfThreadsAndWhateverIsKept) {
  const Survey one = run(wall_scene(), {}, 1);
  for (const int threads : {2, 3, 8}) expect_same(one, run(wall_scene(), {}, threads));
  expect_same(one, run(wall_scene(), {.keep_bytes = 0}));
}

TEST(Survey, KeepsNothingItNeedNot) {
  // More views than noise needs, none may be kept: they are read again, and the answer is the same.
  Scene scene;
  for (unsigned i = 0; i < 24; ++i)
    scene.views.push_back(test::as_source(test::make_view("wall", PinholeSensor{60, 60, 60, 60, 29.5, 29.5, {}},
                                                          test::look_at({0.1 * i, 0, 2}, {0.1 * i, 0, 0}),
                                                          test::plane({0, 0, 0}, Eigen::Vector3d::UnitZ()), 0.001, i)));
  const Survey kept = run(scene);
  EXPECT_GT(kept.pairs.size(), 24u);
  expect_same(kept, run(scene, {.keep_bytes = 0}));
}

TEST(Survey, StopsWhenCancelled) {
  Context context(2);
  context.cancel();
  EXPECT_THROW(survey(wall_scene(), {}, context), Cancelled);
}

}  // namespace
}  // namespace lapseam
