#include <gtest/gtest.h>

#include "lapseam/reduce.h"
#include "reduce/shapes.h"
#include "support/expect_valid_mesh.h"

namespace lapseam {
namespace {

// Two views side by side, a column of seam triangles between them; colour says how far right, pixel is the index.
Mesh two_views() {
  constexpr std::uint32_t kColumns = 200;
  Mesh mesh = test::noisy_plane(kColumns, 0.0003f, 1);
  for (std::uint32_t v = 0; v < mesh.vertex_count(); ++v) {
    const float x = mesh.positions_m[v].x();
    mesh.vertex_view.push_back(x <= 0.5f ? 4 : 7);
    mesh.vertex_pixel.push_back(v);
    mesh.colors.push_back({std::uint8_t(255 * x), 0, 0});
  }
  for (const Triangle& t : mesh.triangles) {
    const std::uint32_t a = mesh.vertex_view[t[0]], b = mesh.vertex_view[t[1]], c = mesh.vertex_view[t[2]];
    mesh.triangle_view.push_back(a);
    mesh.triangle_tag.push_back(a == b && b == c ? TriangleTag::kMeasured : TriangleTag::kSeam);
  }
  return mesh;
}

TEST(ReduceProvenance, VerticesKnowTheNearestSample) {
  const Mesh mesh = two_views();
  for (const Placement placement : {Placement::kOptimal, Placement::kEndpoint}) {
    Context context;
    const Mesh out = reduce(mesh, {}, {.max_triangles = 4000, .placement = placement}, context).mesh;
    expect_valid_mesh(out);
    ASSERT_EQ(out.vertex_pixel.size(), out.vertex_count());
    for (std::size_t v = 0; v < out.vertex_count(); ++v) {
      const std::uint32_t source = out.vertex_pixel[v];
      EXPECT_EQ(out.vertex_view[v], mesh.vertex_view[source]);
      EXPECT_EQ(out.colors[v].r, mesh.colors[source].r);
      const float distance = (out.positions_m[v] - mesh.positions_m[source]).norm();
      if (placement == Placement::kEndpoint)
        EXPECT_EQ(distance, 0.f) << "moved, though it must not";
      else
        EXPECT_LT(distance, 0.025f);  // a vertex stands for twenty samples: five cells across
    }
  }
}

TEST(ReduceProvenance, TrianglesKeepViewAndTag) {
  Context context;
  const Mesh out = reduce(two_views(), {}, {.max_triangles = 4000}, context).mesh;
  std::size_t measured = 0, wrong_side = 0;
  for (std::size_t i = 0; i < out.triangle_count(); ++i) {
    float left = 1, right = 0;
    for (const std::uint32_t v : out.triangles[i]) {
      left = std::min(left, out.positions_m[v].x());
      right = std::max(right, out.positions_m[v].x());
    }
    measured += out.triangle_tag[i] == TriangleTag::kMeasured;
    wrong_side += (right < 0.48f && out.triangle_view[i] != 4) || (left > 0.52f && out.triangle_view[i] != 7);
  }
  EXPECT_EQ(wrong_side, 0u);
  EXPECT_GT(double(measured), 0.9 * double(out.triangle_count()));
  EXPECT_LT(measured, out.triangle_count());
}

TEST(ReduceProvenance, TextureIsDroppedWithAWarning) {
  Context context;
  Mesh mesh = test::noisy_plane(10, 0.001f, 2);
  mesh.texcoords.resize(mesh.triangle_count());
  const Mesh out = reduce(mesh, {}, {.max_triangles = 50}, context).mesh;
  EXPECT_TRUE(out.texcoords.empty());
  EXPECT_EQ(context.warnings().size(), 1u);
}

}  // namespace
}  // namespace lapseam
