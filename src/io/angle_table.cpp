#include "io/angle_table.h"

#include <array>
#include <charconv>
#include <cmath>
#include <numbers>

#include "lapseam/sensor.h"

namespace lapseam {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

/// Edges half a step outside the first and the last centre, in degrees; limits are mostly round numbers there.
std::pair<double, double> outer_edges_deg(const std::vector<double>& angles_rad) {
  const double first = angles_rad.front(), last = angles_rad.back();
  const double half_step = (last - first) / double(angles_rad.size() - 1) / 2;
  const auto round_up = [](double angle_rad) {
    const double angle_deg = angle_rad / kRadPerDeg;
    const double rounded = std::round(angle_deg * 1e9) / 1e9;
    return rounded == 0 ? 0.0 : rounded;  // no −0
  };
  return {round_up(first - half_step), round_up(last + half_step)};
}

double max_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
  return largest;
}

}  // namespace

std::vector<double> angles_between(double begin, double end, int count) {
  return SphericalSensor::from_limits(count, 1, begin, end, 0.0, 1.0).azimuth_rad;
}

std::optional<std::pair<double, double>> exact_limits(const std::vector<double>& angles_rad) {
  if (angles_rad.size() < 2) return std::nullopt;
  const auto [begin_deg, end_deg] = outer_edges_deg(angles_rad);
  const std::array<std::pair<double, double>, 2> candidates{{
      {begin_deg * kRadPerDeg, end_deg * kRadPerDeg},
      {begin_deg / 180.0 * std::numbers::pi, end_deg / 180.0 * std::numbers::pi},
  }};
  for (const auto& limits : candidates)
    if (angles_between(limits.first, limits.second, int(angles_rad.size())) == angles_rad) return limits;
  return std::nullopt;
}

std::optional<std::pair<double, double>> limits_in_degrees(const std::vector<double>& angles_rad) {
  if (angles_rad.size() < 2) return std::nullopt;
  const auto limits = outer_edges_deg(angles_rad);
  const std::vector<double> uniform =
      angles_between(limits.first * kRadPerDeg, limits.second * kRadPerDeg, int(angles_rad.size()));
  if (max_difference(uniform, angles_rad) > 1e-12) return std::nullopt;
  return limits;
}

std::string to_text(const std::vector<double>& values) {
  std::string text;
  for (const double value : values) {
    char digits[32];
    const auto [end, error] = std::to_chars(digits, digits + sizeof digits, value);
    if (error != std::errc()) continue;  // 24 characters are enough for any double
    if (!text.empty()) text += ' ';
    text.append(digits, end);
  }
  return text;
}

void check_angle_table(const Source& source, const std::string& field, const std::vector<double>& angles, int count) {
  if (angles.size() != std::size_t(count))
    source.refuse(field, "has " + std::to_string(angles.size()) + " angles for " + std::to_string(count) + " samples");
  for (std::size_t i = 0; i < angles.size(); ++i) {
    if (!std::isfinite(angles[i])) source.refuse(field, "angle " + std::to_string(i) + " is not finite");
    const bool is_rising = angles.size() > 1 && angles[1] > angles[0];
    if (i > 0 && (is_rising ? !(angles[i] > angles[i - 1]) : !(angles[i] < angles[i - 1])))
      source.refuse(field, "angle " + std::to_string(i) + " does not go on in the direction of those before");
  }
}

}  // namespace lapseam
