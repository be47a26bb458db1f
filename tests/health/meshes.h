#pragma once

// Small meshes whose health is known.

#include <cstdint>
#include <random>

#include "lapseam/mesh.h"

namespace lapseam::test {

inline Mesh tetrahedron() {
  Mesh mesh;
  mesh.positions_m = {{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}};
  mesh.triangles = {{0, 1, 2}, {0, 3, 1}, {0, 2, 3}, {1, 3, 2}};
  return mesh;
}

/// columns × rows cells of the given size in the plane z = 0, two triangles each, normals up.
inline Mesh grid(std::uint32_t columns, std::uint32_t rows, float cell_m = 1) {
  Mesh mesh;
  for (std::uint32_t j = 0; j <= rows; ++j)
    for (std::uint32_t i = 0; i <= columns; ++i)
      mesh.positions_m.emplace_back(float(i) * cell_m, float(j) * cell_m, 0.f);
  for (std::uint32_t j = 0; j < rows; ++j) {
    for (std::uint32_t i = 0; i < columns; ++i) {
      const std::uint32_t a = j * (columns + 1) + i, b = a + 1, c = a + columns + 1, d = c + 1;
      mesh.triangles.push_back({a, b, d});
      mesh.triangles.push_back({a, d, c});
    }
  }
  return mesh;
}

/// Random triangles on points of a small integer lattice: touching, coplanar, duplicate and degenerate in abundance.
inline Mesh lattice_soup(std::uint32_t seed, std::uint32_t triangles, int half_width, std::uint32_t vertices) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> coordinate(-half_width, half_width);
  std::uniform_int_distribution<std::uint32_t> vertex(0, vertices - 1);
  Mesh mesh;
  for (std::uint32_t i = 0; i < vertices; ++i)
    mesh.positions_m.emplace_back(float(coordinate(random)), float(coordinate(random)), float(coordinate(random)));
  for (std::uint32_t i = 0; i < triangles; ++i)
    mesh.triangles.push_back({vertex(random), vertex(random), vertex(random)});
  return mesh;
}

}  // namespace lapseam::test
