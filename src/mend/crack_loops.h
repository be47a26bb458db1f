#pragma once

// Outlines of what is open although views measured a surface there, and triangles that close it.

#include <map>
#include <set>
#include <span>
#include <tuple>
#include <vector>

#include "lapseam/close_cracks.h"
#include "mend/layers.h"
#include "mend/witnesses.h"
#include "sew_meshes/loops.h"

namespace lapseam {

/// Longer outlines are gaps between two pieces, or have holes in them: no disk closes them.
inline constexpr std::size_t kLongestLoop = kLargestWhole;

/// Of every vertex: how far it may be off along its normal, and the noise of its sample along its ray.
struct VertexNoise {
  std::span<const float> error_m, sigma_m;
};

/// Changes the mesh by removing and adding triangles, never vertices. What it is made of must outlive it. Same result
/// for any number of threads.
class CrackLoops {
 public:
  CrackLoops(LiveMesh& mesh, TriangleCheck& check, const Layers& layers, const Witnesses& witnesses, VertexNoise noise,
             CloseCracksReport& report, Context& context);

  /// Closes loops where views measured a surface in all of the hole.
  void close(std::size_t longest, const TriangleRule& rule);
  /// Fills what can be filled of loops along most of which a view measured the surface going on.
  void fill(const TriangleRule& rule);
  /// Fills corners of what is still open, where a view measured a surface.
  void fill_corners(const TriangleRule& rule);

 private:
  /// A loop, the views that may see it, and along how much of it one of them measured the surface going on.
  struct Judged {
    Loop loop;
    std::vector<std::uint32_t> views;
    float crack_share = 0;
    /// Whether it is a crack by what is along it, and not only by what is in it.
    bool is_crack() const { return crack_share >= kCrackShare; }
  };
  static constexpr float kCrackShare = 0.5f;

  /// Those that may see some of the vertices.
  std::vector<std::uint32_t> views_of(std::span<const std::uint32_t> vertices) const;
  Judged judge(const Loop& loop) const;
  /// All loops up to a length, the shortest first: what they take is little.
  std::vector<Judged> judged_loops(std::size_t longest) const;
  bool goes_on_beyond(std::uint32_t a, std::uint32_t b, std::span<const std::uint32_t> views) const;
  bool is_confirmed(const Hearing& hearing, float sigma_m) const;
  /// Where in a new triangle a view must have measured a surface.
  enum class Confirmed { kInTheMiddle, kEverywhere };
  /// size_m: of what is asked about, see Witnesses::ask.
  bool is_contradicted(const Triangle& t, std::span<const std::uint32_t> views, Confirmed where, float size_m) const;
  bool is_open(const Loop& loop) const;

  enum class Extent { kWhole, kParts };  ///< of a loop: all of it or nothing, or what can be filled
  /// How a loop would be closed.
  struct Proposal {
    bool is_made = false;
    std::vector<std::uint32_t> removed;
    std::vector<Triangle> added;
  };
  /// Returns how many were changed.
  std::size_t close_each(std::span<const Judged> judged, const TriangleRule& rule, Extent extent);
  Proposal propose(const Judged& judged, const TriangleRule& rule, Extent extent) const;
  bool apply(const Proposal& proposal, const TriangleRule& rule);
  bool close_as_proposed(const Judged& judged, const Proposal& proposal, const TriangleRule& rule, Extent extent);
  bool is_hopeless(const Loop& loop, const TriangleRule& rule, Extent extent) const;
  bool close_one(const Judged& judged, const TriangleRule& rule, Extent extent);
  bool widen_and_close(const Judged& judged, const TriangleRule& rule);
  std::vector<Loop> outlines_of(std::span<const std::uint32_t> removed) const;
  bool close_all(std::span<const Loop> loops, const TriangleRule& rule);
  bool keeps_surface(std::span<const std::uint32_t> removed, std::span<const std::uint32_t> views) const;
  void remove_since(std::size_t first);

  LiveMesh& mesh_;
  TriangleCheck& check_;
  const Layers& layers_;
  const Witnesses& witnesses_;
  VertexNoise noise_;
  CloseCracksReport& report_;
  Context& context_;
  bool has_filled_parts_ = false;
  // Loops that could not be closed, and by which fold: membership only.
  std::set<std::tuple<Extent, double, Loop>> hopeless_;
};

}  // namespace lapseam
