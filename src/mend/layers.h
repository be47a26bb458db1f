#pragma once

// Surface that lies over surface.

#include <cstdint>
#include <span>

#include "lapseam/overlap.h"
#include "sew_meshes/triangle_check.h"

namespace lapseam {

/// Of every vertex: how far it may be off along its normal, and the distance between the samples of its view there.
struct VertexResolution {
  std::span<const float> error_m, spacing_m;
};

/// Answers are const and thread-safe while the mesh stays as it is. What it is made of must outlive it.
class Layers {
 public:
  /// Where on a triangle it is asked what lies there.
  enum class Places {
    kMiddle,
    kSpread,  ///< the middle, and three places towards the corners
  };

  Layers(const LiveMesh& mesh, const TriangleCheck& check, VertexResolution resolution, const OverlapOptions& options)
      : mesh_(mesh), check_(check), resolution_(resolution), options_(options) {}
  /// The same of a draft of that mesh.
  Layers(const LiveMesh& draft, const TriangleCheck& check, const Layers& original)
      : Layers(draft, check, original.resolution_, original.options_) {}

  /// Of the least certain corner.
  float error_of(const Triangle& t) const;
  /// Whether, at one of the places, a living triangle that faces alike and shares no vertex with this one is no farther
  /// off than the noise of this one allows, or than its view could have told apart.
  bool is_covered(const Triangle& t, Places places) const;
  /// Whether any living triangle is where the middle of this one is.
  bool has_surface_at(const Triangle& t) const;

 private:
  double thickness_m(const Triangle& t) const;
  template <typename Accept>
  bool lies_over(const Triangle& t, Places places, const Accept& accept) const;

  const LiveMesh& mesh_;
  const TriangleCheck& check_;
  VertexResolution resolution_;
  const OverlapOptions& options_;
};

}  // namespace lapseam
