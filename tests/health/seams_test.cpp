#include <gtest/gtest.h>

#include "health/meshes.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/health.h"
#include "lapseam/seam_health.h"

namespace lapseam {
namespace {

using test::grid;

/// A sheet of 10 × 4 cells of 1 m: six columns of view 0, one of seam, three of view 1.
Mesh two_patches_and_a_strip() {
  Mesh mesh = grid(10, 4);
  for (std::uint32_t i = 0; i < mesh.triangle_count(); ++i) {
    const std::uint32_t column = i / 2 % 10;
    mesh.triangle_tag.push_back(column == 6 ? TriangleTag::kSeam : TriangleTag::kMeasured);
    mesh.triangle_view.push_back(column < 7 ? 0u : 1u);
  }
  return mesh;
}

SeamHealth seams_of(const Mesh& mesh, const SeamOptions& options = {}) {
  Context context;
  return check_seams(mesh, options, context);
}

TEST(Seams, strip_between_two_patches_is_as_long_as_it_is) {
  const SeamHealth seams = seams_of(two_patches_and_a_strip());
  EXPECT_EQ(seams.measured_triangles, 72u);
  EXPECT_EQ(seams.seam_triangles, 8u);
  EXPECT_EQ(seams.filled_triangles, 0u);
  EXPECT_DOUBLE_EQ(seams.seam_area_m2, 4);
  EXPECT_DOUBLE_EQ(seams.seam_area_share, 0.1);
  EXPECT_DOUBLE_EQ(seams.seam_length_m, 4);  // two sides of 4 m, half each
  EXPECT_DOUBLE_EQ(seams.seam_length_per_area_per_m, 0.1);
  EXPECT_EQ(seams.patches, 2u);
  EXPECT_EQ(seams.islands, 1u);
  EXPECT_EQ(seams.triangles_in_islands, 24u);
  EXPECT_NEAR(seams.seam_min_angle_percentiles_deg[0], 45, 1e-4);
  EXPECT_TRUE(seams.self_intersections_checked);
  EXPECT_EQ(seams.self_intersecting_seam_triangles, 0u);
}

TEST(Seams, patches_of_one_view_that_touch_in_a_vertex_are_two) {
  Mesh mesh = grid(2, 2);
  mesh.triangle_tag.assign(8, TriangleTag::kMeasured);
  mesh.triangle_view.assign(8, 3);
  std::vector<std::uint8_t> keep = {1, 1, 0, 0, 0, 0, 1, 1};  // cells on one diagonal
  EXPECT_EQ(seams_of(compact(mesh, keep)).patches, 2u);
  EXPECT_EQ(seams_of(mesh).patches, 1u);
}

TEST(Seams, patches_that_touch_along_an_edge_have_its_length_once) {
  Mesh mesh = grid(2, 3);
  for (std::uint32_t i = 0; i < mesh.triangle_count(); ++i) mesh.triangle_view.push_back(i / 2 % 2);
  mesh.triangle_tag.assign(mesh.triangle_count(), TriangleTag::kMeasured);
  EXPECT_DOUBLE_EQ(seams_of(mesh).seam_length_m, 3);
}

TEST(Seams, slivers_among_seam_triangles_show_and_others_do_not) {
  Mesh mesh = two_patches_and_a_strip();
  // The seam's own vertices are those of columns 6 and 7; squeezing the last column makes no seam sliver.
  Mesh squeezed_patch = mesh, squeezed_seam = mesh;
  for (Eigen::Vector3f& p : squeezed_patch.positions_m)
    if (p.x() > 9.5f) p.x() = 9.01f;
  for (Eigen::Vector3f& p : squeezed_seam.positions_m)
    if (p.x() > 6.5f) p.x() -= 0.99f;
  EXPECT_NEAR(seams_of(squeezed_patch).seam_min_angle_percentiles_deg[0], 45, 1e-4);
  EXPECT_NEAR(seams_of(squeezed_seam).seam_min_angle_percentiles_deg[2], 0.573, 1e-3);  // atan 0.01
}

TEST(Seams, only_seam_triangles_that_meet_others_count) {
  Mesh mesh = two_patches_and_a_strip();
  const auto add_spike = [&](float x) {  // stands on the sheet and pierces it
    const auto first = std::uint32_t(mesh.vertex_count());
    mesh.positions_m.insert(mesh.positions_m.end(), {{x, 1.4f, -1}, {x, 1.6f, -1}, {x, 1.5f, 1}});
    mesh.triangles.push_back({first, first + 1, first + 2});
    mesh.triangle_tag.push_back(TriangleTag::kMeasured);
    mesh.triangle_view.push_back(2);
  };
  add_spike(2.3f);
  EXPECT_EQ(seams_of(mesh).self_intersecting_seam_triangles, 0u);
  add_spike(6.3f);
  EXPECT_GE(seams_of(mesh).self_intersecting_seam_triangles, 1u);
  EXPECT_FALSE(seams_of(mesh, {.self_intersections = false}).self_intersections_checked);
}

TEST(Seams, mesh_without_tags_is_refused) { EXPECT_THROW(seams_of(grid(2, 2)), InvalidInput); }

TEST(Seams, health_tells_of_seams_when_there_are_tags) {
  Context context;
  const MeshHealth health = check_health(two_patches_and_a_strip(), {.weld = true}, context);
  ASSERT_TRUE(health.seams);
  EXPECT_EQ(health.seams->seam_triangles, 8u);
  EXPECT_NE(to_json(health).find("\"seam_triangles\":8"), std::string::npos);
  EXPECT_FALSE(check_health(grid(2, 2), {}, context).seams);
}

TEST(Seams, components_by_area_are_told_from_components_by_count) {
  // A large sheet of two triangles, and a small one of fifty.
  Mesh mesh = grid(1, 1, 100);
  const Mesh small = grid(5, 5, 0.1f);
  for (const Triangle& t : small.triangles) mesh.triangles.push_back({t[0] + 4, t[1] + 4, t[2] + 4});
  mesh.positions_m.insert(mesh.positions_m.end(), small.positions_m.begin(), small.positions_m.end());
  Context context;
  const MeshHealth health = check_health(mesh, {}, context);
  EXPECT_EQ(health.components, 2u);
  EXPECT_EQ(health.components_99_percent_area, 1u);
  EXPECT_EQ(health.smallest_component_triangles, 2u);
  EXPECT_LT(health.largest_component_share, 0.97);
}

}  // namespace
}  // namespace lapseam
