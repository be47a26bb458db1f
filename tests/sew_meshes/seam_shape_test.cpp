#include "sew_meshes/seam_shape.h"

#include <gtest/gtest.h>

#include <algorithm>

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

struct Improved {
  std::uint64_t collapses;
  double fold_before, fold_after;  // cosines of the sharpest
};

double sharpest_fold(const LiveMesh& mesh, const TriangleCheck& check) {
  double fold = 1;
  for (std::uint32_t t = 0; t < mesh.triangle_count(); ++t)
    if (mesh.is_alive(t)) fold = std::min(fold, check.fold_of(mesh.triangle(t)));
  return fold;
}

Improved improve(Mesh mesh, double most_bent_cosine) {
  Context context;
  LiveMesh live(mesh);
  TriangleCheck check(live, {}, context);
  Improved out{0, sharpest_fold(live, check), 1};
  out.collapses = SeamShape(live, check, most_bent_cosine, context).improve(0).collapses;
  out.fold_after = sharpest_fold(live, check);
  return out;
}

TEST(SeamShape, TakesNeedlesOutOfASharpFoldWhichStaysAsSharp) {
  const Improved improved = improve(ridge(1.0f), -0.9);  // its sides' normals are 127 degrees apart
  EXPECT_EQ(improved.collapses, 1u);
  EXPECT_LT(improved.fold_before, -0.5);
  EXPECT_GE(improved.fold_after, improved.fold_before - 1e-6);
  EXPECT_EQ(improve(ridge(1.0f), 0).collapses, 0u);
}

TEST(SeamShape, TakesNeedlesOutOfAFlatSurface) { EXPECT_EQ(improve(ridge(0.1f), 0).collapses, 1u); }

TEST(SeamShape, LeavesSurfacesThatAreFoldedBackOnThemselves) {
  EXPECT_EQ(improve(ridge(5.0f), -0.9).collapses, 0u);  // 169 degrees
}

}  // namespace
}  // namespace lapseam
