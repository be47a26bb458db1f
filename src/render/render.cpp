#include "lapseam/render.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/parallel.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "render/edge_overlay.h"
#include "render/ray_maker.h"
#include "render/surface_color.h"
#include "spatial/ray_scene.h"

namespace lapseam {
namespace {

const Color kBoundaryLine(255, 214, 0);
const Color kFaultyLine(0, 229, 255);
const Color kWire(24, 28, 40);

struct SurfaceHit {
  RayHit hit;
  bool is_backface = false;
};

/// First surface on the ray that shows.
SurfaceHit cast_visible(const RayScene& scene, const Mesh& mesh, const Ray& ray, bool cull_backfaces) {
  // More walls than this behind each other are not looked through.
  constexpr int kMostLayers = 256;
  const Eigen::Vector3f origin = ray.origin.cast<float>(), direction = ray.direction.cast<float>();
  float near = 0;
  for (int layer = 0; layer < kMostLayers; ++layer) {
    const RayHit hit = scene.cast(origin, direction, near);
    if (!hit) return {};
    const bool is_backface = geometric_normal(mesh, hit.triangle).dot(direction) > 0;
    if (!is_backface || !cull_backfaces) return {hit, is_backface};
    near = hit.t + std::max(hit.t, 1e-3f) * 4e-6f;
  }
  return {};
}

/// Barycentric weights of the point where a ray meets the plane of a triangle.
Eigen::Vector3d weights_on_plane(const Mesh& mesh, std::uint32_t triangle, const Ray& ray) {
  const Triangle& t = mesh.triangles[triangle];
  const Eigen::Vector3d a = mesh.positions_m[t[0]].cast<double>();
  const Eigen::Vector3d ab = mesh.positions_m[t[1]].cast<double>() - a, ac = mesh.positions_m[t[2]].cast<double>() - a;
  const Eigen::Vector3d n = ab.cross(ac);
  const double distance = (a - ray.origin).dot(n) / ray.direction.dot(n);
  const Eigen::Vector3d ap = ray.origin + distance * ray.direction - a;
  const double b1 = ap.cross(ac).dot(n) / n.squaredNorm(), b2 = ab.cross(ap).dot(n) / n.squaredNorm();
  return {1 - b1 - b2, b1, b2};
}

/// Distance in pixels from (x, y) to the nearest edge of the triangle that is there.
double edge_distance_px(const Mesh& mesh, std::uint32_t triangle, const RayMaker& rays, double x, double y) {
  const Eigen::Vector3d here = weights_on_plane(mesh, triangle, rays.ray(x, y));
  const Eigen::Vector3d along_x = weights_on_plane(mesh, triangle, rays.ray(x + 1, y)) - here;
  const Eigen::Vector3d along_y = weights_on_plane(mesh, triangle, rays.ray(x, y + 1)) - here;
  double nearest = std::numeric_limits<double>::infinity();
  // A weight falls to 0 at its edge; its slope says how many pixels away that is.
  for (int i = 0; i < 3; ++i) nearest = std::min(nearest, here[i] / std::hypot(along_x[i], along_y[i]));
  return nearest;
}

void check_options(const RayMaker& rays, const RenderOptions& options) {
  if (std::size_t(rays.width()) * std::size_t(rays.height()) > kMaxPixels)
    throw InvalidInput({}, {}, "size", "the picture is too large");
  if (options.samples_per_side < 1 || options.samples_per_side > 8)
    throw InvalidInput({}, {}, "samples_per_side", "must be 1 to 8");
  if (!(options.boundary_width_px > 0 && options.boundary_width_px < 100) ||
      !(options.wireframe_width_px > 0 && options.wireframe_width_px < 100))
    throw InvalidInput({}, {}, "line width", "must be over 0 and under 100 pixels");
}

Rgb8 to_rgb8(const Color& color) {
  const auto channel = [](float c) { return std::uint8_t(std::clamp(c, 0.0f, 255.0f) + 0.5f); };
  return {channel(color.x()), channel(color.y()), channel(color.z())};
}

/// One picture under way.
class Picture {
 public:
  Picture(const Mesh& mesh, const RayScene& scene, const RayMaker& rays, const SurfaceColor& surface,
          const RenderOptions& options)
      : mesh_(mesh), scene_(scene), rays_(rays), surface_(surface), options_(options) {}

  /// coverage: share of the pixel's rays that met a front face.
  Color pixel(int x, int y, float& coverage) const {
    const int n = options_.samples_per_side;
    Color sum = Color::Zero();
    int fronts = 0;
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) sum += sample(x + (i + 0.5) / n - 0.5, y + (j + 0.5) / n - 0.5, fronts);
    coverage = float(fronts) / float(n * n);
    return sum / float(n * n);
  }

 private:
  Color sample(double x, double y, int& fronts) const {
    const Ray ray = rays_.ray(x, y);
    const SurfaceHit surface = cast_visible(scene_, mesh_, ray, options_.cull_backfaces);
    if (!surface.hit) return to_color(options_.background);
    fronts += !surface.is_backface;
    const Color color = surface_.shade(surface.hit, ray.direction.cast<float>(), surface.is_backface);
    const bool is_wire = options_.show_wireframe &&
                         edge_distance_px(mesh_, surface.hit.triangle, rays_, x, y) < 0.5 * options_.wireframe_width_px;
    return is_wire ? Color(0.25f * color + 0.75f * kWire) : color;
  }

  const Mesh& mesh_;
  const RayScene& scene_;
  const RayMaker& rays_;
  const SurfaceColor& surface_;
  const RenderOptions& options_;
};

}  // namespace

struct Renderer::Impl {
  const Mesh& mesh;
  RayScene scene;
  Eigen::Vector3f sky;

  Impl(const Mesh& shown, Context& context)
      : mesh(shown), scene(shown.positions_m, shown.triangles, context), sky(guess_up(shown).cast<float>()) {}

  void draw_edges(ColorImage& image, const RayMaker& rays, const RenderOptions& options, Context& context) const {
    const std::vector<MarkedEdge> edges = find_marked_edges(mesh, context);
    const auto shows = [&](const Ray& ray, double free_until_m, std::uint32_t triangle) {
      const Eigen::Vector3f direction = ray.direction.cast<float>();
      if (options.cull_backfaces && geometric_normal(mesh, triangle).dot(direction) > 0) return false;
      const SurfaceHit surface = cast_visible(scene, mesh, ray, options.cull_backfaces);
      return !surface.hit || double(surface.hit.t) >= free_until_m;
    };
    const EdgeCoverage coverage = cover_edges(mesh, edges, rays, shows, options.boundary_width_px, context);
    for (std::size_t i = 0; i < image.size(); ++i) {
      Color color = to_color(image.pixels[i]);
      color += coverage.boundary.pixels[i] * (kBoundaryLine - color);
      color += coverage.faulty.pixels[i] * (kFaultyLine - color);
      image.pixels[i] = to_rgb8(color);
    }
  }
};

Renderer::Renderer(const Mesh& mesh, Context& context) {
  check_mesh(mesh);
  impl_ = std::make_unique<Impl>(mesh, context);
}
Renderer::~Renderer() = default;
Renderer::Renderer(Renderer&&) noexcept = default;
Renderer& Renderer::operator=(Renderer&&) noexcept = default;

ColorImage Renderer::render(const RenderCamera& camera, const RenderOptions& options, Context& context) const {
  return render_covered(camera, options, context).image;
}

CoveredPicture Renderer::render_covered(const RenderCamera& camera, const RenderOptions& options,
                                        Context& context) const {
  const Mesh& mesh = impl_->mesh;
  const RayMaker rays(camera, mesh.origin_m);
  check_options(rays, options);
  const std::vector<Eigen::Vector3f> normals =
      options.smooth_normals ? vertex_normals(mesh) : std::vector<Eigen::Vector3f>();
  const SurfaceColor surface(mesh, options.mode, normals, impl_->sky);
  const Picture picture(mesh, impl_->scene, rays, surface, options);

  StageScope stage(context, "render", std::uint64_t(rays.height()));
  CoveredPicture out{ColorImage(rays.width(), rays.height()), Image<float>(rays.width(), rays.height())};
  parallel_for(context, std::size_t(rays.height()), 1, [&](std::size_t row) {
    for (int x = 0, y = int(row); x < out.image.width; ++x)
      out.image.at(x, y) = to_rgb8(picture.pixel(x, y, out.coverage.at(x, y)));
    stage.advance();
  });
  if (options.show_boundary) impl_->draw_edges(out.image, rays, options, context);
  return out;
}

ColorImage render(const Mesh& mesh, const RenderCamera& camera, const RenderOptions& options, Context& context) {
  return Renderer(mesh, context).render(camera, options, context);
}

}  // namespace lapseam
