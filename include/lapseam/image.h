#pragma once

// Plain images. Pixel (u, v) is column u, row v; row-major; pixel centres are at integers.

#include <cstddef>
#include <cstdint>
#include <vector>

namespace lapseam {

/// "No sample here." Every valid range is finite and greater than zero, so `r > 0` is the test for validity.
inline constexpr float kInvalidRange = 0.0f;

/// width × height values of T, row-major.
template <typename T>
struct Image {
  int width = 0;
  int height = 0;
  std::vector<T> pixels;

  Image() = default;
  Image(int w, int h, T fill = T{}) : width(w), height(h), pixels(std::size_t(w) * std::size_t(h), fill) {}

  std::size_t size() const { return pixels.size(); }
  bool empty() const { return pixels.empty(); }
  std::size_t index(int u, int v) const { return std::size_t(v) * std::size_t(width) + std::size_t(u); }
  T& at(int u, int v) { return pixels[index(u, v)]; }
  const T& at(int u, int v) const { return pixels[index(u, v)]; }
};

/// sRGB, 8 bits a channel.
struct Rgb8 {
  std::uint8_t r = 0, g = 0, b = 0;
  friend bool operator==(const Rgb8&, const Rgb8&) = default;
};

/// Metres; the meaning of range is the sensor's (see sensor.h); kInvalidRange where nothing was measured.
using RangeImage = Image<float>;
using ColorImage = Image<Rgb8>;

}  // namespace lapseam
