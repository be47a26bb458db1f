// What sensors measure of a scene: true ranges, colours, and then everything that goes wrong.

#include <algorithm>
#include <cmath>
#include <functional>
#include <type_traits>

#include "core/parallel.h"
#include "lapseam/error.h"
#include "lapseam/simulate.h"
#include "simulate/color.h"
#include "simulate/counter_rng.h"
#include "simulate/ray_caster.h"

namespace lapseam {
namespace simulation {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::Vector3f;

/// Runs a body over image rows, here or on all threads.
using RowLoop = std::function<void(int rows, const std::function<void(int row)>& body)>;

/// One image's hits, with neighbours that go around where the sensor does.
struct HitImage {
  Image<Hit> hits;
  bool wraps = false;

  const Hit* neighbor(int u, int v) const {
    if (wraps) u = (u + hits.width) % hits.width;
    return u < 0 || v < 0 || u >= hits.width || v >= hits.height ? nullptr : &hits.at(u, v);
  }
};

HitImage cast_image(const RayCaster& caster, const Sensor& sensor, const RayGenerator& ray_of, const RowLoop& rows) {
  HitImage out{Image<Hit>(width(sensor), height(sensor)), wraps(sensor)};
  rows(out.hits.height, [&](int v) {
    for (int u = 0; u < out.hits.width; ++u) out.hits.at(u, v) = caster.cast(ray_of(u, v));
  });
  return out;
}

// ---- range

/// Draws of one pixel: which random number serves what.
enum Draw : std::uint64_t { kGrazing = 0, kDark, kSpecular };

class RangeMeasurement {
 public:
  RangeMeasurement(const RayCaster& caster, const SensorEffects& effects, const RayGenerator& ray_of,
                   const HitImage& image, std::uint64_t seed, std::uint32_t view_index)
      : caster_(caster), effects_(effects), ray_of_(ray_of), image_(image), seed_(seed), view_(view_index) {}

  /// What the pixel's central ray meets, if a sensor can see it.
  float true_range(int u, int v) const {
    const Hit& hit = image_.hits.at(u, v);
    if (!hit || !is_seen(hit, ray_of_(u, v))) return kInvalidRange;
    return hit.range;
  }

  float measured_range(int u, int v) const {
    const Hit* hit = &image_.hits.at(u, v);
    double r = double(true_range(u, v));
    if (effects_.has_mixed_pixels && is_near_edge(u, v)) r = footprint_range(u, v, r);
    if (!(r > 0)) return kInvalidRange;
    // A pixel whose middle ray missed may still measure what its rim meets.
    double cosine = 1;
    if (*hit) {
      const Ray ray = ray_of_(u, v);
      cosine = std::abs(caster_.incidence_cosine(hit->triangle, ray));
      if (is_lost(u, v, *hit, ray, cosine)) return kInvalidRange;
    }
    const double angle = std::acos(std::min(cosine, 1.0));
    const double factor = 1 + angle * (effects_.incidence_1 + angle * effects_.incidence_2);
    const double sigma =
        effects_.noise.sigma(r, std::max(cosine, kMostGrazing), effects_.noise.intensity_factor(intensity(u, v))) *
        factor;
    if (sigma > 0) r += sigma * CounterRng(seed_, Stream::kNoise, view_, pixel(u, v)).gaussian(0);
    const double step = effects_.quantization_m + effects_.quantization_2_per_m * r * r;
    if (step > 0) r = step * std::round(r / step);
    return r > 0 && is_in_limits(r) ? float(r) : kInvalidRange;
  }

  /// Of the light that comes back, as a share of 255.
  std::uint8_t intensity(int u, int v) const {
    const Hit& hit = image_.hits.at(u, v);
    if (effects_.noise.intensity_power == 0 || !hit) return 0;
    const Ray ray = ray_of_(u, v);
    const double cosine = std::abs(caster_.incidence_cosine(hit.triangle, ray));
    return std::uint8_t(std::clamp(std::lround(255 * cosine * reflectance(hit, ray)), 1l, 255l));
  }

 private:
  double reflectance(const Hit& hit, const Ray& ray) const {
    const Vector3f albedo = caster_.albedo_at(hit, ray.origin + double(hit.range) * ray.direction);
    return double(albedo.dot(Vector3f(0.2126f, 0.7152f, 0.0722f)));
  }
  std::uint64_t pixel(int u, int v) const { return image_.hits.index(u, v); }
  static constexpr double kMostGrazing = 0.02;  // no ray of a sensor lies in a surface
  bool is_in_limits(double r) const { return r >= effects_.min_range_m && r <= effects_.max_range_m; }
  bool is_seen(const Hit& hit, const Ray& ray) const {
    if (!(hit.range > 0) || !is_in_limits(double(hit.range))) return false;
    return caster_.scene().is_two_sided || caster_.incidence_cosine(hit.triangle, ray) > 0;
  }

  bool is_lost(int u, int v, const Hit& hit, const Ray& ray, double cosine) const {
    const CounterRng rng(seed_, Stream::kDropout, view_, pixel(u, v));
    if (cosine < effects_.grazing_cosine && rng.uniform(kGrazing) < effects_.grazing_dropout) return true;
    if (effects_.dark_dropout > 0 && rng.uniform(kDark) < effects_.dark_dropout) {
      if (reflectance(hit, ray) < 0.04) return true;
    }
    constexpr double kCosineOf20Degrees = 0.93969262;
    const std::uint32_t m = caster_.material(hit.triangle);
    return m != kInvalidIndex && caster_.scene().materials[m].is_specular && cosine < kCosineOf20Degrees &&
           rng.uniform(kSpecular) < effects_.specular_dropout;
  }

  /// True when a neighbour's ray met another triangle: only there can the footprint hold several surfaces.
  bool is_near_edge(int u, int v) const {
    const std::uint32_t middle = image_.hits.at(u, v).triangle;
    for (int dv = -1; dv <= 1; ++dv)
      for (int du = -1; du <= 1; ++du) {
        const Hit* other = image_.neighbor(u + du, v + dv);
        if (other && other->triangle != middle) return true;
      }
    return false;
  }

  /// Mean over 3 × 3 rays of the footprint where they meet several surfaces; else the range as given.
  double footprint_range(int u, int v, double r) const {
    const Hit& middle = image_.hits.at(u, v);
    double sum = 0;
    int seen = 0, off_surface = 0;
    for (int i = 0; i < 9; ++i) {
      const Ray ray = ray_of_(u + (i % 3 - 1) / 3.0, v + (i / 3 - 1) / 3.0);
      const Hit hit = caster_.cast(ray);
      if (!hit || !is_seen(hit, ray)) {
        ++off_surface;
        continue;
      }
      const double expected = r > 0 ? caster_.plane_range(middle.triangle, ray, r) : -1.0;
      // 1 % is far more than a curved surface departs from its tangent within one pixel.
      if (std::abs(double(hit.range) - expected) > 0.002 + 0.01 * double(hit.range)) ++off_surface;
      sum += double(hit.range);
      ++seen;
    }
    if (off_surface == 0) return r;
    // Less than half the light comes back: no return.
    return seen >= 5 ? sum / seen : double(kInvalidRange);
  }

  const RayCaster& caster_;
  const SensorEffects& effects_;
  const RayGenerator& ray_of_;
  const HitImage& image_;
  std::uint64_t seed_;
  std::uint32_t view_;
};

// ---- colour

class Photograph {
 public:
  Photograph(const RayCaster& caster, const RayGenerator& ray_of, const HitImage& image, float gain)
      : caster_(caster), ray_of_(ray_of), image_(image), gain_(gain) {}

  Rgb8 color(int u, int v) const {
    const Hit& hit = image_.hits.at(u, v);
    const bool is_edge = is_silhouette(u, v);
    if (!hit && !is_edge) return to_srgb(gain_ * background());
    // Four samples a pixel. Away from edges they lie on the plane that the middle ray met, and need no rays.
    Vector3f sum = Vector3f::Zero();
    for (const double du : {-0.25, 0.25})
      for (const double dv : {-0.25, 0.25}) {
        const Ray ray = ray_of_(u + du, v + dv);
        sum += is_edge ? radiance(caster_.cast(ray), ray) : radiance_on_plane(hit, ray);
      }
    return to_srgb(0.25f * gain_ * sum);
  }

 private:
  static Vector3f background() { return Vector3f::Constant(0.02f); }

  Vector3f radiance(const Hit& hit, const Ray& ray) const {
    if (!hit) return background();
    const Vector3d point = ray.origin + double(hit.range) * ray.direction;
    return caster_.albedo_at(hit, point).cwiseProduct(caster_.light_at(hit));
  }

  Vector3f radiance_on_plane(const Hit& middle, const Ray& ray) const {
    Hit hit = middle;
    hit.range = float(caster_.plane_range(middle.triangle, ray, double(middle.range)));
    return radiance(hit, ray);
  }

  /// Another surface, material or crease within a pixel: worth rays of its own.
  bool is_silhouette(int u, int v) const {
    const Hit& middle = image_.hits.at(u, v);
    constexpr int kAround[4][2] = {{-1, 0}, {1, 0}, {0, -1}, {0, 1}};
    for (const auto& d : kAround) {
      const Hit* other = image_.neighbor(u + d[0], v + d[1]);
      if (!other || other->triangle == middle.triangle) continue;
      if (!*other || !middle || caster_.material(other->triangle) != caster_.material(middle.triangle)) return true;
      if (std::abs(other->range - middle.range) > 0.02f * middle.range) return true;
      if (caster_.normal(other->triangle).dot(caster_.normal(middle.triangle)) < 0.9) return true;
    }
    return false;
  }

  const RayCaster& caster_;
  const RayGenerator& ray_of_;
  const HitImage& image_;
  float gain_;
};

bool are_same(const Sensor& a, const Sensor& b) {
  if (a.index() != b.index()) return false;
  if (const auto* p = std::get_if<PinholeSensor>(&a)) {
    const auto& q = std::get<PinholeSensor>(b);
    return p->width == q.width && p->height == q.height && p->fx == q.fx && p->fy == q.fy && p->cx == q.cx &&
           p->cy == q.cy && p->distortion.is_zero() && q.distortion.is_zero();
  }
  if (const auto* s = std::get_if<SphericalSensor>(&a)) {
    const auto& t = std::get<SphericalSensor>(b);
    return s->azimuth_rad == t.azimuth_rad && s->elevation_rad == t.elevation_rad && s->warp == t.warp;
  }
  if (const auto* o = std::get_if<OrthographicSensor>(&a)) {
    const auto& q = std::get<OrthographicSensor>(b);
    return o->width == q.width && o->height == q.height && o->pitch_x_m == q.pitch_x_m && o->pitch_y_m == q.pitch_y_m &&
           o->cx == q.cx && o->cy == q.cy;
  }
  return false;
}

Isometry3d with_error(const Isometry3d& T_true, const SensorEffects& effects, const CounterRng& rng) {
  const Vector3d shift(rng.gaussian(0), rng.gaussian(1), rng.gaussian(2));
  const Vector3d turn = effects.pose_sigma_rad * Vector3d(rng.gaussian(3), rng.gaussian(4), rng.gaussian(5));
  Isometry3d T = T_true;
  if (turn.norm() > 0) T.linear() = T.linear() * Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
  T.translation() += effects.pose_sigma_m * shift;
  return T;
}

void check_view(const ViewSource& planned, bool has_light) {
  if (!planned.sensor) throw InvalidInput({}, planned.name, "sensor", "is missing");
  const auto check = [&](const Sensor& sensor, const char* field) {
    if (std::holds_alternative<MeasuredGridSensor>(sensor))
      throw InvalidInput({}, planned.name, field, "a measured grid cannot be simulated");
    if (width(sensor) < 1 || height(sensor) < 1) throw InvalidInput({}, planned.name, field, "has no pixels");
  };
  check(*planned.sensor, "sensor");
  if (planned.color) check(planned.color->camera, "colour camera");
  if (planned.color && !has_light)
    throw InvalidInput({}, planned.name, "color", "the simulator was made without colour");
}

SimulatedView simulate_view(const RayCaster& caster, std::uint64_t seed, const ViewSource& planned,
                            std::uint32_t view_index, const SensorEffects& effects, const RowLoop& rows) {
  check_view(planned, caster.has_light());
  SimulatedView out;
  const Sensor& sensor = *planned.sensor;
  out.T_world_view_true = planned.T_world_view;
  out.view = {planned.name, planned.sensor_id, sensor, RangeImage(width(sensor), height(sensor)),
              with_error(planned.T_world_view, effects, CounterRng(seed, Stream::kPose, view_index))};
  out.true_range = RangeImage(width(sensor), height(sensor));
  if (effects.noise.intensity_power > 0) out.view.intensity = Image<std::uint8_t>(width(sensor), height(sensor), 0);
  if (effects.exposure_sigma > 0)
    out.exposure_gain = std::exp(effects.exposure_sigma * CounterRng(seed, Stream::kExposure, view_index).gaussian(0));

  const Isometry3d T_mesh_view = Eigen::Translation3d(-caster.scene().mesh.origin_m) * planned.T_world_view;
  const RayGenerator ray_of(sensor, T_mesh_view);
  HitImage image = cast_image(caster, sensor, ray_of, rows);
  const RangeMeasurement measurement(caster, effects, ray_of, image, seed, view_index);
  rows(out.true_range.height, [&](int v) {
    for (int u = 0; u < out.true_range.width; ++u) {
      out.true_range.at(u, v) = measurement.true_range(u, v);
      out.view.range.at(u, v) = measurement.measured_range(u, v);
      if (!out.view.intensity.pixels.empty()) out.view.intensity.at(u, v) = measurement.intensity(u, v);
    }
  });
  if (!planned.color) return out;

  const ColorSource& color = *planned.color;
  const RayGenerator color_ray_of(color.camera, T_mesh_view * color.T_view_color);
  if (!color.T_view_color.isApprox(Isometry3d::Identity(), 1e-15) || !are_same(color.camera, sensor))
    image = cast_image(caster, color.camera, color_ray_of, rows);
  const Photograph photograph(caster, color_ray_of, image, float(out.exposure_gain));
  out.color = ColorImage(image.hits.width, image.hits.height);
  rows(out.color.height, [&](int v) {
    for (int u = 0; u < out.color.width; ++u) out.color.at(u, v) = photograph.color(u, v);
  });
  return out;
}

}  // namespace
}  // namespace simulation

struct Simulator::Impl {
  Impl(const SimulatedScene& scene, std::uint64_t view_seed, Context& context, bool has_color)
      : caster(scene, context, has_color), seed(view_seed) {}
  simulation::RayCaster caster;
  std::uint64_t seed;
};

Simulator::Simulator(const SimulatedScene& scene, std::uint64_t seed, Context& context, bool has_color) {
  check_mesh(scene.mesh);
  if (scene.mesh.triangles.empty()) throw InvalidInput({}, scene.name, "triangles", "the scene has none");
  if (!scene.triangle_material.empty() && scene.triangle_material.size() != scene.mesh.triangle_count())
    throw InvalidInput({}, scene.name, "triangle_material", "must have one entry per triangle");
  for (const std::uint32_t m : scene.triangle_material)
    if (m != kInvalidIndex && m >= scene.materials.size())
      throw InvalidInput({}, scene.name, "triangle_material", "names a material that is not there");
  impl_ = std::make_unique<Impl>(scene, seed, context, has_color);
}

Simulator::~Simulator() = default;

SimulatedView Simulator::simulate(const ViewSource& planned, std::uint32_t view_index, const SensorEffects& effects,
                                  Context& context) const {
  const simulation::RowLoop rows = [&](int count, const std::function<void(int)>& body) {
    parallel_for(context, std::size_t(count), 4, [&](std::size_t row) { body(int(row)); });
  };
  return simulation::simulate_view(impl_->caster, impl_->seed, planned, view_index, effects, rows);
}

SimulatedView Simulator::simulate_serially(const ViewSource& planned, std::uint32_t view_index,
                                           const SensorEffects& effects) const {
  const simulation::RowLoop rows = [](int count, const std::function<void(int)>& body) {
    for (int row = 0; row < count; ++row) body(row);
  };
  return simulation::simulate_view(impl_->caster, impl_->seed, planned, view_index, effects, rows);
}

std::vector<SimulatedView> simulate_views(const SimulatedScene& scene, const std::vector<ViewSource>& planned,
                                          const SensorEffects& effects, std::uint64_t seed, Context& context) {
  const bool has_color =
      std::any_of(planned.begin(), planned.end(), [](const auto& view) { return view.color.has_value(); });
  const Simulator simulator(scene, seed, context, has_color);
  StageScope stage(context, "simulate", planned.size());
  std::vector<SimulatedView> views;
  for (std::size_t i = 0; i < planned.size(); ++i) {
    views.push_back(simulator.simulate(planned[i], std::uint32_t(i), effects, context));
    stage.advance();
  }
  return views;
}

}  // namespace lapseam
