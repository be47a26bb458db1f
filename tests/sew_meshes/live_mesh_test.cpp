#include "sew_meshes/live_mesh.h"

#include <gtest/gtest.h>

#include <random>

#include "sew_meshes/shapes.h"

namespace lapseam {
namespace {

Mesh tagged_grid() {
  Mesh mesh = test::grid(8, 8, 1, Eigen::Vector3f::Zero());
  mesh.triangle_tag.assign(mesh.triangle_count(), TriangleTag::kMeasured);
  return mesh;
}

// All that can be asked about half-edges.
void expect_same(const LiveMesh& a, const LiveMesh& b) {
  ASSERT_EQ(a.triangle_count(), b.triangle_count());
  for (std::uint32_t t = 0; t < a.triangle_count(); ++t) {
    EXPECT_EQ(a.is_alive(t), b.is_alive(t));
    EXPECT_EQ(a.triangle(t), b.triangle(t));
    EXPECT_EQ(a.tag(t), b.tag(t));
  }
  std::vector<std::uint32_t> of_a, of_b;
  for (std::uint32_t v = 0; v < a.vertex_count(); ++v) {
    for (std::uint32_t w = 0; w < a.vertex_count(); ++w) EXPECT_EQ(a.find(v, w), b.find(v, w));
    a.open_out(v, of_a), b.open_out(v, of_b);
    EXPECT_EQ(of_a, of_b);
    EXPECT_EQ(a.count_fans(v), b.count_fans(v));
  }
}

TEST(LiveMesh, DraftIsWhatTheMeshWouldBe) {
  Mesh mesh = tagged_grid(), other = tagged_grid();
  LiveMesh original(mesh), changed(other);
  for (const std::uint32_t t : {10u, 11u, 40u}) original.remove(t), changed.remove(t);
  LiveMesh draft = LiveMesh::draft_of(original);
  std::mt19937 random(1);
  std::vector<std::uint32_t> gone;
  for (int i = 0; i < 300; ++i) {
    const auto t = std::uint32_t(random() % changed.triangle_count());
    if (changed.is_alive(t)) {
      draft.remove(t), changed.remove(t);
      gone.push_back(t);
    } else if (!gone.empty() && random() % 2) {
      draft.restore(gone.back()), changed.restore(gone.back());
      gone.pop_back();
    } else if (!gone.empty()) {
      const Triangle corners = changed.triangle(gone.back());
      gone.pop_back();
      EXPECT_EQ(draft.add(corners, TriangleTag::kSeam), changed.add(corners, TriangleTag::kSeam));
    }
  }
  expect_same(draft, changed);
  std::vector<std::uint32_t> removed;
  for (std::uint32_t t = 0; t < original.triangle_count(); ++t)
    if (original.is_alive(t) && !changed.is_alive(t)) removed.push_back(t);
  EXPECT_EQ(draft.removed(), removed);
}

TEST(LiveMesh, DraftLeavesTheMeshAlone) {
  Mesh mesh = tagged_grid(), other = tagged_grid();
  LiveMesh original(mesh), untouched(other);
  LiveMesh draft = LiveMesh::draft_of(original);
  draft.remove(3);
  draft.add(draft.triangle(3), TriangleTag::kSeam);
  draft.remove(70);
  EXPECT_FALSE(draft.is_alive(3));
  expect_same(original, untouched);
  EXPECT_EQ(mesh.triangle_count(), other.triangle_count());
}

}  // namespace
}  // namespace lapseam
