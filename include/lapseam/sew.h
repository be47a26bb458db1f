#pragma once

// One mesh from all views. The model grows view by view: in the image plane of each view, what it adds and the border
// of what is already there are triangulated together, so that nothing overlaps and no gap stays. After Turk & Levoy
// 1994, §4 (clipping one border against the other), and Sun, Dumont, Abidi 2000, §2.3.

#include <array>
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

/// One view's turn at the growing mesh.
struct ZipperTurn {
  std::uint32_t view = 0;      ///< index of its patch
  Image<std::uint8_t> wanted;  ///< one per pixel; 0: samples that are not to be added
};

/// Every view once, in groups of at most `largest` in which no two views overlap; the first of a group is the first
/// that is left. `overlapping`: pairs of views that see something in common, in any order. Deterministic.
std::vector<std::vector<std::uint32_t>> group_turns(std::uint32_t views,
                                                    std::span<const std::array<std::uint32_t, 2>> overlapping,
                                                    std::size_t largest);

/// Grows a mesh from patches. No two triangles that one view can see overlap in its image; every edge has at most two
/// triangles, in opposite directions; new triangles face the view that added them.
class Zipper {
 public:
  /// The patches must outlive the zipper.
  Zipper(std::span<const Patch> patches, const OverlapOptions& options);
  ~Zipper();

  /// For each turn, adds the samples that are wanted wherever the model does not cover them, and closes what gaps
  /// between them and the model, and within the model, the view measured as surface. A view may come again.
  ///
  /// All turns are worked out at the same time, in the model as it is: make them of views that see nothing in common
  /// (see group_turns). Those that get in each other's way are made one after another. Deterministic.
  void add(std::span<const ZipperTurn> turns, Context& context);
  void add(const ZipperTurn& turn, Context& context) { add({&turn, 1}, context); }

  /// As add, but only around the model's border: what is left open is closed by whichever view saw it. Outlines of
  /// fewer than `shortest_outline` edges are slits, and left to close_cracks(), which sees them in space.
  void revisit(std::span<const ZipperTurn> turns, Context& context, std::uint32_t shortest_outline = 0);
  void revisit(const ZipperTurn& turn, Context& context) { revisit({&turn, 1}, context); }

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

/// Removes triangles until every half-edge exists once: of those that share one, all but the first. Returns the
/// triangles removed.
std::uint64_t remove_nonmanifold(Mesh& mesh);

/// Removes connected components (by shared edges) of fewer than `smallest` triangles. Returns the triangles removed.
std::uint64_t remove_small_components(Mesh& mesh, std::uint64_t smallest);

}  // namespace lapseam
