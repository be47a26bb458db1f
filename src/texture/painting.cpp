#include "texture/painting.h"

#include <algorithm>
#include <cmath>

namespace lapseam {
namespace {

// A fringe is replaced by pixels that are at most this far; beyond, there is nothing better than it.
constexpr int kFarthestReplacement_px = 12;

constexpr std::array<std::pair<int, int>, 8> kAround = {
    {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {-1, 1}, {1, -1}, {-1, -1}}};

Rgb8 pixel_of(const ColorImage& image, int u, int v, bool wraps) {
  u = wraps ? (u % image.width + image.width) % image.width : std::clamp(u, 0, image.width - 1);
  return image.at(u, std::clamp(v, 0, image.height - 1));
}

Eigen::Vector3f to_vector(Rgb8 c) { return {float(c.r), float(c.g), float(c.b)}; }

Rgb8 to_rgb8(const Eigen::Vector3f& color) {
  const auto channel = [](float x) { return std::uint8_t(std::clamp(x, 0.0f, 255.0f) + 0.5f); };
  return {channel(color.x()), channel(color.y()), channel(color.z())};
}

Rgb8 sample_bilinear(const ColorImage& image, const Eigen::Vector2f& at, bool wraps) {
  const float u = std::floor(at.x()), v = std::floor(at.y()), fu = at.x() - u, fv = at.y() - v;
  const auto pixel = [&](int du, int dv) { return to_vector(pixel_of(image, int(u) + du, int(v) + dv, wraps)); };
  return to_rgb8((1 - fv) * ((1 - fu) * pixel(0, 0) + fu * pixel(1, 0)) +
                 fv * ((1 - fu) * pixel(0, 1) + fu * pixel(1, 1)));
}

/// Mean over the rectangle of the image that a smaller pixel stands for.
Rgb8 sample_area(const ColorImage& image, const Eigen::Vector2f& middle, float size_px, bool wraps) {
  const Eigen::Vector2f from = middle.array() - 0.5f * size_px + 0.5f, to = from.array() + size_px;  // edges of pixels
  Eigen::Vector3f sum = Eigen::Vector3f::Zero();
  float weights = 0;
  for (int v = int(std::floor(from.y())); float(v) < to.y(); ++v)
    for (int u = int(std::floor(from.x())); float(u) < to.x(); ++u) {
      const float w = (std::min(to.x(), float(u + 1)) - std::max(from.x(), float(u))) *
                      (std::min(to.y(), float(v + 1)) - std::max(from.y(), float(v)));
      sum += w * to_vector(pixel_of(image, u, v, wraps));
      weights += w;
    }
  return to_rgb8(sum / weights);
}

Rgb8 sample(const ColorImage& image, const Chart& chart, const Eigen::Vector2f& at, bool wraps) {
  return chart.scale < 1 ? sample_area(image, at, 1 / chart.scale, wraps) : sample_bilinear(image, at, wraps);
}

template <typename Visit>
void for_owned_pixels(const Chart& chart, const Visit& visit) {
  for (int y = 0; y < chart.shape.height * kBlock_px; ++y)
    for (int x = 0; x < chart.shape.width * kBlock_px; ++x)
      if (chart.owns(x, y)) visit(x, y);
}

/// Visits the pixels of a chart in the order of their distance (by steps to one of eight neighbours) from those where
/// is_source says so, up to `farthest`: visit(x, y, from_x, from_y), from being a neighbour visited before.
template <typename IsSource, typename Visit>
void spread(const Chart& chart, int farthest, const IsSource& is_source, const Visit& visit) {
  const int width = chart.shape.width * kBlock_px, height = chart.shape.height * kBlock_px;
  Image<std::uint8_t> is_reached(width, height);
  std::vector<std::pair<int, int>> front, next;
  for_owned_pixels(chart, [&](int x, int y) {
    if (!is_source(x, y)) return;
    is_reached.at(x, y) = 1;
    front.emplace_back(x, y);
  });
  for (int steps = 1; steps <= farthest && !front.empty(); ++steps, std::swap(front, next)) {
    next.clear();
    for (const auto& [x, y] : front)
      for (const auto& [dx, dy] : kAround) {
        const int u = x + dx, v = y + dy;
        if (u < 0 || v < 0 || u >= width || v >= height || is_reached.at(u, v) || !chart.owns(u, v)) continue;
        is_reached.at(u, v) = 1;
        visit(u, v, x, y);
        next.emplace_back(u, v);
      }
  }
}

}  // namespace

void mark_used(const Charts& charts, const Chart& chart, const DepthImage* depth, UseMask& page) {
  const auto use = [&](int x, int y) -> std::uint8_t& { return page.at(chart.x0() + x, chart.y0() + y); };
  bool some_used = false;
  // A hair wider than exact, so that no rounding leaves a pixel out between two triangles.
  constexpr float kHair_px = 1e-3f;
  for (const std::uint32_t i : chart.triangles)
    for_pixels(charts.pixels[i], kHair_px, [&](int x, int y, float, float) { use(x, y) = kUsed, some_used = true; });
  if (!some_used)  // smaller than any pixel: the nearest ones
    for (const std::uint32_t i : chart.triangles)
      for (const Eigen::Vector2f& p : charts.pixels[i]) use(int(std::lround(p.x())), int(std::lround(p.y()))) = kUsed;
  if (!depth) return;
  const auto is_clean = [&](int x, int y) {
    return use(x, y) == kUsed && !depth->is_fringe(chart.to_image({float(x), float(y)}));
  };
  Image<std::uint8_t> is_clean_pixel(chart.shape.width * kBlock_px, chart.shape.height * kBlock_px);
  for_owned_pixels(chart, [&](int x, int y) { is_clean_pixel.at(x, y) = is_clean(x, y); });
  spread(
      chart, kFarthestReplacement_px, [&](int x, int y) { return is_clean_pixel.at(x, y) != 0; },
      [&](int x, int y, int, int) {
        if (use(x, y) == kUsed) use(x, y) = kFringed;
      });
}

void copy_blocks(const Mesh& mesh, const Charts& charts, const Chart& chart, const ColorImage& image,
                 const ColorCamera& camera, ColorImage& page) {
  const bool wraps = camera.wraps();
  for_owned_pixels(chart, [&](int x, int y) {
    const Eigen::Vector2f at = chart.to_image({float(x), float(y)});
    page.at(chart.x0() + x, chart.y0() + y) =
        chart.scale < 1 ? sample_area(image, at, 1 / chart.scale, wraps)
                        : pixel_of(image, int(std::lround(at.x())), int(std::lround(at.y())), wraps);
  });
  for (const float margin_px : {1.0f, 0.0f})  // what belongs to a triangle has the last word over what lies beside
    for (const std::uint32_t i : chart.triangles) {
      if (!charts.is_resampled[i]) continue;
      const Triangle& t = mesh.triangles[i];
      for_pixels(charts.pixels[i], margin_px, [&](int x, int y, float b1, float b2) {
        const Eigen::Vector3f point =
            (1 - b1 - b2) * mesh.positions_m[t[0]] + b1 * mesh.positions_m[t[1]] + b2 * mesh.positions_m[t[2]];
        Eigen::Vector2f at;
        if (camera.project(point, at)) page.at(chart.x0() + x, chart.y0() + y) = sample(image, chart, at, wraps);
      });
    }
}

void fill_unused(const Chart& chart, const UseMask& use, ColorImage& page) {
  const auto pixel = [&](int x, int y) -> Rgb8& { return page.at(chart.x0() + x, chart.y0() + y); };
  const int farthest = (chart.shape.width + chart.shape.height) * kBlock_px;
  spread(
      chart, farthest, [&](int x, int y) { return use.at(chart.x0() + x, chart.y0() + y) == kUsed; },
      [&](int x, int y, int from_x, int from_y) { pixel(x, y) = pixel(from_x, from_y); });
}

void correct_chart(const Chart& chart, const ColorResponse& response, const ColorCamera& camera,
                   const Correction& correction, ColorImage& page) {
  for_owned_pixels(chart, [&](int x, int y) {
    Rgb8& pixel = page.at(chart.x0() + x, chart.y0() + y);
    Eigen::Vector3f color = to_vector(pixel);
    color.array() *= response.factor(camera.squared_radius(chart.to_image({float(x), float(y)}))).array();
    if (!correction.empty()) color += correction.at(x, y);
    pixel = to_rgb8(color);
  });
}

}  // namespace lapseam
