#include "lapseam/health.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>

#include "health/meshes.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "support/expect_valid_mesh.h"

namespace lapseam {
namespace {

using test::grid;
using test::tetrahedron;

MeshHealth health_of(const Mesh& mesh, const HealthOptions& options = {}) {
  Context context;
  return check_health(mesh, options, context);
}

TEST(Health, closed_tetrahedron_has_nothing_wrong) {
  const MeshHealth health = health_of(tetrahedron());
  EXPECT_EQ(health.vertices, 4u);
  EXPECT_EQ(health.triangles, 4u);
  EXPECT_EQ(health.edges, 6u);
  EXPECT_EQ(health.components, 1u);
  EXPECT_EQ(health.boundary_edges, 0u);
  EXPECT_EQ(health.boundary_loops, 0u);
  EXPECT_EQ(health.pinched_vertices, 0u);
  EXPECT_TRUE(health.is_sound());
  EXPECT_TRUE(health.self_intersections_checked);
  EXPECT_EQ(health.self_intersecting_triangles, 0u);
  const double side = 2 * std::sqrt(2.0);
  EXPECT_NEAR(health.area_m2, std::sqrt(3.0) * side * side, 1e-9);
  EXPECT_NEAR(health.edge_length_median_m, side, 1e-6);
  for (const double angle : health.min_angle_percentiles_deg) EXPECT_NEAR(angle, 60, 1e-4);
  EXPECT_DOUBLE_EQ(health.largest_component_share, 1);
  expect_valid_mesh(tetrahedron());
}

TEST(Health, empty_mesh_has_no_figures) {
  const MeshHealth health = health_of({});
  EXPECT_EQ(health.triangles, 0u);
  EXPECT_EQ(health.components, 0u);
  EXPECT_EQ(health.largest_component_share, 0);
  EXPECT_TRUE(health.is_sound());
}

TEST(Health, open_grid_has_its_outline_as_boundary) {
  const MeshHealth health = health_of(grid(7, 4, 0.5f));
  EXPECT_EQ(health.boundary_edges, 22u);
  EXPECT_NEAR(health.boundary_length_m, 11, 1e-9);
  EXPECT_EQ(health.boundary_loops, 1u);
  EXPECT_EQ(health.edges, 7u * 5 + 4 * 8 + 28);
  EXPECT_NEAR(health.min_angle_percentiles_deg[3], 45, 1e-5);
  EXPECT_NEAR(health.edge_length_median_m, 0.5, 1e-7);
  EXPECT_NEAR(health.area_m2, 7, 1e-9);
}

TEST(Health, holes_are_loops_of_their_own) {
  Mesh mesh = grid(9, 9);
  std::vector<std::uint8_t> keep(mesh.triangle_count(), 1);
  keep[2 * (2 * 9 + 2)] = 0;                              // one triangle: a hole of three edges
  keep[2 * (5 * 9 + 5)] = keep[2 * (5 * 9 + 5) + 1] = 0;  // a cell: four edges
  mesh = compact(mesh, keep);
  const MeshHealth health = health_of(mesh);
  EXPECT_EQ(health.boundary_loops, 3u);
  EXPECT_EQ(health.boundary_edges, 36u + 3 + 4);
  EXPECT_EQ(health.pinched_vertices, 0u);
}

TEST(Health, holes_that_touch_in_a_vertex_pinch_it_and_stay_two_loops) {
  Mesh mesh = grid(6, 6);
  std::vector<std::uint8_t> keep(mesh.triangle_count(), 1);
  for (const std::size_t cell : {2u * 6 + 2, 3u * 6 + 3}) keep[2 * cell] = keep[2 * cell + 1] = 0;
  mesh = compact(mesh, keep);
  const MeshHealth health = health_of(mesh);
  EXPECT_EQ(health.pinched_vertices, 1u);
  EXPECT_EQ(health.boundary_edges, 24u + 8);
  // Along the surface, the outlines of both holes run into one another at the common vertex.
  EXPECT_EQ(health.boundary_loops, 2u);
}

TEST(Health, third_triangle_on_an_edge_is_nonmanifold) {
  Mesh mesh;
  mesh.positions_m = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}};
  mesh.triangles = {{0, 1, 2}, {1, 0, 3}, {0, 1, 4}};
  const MeshHealth health = health_of(mesh);
  EXPECT_EQ(health.nonmanifold_edges, 1u);
  EXPECT_EQ(health.misoriented_edges, 1u);
  EXPECT_EQ(health.boundary_edges, 6u);
  EXPECT_FALSE(health.is_sound());
}

TEST(Health, flipped_triangle_misorients_its_inner_edges) {
  Mesh mesh = tetrahedron();
  std::swap(mesh.triangles[2][0], mesh.triangles[2][1]);
  const MeshHealth health = health_of(mesh);
  EXPECT_EQ(health.misoriented_edges, 3u);
  EXPECT_EQ(health.nonmanifold_edges, 0u);
}

TEST(Health, solids_that_share_a_vertex_are_pinched_there) {
  Mesh mesh = tetrahedron();
  for (const Eigen::Vector3f& p : {Eigen::Vector3f(3, 1, 1), Eigen::Vector3f(1, 3, 1), Eigen::Vector3f(1, 1, 3)})
    mesh.positions_m.push_back(p);
  for (const Triangle& t : {Triangle{0, 4, 5}, Triangle{0, 5, 6}, Triangle{0, 6, 4}, Triangle{4, 6, 5}})
    mesh.triangles.push_back(t);
  const MeshHealth health = health_of(mesh);
  EXPECT_EQ(health.pinched_vertices, 1u);
  EXPECT_EQ(health.components, 1u);
  EXPECT_TRUE(health.is_sound());
}

TEST(Health, duplicates_count_in_any_winding) {
  Mesh mesh = grid(2, 2);
  mesh.triangles.push_back(mesh.triangles[0]);
  mesh.triangles.push_back({mesh.triangles[3][2], mesh.triangles[3][1], mesh.triangles[3][0]});
  mesh.triangles.push_back({mesh.triangles[0][1], mesh.triangles[0][2], mesh.triangles[0][0]});
  EXPECT_EQ(health_of(mesh).duplicate_triangles, 3u);
}

TEST(Health, degenerate_is_a_repeated_vertex_or_exactly_no_area) {
  Mesh mesh = tetrahedron();
  mesh.positions_m.insert(mesh.positions_m.end(),
                          {{0.1f, 0.1f, 0.1f}, {0.2f, 0.2f, 0.2f}, {0.3f, 0.3f, 0.3f}, {0.3f, 0.3f, 0.30000003f}});
  mesh.triangles.push_back({1, 1, 2});
  mesh.triangles.push_back({4, 5, 6});
  EXPECT_EQ(health_of(mesh).degenerate_triangles, 2u);
  mesh.triangles.push_back({4, 5, 7});  // one unit in the last place off the line: thin, but a triangle
  const MeshHealth health = health_of(mesh);
  EXPECT_EQ(health.degenerate_triangles, 2u);
  EXPECT_GT(health.min_angle_below_10_deg_share, 0);
}

TEST(Health, components_and_unused_vertices) {
  Mesh mesh = grid(10, 10);
  const auto first = std::uint32_t(mesh.vertex_count());
  for (int i = 0; i < 5; ++i) mesh.positions_m.emplace_back(20.f + float(i % 2), float(i), 3.f);
  mesh.triangles.push_back({first, first + 1, first + 2});
  const MeshHealth health = health_of(mesh);
  EXPECT_EQ(health.components, 2u);
  EXPECT_EQ(health.components_100_triangles, 1u);
  EXPECT_EQ(health.unused_vertices, 2u);
  EXPECT_NEAR(health.largest_component_share, 200.0 / 201, 1e-12);
}

TEST(Health, welding_gives_a_soup_its_topology) {
  const Mesh whole = grid(5, 6);
  Mesh soup;
  for (const Triangle& t : whole.triangles) {
    const auto n = std::uint32_t(soup.vertex_count());
    for (const std::uint32_t v : t) soup.positions_m.push_back(whole.positions_m[v]);
    soup.triangles.push_back({n, n + 1, n + 2});
  }
  soup.positions_m[0].x() = -0.0f;  // equals 0
  EXPECT_EQ(health_of(soup).components, 60u);
  EXPECT_EQ(to_json(health_of(soup, {.weld = true})), to_json(health_of(whole)));
}

TEST(Health, index_out_of_range_and_nan_are_refused) {
  Mesh mesh = tetrahedron();
  mesh.triangles[0][1] = 4;
  EXPECT_THROW(health_of(mesh), InvalidInput);
  mesh = tetrahedron();
  mesh.positions_m[2].y() = std::nanf("");
  EXPECT_THROW(health_of(mesh), InvalidInput);
}

TEST(Health, self_intersections_can_be_left_out) {
  const MeshHealth health = health_of(tetrahedron(), {.self_intersections = false});
  EXPECT_FALSE(health.self_intersections_checked);
  EXPECT_NE(to_json(health).find("\"self_intersecting_triangles\":null"), std::string::npos);
}

// ---- against brute force

MeshHealth topology_by_maps(const Mesh& mesh) {
  MeshHealth health;
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges, directed;
  std::set<Triangle> distinct;
  std::map<std::uint32_t, std::vector<Triangle>> around;
  std::uint64_t proper = 0;
  for (const Triangle& t : mesh.triangles) {
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) continue;
    ++proper;
    Triangle sorted = t;
    std::sort(sorted.begin(), sorted.end());
    distinct.insert(sorted);
    for (std::size_t k = 0; k < 3; ++k) {
      ++directed[{t[k], t[(k + 1) % 3]}];
      ++edges[std::minmax(t[k], t[(k + 1) % 3])];
      around[t[k]].push_back(t);
    }
  }
  health.duplicate_triangles = proper - distinct.size();
  health.edges = edges.size();
  for (const auto& [edge, n] : edges) health.boundary_edges += n == 1, health.nonmanifold_edges += n > 2;
  for (const auto& [edge, n] : directed) health.misoriented_edges += n > 1;
  health.unused_vertices = mesh.vertex_count() - around.size();
  for (const auto& [v, triangles] : around) {
    // Flood from the first triangle over common edges at v.
    std::set<std::size_t> reached = {0};
    for (bool grows = true; grows;) {
      grows = false;
      for (std::size_t i = 0; i < triangles.size(); ++i) {
        if (reached.count(i)) continue;
        for (const std::size_t j : reached) {
          int common = 0;
          for (const auto a : triangles[i])
            for (const auto b : triangles[j]) common += a == b;
          if (common >= 2) {
            reached.insert(i);
            grows = true;
            break;
          }
        }
      }
    }
    health.pinched_vertices += reached.size() < triangles.size();
  }
  return health;
}

class HealthOfSoup : public testing::TestWithParam<std::uint32_t> {};

TEST_P(HealthOfSoup, counts_agree_with_brute_force) {
  const Mesh mesh = test::lattice_soup(GetParam(), 20 + 40 * GetParam(), 5, 10 + 6 * GetParam());
  const MeshHealth found = health_of(mesh, {.self_intersections = false}), expected = topology_by_maps(mesh);
  EXPECT_EQ(found.edges, expected.edges);
  EXPECT_EQ(found.boundary_edges, expected.boundary_edges);
  EXPECT_EQ(found.nonmanifold_edges, expected.nonmanifold_edges);
  EXPECT_EQ(found.misoriented_edges, expected.misoriented_edges);
  EXPECT_EQ(found.duplicate_triangles, expected.duplicate_triangles);
  EXPECT_EQ(found.pinched_vertices, expected.pinched_vertices);
  EXPECT_EQ(found.unused_vertices, expected.unused_vertices);
}

INSTANTIATE_TEST_SUITE_P(Seeds, HealthOfSoup, testing::Range(1u, 13u));

TEST(Health, same_figures_for_any_number_of_threads) {
  Mesh mesh = test::lattice_soup(5, 2000, 60, 1500);
  for (Eigen::Vector3f& p : mesh.positions_m) p *= 0.137f;
  std::string expected;
  for (const int threads : {1, 2, 3, 8}) {
    Context context(threads);
    const std::string json = to_json(check_health(mesh, {.weld = true}, context));
    if (expected.empty()) expected = json;
    EXPECT_EQ(json, expected) << threads;
  }
}

}  // namespace
}  // namespace lapseam
