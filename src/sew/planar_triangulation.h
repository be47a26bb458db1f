#pragma once

// Constrained Delaunay triangulation of points in an image plane, exact on a fine grid of integer coordinates.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace lapseam {

/// Coordinates in grid units; at most kLargest in magnitude, so that all predicates are exact.
struct GridPoint {
  static constexpr std::int32_t kLargest = 1 << 24;
  std::int32_t x = 0, y = 0;
  bool operator==(const GridPoint&) const = default;
};

/// Inserts points in one go, then edges one by one. After S. W. Sloan, A fast algorithm for generating constrained
/// Delaunay triangulations, 1993 (insertion with walking search and edge swaps; edges by swapping diagonals).
/// Deterministic. About 1.5 µs a point.
class PlanarTriangulation {
 public:
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;

  struct Face {
    std::array<std::uint32_t, 3> corner;    ///< counter-clockwise for x to the right, y up; see is_real
    std::array<std::uint32_t, 3> neighbor;  ///< across the edge opposite corner k; kNone outside of everything
    std::uint8_t constrained = 0;           ///< bit k: the edge opposite corner k is a constraint
  };

  explicit PlanarTriangulation(std::vector<GridPoint> points);

  /// Points at the place of an earlier one are left out.
  bool is_in(std::uint32_t point) const { return face_of_[point] != kNone; }
  /// Makes a–b an edge for good. False, and nothing changes, when it would cross such an edge or pass through a point,
  /// or when a point is not in.
  bool constrain(std::uint32_t a, std::uint32_t b);

  const std::vector<Face>& faces() const { return faces_; }
  /// The face to the left of a → b, if that is an edge; else kNone.
  std::uint32_t face_left_of(std::uint32_t a, std::uint32_t b) const;
  /// Whether all corners are points that were given, and not of the frame around them.
  bool is_real(const Face& face) const;
  const GridPoint& point(std::uint32_t i) const { return points_[i]; }

 private:
  void insert(std::uint32_t p);
  std::uint32_t locate(const GridPoint& p, int& edge) const;
  void split_face(std::uint32_t f, std::uint32_t p);
  void split_edge(std::uint32_t f, int k, std::uint32_t p);
  void legalize(std::uint32_t p);
  void swap_diagonal(std::uint32_t f, int k);
  bool is_swappable(std::uint32_t f, int k) const;
  bool should_swap(std::uint32_t f, int k) const;
  void set_face(std::uint32_t f, std::array<std::uint32_t, 3> corner, std::array<std::uint32_t, 3> neighbor,
                std::array<bool, 3> constrained);
  void replace_neighbor(std::uint32_t f, std::uint32_t old_neighbor, std::uint32_t new_neighbor);
  int side(std::uint32_t a, std::uint32_t b, std::uint32_t c) const;
  bool find_crossed_edges(std::uint32_t a, std::uint32_t b, std::vector<std::uint64_t>& crossed) const;
  bool find_edge(std::uint32_t a, std::uint32_t b, std::uint32_t& face, int& k) const;

  std::vector<GridPoint> points_;  // as given, then three of the frame
  std::vector<Face> faces_;
  std::vector<std::uint32_t> face_of_;  // of each point, one face around it
  std::vector<std::uint32_t> stack_;    // faces whose edge opposite their corner 0 is to be checked
  std::uint32_t last_ = 0;              // where the next search starts
};

}  // namespace lapseam
