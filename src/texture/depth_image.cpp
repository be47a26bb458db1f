#include "texture/depth_image.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lapseam {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// A crease changes the distance by some angles between neighbouring rays, as a share of it; more is a jump.
constexpr float kJump = 3;
constexpr float kTolerance = 0.02f;
constexpr float kBlur_px = 1.5f;

/// Inverse distance is linear across a plane's image (exactly so in a pinhole's z, closely in neighbouring rays of any
/// camera), so its second difference shows jumps however flatly the plane is seen.
bool is_jump(float before, float here, float after, float angle) {
  const bool some_missing = std::isinf(before) || std::isinf(here) || std::isinf(after);
  if (some_missing) return !(std::isinf(before) && std::isinf(here) && std::isinf(after));
  return std::abs(1 / before + 1 / after - 2 / here) * std::min({before, here, after}) > kJump * angle;
}

Image<std::uint8_t> find_jumps(const Image<float>& d, float angle, bool wraps) {
  Image<std::uint8_t> jumps(d.width, d.height);
  for (int v = 0; v < d.height; ++v)
    for (int u = 0; u < d.width; ++u) {
      const int left = u > 0 ? u - 1 : wraps ? d.width - 1 : u, right = u + 1 < d.width ? u + 1 : wraps ? 0 : u;
      const int above = std::max(v - 1, 0), below = std::min(v + 1, d.height - 1);
      const bool has_row = left != u && right != u, has_column = above != v && below != v;
      jumps.at(u, v) = (has_row && is_jump(d.at(left, v), d.at(u, v), d.at(right, v), angle)) ||
                       (has_column && is_jump(d.at(u, above), d.at(u, v), d.at(u, below), angle));
    }
  return jumps;
}

/// Marks everything within `radius` cells, along rows and then columns.
Image<std::uint8_t> dilate(const Image<std::uint8_t>& in, int radius) {
  Image<std::uint8_t> rows(in.width, in.height), out(in.width, in.height);
  for (int v = 0; v < in.height; ++v)
    for (int u = 0; u < in.width; ++u)
      if (in.at(u, v))
        for (int k = std::max(0, u - radius); k <= std::min(in.width - 1, u + radius); ++k) rows.at(k, v) = 1;
  for (int v = 0; v < in.height; ++v)
    for (int k = std::max(0, v - radius); k <= std::min(in.height - 1, v + radius); ++k)
      for (int u = 0; u < in.width; ++u) out.at(u, v) |= rows.at(u, k);
  return out;
}

float median_distance(const Image<float>& distance_m) {
  std::vector<float> known;
  for (const float d : distance_m.pixels)
    if (!std::isinf(d)) known.push_back(d);
  if (known.empty()) return 1;
  const auto middle = known.begin() + std::ptrdiff_t(known.size() / 2);
  std::nth_element(known.begin(), middle, known.end());
  return *middle;
}

}  // namespace

std::uint8_t DepthImage::step_at(const Eigen::Vector2f& pixel) const {
  const int u = std::clamp(cell(pixel.x()), 0, distance_m.width - 1);
  const int v = std::clamp(cell(pixel.y()), 0, distance_m.height - 1);
  return is_near_step.at(u, v);
}

bool DepthImage::is_visible(const Eigen::Vector2f& pixel, float distance) const {
  // The farthest of the four around it, so that flatly seen surfaces hide nothing of themselves.
  const float x = (pixel.x() + 0.5f) / float(stride) - 0.5f, y = (pixel.y() + 0.5f) / float(stride) - 0.5f;
  float farthest = 0;
  for (int v = int(std::floor(y)); v <= int(std::floor(y)) + 1; ++v)
    for (int u = int(std::floor(x)); u <= int(std::floor(x)) + 1; ++u)
      farthest = std::max(
          farthest, distance_m.at(std::clamp(u, 0, distance_m.width - 1), std::clamp(v, 0, distance_m.height - 1)));
  return distance <= farthest * (1 + kTolerance);
}

bool DepthImage::is_hidden(const Eigen::Vector2f& pixel, float distance) const {
  if (!is_visible(pixel, distance)) return true;
  const int u = std::clamp(cell(pixel.x()), 0, distance_m.width - 1);
  const int v = std::clamp(cell(pixel.y()), 0, distance_m.height - 1);
  return is_near_step.at(u, v) != 0 && distance > distance_m.at(u, v) * (1 + kTolerance);
}

DepthImage render_depth(const ColorCamera& camera, const RayScene& scene, int stride) {
  DepthImage out;
  out.stride = stride;
  out.distance_m = Image<float>((camera.width() + stride - 1) / stride, (camera.height() + stride - 1) / stride);
  for (int v = 0; v < out.distance_m.height; ++v)
    for (int u = 0; u < out.distance_m.width; ++u) {
      const float half = 0.5f * float(stride) - 0.5f;
      const Eigen::Vector2f pixel(std::min(float(u * stride) + half, float(camera.width() - 1)),
                                  std::min(float(v * stride) + half, float(camera.height() - 1)));
      const RayHit hit = scene.cast(camera.ray_origin(pixel), camera.ray_direction(pixel));
      out.distance_m.at(u, v) = hit ? hit.t : kInfinity;
    }
  const Eigen::Vector2f middle(0.5f * float(camera.width()), 0.5f * float(camera.height()));
  out.angle_rad = (camera.ray_direction(middle) - camera.ray_direction(middle + Eigen::Vector2f(1, 0))).norm();
  out.pixel_m = std::max(out.angle_rad * median_distance(out.distance_m), 1e-9f);
  return out;
}

void mark_fringes(DepthImage& depth, bool wraps, double displacement_px) {
  const float fringe_px = kBlur_px + std::min(float(displacement_px), kMostDisplacement_px);
  // A jump is marked on both of its sides already.
  const int radius = std::max(0, int(std::ceil(fringe_px / float(depth.stride))) - 1);
  depth.fringe_px = (radius + 1) * depth.stride;
  depth.is_near_step = dilate(find_jumps(depth.distance_m, depth.angle_rad * float(depth.stride), wraps), radius);
}

int choose_stride(std::uint64_t pixels, std::uint64_t pixels_of_all_cameras) {
  constexpr std::uint64_t kMostInOne = 1'000'000, kMostInAll = 40'000'000;
  int stride = 2;
  const auto reduced = [&](std::uint64_t n) { return n / std::uint64_t(stride) / std::uint64_t(stride); };
  while (reduced(pixels) > kMostInOne || reduced(pixels_of_all_cameras) > kMostInAll) ++stride;
  return stride;
}

}  // namespace lapseam
