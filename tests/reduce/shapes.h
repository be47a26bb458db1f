#pragma once

// Meshes of shapes that are known in closed form.

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "lapseam/mesh.h"

namespace lapseam::test {

/// columns × rows cells over [0, 1] × [0, rows / columns], at the height that the function says; normals up.
inline Mesh height_field(std::uint32_t columns, std::uint32_t rows, const std::function<float(float, float)>& height) {
  Mesh mesh;
  const float cell = 1 / float(columns);
  for (std::uint32_t j = 0; j <= rows; ++j)
    for (std::uint32_t i = 0; i <= columns; ++i)
      mesh.positions_m.emplace_back(float(i) * cell, float(j) * cell, height(float(i) * cell, float(j) * cell));
  for (std::uint32_t j = 0; j < rows; ++j) {
    for (std::uint32_t i = 0; i < columns; ++i) {
      const std::uint32_t a = j * (columns + 1) + i, b = a + 1, c = a + columns + 1, d = c + 1;
      mesh.triangles.push_back({a, b, d});
      mesh.triangles.push_back({a, d, c});
    }
  }
  return mesh;
}

inline Mesh noisy_plane(std::uint32_t columns, float sigma, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> noise(0, sigma);
  return height_field(columns, columns, [&](float, float) { return noise(random); });
}

/// Unit sphere: the faces of a cube, cut into cells × cells, blown up. Closed.
/// With blow false, the cube itself: [−1, 1]³.
inline Mesh sphere_or_cube(std::uint32_t cells, bool blow) {
  Mesh mesh;
  // Lattice points on the surface of the cube, each once.
  const std::uint32_t n = cells + 1;
  std::vector<std::uint32_t> index(std::size_t(n) * n * n, kInvalidIndex);
  const auto vertex = [&](const std::array<std::uint32_t, 3>& p) {
    std::uint32_t& i = index[(std::size_t(p[2]) * n + p[1]) * n + p[0]];
    if (i == kInvalidIndex) {
      i = std::uint32_t(mesh.positions_m.size());
      Eigen::Vector3f x;
      for (int k = 0; k < 3; ++k) x[k] = 2 * float(p[std::size_t(k)]) / float(cells) - 1;
      mesh.positions_m.push_back(blow ? x.normalized().eval() : x);
    }
    return i;
  };
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const bool is_high : {false, true}) {
      for (std::uint32_t j = 0; j < cells; ++j) {
        for (std::uint32_t i = 0; i < cells; ++i) {
          const auto at = [&](std::uint32_t u, std::uint32_t v) {
            std::array<std::uint32_t, 3> p;
            p[axis] = is_high ? cells : 0;
            p[(axis + 1) % 3] = is_high ? i + u : i + v;
            p[(axis + 2) % 3] = is_high ? j + v : j + u;
            return vertex(p);
          };
          mesh.triangles.push_back({at(0, 0), at(1, 0), at(1, 1)});
          mesh.triangles.push_back({at(0, 0), at(1, 1), at(0, 1)});
        }
      }
    }
  }
  return mesh;
}

/// Both meshes in one, vertices of the second after those of the first.
inline Mesh together(const Mesh& a, const Mesh& b) {
  Mesh mesh = a;
  mesh.positions_m.insert(mesh.positions_m.end(), b.positions_m.begin(), b.positions_m.end());
  for (Triangle t : b.triangles) {
    for (std::uint32_t& v : t) v += std::uint32_t(a.vertex_count());
    mesh.triangles.push_back(t);
  }
  return mesh;
}

}  // namespace lapseam::test
