#include "mend/layers.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "patch/same_surface.h"

namespace lapseam {
namespace {

// Surfaces that face apart by more are two sides of a sheet, or meet in a crease.
constexpr double kSameLayerCosine = 0.5;
// Where views are bent against each other by more than noise and registration, their surfaces part. Two that face alike
// have the back of the upper one between them: nearer together than two samples, no view has measured that.
constexpr double kResolvedSpacings = 2;

// Weights of the corners; the middle first.
constexpr std::array<std::array<double, 3>, 4> kPlaces = {{
    {1.0 / 3, 1.0 / 3, 1.0 / 3},
    {0.6, 0.2, 0.2},
    {0.2, 0.6, 0.2},
    {0.2, 0.2, 0.6},
}};

bool share_vertex(const Triangle& a, const Triangle& b) {
  return std::any_of(a.begin(), a.end(), [&](std::uint32_t v) { return v == b[0] || v == b[1] || v == b[2]; });
}

Eigen::Vector3d place_on(const LiveMesh& mesh, const Triangle& t, const std::array<double, 3>& weights) {
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  for (std::size_t k = 0; k < 3; ++k) place += weights[k] * mesh.position(t[k]).cast<double>();
  return place;
}

float largest_of(std::span<const float> values, const Triangle& t) {
  return std::max({values[t[0]], values[t[1]], values[t[2]]});
}

}  // namespace

float Layers::error_of(const Triangle& t) const { return largest_of(resolution_.error_m, t); }

double Layers::thickness_m(const Triangle& t) const {
  const double noise =
      options_.noise_factor * double(error_of(t)) + double(kRegistrationFactor) * options_.registration_error_m;
  return std::max(noise, kResolvedSpacings * double(largest_of(resolution_.spacing_m, t)));
}

template <typename Accept>
bool Layers::lies_over(const Triangle& t, Places places, const Accept& accept) const {
  const double thickness = thickness_m(t);
  const std::size_t count = places == Places::kMiddle ? 1 : kPlaces.size();
  std::array<Eigen::Vector3d, kPlaces.size()> at;
  Box box;
  for (std::size_t i = 0; i < count; ++i) {
    at[i] = place_on(mesh_, t, kPlaces[i]);
    box.extend(at[i].cast<float>());
  }
  box.low.array() -= float(thickness);
  box.high.array() += float(thickness);
  return check_.is_any_near(box, [&](const Triangle& other) {
    if (!accept(other)) return false;
    const Eigen::Vector3d normal = mesh_.area_normal(other).stableNormalized();
    const auto corner = [&](std::size_t k) -> Eigen::Vector3d { return mesh_.position(other[k % 3]).cast<double>(); };
    return std::any_of(at.begin(), at.begin() + std::ptrdiff_t(count), [&](const Eigen::Vector3d& place) {
      if (std::abs(normal.dot(place - corner(0))) > thickness) return false;
      for (std::size_t k = 0; k < 3; ++k)
        if (normal.dot((corner(k + 1) - corner(k)).cross(place - corner(k))) < 0) return false;
      return true;
    });
  });
}

bool Layers::is_covered(const Triangle& t, Places places) const {
  const Eigen::Vector3d normal = mesh_.area_normal(t).stableNormalized();
  return lies_over(t, places, [&](const Triangle& other) {
    if (share_vertex(t, other)) return false;
    const Eigen::Vector3d n = mesh_.area_normal(other);
    return n.dot(normal) >= kSameLayerCosine * n.norm();
  });
}

bool Layers::has_surface_at(const Triangle& t) const {
  return lies_over(t, Places::kMiddle, [](const Triangle&) { return true; });
}

}  // namespace lapseam
