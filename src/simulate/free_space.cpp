#include "simulate/free_space.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>

#include "core/parallel.h"

namespace lapseam::simulation {

using Eigen::Vector3f;

namespace {
constexpr float kSmallestCell_m = 0.1f;
constexpr float kMostCells = 400'000;
}  // namespace

FreeSpace::FreeSpace(const RayScene& rays, const Eigen::AlignedBox3f& box, float clearance_m, Context& context)
    : low_(box.min()), cell_m_(kSmallestCell_m), nx_(0), ny_(0), nz_(0) {
  const Vector3f size = box.sizes();
  if (box.isEmpty()) return;
  cell_m_ =
      std::max(kSmallestCell_m, std::cbrt(size.x() * size.y() * std::max(size.z(), kSmallestCell_m) / kMostCells));
  nx_ = int(size.x() / cell_m_) + 1, ny_ = int(size.y() / cell_m_) + 1, nz_ = int(size.z() / cell_m_) + 1;
  is_free_.assign(std::size_t(nx_) * std::size_t(ny_) * std::size_t(nz_), 0);
  parallel_for(context, is_free_.size(), 256, [&](std::size_t i) {
    is_free_[i] = rays.closest(center(std::uint32_t(i)), clearance_m).triangle == kInvalidIndex ? 1 : 0;
  });
  keep_largest_component();
}

Vector3f FreeSpace::center(std::uint32_t cell) const {
  const int i = int(cell), x = i % nx_, y = i / nx_ % ny_, z = i / nx_ / ny_;
  return low_ + cell_m_ * Vector3f(float(x), float(y), float(z));
}

bool FreeSpace::is_free(const Vector3f& point) const {
  const Vector3f q = (point - low_) / cell_m_;
  const int x = int(std::lround(q.x())), y = int(std::lround(q.y())), z = int(std::lround(q.z()));
  if (x < 0 || y < 0 || z < 0 || x >= nx_ || y >= ny_ || z >= nz_) return false;
  return is_free_[(std::size_t(z) * std::size_t(ny_) + std::size_t(y)) * std::size_t(nx_) + std::size_t(x)] != 0;
}

template <typename Visit>
void FreeSpace::for_neighbors(std::uint32_t cell, const Visit& visit) const {
  const int i = int(cell), x = i % nx_, y = i / nx_ % ny_, z = i / nx_ / ny_;
  for (int dz = -1; dz <= 1; ++dz)
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx) {
        const int u = x + dx, v = y + dy, w = z + dz;
        if (u < 0 || v < 0 || w < 0 || u >= nx_ || v >= ny_ || w >= nz_) continue;
        const std::uint32_t other = std::uint32_t((w * ny_ + v) * nx_ + u);
        if (other != cell && is_free_[other]) visit(other, std::sqrt(float(dx * dx + dy * dy + dz * dz)));
      }
}

void FreeSpace::keep_largest_component() {
  std::vector<std::uint8_t> is_visited(is_free_.size(), 0);
  for (std::size_t seed = 0; seed < is_free_.size(); ++seed) {
    if (!is_free_[seed] || is_visited[seed]) continue;
    std::vector<std::uint32_t> component{std::uint32_t(seed)};
    is_visited[seed] = 1;
    for (std::size_t k = 0; k < component.size(); ++k)
      for_neighbors(component[k], [&](std::uint32_t other, float) {
        if (is_visited[other]) return;
        is_visited[other] = 1;
        component.push_back(other);
      });
    if (component.size() > cells_.size()) cells_ = std::move(component);
  }
  std::sort(cells_.begin(), cells_.end());
  std::fill(is_free_.begin(), is_free_.end(), std::uint8_t{0});
  for (const std::uint32_t cell : cells_) is_free_[cell] = 1;
}

std::vector<Vector3f> FreeSpace::find_path(std::uint32_t from, std::uint32_t to) const {
  // Dijkstra; equal distances in the order of cells.
  std::vector<float> distance(is_free_.size(), std::numeric_limits<float>::infinity());
  std::vector<std::uint32_t> previous(is_free_.size(), kInvalidIndex);
  using Entry = std::pair<float, std::uint32_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
  distance[from] = 0;
  queue.emplace(0.0f, from);
  while (!queue.empty()) {
    const auto [d, cell] = queue.top();
    queue.pop();
    if (cell == to) break;
    if (d > distance[cell]) continue;
    for_neighbors(cell, [&, here = cell, so_far = d](std::uint32_t other, float step) {
      if (so_far + step >= distance[other]) return;
      distance[other] = so_far + step;
      previous[other] = here;
      queue.emplace(distance[other], other);
    });
  }
  std::vector<Vector3f> path;
  for (std::uint32_t cell = to; cell != kInvalidIndex; cell = previous[cell]) path.push_back(center(cell));
  std::reverse(path.begin(), path.end());
  return path;
}

}  // namespace lapseam::simulation
