#pragma once

// From texture coordinates per triangle corner, as Mesh has them, to texture coordinates per vertex, as files want
// them.

#include <cstdint>
#include <vector>

#include "lapseam/mesh.h"

namespace lapseam {

/// The triangles of one texture page. A mesh vertex appears once for each different coordinate it has on the page.
struct WeldedPage {
  std::uint32_t page = kInvalidIndex;      ///< kInvalidIndex: the untextured triangles
  bool is_unseen = false;                  ///< of the untextured ones, those that no image shows
  std::vector<std::uint32_t> vertices;     ///< mesh vertex of each welded vertex
  std::vector<Eigen::Vector2f> texcoords;  ///< of each welded vertex; empty when untextured
  std::vector<std::uint32_t> indices;      ///< three welded vertices a triangle, in the mesh's order of triangles
};

/// Ordered by page, untextured last, of these those that no image shows last (all, where the mesh does not say); pages
/// without triangles are left out. Welded vertices are in order of first use.
std::vector<WeldedPage> weld_corners(const Mesh& mesh);

}  // namespace lapseam
