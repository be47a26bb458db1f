#include "evaluate/image_difference.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace lapseam {
namespace {

constexpr int kRadius = 5;
constexpr double kPeak = 255;

using Plane = Image<double>;

double luma(Rgb8 c) { return 0.299 * double(c.r) + 0.587 * double(c.g) + 0.114 * double(c.b); }

Plane blurred(const Plane& in) {
  std::array<double, 2 * kRadius + 1> kernel{};
  double sum = 0;
  for (int k = -kRadius; k <= kRadius; ++k)
    sum += kernel[std::size_t(k + kRadius)] = std::exp(-k * k / (2 * 1.5 * 1.5));
  for (double& weight : kernel) weight /= sum;
  Plane rows(in.width, in.height), out(in.width, in.height);
  for (int v = 0; v < in.height; ++v)
    for (int u = kRadius; u < in.width - kRadius; ++u)
      for (int k = -kRadius; k <= kRadius; ++k) rows.at(u, v) += kernel[std::size_t(k + kRadius)] * in.at(u + k, v);
  for (int v = kRadius; v < in.height - kRadius; ++v)
    for (int u = kRadius; u < in.width - kRadius; ++u)
      for (int k = -kRadius; k <= kRadius; ++k) out.at(u, v) += kernel[std::size_t(k + kRadius)] * rows.at(u, v + k);
  return out;
}

Plane product(const Plane& a, const Plane& b) {
  Plane out(a.width, a.height);
  for (std::size_t i = 0; i < a.size(); ++i) out.pixels[i] = a.pixels[i] * b.pixels[i];
  return out;
}

/// Mean over the pixels whose window lies in the image and the mask.
double mean_ssim(const Plane& a, const Plane& b, const Image<std::uint8_t>& mask) {
  constexpr double kC1 = 0.01 * 0.01 * kPeak * kPeak, kC2 = 0.03 * 0.03 * kPeak * kPeak;
  Plane outside(mask.width, mask.height);
  for (std::size_t i = 0; i < mask.size(); ++i) outside.pixels[i] = mask.pixels[i] ? 0 : 1;
  const Plane missing = blurred(outside), ma = blurred(a), mb = blurred(b);
  const Plane aa = blurred(product(a, a)), bb = blurred(product(b, b)), ab = blurred(product(a, b));
  double sum = 0;
  std::uint64_t count = 0;
  for (int v = kRadius; v < mask.height - kRadius; ++v)
    for (int u = kRadius; u < mask.width - kRadius; ++u) {
      if (missing.at(u, v) > 0) continue;
      const double x = ma.at(u, v), y = mb.at(u, v);
      const double xx = aa.at(u, v) - x * x, yy = bb.at(u, v) - y * y, xy = ab.at(u, v) - x * y;
      sum += (2 * x * y + kC1) * (2 * xy + kC2) / ((x * x + y * y + kC1) * (xx + yy + kC2));
      ++count;
    }
  return count > 0 ? sum / double(count) : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

ImageDifference compare_images(const ColorImage& picture, const ColorImage& photograph,
                               const Image<std::uint8_t>& mask) {
  const auto channels = [](Rgb8 c) { return std::array<double, 3>{double(c.r), double(c.g), double(c.b)}; };
  ImageDifference out;
  double products = 0, squares = 0;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (!mask.pixels[i]) continue;
    ++out.pixels;
    const auto p = channels(picture.pixels[i]), q = channels(photograph.pixels[i]);
    for (std::size_t c = 0; c < 3; ++c) products += p[c] * q[c], squares += p[c] * p[c];
  }
  if (squares > 0) out.gain = products / squares;
  double error = 0;
  Plane a(mask.width, mask.height), b(mask.width, mask.height);
  for (std::size_t i = 0; i < mask.size(); ++i) {
    a.pixels[i] = out.gain * luma(picture.pixels[i]);
    b.pixels[i] = luma(photograph.pixels[i]);
    if (!mask.pixels[i]) continue;
    const auto p = channels(picture.pixels[i]), q = channels(photograph.pixels[i]);
    for (std::size_t c = 0; c < 3; ++c) error += (out.gain * p[c] - q[c]) * (out.gain * p[c] - q[c]);
  }
  out.psnr_db = out.pixels > 0 ? 10 * std::log10(kPeak * kPeak / (error / double(3 * out.pixels)))
                               : std::numeric_limits<double>::quiet_NaN();
  out.ssim = mean_ssim(a, b, mask);
  return out;
}

}  // namespace lapseam
