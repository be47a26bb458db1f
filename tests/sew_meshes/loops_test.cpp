#include "sew_meshes/loops.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "lapseam/context.h"
#include "lapseam/health.h"
#include "shapes.h"

namespace lapseam {
namespace {

constexpr TriangleRule kRule = {.smallest_sine = 1e-3, .fold_cosine = 0.5};

/// A sheet with a slot of one square's height in row 3, two columns from either end.
Mesh slotted_sheet(std::size_t columns = 20) {
  Mesh mesh = test::grid(int(columns), 7, 0.1f, Eigen::Vector3f::Zero());
  std::vector<std::uint8_t> keep(mesh.triangle_count(), 1);
  for (std::size_t t = 0; t < keep.size(); ++t) {
    const std::size_t square = t / 2, column = square % columns, row = square / columns;
    keep[t] = !(row == 3 && column >= 2 && column + 2 < columns);
  }
  mesh = compact(mesh, keep);
  mesh.triangle_tag.assign(mesh.triangle_count(), TriangleTag::kMeasured);
  return mesh;
}

Loop slot_of(const LiveMesh& live, Context& context) {
  Loop slot;
  for (const Loop& loop : trace_loops(live, open_edges(live, context)))
    if (slot.empty() || loop.size() < slot.size()) slot = loop;
  return slot;
}

double open_length(const LiveMesh& live, Context& context) {
  double sum = 0;
  for (const auto& [a, b] : open_edges(live, context)) sum += double((live.position(b) - live.position(a)).norm());
  return sum;
}

/// A hole in the slot around its middle: no triangle may reach into it.
bool keeps_out(const Mesh& mesh, const Triangle& t) {
  float low = 3e38f, high = -3e38f;
  for (const std::uint32_t v : t)
    low = std::min(low, mesh.positions_m[v].x()), high = std::max(high, mesh.positions_m[v].x());
  return high < 0.95f || low > 1.05f;
}

TEST(FillLoop, AllOfALoopWhereEverythingIsAllowed) {
  Context context(1);
  Mesh mesh = slotted_sheet();
  LiveMesh live(mesh);
  TriangleCheck check(live, {}, context);
  const Loop slot = slot_of(live, context);
  ASSERT_EQ(slot.size(), 34u);
  EXPECT_EQ(fill_loop(live, check, slot, LoopGoal::kArea, kRule, TriangleTag::kSeam), slot.size() - 2);
  mesh = compact(mesh, live.alive());
  EXPECT_EQ(check_health(mesh, {}, context).boundary_loops, 1u);
}

TEST(FillLoop, LeavesTheLeastLengthOpen) {
  Context context(1);
  Mesh mesh = slotted_sheet();
  LiveMesh live(mesh);
  TriangleCheck check(live, {}, context);
  check.set_condition([&](const Triangle& t) { return keeps_out(mesh, t); });
  const double rim = open_length(live, context) - 34 * 0.1;
  ASSERT_FALSE(close_loop(live, check, slot_of(live, context), LoopGoal::kArea, kRule, TriangleTag::kSeam));
  EXPECT_EQ(fill_loop(live, check, slot_of(live, context), LoopGoal::kArea, kRule, TriangleTag::kSeam), 28u);
  // Of the slot, the two squares at its middle stay open: nothing smaller contains the hole.
  EXPECT_NEAR(open_length(live, context) - rim, 6 * 0.1, 1e-4);
  mesh = compact(mesh, live.alive());
  const MeshHealth health = check_health(mesh, {.self_intersections = true}, context);
  EXPECT_EQ(health.boundary_loops, 2u);
  EXPECT_EQ(health.nonmanifold_edges, 0u);
  EXPECT_EQ(health.self_intersecting_triangles, 0u);
}

TEST(FillLoop, FindsTheFewTrianglesThatAreAllowed) {
  Context context(1);
  Mesh mesh = slotted_sheet(60);
  LiveMesh live(mesh);
  TriangleCheck check(live, {}, context);
  // Three squares at the end of the slot, of 56: hundreds of better triangulations have others.
  check.set_condition([&](const Triangle& t) {
    float low = 3e38f, high = 0;
    for (const std::uint32_t v : t)
      low = std::min(low, mesh.positions_m[v].x()), high = std::max(high, mesh.positions_m[v].x());
    return high < 0.51f && high - low < 0.11f;
  });
  const double before = open_length(live, context);
  EXPECT_EQ(fill_loop(live, check, slot_of(live, context), LoopGoal::kArea, kRule, TriangleTag::kSeam), 6u);
  EXPECT_NEAR(open_length(live, context), before - 6 * 0.1, 1e-4);
}

TEST(FillLoop, ChangesNothingWhereNothingIsAllowed) {
  Context context(1);
  Mesh mesh = slotted_sheet();
  LiveMesh live(mesh);
  TriangleCheck check(live, {}, context);
  check.set_condition([](const Triangle&) { return false; });
  const std::size_t before = live.triangle_count();
  EXPECT_EQ(fill_loop(live, check, slot_of(live, context), LoopGoal::kArea, kRule, TriangleTag::kSeam), 0u);
  EXPECT_EQ(live.triangle_count(), before);
}

}  // namespace
}  // namespace lapseam
