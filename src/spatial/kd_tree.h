#pragma once

// Nearest neighbours among points: a thin wrapper of nanoflann (the only place that includes it).
// Ties of distance are broken by index, so results do not depend on how the tree was built.

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace lapseam {

struct Neighbor {
  std::uint32_t index;
  float squared_distance;
};

/// Keeps a copy of the points. Queries are const and thread-safe.
class KdTree {
 public:
  explicit KdTree(std::span<const Eigen::Vector3f> points);
  ~KdTree();
  KdTree(KdTree&&) noexcept;
  KdTree& operator=(KdTree&&) noexcept;

  /// All points closer than radius, in no particular order (sorting costs more than finding).
  void find_in_radius(const Eigen::Vector3f& query, float radius, std::vector<Neighbor>& out) const;
  /// The nearest count points, nearest first.
  void find_nearest(const Eigen::Vector3f& query, std::size_t count, std::vector<Neighbor>& out) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lapseam
