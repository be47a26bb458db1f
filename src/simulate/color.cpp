#include "simulate/color.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace lapseam::simulation {
namespace {

constexpr int kTableSize = 16384;

std::array<float, 256> linear_table() {
  std::array<float, 256> table{};
  for (int i = 0; i < 256; ++i) {
    const double s = i / 255.0;
    table[std::size_t(i)] = float(s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4));
  }
  return table;
}

std::array<std::uint8_t, kTableSize> srgb_table() {
  std::array<std::uint8_t, kTableSize> table{};
  for (int i = 0; i < kTableSize; ++i) {
    const double l = double(i) / (kTableSize - 1);
    const double s = l <= 0.0031308 ? 12.92 * l : 1.055 * std::pow(l, 1.0 / 2.4) - 0.055;
    table[std::size_t(i)] = std::uint8_t(std::lround(255.0 * s));
  }
  return table;
}

std::uint8_t encode(float linear) {
  static const auto table = srgb_table();
  return table[std::size_t(std::clamp(linear, 0.0f, 1.0f) * float(kTableSize - 1) + 0.5f)];
}

}  // namespace

float to_linear(std::uint8_t srgb) {
  static const auto table = linear_table();
  return table[srgb];
}

Eigen::Vector3f to_linear(Rgb8 color) { return {to_linear(color.r), to_linear(color.g), to_linear(color.b)}; }

Rgb8 to_srgb(const Eigen::Vector3f& linear) { return {encode(linear.x()), encode(linear.y()), encode(linear.z())}; }

}  // namespace lapseam::simulation
