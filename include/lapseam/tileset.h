#pragma once

// Meshes too large for one file: a tree of small ones, coarse to fine (3D Tiles 1.1).

#include <cstdint>
#include <filesystem>

#include "lapseam/mesh.h"

namespace lapseam {

class Context;

struct TilesetOptions {
  /// No tile has more.
  std::uint64_t max_triangles = 65'000;
};

struct TilesetReport {
  std::uint64_t tiles = 0, leaves = 0;
  int levels = 0;
  double root_error_m = 0;
};

/// Writes FOLDER/tileset.json and FOLDER/tiles/*.glb. Each leaf has the mesh's own triangles of its part of space; a
/// tile above shows the same part with at most max_triangles (reduce, Garland & Heckbert 1997), and its geometric error
/// is the largest distance from the mesh's vertices there to its surface. Tiles replace the one above. Colours are
/// those of vertices, taken from the texture where the mesh has one; in the tiles above leaves, each is the mean of the
/// mesh's vertices that lie nearest to it. The mesh's origin, in double, is the root's transform, and tiles are
/// relative to it, so that map coordinates keep their precision. The world's z is taken to point up, as 3D Tiles has
/// it. The folder appears when it is complete, as with convert_scene. Deterministic. Throws InvalidInput for a mesh
/// without triangles.
TilesetReport write_tileset(const Mesh& mesh, const std::filesystem::path& folder, const TilesetOptions& options,
                            Context& context);

}  // namespace lapseam
