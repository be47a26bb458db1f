#pragma once

// Where an image shows things beside of where its camera should have them.

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

namespace lapseam {

/// A displacement in pixels, bilinear between the nodes of a coarse lattice over the image, constant beyond its rim.
struct ImageWarp {
  int columns = 0, rows = 0;
  Eigen::Vector2f spacing_px{1, 1};
  std::vector<Eigen::Vector2f> nodes{};  ///< row after row; the first lies at the middle of the first pixel

  struct Weights {
    std::array<std::size_t, 4> node;
    std::array<float, 4> weight;
  };
  Weights weights_at(const Eigen::Vector2f& pixel) const {
    const float x = std::clamp(pixel.x() / spacing_px.x(), 0.0f, float(columns - 1));
    const float y = std::clamp(pixel.y() / spacing_px.y(), 0.0f, float(rows - 1));
    const int u = std::min(int(x), columns - 2), v = std::min(int(y), rows - 2);
    const float fx = x - float(u), fy = y - float(v);
    const std::size_t first = std::size_t(v) * std::size_t(columns) + std::size_t(u);
    return {{first, first + 1, first + std::size_t(columns), first + std::size_t(columns) + 1},
            {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy}};
  }
  Eigen::Vector2f at(const Eigen::Vector2f& pixel) const {
    const Weights w = weights_at(pixel);
    Eigen::Vector2f sum = Eigen::Vector2f::Zero();
    for (std::size_t k = 0; k < 4; ++k) sum += w.weight[k] * nodes[w.node[k]];
    return sum;
  }
  /// The pixel that is displaced to this one. Displacements change by little over their own length: three steps do.
  Eigen::Vector2f undo(const Eigen::Vector2f& pixel) const {
    Eigen::Vector2f from = pixel;
    for (int step = 0; step < 3; ++step) from = pixel - at(from);
    return from;
  }
};

}  // namespace lapseam
