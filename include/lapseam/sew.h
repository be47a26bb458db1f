#pragma once

// One mesh from all views. The model grows view by view: in the image plane of each view, what it adds and the border
// of what is already there are triangulated together, so that nothing overlaps and no gap stays. After Turk & Levoy
// 1994, §4 (clipping one border against the other), and Sun, Dumont, Abidi 2000, §2.3.

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "lapseam/overlap.h"
#include "lapseam/patch.h"

namespace lapseam {

class Context;

struct ZipperReport {
  std::uint64_t measured_triangles = 0;  ///< taken over from the views as they are
  std::uint64_t seam_triangles = 0;      ///< made between views
  std::uint64_t open_edges = 0;          ///< of the model, at the end
};

/// Grows a mesh from patches. No two triangles that one view can see overlap in its image; every edge has at most two
/// triangles, in opposite directions; new triangles face the view that added them.
class Zipper {
 public:
  /// The patches must outlive the zipper.
  Zipper(std::span<const Patch> patches, const OverlapOptions& options);
  ~Zipper();

  /// Adds the samples of patch `index` for which wanted is not 0 (one per pixel) wherever the model does not cover
  /// them, and closes what gaps between them and the model, and within the model, the view measured as surface. May be
  /// called again for the same view.
  void add(std::uint32_t index, const Image<std::uint8_t>& wanted, Context& context);

  /// As add, but only around the model's border: what is left open is closed by whichever view saw it.
  void revisit(std::uint32_t index, const Image<std::uint8_t>& wanted, Context& context);

  const Mesh& mesh() const;
  /// Goes on with another mesh: one of the same provenance, for fewer triangles.
  void replace_mesh(Mesh mesh, Context& context);

  ZipperReport report() const;
  /// The mesh with provenance; the zipper is empty afterwards, until replace_mesh.
  Mesh take();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Gives each fan of a vertex where several fans touch its own copy. Returns the number of copies made.
std::uint64_t split_pinched_vertices(Mesh& mesh);

/// Removes connected components (by shared edges) of fewer than `smallest` triangles. Returns the triangles removed.
std::uint64_t remove_small_components(Mesh& mesh, std::uint64_t smallest);

}  // namespace lapseam
