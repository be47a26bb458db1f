#pragma once

// What one view adds to the model: samples that the model lacks, and what closes the gaps that the view measured as
// surface. The model itself is left as it is, so that views which have nothing to do with each other find theirs at the
// same time.

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "lapseam/context.h"
#include "sew/covering.h"
#include "sew/gap_faces.h"
#include "sew/grown_model.h"
#include "sew/model_in_view.h"

namespace lapseam {

/// Which places of its image a view works at.
enum class Where : std::uint8_t {
  kWanted,  ///< at wanted samples
  kBorder,  ///< at the model's border
};

class ViewTurn {
 public:
  /// Image columns are turned by `shift`, see ViewCanvas.
  ViewTurn(const GrownModel& model, std::uint32_t index, const Image<std::uint8_t>& wanted, int shift, Where where,
           Context& context);
  ModelAddition run();

 private:
  enum class WallKind : std::uint8_t { kElsewhere, kWall, kBlocked };
  struct Wall {
    std::uint32_t open;  // index into the model's open edges
    CanvasPoint a, b;
  };

  // ---- the model's border as the view sees it
  void find_walls();
  WallKind classify(const OpenEdge& edge, CanvasPoint& a, CanvasPoint& b) const;
  bool focus_on_border();
  bool ends_in_surface(const Wall& wall) const;
  void block_out_of_focus();
  void mark_walls();
  void mark_near(const CanvasPoint& a, const CanvasPoint& b);
  void block(const CanvasPoint& a, const CanvasPoint& b);
  template <typename Visit>
  void walk(const CanvasPoint& a, const CanvasPoint& b, const Visit& visit) const;

  // ---- samples that the view adds
  void emit_grid();
  void mark_emitted();
  void find_anchors();
  int anchor_of(int u, int v) const;
  std::uint32_t vertex_of(int u, int v);
  std::uint32_t vertex_of(std::uint32_t sample);
  float deviation_from_plane(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t m) const;
  bool is_emitted(int u, int v, int slot) const;
  bool is_neighbor_emitted(int u, int v, int slot, const Eigen::Vector2i& p, const Eigen::Vector2i& q) const;

  // ---- gaps
  void triangulate_gaps();
  template <typename T, typename Collect>
  std::vector<T> collect_in_focus(const Collect& collect);
  std::uint32_t gap_point_of_wall(std::uint32_t vertex, const CanvasPoint& at);
  std::uint32_t gap_point_of(int u, int v);
  void find_border_triangles();
  bool is_on_border(const Triangle& t, std::size_t k) const;
  bool touches_gap(int u, int v) const;
  void add_face(const std::array<std::uint32_t, 3>& corners);

  // ---- which edges are open now
  void report_border();

  const GrownModel& model_;
  std::uint32_t index_;
  Where where_;
  Context& context_;
  ModelInView in_;
  Covering covering_;
  GapFaces gaps_;
  Image<std::uint8_t> emitted_;
  Image<std::uint32_t> vertex_of_sample_, gap_point_of_sample_;
  std::vector<std::vector<int>> anchors_;  // of rows whose samples are crowded: the column that stands for each
  std::unordered_map<std::uint32_t, std::uint32_t> gap_point_of_vertex_;
  std::vector<Wall> walls_, blocked_;
  std::vector<OpenEdge> new_border_;
  std::vector<std::uint8_t> on_border_;  // of own vertices: whether they are on that
  ModelAddition addition_;
};

}  // namespace lapseam
