#pragma once

// What of a view the model covers already (Sun, Dumont, Abidi 2000, §2.2: overlap, in the image of the new view).

#include <array>
#include <compare>
#include <cstdint>
#include <vector>

#include "lapseam/context.h"
#include "sew/model_in_view.h"

namespace lapseam {

class Covering {
 public:
  explicit Covering(ModelInView& in) : in_(in) {}

  /// Draws the model into the view where that is in focus: marks samples kCovered and kShadowed, and remembers the
  /// triangles of cells that are marked already.
  void mark(Context& context);

  /// A new triangle in the view's image: u to the right, v down or up as the image is mirrored or not.
  struct Face {
    std::array<Eigen::Vector2f, 3> corner;
    float low_r, high_r;
  };
  /// Whether a triangle of the model that is the same surface lies over or under a face.
  bool overlaps(const Face& face) const;

 private:
  // A model triangle in a cell that the model's border passes through.
  struct Beneath {
    std::uint32_t cell, triangle;
    auto operator<=>(const Beneath&) const = default;
  };

  bool may_matter(const Chunk& chunk) const;
  bool is_apart(const std::array<CanvasPoint, 3>& p) const;
  void cover(std::size_t t, const std::array<CanvasPoint, 3>& p, std::vector<Beneath>& beneath);
  bool meets_curved(const Triangle& t, const std::array<Eigen::Vector2f, 3>& face, const Eigen::Vector2f& middle) const;

  ModelInView& in_;
  std::vector<Beneath> beneath_;  // sorted
};

}  // namespace lapseam
