#include "lapseam/sew.h"

#include <gtest/gtest.h>

#include <random>

#include "lapseam/context.h"
#include "lapseam/health.h"
#include "support/expect_valid_mesh.h"

namespace lapseam {
namespace {

// A flat grid of nx × ny unit-spaced samples (times `spacing`) with its lower left corner at (x, y); appended to the
// mesh. Triangles for which `keep` is false are left out, and edges towards them are active.
void append_grid(ExtractedMesh& out, int nx, int ny, double x, double y, double spacing, double angle_rad,
                 const std::function<bool(const Eigen::Vector3f&)>& keep, std::uint32_t view) {
  Mesh& mesh = out.mesh;
  const auto base = std::uint32_t(mesh.vertex_count());
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) {
      const double gx = i * spacing, gy = j * spacing;
      mesh.positions_m.push_back({float(x + std::cos(angle_rad) * gx - std::sin(angle_rad) * gy),
                                  float(y + std::sin(angle_rad) * gx + std::cos(angle_rad) * gy), 0.0f});
      mesh.vertex_view.push_back(view);
      mesh.vertex_pixel.push_back(std::uint32_t(j * nx + i));
    }
  std::vector<Triangle> all;
  for (int j = 0; j + 1 < ny; ++j)
    for (int i = 0; i + 1 < nx; ++i) {
      const std::uint32_t a = base + std::uint32_t(j * nx + i), b = a + 1, c = a + std::uint32_t(nx), d = c + 1;
      all.push_back({a, b, d});
      all.push_back({a, d, c});
    }
  std::vector<std::uint8_t> is_kept;
  for (const Triangle& t : all)
    is_kept.push_back(keep((mesh.positions_m[t[0]] + mesh.positions_m[t[1]] + mesh.positions_m[t[2]]) / 3));
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!is_kept[i]) continue;
    const auto index = std::uint32_t(mesh.triangle_count());
    mesh.triangles.push_back(all[i]);
    mesh.triangle_view.push_back(view);
    mesh.triangle_tag.push_back(TriangleTag::kMeasured);
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = all[i][k], b = all[i][(k + 1) % 3];
      for (std::size_t j = 0; j < all.size(); ++j)
        if (!is_kept[j])
          for (std::size_t m = 0; m < 3; ++m)
            if (all[j][m] == b && all[j][(m + 1) % 3] == a) out.active_edges.push_back({a, b, index});
    }
  }
}

double area(const Mesh& mesh) {
  double sum = 0;
  for (const Triangle& t : mesh.triangles) {
    const auto& p = mesh.positions_m;
    sum += 0.5 * double((p[t[1]] - p[t[0]]).cross(p[t[2]] - p[t[0]]).norm());
  }
  return sum;
}

// Two grids of different spacing and direction that were cut along a curve, with a gap between them.
ExtractedMesh two_patches(double spacing_a, double spacing_b, double angle, double gap) {
  ExtractedMesh out;
  const auto curve = [](const Eigen::Vector3f& p) { return 10 + 2 * std::sin(0.5 * double(p.y())); };
  append_grid(
      out, int(20 / spacing_a), int(20 / spacing_a), 0, 0, spacing_a, 0,
      [&](const Eigen::Vector3f& p) { return double(p.x()) < curve(p) - gap; }, 0);
  append_grid(
      out, int(30 / spacing_b), int(30 / spacing_b), 3.21, -4.13, spacing_b, angle,
      [&](const Eigen::Vector3f& p) { return double(p.x()) > curve(p) + gap && p.y() > 1 && p.y() < 18 && p.x() < 22; },
      1);
  // The second grid's outline above is a cut of the test's own making, not of the overlap: natural, not active.
  std::erase_if(out.active_edges, [&](const BoundaryEdge& e) {
    const Eigen::Vector3f p = 0.5f * (out.mesh.positions_m[e.a] + out.mesh.positions_m[e.b]);
    return out.mesh.vertex_view[e.a] == 1 && double(p.x()) > curve(p) + gap + 1.5 * spacing_b;
  });
  return out;
}

struct Case {
  double spacing_a, spacing_b, angle, gap;
};

class SewGap : public testing::TestWithParam<Case> {};

TEST_P(SewGap, IsClosed) {
  const Case c = GetParam();
  ExtractedMesh extracted = two_patches(c.spacing_a, c.spacing_b, c.angle, c.gap);
  Context context(2);
  const MeshHealth before = check_health(extracted.mesh, {}, context);
  ASSERT_EQ(before.self_intersecting_triangles, 0u) << "the test's own patches must not overlap";
  const double area_before = area(extracted.mesh);
  const std::size_t triangles_before = extracted.mesh.triangle_count();
  const SewReport report = sew(extracted.mesh, extracted.active_edges, {}, context);
  expect_valid_mesh(extracted.mesh);
  const MeshHealth after = check_health(extracted.mesh, {}, context);
  EXPECT_EQ(after.self_intersecting_triangles, 0u);
  EXPECT_EQ(before.components, 2u);
  EXPECT_EQ(after.components, 1u);
  EXPECT_EQ(report.front_triangles + report.loop_triangles, extracted.mesh.triangle_count() - triangles_before);
  for (std::size_t i = triangles_before; i < extracted.mesh.triangle_count(); ++i)
    EXPECT_EQ(extracted.mesh.triangle_tag[i], TriangleTag::kSeam);
  // Well inside of both grids, nothing may be left open between them.
  int open_inside = 0;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> edges;
  for (const Triangle& t : extracted.mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) edges.push_back({t[k], t[(k + 1) % 3]});
  std::sort(edges.begin(), edges.end());
  for (const auto& [a, b] : edges) {
    if (std::binary_search(edges.begin(), edges.end(), std::pair(b, a))) continue;
    const Eigen::Vector3f p = 0.5f * (extracted.mesh.positions_m[a] + extracted.mesh.positions_m[b]);
    const double curve = 10 + 2 * std::sin(0.5 * double(p.y()));
    if (p.y() > 5.0f && p.y() < 15.5f &&
        std::abs(double(p.x()) - curve) < c.gap + 2 * std::max(c.spacing_a, c.spacing_b))
      ++open_inside;
  }
  EXPECT_EQ(open_inside, 0);
  // Area is the other half of "no overlap": a flap would add to it. 17 wide, the gap twice `gap` plus ragged borders.
  EXPECT_LT(area(extracted.mesh) - area_before, 20 * (2 * c.gap + 2.5 * std::max(c.spacing_a, c.spacing_b)));
}

INSTANTIATE_TEST_SUITE_P(Gaps, SewGap,
                         testing::Values(Case{0.5, 0.5, 0, 0.45}, Case{0.5, 0.5, 0.3, 0.5}, Case{0.5, 0.37, 0.7, 0.5},
                                         Case{1.0, 0.33, 0.2, 1.0}, Case{0.3, 1.0, 0.5, 1.0}));

TEST(Sew, NothingActiveNothingDone) {
  ExtractedMesh extracted;
  append_grid(
      extracted, 10, 10, 0, 0, 1, 0, [](const auto&) { return true; }, 0);
  append_grid(
      extracted, 10, 10, 9.5, 0, 1, 0, [](const auto&) { return true; }, 1);
  const std::size_t triangles = extracted.mesh.triangle_count();
  Context context(1);
  EXPECT_EQ(sew(extracted.mesh, {}, {}, context).front_triangles, 0u);
  EXPECT_EQ(extracted.mesh.triangle_count(), triangles);
}

TEST(Sew, SpaceSeenAsEmptyStaysOpen) {
  ExtractedMesh extracted = two_patches(0.5, 0.5, 0.3, 0.5);
  Context context(2);
  SewOptions options;
  options.is_seen_through = [](const Mesh&, const Triangle&) { return true; };
  const SewReport report = sew(extracted.mesh, extracted.active_edges, options, context);
  EXPECT_EQ(report.front_triangles + report.loop_triangles, 0u);
}

TEST(Sew, SameMeshForAnyThreads) {
  allow_threads(8);  // or threads beyond the processors would not be made
  Context one(1);
  ExtractedMesh reference = two_patches(0.5, 0.37, 0.7, 0.4);
  sew(reference.mesh, reference.active_edges, {}, one);
  for (const int threads : {2, 3, 8}) {
    Context context(threads);
    ExtractedMesh other = two_patches(0.5, 0.37, 0.7, 0.4);
    sew(other.mesh, other.active_edges, {}, context);
    EXPECT_EQ(other.mesh.triangles, reference.mesh.triangles);
  }
}

TEST(SplitPinchedVertices, TwoTrianglesThatTouchInAPoint) {
  Mesh mesh;
  mesh.positions_m = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
  mesh.triangles = {{0, 1, 2}, {0, 3, 4}};
  mesh.vertex_view = {5, 6, 7, 8, 9};
  EXPECT_EQ(split_pinched_vertices(mesh), 1u);
  EXPECT_EQ(mesh.vertex_count(), 6u);
  EXPECT_EQ(mesh.vertex_view.back(), 5u);
  EXPECT_EQ(mesh.positions_m.back(), mesh.positions_m[0]);
  EXPECT_EQ(split_pinched_vertices(mesh), 0u);
}

TEST(RemoveSmallComponents, KeepsTheLargeOnes) {
  ExtractedMesh extracted;
  append_grid(
      extracted, 5, 5, 0, 0, 1, 0, [](const auto&) { return true; }, 0);
  append_grid(
      extracted, 2, 2, 10, 0, 1, 0, [](const auto&) { return true; }, 1);
  EXPECT_EQ(remove_small_components(extracted.mesh, 3), 2u);
  EXPECT_EQ(extracted.mesh.triangle_count(), 32u);
  EXPECT_EQ(extracted.mesh.vertex_count(), 25u);
  EXPECT_EQ(extracted.mesh.triangle_view.size(), 32u);
}

}  // namespace
}  // namespace lapseam
