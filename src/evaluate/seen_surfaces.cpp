#include "evaluate/seen_surfaces.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "lapseam/sensor.h"

namespace lapseam {
namespace {

// 75° to the ray, in sample spacings.
constexpr double kFarthest = 4;

// 21 bits for each coordinate, from the middle: 20 km each way for cells of 2 cm.
constexpr int kBits = 21;
constexpr std::int64_t kMiddle = std::int64_t(1) << (kBits - 1);

std::uint64_t key_of(const Eigen::Matrix<std::int64_t, 3, 1>& cell) {
  const auto part = [](std::int64_t x) {
    return std::uint64_t(std::clamp<std::int64_t>(x + kMiddle, 0, 2 * kMiddle - 1));
  };
  return part(cell.x()) << (2 * kBits) | part(cell.y()) << kBits | part(cell.z());
}

}  // namespace

std::uint32_t SeenSurfaces::cell_of(std::uint64_t key) {
  const auto [place, is_new] = cells_.try_emplace(key, std::uint32_t(keys_.size()));
  if (is_new) keys_.push_back(key);
  return place->second;
}

void SeenSurfaces::visit(const View& view) {
  const int width = view.range.width, height = view.range.height;
  struct Sample {
    Eigen::Vector3d point_m;
    std::uint64_t key = 0;
    std::uint32_t cell = 0;
    bool is_valid = false;
  };
  const SpacingLine spacing = spacing_line(view.sensor);
  const auto columns = std::size_t(width);
  std::vector<Sample> above(columns), row(columns);
  const auto link = [&](const Sample& a, const Sample& b, double spacing_m) {
    if (!a.is_valid) return;
    const Eigen::Vector3d apart = b.point_m - a.point_m;
    if (apart.cwiseAbs().maxCoeff() < cell_m_) return;  // their cells touch
    if (apart.norm() <= kFarthest * spacing_m) linked_.emplace_back(a.cell, b.cell);
  };
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const auto r = double(view.range.at(u, v));
      Sample& sample = row[std::size_t(u)];
      sample.is_valid = r > double(kInvalidRange);
      if (!sample.is_valid) continue;
      sample.point_m = view.T_world_view * unproject(view.sensor, u, v, r);
      const Eigen::Vector3d cell = ((sample.point_m - origin_m_) / cell_m_).array().floor();
      sample.key = key_of(cell.cast<std::int64_t>());
      const Sample* left = u > 0 && row[std::size_t(u - 1)].is_valid ? &row[std::size_t(u - 1)] : nullptr;
      sample.cell = left && left->key == sample.key ? left->cell : cell_of(sample.key);
      const double spacing_m = spacing.at(r);
      if (left) link(*left, sample, spacing_m);
      if (v > 0) link(above[std::size_t(u)], sample, spacing_m);
    }
    row.swap(above);
  }
  std::sort(linked_.begin(), linked_.end());
  linked_.erase(std::unique(linked_.begin(), linked_.end()), linked_.end());
}

std::uint64_t SeenSurfaces::pieces_99_percent() {
  DisjointSets pieces(keys_.size());
  for (const auto& [a, b] : linked_) pieces.unite(a, b);
  for (std::uint32_t i = 0; i < keys_.size(); ++i)
    for (std::int64_t dx = -1; dx <= 1; ++dx)
      for (std::int64_t dy = -1; dy <= 1; ++dy)
        for (std::int64_t dz = -1; dz <= 1; ++dz) {
          const std::int64_t away = dx * (std::int64_t(1) << (2 * kBits)) + dy * (std::int64_t(1) << kBits) + dz;
          if (away <= 0) continue;  // the other one finds this one
          const auto other = cells_.find(keys_[i] + std::uint64_t(away));
          if (other != cells_.end()) pieces.unite(i, other->second);
        }
  std::vector<std::uint64_t> size(keys_.size());
  for (std::uint32_t i = 0; i < keys_.size(); ++i) ++size[pieces.find(i)];
  std::sort(size.begin(), size.end(), std::greater<>());
  std::uint64_t held = 0, count = 0;
  while (100 * held < 99 * std::uint64_t(keys_.size())) held += size[count++];
  return count;
}

}  // namespace lapseam
