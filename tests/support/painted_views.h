#pragma once

// Colour images of shapes whose paint is known at every place, and meshes of these shapes. For tests only.

#include <algorithm>
#include <functional>
#include <memory>
#include <string>

#include "lapseam/mesh.h"
#include "support/analytic_views.h"

namespace lapseam::test {

/// Colour of a place of the world, 0 to 255.
using Paint = std::function<Eigen::Vector3d(const Eigen::Vector3d&)>;

/// What a camera adds: factors of the channels, and a loss towards the corners of the image.
struct Lens {
  Eigen::Vector3d gain = Eigen::Vector3d::Ones();
  double vignetting = 0;  ///< share of the light that is lost in the corners
};

/// A view with a colour image from its own pose; 3 × 3 rays a pixel. No range image.
inline ViewSource painted_source(const std::string& name, const Sensor& camera, const Eigen::Isometry3d& T_world_view,
                                 const Shape& shape, const Paint& paint, const Lens& lens = {}) {
  ColorImage image(width(camera), height(camera));
  const Eigen::Vector2d half(0.5 * image.width, 0.5 * image.height);
  for (int v = 0; v < image.height; ++v)
    for (int u = 0; u < image.width; ++u) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (int k = 0; k < 9; ++k) {
        const double x = u + (k % 3 - 1) / 3.0, y = v + (k / 3 - 1) / 3.0;
        const Eigen::Vector3d o = T_world_view * unproject(camera, x, y, 0.0);
        const Eigen::Vector3d d = T_world_view.linear() * ray_direction(camera, x, y);
        if (const auto t = shape(o, d)) sum += paint(o + *t * d);
      }
      const double r2 = (Eigen::Vector2d(u + 0.5, v + 0.5) - half).squaredNorm() / half.squaredNorm();
      sum = (sum / 9).cwiseProduct(lens.gain) * (1 - lens.vignetting * r2);
      const auto channel = [](double x) { return std::uint8_t(std::clamp(x, 0.0, 255.0) + 0.5); };
      image.at(u, v) = {channel(sum.x()), channel(sum.y()), channel(sum.z())};
    }
  ViewSource source;
  source.name = name;
  source.sensor_id = "painted";
  source.sensor = camera;
  source.T_world_view = T_world_view;
  source.color = ColorSource{{}, camera, Eigen::Isometry3d::Identity(), std::make_shared<ColorImage>(std::move(image))};
  return source;
}

/// n × n squares from corner along two sides, facing along side_a × side_b, added to a mesh.
inline void append_patch(Mesh& mesh, const Eigen::Vector3d& corner, const Eigen::Vector3d& side_a,
                         const Eigen::Vector3d& side_b, int n) {
  const auto base = std::uint32_t(mesh.vertex_count());
  for (int j = 0; j <= n; ++j)
    for (int i = 0; i <= n; ++i) mesh.positions_m.push_back((corner + side_a * i / n + side_b * j / n).cast<float>());
  const auto at = [&](int i, int j) { return base + std::uint32_t(j * (n + 1) + i); };
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
}

/// The six walls of a box, facing inwards, n × n squares each.
inline Mesh room_mesh(const Eigen::Vector3d& low, const Eigen::Vector3d& high, int n) {
  Mesh mesh;
  const Eigen::Vector3d x(high.x() - low.x(), 0, 0), y(0, high.y() - low.y(), 0), z(0, 0, high.z() - low.z());
  append_patch(mesh, low, x, y, n);
  append_patch(mesh, low, y, z, n);
  append_patch(mesh, low, z, x, n);
  append_patch(mesh, high, -y, -x, n);
  append_patch(mesh, high, -z, -y, n);
  append_patch(mesh, high, -x, -z, n);
  return mesh;
}

}  // namespace lapseam::test
