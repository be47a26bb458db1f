#include "health/outline.h"

#include <gtest/gtest.h>

#include "health/meshes.h"
#include "lapseam/context.h"
#include "lapseam/health.h"

namespace lapseam {
namespace {

struct Found {
  Outline outline;
  std::vector<OutlineFrame> frames;
};

Found find(const Mesh& mesh) {
  Context context;
  const Incidence incidence = build_incidence(mesh.vertex_count(), mesh.triangles);
  Found found{find_outline(mesh.vertex_count(), mesh.triangles, incidence, context), {}};
  found.frames = outline_frames(mesh.positions_m, mesh.triangles, incidence, found.outline, context);
  return found;
}

TEST(Outline, frames_of_a_sheet_look_outwards) {
  const Found found = find(test::grid(4, 3));
  ASSERT_EQ(found.outline.edges.size(), 14u);
  EXPECT_EQ(found.outline.loops, 1u);
  for (std::size_t i = 0; i < found.frames.size(); ++i) {
    const OutlineFrame& frame = found.frames[i];
    const OutlineEdge& edge = found.outline.edges[i];
    EXPECT_GT(frame.outward.dot(frame.middle - frame.inside), 0);
    EXPECT_NEAR(frame.normal.z(), 1, 1e-6);
    EXPECT_NEAR(frame.outward.norm(), 1, 1e-6);
    EXPECT_NEAR(frame.length_m, 1, 1e-6);
    EXPECT_NEAR(frame.side_m, 1, 1e-6);
    ASSERT_NE(edge.after, kInvalidIndex);
    EXPECT_EQ(found.outline.edges[edge.after].a, edge.b);
    EXPECT_EQ(found.outline.edges[edge.after].before, i);
  }
}

TEST(Outline, staircase_looks_across_its_stairs) {
  // The cells under the diagonal: their steps look right and up by turns, the outline as a whole to the upper right.
  Mesh mesh = test::grid(12, 12);
  std::vector<std::uint8_t> keep(mesh.triangle_count());
  for (std::uint32_t i = 0; i < mesh.triangle_count(); ++i) keep[i] = i / 2 % 12 + i / 2 / 12 < 12;
  const Found found = find(compact(mesh, keep));
  int steps = 0;
  for (const OutlineFrame& frame : found.frames) {
    const float place = frame.middle.x() + frame.middle.y();
    if (place < 12 || frame.middle.x() < 3 || frame.middle.y() < 3) continue;
    ++steps;
    EXPECT_GT(frame.outward.x(), 0.4f);
    EXPECT_GT(frame.outward.y(), 0.4f);
  }
  EXPECT_GE(steps, 12);
}

class OutlineOfSoup : public testing::TestWithParam<std::uint32_t> {};

TEST_P(OutlineOfSoup, has_the_loops_and_length_that_health_counts) {
  Mesh mesh = test::lattice_soup(GetParam(), 60, 4, 40);
  Context context;
  const MeshHealth health = check_health(mesh, {.self_intersections = false}, context);
  const Found found = find(mesh);
  EXPECT_EQ(found.outline.edges.size(), health.boundary_edges);
  EXPECT_EQ(found.outline.loops, health.boundary_loops);
  double length = 0;
  for (const OutlineFrame& frame : found.frames) length += double(frame.length_m);
  EXPECT_NEAR(length, health.boundary_length_m, 1e-4);  // single precision per edge
}
INSTANTIATE_TEST_SUITE_P(Seeds, OutlineOfSoup, testing::Range(0u, 12u));

}  // namespace
}  // namespace lapseam
