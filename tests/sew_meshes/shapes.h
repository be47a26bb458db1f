#pragma once

// Small meshes with known topology, normals up or outwards.

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "lapseam/mesh.h"

namespace lapseam::test {

/// columns × rows squares of `spacing_m` in a plane of constant z, from `corner`; two triangles each.
inline Mesh grid(int columns, int rows, float spacing_m, const Eigen::Vector3f& corner) {
  Mesh mesh;
  for (int j = 0; j <= rows; ++j)
    for (int i = 0; i <= columns; ++i)
      mesh.positions_m.push_back(corner + spacing_m * Eigen::Vector3f(float(i), float(j), 0));
  const auto at = [&](int i, int j) { return std::uint32_t(j * (columns + 1) + i); };
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) {
      mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  return mesh;
}

inline Mesh turned_over(Mesh mesh) {
  for (Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
  return mesh;
}

/// A sphere of radius 1 from a cube of n × n squares a side, so that no triangle is bad.
inline Mesh sphere(int n) {
  Mesh mesh;
  std::vector<std::uint32_t> index(std::size_t(n + 1) * std::size_t(n + 1) * std::size_t(n + 1), kInvalidIndex);
  const auto vertex = [&](const Eigen::Vector3i& p) {
    std::uint32_t& i = index[std::size_t((p.z() * (n + 1) + p.y()) * (n + 1) + p.x())];
    if (i == kInvalidIndex) {
      i = std::uint32_t(mesh.positions_m.size());
      Eigen::Vector3f q;
      for (int k = 0; k < 3; ++k) q[k] = std::tan((2 * float(p[k]) / float(n) - 1) * std::numbers::pi_v<float> / 4);
      mesh.positions_m.push_back(q.normalized());
    }
    return i;
  };
  for (int axis = 0; axis < 3; ++axis)
    for (int side = 0; side < 2; ++side)
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
          std::uint32_t corner[4];
          for (int k = 0; k < 4; ++k) {
            Eigen::Vector3i p;
            p[axis] = side * n;
            p[(axis + 1) % 3] = i + (k == 1 || k == 2);
            p[(axis + 2) % 3] = j + (k >= 2);
            corner[k] = vertex(p);
          }
          if (side == 0) std::swap(corner[1], corner[3]);
          mesh.triangles.push_back({corner[0], corner[1], corner[2]});
          mesh.triangles.push_back({corner[0], corner[2], corner[3]});
        }
  return mesh;
}

inline double area_of(const Mesh& mesh) {
  double sum = 0;
  for (const Triangle& t : mesh.triangles)
    sum += 0.5 * double((mesh.positions_m[t[1]] - mesh.positions_m[t[0]])
                            .cross(mesh.positions_m[t[2]] - mesh.positions_m[t[0]])
                            .norm());
  return sum;
}

}  // namespace lapseam::test
