#include "sew_meshes/seam_shape.h"

#include <gtest/gtest.h>

#include "lapseam/context.h"

namespace lapseam {
namespace {

// A ridge along x with steep sides, `depth` below it; two of its four vertices are close together.
Mesh ridge(float depth) {
  Mesh mesh;
  for (const float x : {0.0f, 1.0f, 1.02f, 2.0f}) mesh.positions_m.emplace_back(x, 0.0f, 0.0f);
  for (const float y : {-0.5f, 0.5f})
    for (const float x : {0.0f, 1.01f, 2.0f}) mesh.positions_m.emplace_back(x, y, -depth);
  const auto side = [&](std::uint32_t foot, bool is_left) {
    for (Triangle t : {Triangle{0, foot, foot + 1}, Triangle{0, foot + 1, 1}, Triangle{1, foot + 1, 2},
                       Triangle{2, foot + 1, foot + 2}, Triangle{2, foot + 2, 3}}) {
      if (!is_left) std::swap(t[1], t[2]);
      mesh.triangles.push_back(t);
    }
  };
  side(4, true);
  side(7, false);
  mesh.triangle_tag.assign(mesh.triangle_count(), TriangleTag::kSeam);
  return mesh;
}

SeamShape::Changes improve(Mesh& mesh) {
  Context context;
  LiveMesh live(mesh);
  TriangleCheck check(live, {}, context);
  return SeamShape(live, check, context).improve(0);
}

TEST(SeamShape, TakesNeedlesOutOfASharpFoldWhichStaysAsSharp) {
  Mesh mesh = ridge(1.0f);  // its sides' normals are 127 degrees apart
  EXPECT_EQ(improve(mesh).collapses, 1u);
}

TEST(SeamShape, TakesNeedlesOutOfAFlatSurface) {
  Mesh mesh = ridge(0.1f);
  EXPECT_EQ(improve(mesh).collapses, 1u);
}

TEST(SeamShape, LeavesSurfacesThatAreFoldedBackOnThemselves) {
  Mesh mesh = ridge(5.0f);  // 169 degrees
  EXPECT_EQ(improve(mesh).collapses, 0u);
}

}  // namespace
}  // namespace lapseam
