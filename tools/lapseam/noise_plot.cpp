#include "noise_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "core/xml.h"

namespace lapseam::tool {
namespace {

constexpr double kWidth = 720, kHeight = 480, kLeft = 80, kRight = 20, kTop = 30, kBottom = 60;
constexpr std::array kColors = {"#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf"};
constexpr int kCurvePoints = 100;

/// Logarithmic, from a value to a pixel.
struct Axis {
  double low, high, begin_px, end_px;
  double at(double value) const {
    return begin_px + (end_px - begin_px) * std::log(value / low) / std::log(high / low);
  }
  /// 1, 2, 5 × 10ⁿ.
  std::vector<double> ticks() const {
    std::vector<double> out;
    for (double decade = std::pow(10, std::floor(std::log10(low))); decade <= high; decade *= 10)
      for (const double step : {1.0, 2.0, 5.0})
        if (step * decade >= low * (1 - 1e-9) && step * decade <= high * (1 + 1e-9)) out.push_back(step * decade);
    return out;
  }
};

Axis make_axis(std::vector<double> values, double begin_px, double end_px) {
  std::erase_if(values, [](double v) { return !(v > 0) || !std::isfinite(v); });
  if (values.empty()) values = {1};
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const double margin = 1.15;  // and at least a factor of two from end to end
  const double spread = std::max(1.0, std::sqrt(2 * *low / *high));
  return {*low / margin / spread, *high * margin * spread, begin_px, end_px};
}

std::string grid(const Axis& x, const Axis& y) {
  std::string out;
  for (const double r : x.ticks())
    out += fmt::format(
        "<line x1='{0:.1f}' y1='{1}' x2='{0:.1f}' y2='{2}' class='grid'/>"
        "<text x='{0:.1f}' y='{3}' text-anchor='middle'>{4:g}</text>\n",
        x.at(r), kTop, kHeight - kBottom, kHeight - kBottom + 18, r);
  for (const double s : y.ticks())
    out += fmt::format(
        "<line x1='{1}' y1='{0:.1f}' x2='{2}' y2='{0:.1f}' class='grid'/>"
        "<text x='{3}' y='{0:.1f}' dy='4' text-anchor='end'>{4:g}</text>\n",
        y.at(s), kLeft, kWidth - kRight, kLeft - 6, 1000 * s);
  out += fmt::format("<text x='{}' y='{}' text-anchor='middle'>range, m</text>\n", 0.5 * (kLeft + kWidth - kRight),
                     kHeight - 18);
  out += fmt::format(
      "<text transform='translate(22,{}) rotate(-90)' text-anchor='middle'>noise along the ray, mm</text>\n",
      0.5 * (kTop + kHeight - kBottom));
  return out;
}

std::string curve(const NoiseModel& noise, const Axis& x, const Axis& y, const char* color, const char* dashes) {
  std::string points;
  for (int i = 0; i <= kCurvePoints; ++i) {
    const double r = x.low * std::pow(x.high / x.low, double(i) / kCurvePoints);
    points += fmt::format("{:.1f},{:.1f} ", x.at(r), std::clamp(y.at(noise.sigma(r)), kTop, kHeight - kBottom));
  }
  return fmt::format("<polyline points='{}' fill='none' stroke='{}' stroke-width='1.5'{}/>\n", points, color, dashes);
}

}  // namespace

std::string plot_noise(std::span<const SensorSurvey> sensors) {
  std::vector<double> ranges, sigmas;
  for (const SensorSurvey& sensor : sensors)
    for (const NoiseBin& bin : sensor.bins) {
      ranges.push_back(bin.range_m);
      for (const double s : {bin.sigma_m, sensor.noise.sigma(bin.range_m)}) sigmas.push_back(s);
      if (sensor.given) sigmas.push_back(sensor.given->sigma(bin.range_m));
    }
  const Axis x = make_axis(ranges, kLeft, kWidth - kRight), y = make_axis(sigmas, kHeight - kBottom, kTop);
  std::string out = fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' width='{0}' height='{1}' viewBox='0 0 {0} {1}' "
      "font-family='sans-serif' font-size='13'>\n<style>.grid {{ stroke: #ddd }}</style>\n"
      "<rect width='100%' height='100%' fill='white'/>\n",
      kWidth, kHeight);
  out += grid(x, y);
  double label_y = kTop + 18;
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    const SensorSurvey& sensor = sensors[i];
    const char* const color = kColors[i % kColors.size()];
    for (const NoiseBin& bin : sensor.bins)
      out += fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='3.5' fill='{}'/>\n", x.at(bin.range_m), y.at(bin.sigma_m),
                         color);
    out += curve(sensor.noise, x, y, color, "");
    if (sensor.given) out += curve(*sensor.given, x, y, color, " stroke-dasharray='6 4'");
    out += fmt::format("<text x='{}' y='{}' fill='{}'>{}: measured (points), fitted (line){}</text>\n", kLeft + 12,
                       label_y, color, escape_xml(sensor.sensor_id), sensor.given ? ", given (dashes)" : "");
    label_y += 18;
  }
  return out + "</svg>\n";
}

}  // namespace lapseam::tool
