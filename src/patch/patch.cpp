#include "lapseam/patch.h"

namespace lapseam {

std::shared_ptr<const RayTable> make_ray_table(const Sensor& sensor) {
  auto table = std::make_shared<RayTable>();
  table->width = width(sensor);
  table->height = height(sensor);
  const std::size_t n = std::size_t(table->width) * std::size_t(table->height);
  table->directions.resize(n);
  const bool is_central =
      std::holds_alternative<PinholeSensor>(sensor) || std::holds_alternative<SphericalSensor>(sensor);
  if (!is_central) table->origins.resize(n);
  std::visit(
      [&](const auto& s) {
        std::size_t i = 0;
        for (int v = 0; v < table->height; ++v)
          for (int u = 0; u < table->width; ++u, ++i) {
            const Eigen::Vector3d at_one = s.unproject(u, v, 1.0);
            if (is_central) {
              table->directions[i] = at_one.cast<float>();
            } else {
              const Eigen::Vector3d slope = s.unproject(u, v, 2.0) - at_one;
              table->directions[i] = slope.cast<float>();
              table->origins[i] = (at_one - slope).cast<float>();
            }
          }
      },
      sensor);
  return table;
}

std::array<std::uint32_t, 3> PatchGrid::corners(std::size_t cell, int slot) const {
  const auto p00 = std::uint32_t(cell);
  const std::uint32_t u = p00 % std::uint32_t(width);
  const std::uint32_t p10 = u + 1 < std::uint32_t(width) ? p00 + 1 : p00 - u;
  const std::uint32_t p01 = p00 + std::uint32_t(width), p11 = p10 + std::uint32_t(width);
  std::array<std::uint32_t, 3> c;
  if (cells[cell] & kAntiDiagonal)
    c = slot == 0 ? std::array{p00, p01, p10} : std::array{p10, p01, p11};
  else
    c = slot == 0 ? std::array{p00, p01, p11} : std::array{p00, p11, p10};
  if (is_mirrored) std::swap(c[1], c[2]);
  return c;
}

std::optional<PatchGrid::Place> PatchGrid::neighbor_across(std::size_t cell, int slot, std::uint32_t p,
                                                           std::uint32_t q) const {
  const auto w = std::size_t(width);
  const std::size_t u = cell % w, v = cell / w;
  const std::size_t right = u + 1 < w ? cell + 1 : cell - u;
  const auto is_edge = [&](std::size_t x, std::size_t y) { return (p == x && q == y) || (p == y && q == x); };
  const auto is_anti_cell = [&](std::size_t c) { return (cells[c] & PatchGrid::kAntiDiagonal) != 0; };
  if (is_edge(cell, cell + w)) {  // left: the triangle with the right edge is always slot 1
    if (u > 0) return Place{cell - 1, 1};
    return wraps ? std::optional(Place{cell + w - 1, 1}) : std::nullopt;
  }
  if (is_edge(right, right + w)) {  // right: the triangle with the left edge is always slot 0
    if (u + 1 < w) return Place{right, 0};
    return wraps ? std::optional(Place{right, 0}) : std::nullopt;
  }
  if (is_edge(cell, right)) {  // top
    if (v == 0) return std::nullopt;
    return Place{cell - w, is_anti_cell(cell - w) ? 1 : 0};
  }
  if (is_edge(cell + w, right + w)) {  // bottom
    if (v + 2 >= std::size_t(height)) return std::nullopt;
    return Place{cell + w, is_anti_cell(cell + w) ? 0 : 1};
  }
  return Place{cell, 1 - slot};  // the diagonal
}

std::size_t PatchGrid::alive_count() const {
  std::size_t count = 0;
  for (const std::uint8_t cell : cells) count += std::size_t((cell >> 3) & 1) + std::size_t((cell >> 4) & 1);
  return count;
}

}  // namespace lapseam
