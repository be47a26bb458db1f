#include "render/surface_color.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "lapseam/error.h"

namespace lapseam {
namespace {

const Color kClay(206, 203, 196);
const Color kBack(128, 48, 42);
const Color kSeam(255, 255, 255);
const Color kFilled(255, 0, 255);
const Color kUnknownView(110, 110, 110);

Color from_hsv(double hue, double saturation, double value) {
  const auto channel = [&](double n) {
    const double k = std::fmod(n + hue * 6.0, 6.0);
    return float(255.0 * (value - value * saturation * std::clamp(std::min(k, 4.0 - k), 0.0, 1.0)));
  };
  return {channel(5), channel(3), channel(1)};
}

float wrap(float t) { return t >= 0 && t <= 1 ? t : t - std::floor(t); }

/// What the type of Mesh leaves open, and sampling relies on.
void check_pages(const Mesh& mesh) {
  for (std::size_t i = 0; i < mesh.triangle_page.size(); ++i) {
    const std::uint32_t page = mesh.triangle_page[i];
    if (page == kInvalidIndex) continue;
    if (page >= mesh.pages.size() || mesh.pages[page].empty() || mesh.texcoords.empty())
      throw InvalidInput({}, {}, "triangle_page",
                         "triangle " + std::to_string(i) + " has no such page or no texcoords");
  }
}

void require(bool has_data, const char* field, const char* problem) {
  if (!has_data) throw InvalidInput({}, {}, field, problem);
}

}  // namespace

Eigen::Vector3f geometric_normal(const Mesh& mesh, std::uint32_t triangle) {
  const Triangle& t = mesh.triangles[triangle];
  const Eigen::Vector3f a = mesh.positions_m[t[0]];
  return (mesh.positions_m[t[1]] - a).cross(mesh.positions_m[t[2]] - a);
}

std::vector<Eigen::Vector3f> vertex_normals(const Mesh& mesh) {
  std::vector<Eigen::Vector3f> normals(mesh.vertex_count(), Eigen::Vector3f::Zero());
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    const Eigen::Vector3f n = geometric_normal(mesh, std::uint32_t(i));
    for (const std::uint32_t v : mesh.triangles[i]) normals[v] += n;
  }
  for (Eigen::Vector3f& n : normals)
    if (const float length = n.norm(); length > 0) n /= length;
  return normals;
}

Color sample_page(const ColorImage& page, Eigen::Vector2f uv) {
  const float x = std::clamp(wrap(uv.x()) * float(page.width) - 0.5f, 0.0f, float(page.width - 1));
  const float y = std::clamp(wrap(uv.y()) * float(page.height) - 0.5f, 0.0f, float(page.height - 1));
  const int x0 = int(x), y0 = int(y);
  const int x1 = std::min(x0 + 1, page.width - 1), y1 = std::min(y0 + 1, page.height - 1);
  const float fx = x - float(x0), fy = y - float(y0);
  const Color top = (1 - fx) * to_color(page.at(x0, y0)) + fx * to_color(page.at(x1, y0));
  const Color bottom = (1 - fx) * to_color(page.at(x0, y1)) + fx * to_color(page.at(x1, y1));
  return (1 - fy) * top + fy * bottom;
}

Color view_color(std::uint32_t view) {
  if (view == kInvalidIndex) return kUnknownView;
  // Steps of the golden section spread hues evenly, however many there are; three levels tell apart close ones.
  constexpr double kGolden = 0.61803398874989485;
  const double hue = std::fmod(double(view) * kGolden, 1.0);
  const std::array<double, 3> saturations{0.75, 0.5, 0.85}, values{0.92, 0.8, 0.62};
  return from_hsv(hue, saturations[view % 3], values[view / 3 % 3]);
}

SurfaceColor::SurfaceColor(const Mesh& mesh, RenderMode mode, const std::vector<Eigen::Vector3f>& normals,
                           const Eigen::Vector3f& sky)
    : mesh_(mesh), mode_(mode), normals_(normals), sky_(sky) {
  if (mode == RenderMode::kTextured) {
    require(!mesh.triangle_page.empty() || !mesh.colors.empty(), "texture", "the mesh has no texture and no colours");
    check_pages(mesh);
  }
  if (mode == RenderMode::kColors) require(!mesh.colors.empty(), "colors", "the mesh has no vertex colours");
  if (mode == RenderMode::kProvenance)
    require(!mesh.triangle_view.empty() || !mesh.triangle_tag.empty(), "provenance",
            "the mesh does not say which view its triangles come from (a .ply of lapseam does)");
}

Color SurfaceColor::shade(const RayHit& hit, const Eigen::Vector3f& ray_direction, bool is_backface) const {
  const bool is_lit = mode_ == RenderMode::kShaded || mode_ == RenderMode::kProvenance;
  if (is_backface) return kBack * light(hit, ray_direction, true);
  const Color base = base_color(hit);
  return is_lit ? Color(base * light(hit, ray_direction, false)) : base;
}

Color SurfaceColor::base_color(const RayHit& hit) const {
  const std::uint32_t t = hit.triangle;
  switch (mode_) {
    case RenderMode::kShaded:
      return kClay;
    case RenderMode::kColors:
      return vertex_color(hit);
    case RenderMode::kTextured: {
      if (mesh_.triangle_page.empty() || mesh_.triangle_page[t] == kInvalidIndex) return vertex_color(hit);
      const auto& uv = mesh_.texcoords[t];
      return sample_page(mesh_.pages[mesh_.triangle_page[t]],
                         (1 - hit.b1 - hit.b2) * uv[0] + hit.b1 * uv[1] + hit.b2 * uv[2]);
    }
    case RenderMode::kProvenance: {
      const TriangleTag tag = mesh_.triangle_tag.empty() ? TriangleTag::kMeasured : mesh_.triangle_tag[t];
      if (tag == TriangleTag::kSeam) return kSeam;
      if (tag == TriangleTag::kFilled) return kFilled;
      return mesh_.triangle_view.empty() ? kUnknownView : view_color(mesh_.triangle_view[t]);
    }
  }
  return kClay;
}

Color SurfaceColor::vertex_color(const RayHit& hit) const {
  if (mesh_.colors.empty()) return kClay;
  const Triangle& t = mesh_.triangles[hit.triangle];
  return (1 - hit.b1 - hit.b2) * to_color(mesh_.colors[t[0]]) + hit.b1 * to_color(mesh_.colors[t[1]]) +
         hit.b2 * to_color(mesh_.colors[t[2]]);
}

/// Mostly from the camera, a little from the sky, so that floors and walls differ.
float SurfaceColor::light(const RayHit& hit, const Eigen::Vector3f& ray_direction, bool is_backface) const {
  Eigen::Vector3f n = geometric_normal(mesh_, hit.triangle);
  if (!normals_.empty()) {
    const Triangle& t = mesh_.triangles[hit.triangle];
    const Eigen::Vector3f smooth =
        (1 - hit.b1 - hit.b2) * normals_[t[0]] + hit.b1 * normals_[t[1]] + hit.b2 * normals_[t[2]];
    if (smooth.squaredNorm() > 0) n = smooth;
  }
  if (is_backface) n = -n;
  const float length = n.norm();
  if (!(length > 0)) return 1;
  n /= length;
  const float facing = std::max(0.0f, -n.dot(ray_direction));
  const float from_sky = 0.5f + 0.5f * n.dot(sky_);
  return 0.16f + 0.16f * from_sky + 0.68f * facing;
}

}  // namespace lapseam
