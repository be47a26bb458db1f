#include "simulate/mesh_builder.h"

#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "simulate/color.h"
#include "simulate/pattern.h"

namespace lapseam::simulation {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kTwoPi = 2.0 * std::numbers::pi;

double signed_power(double x, double exponent) { return std::copysign(std::pow(std::abs(x), exponent), x); }

Vector3d any_perpendicular(const Vector3d& d) {
  const Vector3d axis = std::abs(d.z()) < 0.9 * d.norm() ? Vector3d::UnitZ() : Vector3d::UnitX();
  return d.cross(axis).normalized();
}

}  // namespace

Eigen::Vector3f linear_color(std::uint32_t srgb) {
  return to_linear(Rgb8{std::uint8_t(srgb >> 16), std::uint8_t(srgb >> 8), std::uint8_t(srgb)});
}

void MeshBuilder::use(Material material) {
  material.T_pattern_world = T_world_object_.inverse().cast<float>();
  scene_.materials.push_back(std::move(material));
}

std::uint32_t MeshBuilder::add_vertex(const Vector3d& object_point) {
  scene_.mesh.positions_m.push_back((T_world_object_ * object_point).cast<float>());
  return std::uint32_t(scene_.mesh.positions_m.size() - 1);
}

void MeshBuilder::add_triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  const auto& p = scene_.mesh.positions_m;
  // Below this, in square metres, rounding of float positions decides the normal.
  constexpr float kSmallestArea = 1e-12f;
  if (0.5f * (p[b] - p[a]).cross(p[c] - p[a]).norm() < kSmallestArea) return;
  scene_.mesh.triangles.push_back({a, b, c});
  scene_.triangle_material.push_back(std::uint32_t(scene_.materials.size() - 1));
}

void MeshBuilder::add_quad(const Vector3d& a, const Vector3d& b, const Vector3d& c, const Vector3d& d) {
  const std::uint32_t i = add_vertex(a);
  add_vertex(b), add_vertex(c), add_vertex(d);
  add_triangle(i, i + 1, i + 2);
  add_triangle(i, i + 2, i + 3);
}

void MeshBuilder::add_box(const Vector3d& low, const Vector3d& high) {
  const auto corner = [&](int k) {
    return Vector3d(k & 1 ? high.x() : low.x(), k & 2 ? high.y() : low.y(), k & 4 ? high.z() : low.z());
  };
  constexpr int kFaces[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  for (const auto& f : kFaces) add_quad(corner(f[0]), corner(f[1]), corner(f[2]), corner(f[3]));
}

void MeshBuilder::add_grid(int nu, int nv, bool closed_u, bool closed_v,
                           const std::function<Vector3d(int, int)>& point) {
  const int columns = closed_u ? nu : nu + 1, rows = closed_v ? nv : nv + 1;
  const std::uint32_t first = std::uint32_t(scene_.mesh.positions_m.size());
  for (int v = 0; v < rows; ++v)
    for (int u = 0; u < columns; ++u) add_vertex(point(u, v));
  const auto at = [&](int u, int v) { return first + std::uint32_t((v % rows) * columns + u % columns); };
  for (int v = 0; v < nv; ++v) {
    for (int u = 0; u < nu; ++u) {
      add_triangle(at(u, v), at(u + 1, v), at(u + 1, v + 1));
      add_triangle(at(u, v), at(u + 1, v + 1), at(u, v + 1));
    }
  }
}

void MeshBuilder::add_revolution(std::span<const Vector2d> profile, int segments) {
  add_grid(segments, int(profile.size()) - 1, true, false, [&](int u, int v) {
    const double angle = kTwoPi * u / segments;
    const Vector2d& p = profile[std::size_t(v)];
    return Vector3d(p.x() * std::cos(angle), p.x() * std::sin(angle), p.y());
  });
}

void MeshBuilder::add_tube(std::span<const Vector3d> path, double diameter_m, int sides) {
  const int rings = int(path.size());
  std::vector<Vector3d> tangents(path.size()), normals(path.size());
  for (int i = 0; i < rings; ++i)
    tangents[std::size_t(i)] =
        (path[std::size_t(std::min(i + 1, rings - 1))] - path[std::size_t(std::max(i - 1, 0))]).normalized();
  normals[0] = any_perpendicular(tangents[0]);
  // Carried along without twist: each ring's normal is the last one made perpendicular again.
  for (std::size_t i = 1; i < path.size(); ++i)
    normals[i] = (normals[i - 1] - tangents[i] * tangents[i].dot(normals[i - 1])).normalized();
  const auto point = [&](int u, int v) {
    const std::size_t i = std::size_t(v);
    const double angle = kTwoPi * u / sides;
    const Vector3d out = std::cos(angle) * normals[i] + std::sin(angle) * tangents[i].cross(normals[i]);
    return Vector3d(path[i] + 0.5 * diameter_m * out);
  };
  add_grid(sides, rings - 1, true, false, point);
  for (const bool is_end : {false, true}) {
    const int v = is_end ? rings - 1 : 0;
    const std::uint32_t center = add_vertex(path[std::size_t(v)]);
    for (int u = 0; u < sides; ++u) add_vertex(point(u, v));
    for (int u = 0; u < sides; ++u) {
      const std::uint32_t a = center + 1 + std::uint32_t(u), b = center + 1 + std::uint32_t((u + 1) % sides);
      is_end ? add_triangle(center, a, b) : add_triangle(center, b, a);
    }
  }
}

void MeshBuilder::add_rod(const Vector3d& a, const Vector3d& b, double diameter_m, int sides) {
  const std::array<Vector3d, 2> path{a, b};
  add_tube(path, diameter_m, sides);
}

void MeshBuilder::add_torus(const Vector3d& center, double radius_m, double tube_radius_m, int segments, int sides) {
  add_grid(segments, sides, true, true, [&](int u, int v) {
    const double a = kTwoPi * u / segments, b = kTwoPi * v / sides;
    const double r = radius_m + tube_radius_m * std::cos(b);
    return Vector3d(center + Vector3d(r * std::cos(a), r * std::sin(a), tube_radius_m * std::sin(b)));
  });
}

void MeshBuilder::add_superellipsoid(const Vector3d& center, const Vector3d& radii, double exponent_vertical,
                                     double exponent_horizontal, int segments) {
  const int rows = segments / 2;
  add_grid(segments, rows, true, false, [&](int u, int v) {
    const double a = kTwoPi * u / segments, b = std::numbers::pi * (double(v) / rows - 0.5);
    // cos(±π/2) is not quite 0 in floating point: the poles must be points.
    const double ring = v == 0 || v == rows ? 0.0 : signed_power(std::cos(b), exponent_vertical);
    const Vector3d unit(ring * signed_power(std::cos(a), exponent_horizontal),
                        ring * signed_power(std::sin(a), exponent_horizontal),
                        signed_power(std::sin(b), exponent_vertical));
    return Vector3d(center + radii.cwiseProduct(unit));
  });
}

void MeshBuilder::add_icosphere(double radius_m, int levels) {
  const double g = std::numbers::phi;
  std::vector<Vector3d> points = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                                  {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  for (Vector3d& p : points) p.normalize();
  std::vector<Triangle> triangles = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                                     {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                                     {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                                     {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  for (int level = 0; level < levels; ++level) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [it, is_new] = middles.try_emplace(std::minmax(a, b), std::uint32_t(points.size()));
      if (is_new) points.push_back((points[a] + points[b]).normalized());
      return it->second;
    };
    std::vector<Triangle> finer;
    finer.reserve(triangles.size() * 4);
    for (const auto& [a, b, c] : triangles) {
      const std::uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    triangles = std::move(finer);
  }
  const std::uint32_t first = std::uint32_t(scene_.mesh.positions_m.size());
  for (const Vector3d& p : points) add_vertex(radius_m * p);
  for (const auto& [a, b, c] : triangles) add_triangle(first + a, first + b, first + c);
}

void MeshBuilder::add_curtain(std::span<const Vector2d> line, double thickness_m, double z0, double z1) {
  const int n = int(line.size());
  const auto side = [&](int i, double sign) {
    const Vector2d d = (line[std::size_t(std::min(i + 1, n - 1))] - line[std::size_t(std::max(i - 1, 0))]).normalized();
    return Vector2d(line[std::size_t(i)] + 0.5 * sign * thickness_m * Vector2d(d.y(), -d.x()));
  };
  const auto lift = [](const Vector2d& p, double z) { return Vector3d(p.x(), p.y(), z); };
  constexpr int kRows = 24;
  const auto height = [&](int v) { return z0 + (z1 - z0) * v / kRows; };
  add_grid(n - 1, kRows, false, false, [&](int u, int v) { return lift(side(u, 1), height(v)); });
  add_grid(n - 1, kRows, false, false, [&](int u, int v) { return lift(side(n - 1 - u, -1), height(v)); });
  add_grid(n - 1, 1, false, false, [&](int u, int v) { return lift(side(u, v ? -1 : 1), z1); });
  add_grid(n - 1, 1, false, false, [&](int u, int v) { return lift(side(u, v ? 1 : -1), z0); });
  for (const int i : {0, n - 1}) {
    const double s = i == 0 ? -1 : 1;
    add_quad(lift(side(i, s), z0), lift(side(i, -s), z0), lift(side(i, -s), z1), lift(side(i, s), z1));
  }
}

SimulatedScene MeshBuilder::finish(std::string name) {
  scene_.name = std::move(name);
  Mesh& mesh = scene_.mesh;
  // A vertex belongs to one shape, so any of its triangles gives its material and a good enough normal.
  mesh.colors.assign(mesh.vertex_count(), Rgb8{});
  for (std::size_t i = mesh.triangles.size(); i-- > 0;) {
    const auto& [a, b, c] = mesh.triangles[i];
    const auto& p = mesh.positions_m;
    const Eigen::Vector3f normal = (p[b] - p[a]).cross(p[c] - p[a]).normalized();
    for (const std::uint32_t v : mesh.triangles[i])
      mesh.colors[v] = to_srgb(albedo(scene_.materials[scene_.triangle_material[i]], p[v], normal));
  }
  // Poles and seams leave points that no triangle uses.
  std::vector<std::uint8_t> keep(mesh.triangles.size(), 1);
  mesh = compact(mesh, keep);
  return std::move(scene_);
}

}  // namespace lapseam::simulation
