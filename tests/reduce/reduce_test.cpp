#include "lapseam/reduce.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "lapseam/error.h"
#include "reduce/shapes.h"
#include "support/expect_valid_mesh.h"

namespace lapseam {
namespace {

Mesh reduced(const Mesh& mesh, const ReduceOptions& options = {}, int threads = 2) {
  Context context(threads);
  return reduce(mesh, {}, options, context).mesh;
}

MeshHealth health_of(const Mesh& mesh) {
  Context context;
  return check_health(mesh, {}, context);
}

double area(const Mesh& mesh) {
  double sum = 0;
  for (const Triangle& t : mesh.triangles)
    sum += 0.5 * double((mesh.positions_m[t[1]] - mesh.positions_m[t[0]])
                            .cross(mesh.positions_m[t[2]] - mesh.positions_m[t[0]])
                            .norm());
  return sum;
}

// Root mean square and largest height over corners, edge middles and centres of all triangles, by area.
struct Heights {
  double rms = 0, largest = 0;
};
Heights heights_of(const Mesh& mesh) {
  Heights out;
  double weights = 0;
  for (const Triangle& t : mesh.triangles) {
    const Eigen::Vector3f &a = mesh.positions_m[t[0]], &b = mesh.positions_m[t[1]], &c = mesh.positions_m[t[2]];
    const double weight = double((b - a).cross(c - a).norm());
    for (const Eigen::Vector3f& p : {a, b, c, Eigen::Vector3f((a + b + c) / 3)}) {
      out.rms += weight * double(p.z()) * double(p.z());
      weights += weight;
      out.largest = std::max(out.largest, std::abs(double(p.z())));
    }
  }
  out.rms = std::sqrt(out.rms / weights);
  return out;
}

TEST(Reduce, PlaneBecomesFewTrianglesWithTheSameOutline) {
  const Mesh mesh = test::height_field(200, 150, [](float x, float y) { return 0.3f * x - 0.2f * y; });
  const Mesh out = reduced(mesh, {.max_error_m = 1e-4});
  expect_valid_mesh(out);
  EXPECT_LT(out.triangle_count(), 300u);  // of 60,000
  EXPECT_NEAR(area(out) / area(mesh), 1, 1e-3);
  // All four corners are still there.
  for (const float x : {0.f, 1.f})
    for (const float y : {0.f, 0.75f}) {
      float nearest = 1;
      for (const Eigen::Vector3f& p : out.positions_m)
        nearest = std::min(nearest, (p - Eigen::Vector3f(x, y, 0.3f * x - 0.2f * y)).norm());
      EXPECT_LT(nearest, 1e-3f) << x << " " << y;
    }
  EXPECT_NEAR(health_of(out).boundary_length_m, health_of(mesh).boundary_length_m, 1e-2);
}

TEST(Reduce, SphereStaysWithinTheBound) {
  const Mesh mesh = test::sphere_or_cube(100, true);  // 120,000 triangles of 15 mm
  constexpr double kBound_m = 0.002;
  const Mesh out = reduced(mesh, {.max_error_m = kBound_m});
  expect_valid_mesh(out);
  EXPECT_LT(out.triangle_count(), mesh.triangle_count() / 10);
  double furthest = 0;
  for (const Triangle& t : out.triangles) {
    const Eigen::Vector3f middle = (out.positions_m[t[0]] + out.positions_m[t[1]] + out.positions_m[t[2]]) / 3;
    furthest = std::max(furthest, std::abs(1 - double(middle.norm())));
    for (const std::uint32_t v : t) furthest = std::max(furthest, std::abs(1 - double(out.positions_m[v].norm())));
  }
  // The bound is a root mean square to planes; at the middle of a triangle the sag is up to a few times that.
  EXPECT_LT(furthest, 3 * kBound_m);
  const MeshHealth health = health_of(out);
  EXPECT_EQ(health.boundary_edges, 0u);
  EXPECT_EQ(health.self_intersecting_triangles, 0u);
}

TEST(Reduce, CreasesOfACubeSurvive) {
  const Mesh mesh = test::sphere_or_cube(80, false);
  constexpr double kBound_m = 0.001;
  const Mesh out = reduced(mesh, {.max_error_m = kBound_m});
  expect_valid_mesh(out);
  EXPECT_LT(out.triangle_count(), 2000u);  // of 76,800
  EXPECT_NEAR(area(out), 24, 24 * 0.005);
  for (const Eigen::Vector3f& p : out.positions_m)
    EXPECT_NEAR(double(p.cwiseAbs().maxCoeff()), 1, 2 * kBound_m);  // on a face
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3f at(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
    float nearest = 1;
    for (const Eigen::Vector3f& p : out.positions_m) nearest = std::min(nearest, (p - at).norm());
    EXPECT_LT(nearest, 2 * float(kBound_m));
  }
}

TEST(Reduce, HoleKeepsItsShape) {
  Mesh mesh = test::height_field(200, 200, [](float, float) { return 0.f; });
  std::vector<std::uint8_t> keep(mesh.triangle_count());
  for (std::size_t i = 0; i < keep.size(); ++i) {
    const Triangle& t = mesh.triangles[i];
    const Eigen::Vector3f middle = (mesh.positions_m[t[0]] + mesh.positions_m[t[1]] + mesh.positions_m[t[2]]) / 3;
    keep[i] = (middle - Eigen::Vector3f(0.5f, 0.5f, 0)).norm() > 0.25f;
  }
  mesh = compact(mesh, keep);
  const Mesh out = reduced(mesh, {.max_error_m = 0.005});
  expect_valid_mesh(out);
  EXPECT_EQ(health_of(out).boundary_loops, 2u);
  EXPECT_NEAR(area(out) / area(mesh), 1, 0.01);
  EXPECT_LT(out.triangle_count(), mesh.triangle_count() / 20);
}

TEST(Reduce, ThinSheetKeepsBothSides) {
  const Mesh top = test::noisy_plane(100, 0.0005f, 1);
  Mesh bottom = test::noisy_plane(100, 0.0005f, 2);
  for (Eigen::Vector3f& p : bottom.positions_m) p.z() -= 0.01f;
  for (Triangle& t : bottom.triangles) std::swap(t[0], t[1]);
  const Mesh out = reduced(test::together(top, bottom), {.max_error_m = 0.002});
  expect_valid_mesh(out);
  const MeshHealth health = health_of(out);
  EXPECT_EQ(health.components, 2u);
  EXPECT_EQ(health.self_intersecting_triangles, 0u);
  EXPECT_NEAR(area(out), 2, 0.02);
  EXPECT_LT(out.triangle_count(), 8000u);  // of 40,000
}

TEST(Reduce, CountIsMet) {
  const Mesh mesh = test::together(test::sphere_or_cube(60, true), test::noisy_plane(150, 0.001f, 3));
  for (const std::uint64_t wanted : {50'000u, 20'000u, 3'000u}) {
    const Mesh out = reduced(mesh, {.max_triangles = wanted});
    expect_valid_mesh(out);
    EXPECT_LE(out.triangle_count(), wanted);
    EXPECT_GE(out.triangle_count() + 1, wanted);
  }
  EXPECT_EQ(reduced(mesh, {.max_triangles = 1'000'000}).triangle_count(), mesh.triangle_count());
}

TEST(Reduce, ErrorBoundHoldsAlsoWhenACountIsWanted) {
  const Mesh mesh = test::sphere_or_cube(60, true);
  const Mesh by_error = reduced(mesh, {.max_error_m = 1e-4});
  const Mesh by_both = reduced(mesh, {.max_error_m = 1e-4, .max_triangles = 100});
  EXPECT_GT(by_both.triangle_count(), by_error.triangle_count() / 2);
}

TEST(Reduce, NoiseIsAveraged) {
  constexpr float kSigma = 0.001f;
  const Mesh mesh = test::noisy_plane(200, kSigma, 4);
  const double before = heights_of(mesh).rms;
  const Mesh averaged = reduced(mesh, {.max_triangles = 4000});
  const Mesh picked = reduced(mesh, {.max_triangles = 4000, .placement = Placement::kEndpoint});
  expect_valid_mesh(averaged);
  // Independent noise of a fifth of the spacing tilts the planes by 16°, so twenty samples do not average as twenty
  // heights would (0.22); 0.60 was measured.
  EXPECT_LT(heights_of(averaged).rms, 0.65 * before);
  EXPECT_LT(heights_of(averaged).rms, heights_of(picked).rms);
}

TEST(Reduce, NoiseIsFoundAndBoundsTheError) {
  constexpr float kSigma = 0.0005f;
  Context context;
  const Mesh mesh = test::noisy_plane(200, kSigma, 5);
  const ReduceResult result = reduce(mesh, {}, {}, context);
  EXPECT_NEAR(result.report.noise_m, double(kSigma), 0.15 * double(kSigma));
  EXPECT_LT(result.mesh.triangle_count(), mesh.triangle_count() / 3);
  EXPECT_LT(heights_of(result.mesh).rms, double(kSigma));
}

TEST(Reduce, BoundInSigmasFollowsTheVertices) {
  Context context;
  const Mesh halves = test::noisy_plane(100, 0.002f, 6);
  std::vector<float> half_sigma(halves.vertex_count());
  for (std::size_t v = 0; v < half_sigma.size(); ++v)
    half_sigma[v] = halves.positions_m[v].x() < 0.5f ? 0.0005f : 0.005f;
  const Mesh out = reduce(halves, half_sigma, {.max_error_sigma = 1}, context).mesh;
  std::size_t left = 0, right = 0;
  for (const Eigen::Vector3f& p : out.positions_m) ++(p.x() < 0.5f ? left : right);
  EXPECT_GT(left, 5 * right);
}

TEST(Reduce, PiecesLeaveNoTraceAtTheirBorders) {
  // Some twenty pieces, whose borders the first round must leave.
  const Mesh mesh = test::noisy_plane(350, 0.0002f, 7);
  const Mesh out = reduced(mesh, {.max_error_m = 0.002});
  expect_valid_mesh(out);
  EXPECT_EQ(health_of(out).boundary_loops, 1u);
  EXPECT_LT(out.triangle_count(), mesh.triangle_count() / 30);
}

TEST(Reduce, SameBytesForAnyNumberOfThreads) {
  allow_threads(8);
  const Mesh mesh = test::together(test::sphere_or_cube(70, true), test::noisy_plane(200, 0.001f, 8));
  for (const ReduceOptions& options : {ReduceOptions{}, ReduceOptions{.max_triangles = 9000}}) {
    const Mesh first = reduced(mesh, options, 1);
    for (const int threads : {2, 3, 8}) {
      const Mesh other = reduced(mesh, options, threads);
      EXPECT_EQ(first.triangles, other.triangles) << threads;
      EXPECT_EQ(first.positions_m, other.positions_m) << threads;
    }
  }
}

TEST(Reduce, TetrahedronIsNotFolded) {
  Mesh mesh;
  mesh.positions_m = {{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}};
  mesh.triangles = {{0, 1, 2}, {0, 3, 1}, {0, 2, 3}, {1, 3, 2}};
  EXPECT_EQ(reduced(mesh, {.max_triangles = 1}).triangle_count(), 4u);
}

TEST(Reduce, EmptyAndDegenerateMeshes) {
  EXPECT_EQ(reduced({}).triangle_count(), 0u);
  Mesh mesh;
  mesh.positions_m = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {0, 1, 0}};
  EXPECT_EQ(reduced(mesh).vertex_count(), 0u);  // points in no triangle are dropped
  mesh.triangles = {{0, 1, 1}, {0, 1, 2}, {0, 1, 3}};
  const Mesh out = reduced(mesh, {.max_error_m = 0.001});
  EXPECT_NO_THROW(check_mesh(out));
  EXPECT_LE(out.triangle_count(), 2u);
}

TEST(Reduce, BadInputIsRefused) {
  Context context;
  Mesh mesh = test::noisy_plane(4, 0.1f, 9);
  const std::vector<float> sigma(mesh.vertex_count(), 0.1f);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(reduce(mesh, {}, {.max_error_m = -1}, context), InvalidInput);
  EXPECT_THROW(reduce(mesh, {}, {.max_error_m = double(nan)}, context), InvalidInput);
  EXPECT_THROW(reduce(mesh, {}, {.max_error_sigma = 1}, context), InvalidInput);
  EXPECT_THROW(reduce(mesh, sigma, {.max_error_m = 1, .max_error_sigma = 1}, context), InvalidInput);
  EXPECT_THROW(reduce(mesh, std::vector<float>(3, 0.1f), {}, context), InvalidInput);
  EXPECT_THROW(reduce(mesh, std::vector<float>(mesh.vertex_count(), 0.f), {}, context), InvalidInput);
  mesh.positions_m[3].y() = nan;
  try {
    reduce(mesh, {}, {}, context);
    FAIL();
  } catch (const InvalidInput& error) {
    EXPECT_NE(std::string(error.what()).find("positions_m"), std::string::npos);
  }
}

TEST(Reduce, StopsWhenCancelled) {
  Context context;
  context.cancel();
  EXPECT_THROW(reduce(test::noisy_plane(300, 0.001f, 10), {}, {}, context), Cancelled);
}

}  // namespace
}  // namespace lapseam
