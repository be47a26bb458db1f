#include "lapseam/integrate.h"

#include <gtest/gtest.h>

#include <atomic>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "support/analytic_views.h"
#include "support/expect_valid_mesh.h"

namespace lapseam {
namespace {

constexpr double kRadius_m = 0.5;

// A ball seen from the six ends of the axes, as in Sun et al. 2000, §3.
Scene ball_scene(double sigma_m = 0.001) {
  Scene scene;
  scene.name = "ball";
  const Eigen::Vector3d eyes[] = {{2, 0, 0}, {-2, 0, 0}, {0, 2, 0}, {0, -2, 0}, {0, 0, 2}, {0, 0, -2}};
  unsigned seed = 0;
  for (const Eigen::Vector3d& eye : eyes) {
    const std::string name = "view" + std::to_string(seed);
    scene.views.push_back(
        test::as_source(test::make_view(name, test::small_camera(120, 200), test::look_at(eye, {0, 0, 0}),
                                        test::sphere({0, 0, 0}, kRadius_m), sigma_m, ++seed)));
  }
  return scene;
}

// FNV-1a over everything that is written out.
std::uint64_t hash_of(const Mesh& mesh) {
  std::uint64_t hash = 1469598103934665603ull;
  const auto add = [&](const void* data, std::size_t bytes) {
    const auto* p = static_cast<const unsigned char*>(data);
    for (std::size_t i = 0; i < bytes; ++i) hash = (hash ^ p[i]) * 1099511628211ull;
  };
  const auto add_all = [&](const auto& array) { add(array.data(), array.size() * sizeof(array[0])); };
  add_all(mesh.positions_m);
  add_all(mesh.triangles);
  add_all(mesh.vertex_view);
  add_all(mesh.vertex_pixel);
  add_all(mesh.triangle_view);
  add_all(mesh.triangle_tag);
  add_all(mesh.texcoords);
  add_all(mesh.triangle_page);
  for (const ColorImage& page : mesh.pages) add_all(page.pixels);
  return hash;
}

void add_color(Scene& scene) {
  for (ViewSource& view : scene.views) {
    ColorImage image(120, 120);
    for (std::size_t i = 0; i < image.size(); ++i) image.pixels[i] = {std::uint8_t(i), std::uint8_t(i / 120), 77};
    view.color =
        ColorSource{{}, *view.sensor, Eigen::Isometry3d::Identity(), std::make_shared<ColorImage>(std::move(image))};
  }
}

TEST(Integrate, BallFromSixSidesIsOneClosedSurface) {
  Context context(2);
  const IntegrateResult result =
      integrate(ball_scene(), {.reduce_sigma = 0, .check_self_intersections = true}, context);
  expect_valid_mesh(result.mesh);
  EXPECT_EQ(result.report.health.components, 1u);
  EXPECT_EQ(result.report.health.boundary_edges, 0u);
  EXPECT_EQ(result.report.health.pinched_vertices, 0u);
  EXPECT_EQ(result.report.health.self_intersecting_triangles, 0u);
  // Euler: a closed surface of genus 0.
  EXPECT_EQ(std::int64_t(result.mesh.vertex_count()) - std::int64_t(result.report.health.edges) +
                std::int64_t(result.mesh.triangle_count()),
            2);
  for (const Eigen::Vector3f& p : result.mesh.positions_m) ASSERT_NEAR(p.norm(), kRadius_m, 0.004);
  // Every view looks at the ball as every other does: none may lose its share.
  for (const ViewReport& view : result.report.views)
    EXPECT_GT(view.triangles_in_model, view.triangles / 4) << view.name;
}

TEST(Integrate, VerticesThatNoiseAloneAsksForAreLeftOut) {
  Context context(2);
  const IntegrateResult all = integrate(ball_scene(), {.reduce_sigma = 0}, context);
  const IntegrateResult some = integrate(ball_scene(), {.check_self_intersections = true}, context);
  expect_valid_mesh(some.mesh);
  EXPECT_LT(some.mesh.triangle_count(), all.mesh.triangle_count() * 3 / 4);
  EXPECT_EQ(some.report.health.components, 1u);
  EXPECT_EQ(some.report.health.boundary_edges, 0u);
  EXPECT_EQ(some.report.health.self_intersecting_triangles, 0u);
  for (const Eigen::Vector3f& p : some.mesh.positions_m) ASSERT_NEAR(p.norm(), kRadius_m, 0.004);
}

TEST(Integrate, AStepThatNoiseHidesInSingleSamplesIsNotSpanned) {
  // A plate five standard deviations before a wall. Of the ramps all around it, with all of the noise two thirds are
  // there, with what smoothing leaves a twentieth.
  constexpr double kWall_m = 2, kStep_m = 0.105, kSigma_m = 0.02, kHalf_m = 0.06;
  Context context(2);
  Scene scene;
  scene.views.push_back(test::as_source(
      test::make_view("plate", test::small_camera(120, 1000), Eigen::Isometry3d::Identity(),
                      test::nearest({test::rectangle(kWall_m - kStep_m, -kHalf_m, kHalf_m, -kHalf_m, kHalf_m),
                                     test::plane({0, 0, kWall_m}, {0, 0, 1})}),
                      kSigma_m, 1)));
  const IntegrateResult result = integrate(scene, {}, context);
  expect_valid_mesh(result.mesh);
  double flat_m2 = 0, spanned_m2 = 0;
  for (const Triangle& t : result.mesh.triangles) {
    const auto& p = result.mesh.positions_m;
    const auto [low, high] = std::minmax({p[t[0]].z(), p[t[1]].z(), p[t[2]].z()});
    const double area = 0.5 * double((p[t[1]] - p[t[0]]).cross(p[t[2]] - p[t[0]]).norm());
    (double(high - low) < 0.5 * kStep_m ? flat_m2 : spanned_m2) += area;
  }
  EXPECT_LT(spanned_m2, 0.1 * (8 * kHalf_m * kStep_m));
  EXPECT_GT(flat_m2, 0.9 * 0.24 * 0.24);
}

TEST(Integrate, NormalsPointOutwards) {
  Context context(2);
  const Mesh mesh = integrate(ball_scene(0.0), {}, context).mesh;
  for (const Triangle& t : mesh.triangles) {
    const auto& p = mesh.positions_m;
    ASSERT_GT((p[t[1]] - p[t[0]]).cross(p[t[2]] - p[t[0]]).dot(p[t[0]]), 0);
  }
}

TEST(Integrate, SameBytesForAnyThreads) {
  allow_threads(8);  // or threads beyond the processors would not be made
  Scene scene = ball_scene(0.002);
  add_color(scene);
  Context one(1);
  const std::uint64_t reference = hash_of(integrate(scene, {}, one).mesh);
  for (const int threads : {2, 3, 8}) {
    Context context(threads);
    EXPECT_EQ(hash_of(integrate(scene, {}, context).mesh), reference) << threads << " threads";
  }
}

TEST(Integrate, SameBytesForAnyMemoryBudget) {
  Scene scene = ball_scene();
  add_color(scene);
  Context all(2), little(2);
  const std::uint64_t reference = hash_of(integrate(scene, {}, all).mesh);
  // The estimate begins with what the process holds already, which a moment later may be more.
  const std::uint64_t budget = 2 * estimate_memory(scene, {}, 2).least_bytes;
  little.set_memory_budget({budget, {}});
  const IntegrateResult result = integrate(scene, {}, little);
  EXPECT_EQ(hash_of(result.mesh), reference);
  EXPECT_EQ(result.report.memory.budget_bytes, budget);
  EXPECT_GT(result.report.memory.largest_stored_bytes, std::uint64_t(6 * 120 * 120 * 7));
  EXPECT_NE(to_json(result.report, little).find("largest_stored_bytes"), std::string::npos);
}

TEST(Integrate, UsualMemoryDoesNotGrowWithTheViews) {
  Scene scene;
  ViewSource view;
  view.sensor_id = "camera";
  view.sensor = PinholeSensor{640, 480, 500, 500, 320, 240, {}};
  const auto usual_of = [&](std::size_t views) {
    scene.views.assign(views, view);
    return estimate_memory(scene, {}, 2).usual_bytes;
  };
  EXPECT_GT(usual_of(2000), estimate_memory(scene, {}, 2).least_bytes);
  if (estimate_memory({}, {}, 2).least_bytes > 60'000'000) GTEST_SKIP() << "the process takes much itself: sanitizers";
  EXPECT_EQ(usual_of(10), 0u);  // all of it is less
  EXPECT_EQ(usual_of(100), 400'000'000u);
  EXPECT_EQ(usual_of(180), 400'000'000u);
  scene.views.assign(70, view);
  const MemoryEstimate middling = estimate_memory(scene, {}, 2);
  EXPECT_LT(middling.all_bytes, 400'000'000u);
  EXPECT_NEAR(double(middling.usual_bytes), 0.8 * double(middling.all_bytes), 1.0);
}

TEST(Integrate, ABudgetThatCannotDoIsRefusedWithOneThatCould) {
  const Scene scene = ball_scene();
  Context context(1);
  context.set_memory_budget({1'000'000, {}});
  try {
    integrate(scene, {}, context);
    FAIL();
  } catch (const InvalidInput& error) {
    const std::string what = error.what();
    EXPECT_NE(what.find("memory: 1 MB will not do; about "), std::string::npos) << what;
  }
}

TEST(Integrate, OrderOfViewsChangesOnlyDetails) {
  Scene scene = ball_scene();
  std::reverse(scene.views.begin(), scene.views.end());
  Context context(2);
  const IntegrateResult result = integrate(scene, {}, context);
  expect_valid_mesh(result.mesh);
  EXPECT_EQ(result.report.health.components, 1u);
  EXPECT_EQ(result.report.health.boundary_edges, 0u);
}

TEST(Integrate, ProvenancePointsAtTheSample) {
  const Scene scene = ball_scene(0.0);
  Context context(2);
  const Mesh mesh =
      integrate(scene, {.smooth = {.reach_px = 0}, .overlap = {.consensus = false}, .reduce_sigma = 0}, context).mesh;
  for (std::size_t i = 0; i < mesh.vertex_count(); ++i) {
    const ViewSource& view = scene.views[mesh.vertex_view[i]];
    const int u = int(mesh.vertex_pixel[i] % 120), v = int(mesh.vertex_pixel[i] / 120);
    const Eigen::Vector3d p = view.T_world_view * unproject(*view.sensor, u, v, double(view.range.memory->at(u, v)));
    ASSERT_LT((p - mesh.positions_m[i].cast<double>()).norm(), 1e-6);
  }
}

TEST(Integrate, ConsensusMovesSamplesAlongTheirRays) {
  const Scene scene = ball_scene(0.002);
  Context context(2);
  const Mesh mesh = integrate(scene, {.smooth = {.reach_px = 0}, .reduce_sigma = 0}, context).mesh;
  double moved = 0;
  for (std::size_t i = 0; i < mesh.vertex_count(); ++i) {
    const ViewSource& view = scene.views[mesh.vertex_view[i]];
    const int u = int(mesh.vertex_pixel[i] % 120), v = int(mesh.vertex_pixel[i] / 120);
    const Eigen::Vector3d in_view = view.T_world_view.inverse() * mesh.positions_m[i].cast<double>();
    const auto at = project(*view.sensor, in_view);
    ASSERT_TRUE(at);
    ASSERT_NEAR(at->u, u, 1e-3);
    ASSERT_NEAR(at->v, v, 1e-3);
    const double shift = at->r - double(view.range.memory->at(u, v));
    ASSERT_LT(std::abs(shift), 0.02);
    moved += std::abs(shift) > 1e-5;
  }
  EXPECT_GT(moved, 0.1 * double(mesh.vertex_count()));
}

TEST(Integrate, FarFromTheOriginNothingIsLost) {
  Scene scene = ball_scene(0.0);
  const Eigen::Vector3d offset(456789.0, 5432100.0, 312.0);
  for (ViewSource& view : scene.views) view.T_world_view.pretranslate(offset);
  Context context(2);
  const Mesh mesh = integrate(scene, {}, context).mesh;
  for (const Eigen::Vector3f& p : mesh.positions_m)
    ASSERT_NEAR((mesh.origin_m + p.cast<double>() - offset).norm(), kRadius_m, 0.002);
}

TEST(Integrate, HoldOutLeavesViewsOut) {
  Context context(2);
  const IntegrateResult result = integrate(ball_scene(), {.hold_out = 3}, context);
  EXPECT_EQ(result.report.views_left_out, (std::vector<std::string>{"view0", "view3"}));
  for (const std::uint32_t view : result.mesh.vertex_view) ASSERT_TRUE(view != 0 && view != 3);
}

TEST(Integrate, BadViewFailsOrIsLeftOut) {
  Scene scene = ball_scene();
  scene.views[2].range.memory = std::make_shared<RangeImage>(120, 120);  // no sample at all
  Context context(2);
  try {
    integrate(scene, {}, context);
    FAIL() << "an empty range image must not pass in silence";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("view2"), std::string::npos) << error.what();
  }
  const IntegrateResult result = integrate(scene, {.skip_bad_views = true}, context);
  EXPECT_EQ(result.report.views_left_out, std::vector<std::string>{"view2"});
  EXPECT_GT(result.mesh.triangle_count(), 1000u);
  EXPECT_EQ(context.warnings().size(), 1u);
}

TEST(Integrate, ViewsThatDoNotOverlapStayApart) {
  Scene scene = ball_scene();
  scene.views.resize(2);  // opposite sides
  Context context(2);
  const IntegrateResult result = integrate(scene, {}, context);
  expect_valid_mesh(result.mesh);
  EXPECT_EQ(result.report.health.components, 2u);
  EXPECT_EQ(result.report.zipper.seam_triangles, 0u);
}

TEST(Integrate, CancelStopsTheWork) {
  Context context(2);
  std::atomic<int> calls{0};
  context.set_progress_sink([&](const Progress& progress) {
    ++calls;
    if (progress.stage == "overlap") context.cancel();
  });
  EXPECT_THROW(integrate(ball_scene(), {}, context), Cancelled);
  EXPECT_GT(calls.load(), 0);
}

TEST(Integrate, ReportIsCompleteJson) {
  Scene scene = ball_scene();
  add_color(scene);
  Context context(2);
  const IntegrateResult result = integrate(scene, {}, context);
  const std::string json = to_json(result.report, context);
  for (const char* key :
       {"\"stages\"", "\"peak_rss_bytes\"", "\"sensors\"", "\"step_m\"", "\"registration_error_m\"",
        "\"triangles_in_model\"", "\"seam_triangles\"", "\"samples_claimed\"", "\"nonmanifold_edges\"", "\"charts\""})
    EXPECT_NE(json.find(key), std::string::npos) << key;
  EXPECT_EQ(result.report.texture.unseen_triangles, 0u);
}

TEST(Integrate, TrianglesThatNoImageShowsAreMarkedWhereVerticesHaveTheColors) {
  Scene scene = ball_scene();
  add_color(scene);
  for (std::size_t i = 1; i < scene.views.size(); ++i) scene.views[i].color.reset();
  Context context(2);
  const IntegrateResult result = integrate(scene, {.color = ColorOutput::kVertices}, context);
  EXPECT_TRUE(result.mesh.pages.empty());
  ASSERT_EQ(result.mesh.is_unseen.size(), result.mesh.triangle_count());
  const auto unseen = std::uint64_t(std::count(result.mesh.is_unseen.begin(), result.mesh.is_unseen.end(), 1));
  EXPECT_EQ(unseen, result.report.texture.unseen_triangles);
  EXPECT_GT(unseen, 0u);
  EXPECT_LT(unseen, result.mesh.triangle_count());
}

}  // namespace
}  // namespace lapseam
