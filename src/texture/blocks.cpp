#include "texture/blocks.h"

#include "core/disjoint_sets.h"
#include "lapseam/mesh.h"

namespace lapseam {

bool meets(const Corners& p, const Eigen::Vector2f& low, const Eigen::Vector2f& high) {
  // Most do, with a corner.
  for (const Eigen::Vector2f& q : p)
    if (q.x() >= low.x() && q.x() <= high.x() && q.y() >= low.y() && q.y() <= high.y()) return true;
  const Eigen::Vector2f middle = 0.5f * (low + high), half = 0.5f * (high - low);
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector2f side = p[(k + 1) % 3] - p[k];
    const Eigen::Vector2f normal(-side.y(), side.x());
    const float radius = std::abs(normal.x()) * half.x() + std::abs(normal.y()) * half.y();
    const float a = normal.dot(p[k] - middle), b = normal.dot(p[(k + 2) % 3] - middle);
    if (std::min(a, b) > radius || std::max(a, b) < -radius) return false;
  }
  return true;
}

void BlockBox::extend(const Corners& p) {
  for_blocks(p, [&](int u, int v) {
    low_u = std::min(low_u, u), low_v = std::min(low_v, v);
    high_u = std::max(high_u, u), high_v = std::max(high_v, v);
  });
}

BlockBox box_of(std::span<const std::uint32_t> triangles, const std::vector<Corners>& pixels) {
  BlockBox box;
  for (const std::uint32_t i : triangles) box.extend(pixels[i]);
  return box;
}

std::vector<std::uint32_t> connect_by_blocks(std::span<const std::uint32_t> triangles,
                                             const std::vector<Corners>& pixels) {
  const BlockBox box = box_of(triangles, pixels);
  std::vector<std::uint32_t> label(triangles.size(), kInvalidIndex);
  if (box.is_empty()) return label;
  DisjointSets sets(std::size_t(box.width()) * std::size_t(box.height()));
  std::vector<std::uint32_t> first(triangles.size(), kInvalidIndex);
  for (std::size_t k = 0; k < triangles.size(); ++k)
    for_blocks(pixels[triangles[k]], [&](int u, int v) {
      const auto block = std::uint32_t(box.index(u, v));
      if (first[k] == kInvalidIndex) first[k] = block;
      sets.unite(first[k], block);
    });
  for (std::size_t k = 0; k < triangles.size(); ++k)
    if (first[k] != kInvalidIndex) label[k] = sets.find(first[k]);
  return label;
}

}  // namespace lapseam
