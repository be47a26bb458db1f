#pragma once

// Where one may stand or walk: a grid of the cells that keep clear of every surface, its largest connected part only.

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "spatial/ray_scene.h"

namespace lapseam::simulation {

class FreeSpace {
 public:
  /// box: where cell centres may lie. clearance_m: to the nearest surface.
  FreeSpace(const RayScene& rays, const Eigen::AlignedBox3f& box, float clearance_m, Context& context);

  /// Indices of the free cells, ascending; empty when there is no room.
  const std::vector<std::uint32_t>& cells() const { return cells_; }
  Eigen::Vector3f center(std::uint32_t cell) const;
  bool is_free(const Eigen::Vector3f& point) const;
  /// Cell centres from one free cell to another, the shortest way over the grid.
  std::vector<Eigen::Vector3f> find_path(std::uint32_t from, std::uint32_t to) const;

 private:
  void keep_largest_component();
  template <typename Visit>
  void for_neighbors(std::uint32_t cell, const Visit& visit) const;

  Eigen::Vector3f low_;
  float cell_m_;
  int nx_, ny_, nz_;
  std::vector<std::uint8_t> is_free_;
  std::vector<std::uint32_t> cells_;
};

}  // namespace lapseam::simulation
