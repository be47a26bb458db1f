#pragma once

// Surfaces whose distances to one another are known on paper.

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "lapseam/mesh.h"
#include "lapseam/view.h"

namespace lapseam::test {

/// A flat sheet of columns × rows cells at the height z, from (0, 0) to (width, depth), normals up.
inline Mesh sheet(float width_m, float depth_m, std::uint32_t columns, std::uint32_t rows, float z_m) {
  Mesh mesh;
  for (std::uint32_t j = 0; j <= rows; ++j)
    for (std::uint32_t i = 0; i <= columns; ++i)
      mesh.positions_m.emplace_back(width_m * float(i) / float(columns), depth_m * float(j) / float(rows), z_m);
  for (std::uint32_t j = 0; j < rows; ++j) {
    for (std::uint32_t i = 0; i < columns; ++i) {
      const std::uint32_t a = j * (columns + 1) + i, b = a + 1, c = a + columns + 1, d = c + 1;
      mesh.triangles.push_back({a, b, d});
      mesh.triangles.push_back({a, d, c});
    }
  }
  return mesh;
}

/// Rings of latitude and segments of longitude, all vertices on the sphere, normals outwards.
inline Mesh sphere(double radius_m, std::uint32_t rings, std::uint32_t segments) {
  Mesh mesh;
  for (std::uint32_t i = 0; i <= rings; ++i) {
    for (std::uint32_t j = 0; j < segments; ++j) {
      const double polar = std::numbers::pi * i / rings, around = 2 * std::numbers::pi * j / segments;
      const Eigen::Vector3d p(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around), std::cos(polar));
      mesh.positions_m.push_back((radius_m * p).cast<float>());
    }
  }
  for (std::uint32_t i = 0; i < rings; ++i) {
    for (std::uint32_t j = 0; j < segments; ++j) {
      const std::uint32_t next = (j + 1) % segments;
      const std::uint32_t a = i * segments + j, b = i * segments + next, c = a + segments, d = b + segments;
      if (i > 0) mesh.triangles.push_back({a, d, b});
      if (i + 1 < rings) mesh.triangles.push_back({a, c, d});
    }
  }
  return mesh;
}

inline void append(Mesh& mesh, const Mesh& other) {
  const auto first = std::uint32_t(mesh.vertex_count());
  mesh.positions_m.insert(mesh.positions_m.end(), other.positions_m.begin(), other.positions_m.end());
  for (const Triangle& t : other.triangles) mesh.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
}

inline void flip(Mesh& mesh) {
  for (Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
}

inline void move(Mesh& mesh, const Eigen::Vector3f& by_m) {
  for (Eigen::Vector3f& p : mesh.positions_m) p += by_m;
}

/// Looks straight down from the height above (x, y); x of the image along +x, y along −y.
inline Eigen::Isometry3d looking_down(double x_m, double y_m, double height_m) {
  Eigen::Isometry3d T_world_view = Eigen::Isometry3d::Identity();
  T_world_view.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal();
  T_world_view.translation() = Eigen::Vector3d(x_m, y_m, height_m);
  return T_world_view;
}

/// A pinhole view straight down on the plane z = 0: every pixel measures the height.
inline View view_down_on_floor(double x_m, double y_m, double height_m, int width, int height, double focal_px) {
  View view;
  view.name = "down";
  view.sensor = PinholeSensor{width, height, focal_px, focal_px, (width - 1) / 2.0, (height - 1) / 2.0, {}};
  view.range = RangeImage(width, height, float(height_m));
  view.T_world_view = looking_down(x_m, y_m, height_m);
  return view;
}

}  // namespace lapseam::test
