#pragma once

// Gaps between what a view adds and the model's border, and within the model: a constrained Delaunay triangulation in
// the image plane, of which those faces stay that the view measured as surface (Turk & Levoy 1994, §4; Sun, Dumont,
// Abidi 2000, §2.3).

#include <cstdint>
#include <functional>
#include <vector>

#include "sew/covering.h"
#include "sew/model_in_view.h"
#include "sew/planar_triangulation.h"

namespace lapseam {

class GapFaces {
 public:
  GapFaces(ModelInView& in, const Covering& covering) : in_(in), covering_(covering) {}

  /// A corner of gaps, in the view's image.
  struct Point {
    std::uint32_t vertex;  ///< of the model; kInvalidIndex: the sample is not in it yet
    std::uint32_t sample;  ///< v·width + u; kInvalidIndex: not of this view
    float range, error_m;
  };
  /// Edge of a border; the gap lies to its left.
  struct Fence {
    std::uint32_t from, to;
  };

  std::uint32_t add_point(const Point& point, float u, float v);
  void add_fence(std::uint32_t from, std::uint32_t to) { fences_.push_back({from, to}); }
  const std::vector<Point>& points() const { return points_; }

  /// The faces that fill gaps, as places in points(). `on_lost` is told fences, by their place, that cannot be edges;
  /// it may mark cells as blocked.
  std::vector<std::array<std::uint32_t, 3>> fill(const std::function<void(std::size_t fence)>& on_lost,
                                                 Context& context);
  /// Ends of a fence in the image.
  std::array<CanvasPoint, 2> ends_of(std::size_t fence) const;

 private:
  using Face = PlanarTriangulation::Face;
  bool is_valid(const Face& face) const;
  bool has_only_idle_samples(const Face& face) const;
  bool is_measured(const Face& face) const;
  bool is_on_fence(const Face& face, const std::array<std::int64_t, 3>& side) const;
  bool overlaps_model(const Face& face) const;
  bool is_as_long_as_border(const Face& face, float extent) const;
  bool has_edge_of_model(const Face& face) const;

  ModelInView& in_;
  const Covering& covering_;
  std::vector<Point> points_;
  std::vector<GridPoint> grid_;  // where they are
  std::vector<Fence> fences_;
  std::vector<float> longest_fence_;  // at each point, pixels
};

}  // namespace lapseam
