#pragma once

// What every mesh that lapseam makes must be, checked in one call.

#include <gtest/gtest.h>

#include "lapseam/context.h"
#include "lapseam/health.h"
#include "lapseam/mesh.h"

namespace lapseam {

/// Provenance: a vertex knows view and pixel or neither; a measured triangle knows its view, and its corners are
/// samples of that view.
inline void expect_consistent_provenance(const Mesh& mesh) {
  EXPECT_EQ(mesh.vertex_view.empty(), mesh.vertex_pixel.empty());
  if (mesh.vertex_view.empty() || mesh.triangle_view.empty() || mesh.triangle_tag.empty()) return;
  std::size_t unknown = 0, foreign = 0;
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    if (mesh.triangle_tag[i] != TriangleTag::kMeasured) continue;
    unknown += mesh.triangle_view[i] == kInvalidIndex;
    for (const std::uint32_t v : mesh.triangles[i]) foreign += mesh.vertex_view[v] != mesh.triangle_view[i];
  }
  EXPECT_EQ(unknown, 0u) << "measured triangles without a view";
  EXPECT_EQ(foreign, 0u) << "corners of measured triangles that are samples of another view";
}

/// Edge-manifold, oriented, no duplicate or degenerate triangle, indices in range, arrays of the right length.
inline void expect_valid_mesh(const Mesh& mesh) {
  ASSERT_NO_THROW(check_mesh(mesh));
  Context context;
  const MeshHealth health = check_health(mesh, {.weld = false, .self_intersections = false}, context);
  EXPECT_EQ(health.nonmanifold_edges, 0u);
  EXPECT_EQ(health.misoriented_edges, 0u);
  EXPECT_EQ(health.duplicate_triangles, 0u);
  EXPECT_EQ(health.degenerate_triangles, 0u);
  expect_consistent_provenance(mesh);
}

}  // namespace lapseam
