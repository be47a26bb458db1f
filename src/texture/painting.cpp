#include "texture/painting.h"

#include <algorithm>
#include <cmath>

#include "texture/stretch.h"

namespace lapseam {
namespace {

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

Eigen::Vector3f sample_bilinear(const ColorImage& image, const Eigen::Vector2f& at, bool wraps) {
  const float u = std::floor(at.x()), v = std::floor(at.y()), fu = at.x() - u, fv = at.y() - v;
  const auto pixel = [&](int du, int dv) { return to_vector(pixel_of(image, int(u) + du, int(v) + dv, wraps)); };
  return (1 - fv) * ((1 - fu) * pixel(0, 0) + fu * pixel(1, 0)) + fv * ((1 - fu) * pixel(0, 1) + fu * pixel(1, 1));
}

/// Mean over the rectangle of the image that a smaller pixel stands for.
Eigen::Vector3f sample_area(const ColorImage& image, const Eigen::Vector2f& middle, float size_px, bool wraps) {
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
  return sum / weights;
}

template <typename Visit>
void for_owned_pixels(const Chart& chart, const Visit& visit) {
  for (int y = 0; y < chart.shape.height * kBlock_px; ++y)
    for (int x = 0; x < chart.shape.width * kBlock_px; ++x)
      if (chart.owns(x, y)) visit(x, y);
}

/// Visits the pixels of a chart in the order of their distance (by steps to one of eight neighbours) from those where
/// is_source says so, up to `farthest` and within what may_enter allows: visit(x, y, from_x, from_y), from being a
/// neighbour visited before.
template <typename IsSource, typename MayEnter, typename Visit>
void spread(const Chart& chart, int farthest, const IsSource& is_source, const MayEnter& may_enter,
            const Visit& visit) {
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
        if (u < 0 || v < 0 || u >= width || v >= height || is_reached.at(u, v) || !chart.owns(u, v) || !may_enter(u, v))
          continue;
        is_reached.at(u, v) = 1;
        visit(u, v, x, y);
        next.emplace_back(u, v);
      }
  }
}

/// Each of some pixels becomes the mean of those around it that are shown or among them, again and again: what has been
/// carried there runs out smoothly instead of in streaks. Images are not mixed: they are levelled later.
void soften(const Chart& chart, const std::vector<std::pair<int, int>>& some, const Image<std::uint8_t>& is_known,
            int rounds, const PartMap& map, ColorImage& page) {
  std::vector<Rgb8> next(some.size());
  for (int round = 0; round < rounds; ++round) {
    for (std::size_t i = 0; i < some.size(); ++i) {
      const auto [x, y] = some[i];
      const int part = chart.pixel(map, x, y) & kPartBits;
      Eigen::Vector3f sum = Eigen::Vector3f::Zero();
      float weights = 0;
      for (std::size_t k = 0; k < kAround.size(); ++k) {
        const int u = x + kAround[k].first, v = y + kAround[k].second;
        if (u < 0 || v < 0 || u >= is_known.width || v >= is_known.height || !is_known.at(u, v)) continue;
        if ((chart.pixel(map, u, v) & kPartBits) != part) continue;
        const float weight = k < 4 ? 2 : 1;
        sum += weight * to_vector(chart.pixel(page, u, v));
        weights += weight;
      }
      next[i] = weights > 0 ? to_rgb8(sum / weights) : chart.pixel(page, x, y);
    }
    for (std::size_t i = 0; i < some.size(); ++i) chart.pixel(page, some[i].first, some[i].second) = next[i];
  }
}

}  // namespace

Eigen::Vector3f Photograph::color_at(const Eigen::Vector2f& pixel, float size_px) const {
  const Eigen::Vector3f color =
      size_px > 1 ? sample_area(image, pixel, size_px, camera.wraps()) : sample_bilinear(image, pixel, camera.wraps());
  return color.cwiseProduct(response.factor(camera.squared_radius(pixel)));
}

namespace {

// A hair wider than exact, so that no rounding leaves a pixel out between two triangles.
constexpr float kHair_px = 1e-3f;

/// Visits the pixels whose centres lie in a triangle, visit(x, y, b1, b2, true), or where there are none, those nearest
/// to its corners, visit(…, false).
template <typename Visit>
void for_own_pixels(const std::array<Eigen::Vector2f, 3>& p, const Visit& visit) {
  bool has_some = false;
  for_pixels(p, kHair_px, [&](int x, int y, float b1, float b2) {
    has_some = true;
    visit(x, y, b1, b2, true);
  });
  for (std::size_t k = 0; k < 3 && !has_some; ++k)
    visit(int(std::lround(p[k].x())), int(std::lround(p[k].y())), k == 1 ? 1.0f : 0.0f, k == 2 ? 1.0f : 0.0f, false);
}

}  // namespace

void mark_parts(const Charts& charts, const Chart& chart, PartMap& map) {
  const auto mark = [&](std::uint32_t i) {
    for_own_pixels(charts.pixels[i], [&](int x, int y, float, float, bool is_inside) {
      std::uint16_t& pixel = chart.pixel(map, x, y);
      const auto part = std::uint16_t(charts.part_of_triangle[i] + 1);
      if (is_inside)
        pixel = part;
      else if (pixel == 0)
        pixel = part | kPaddingBit;
    });
  };
  const auto rank = [&](std::uint32_t i) {
    return is_slender(charts.pixels[i]) ? 0 : charts.view_of_triangle[i] == chart.view ? 2 : 1;
  };
  for (int pass = 0; pass < 3; ++pass)
    for (const std::uint32_t i : chart.triangles)
      if (rank(i) == pass) mark(i);
}

void paint_triangle(const Mesh& mesh, const Charts& charts, std::uint32_t triangle, const Photograph& photograph,
                    PartMap& map, ColorImage& page) {
  const Chart& chart = charts.charts[charts.chart_of_triangle[triangle]];
  const Triangle& t = mesh.triangles[triangle];
  const auto part = std::uint16_t(charts.part_of_triangle[triangle] + 1);
  for_own_pixels(charts.pixels[triangle], [&](int x, int y, float b1, float b2, bool is_inside) {
    std::uint16_t& mark = chart.pixel(map, x, y);
    if ((mark & kPartBits) != part || is_used(mark) != is_inside) return;
    const Eigen::Vector3f point =
        (1 - b1 - b2) * mesh.positions_m[t[0]] + b1 * mesh.positions_m[t[1]] + b2 * mesh.positions_m[t[2]];
    Eigen::Vector2f at = chart.to_image({float(x), float(y)});
    if (charts.is_resampled[triangle]) {
      if (!photograph.camera.project_beyond(point, at)) return;
    } else if (chart.scale == 1) {
      at = {std::round(at.x()), std::round(at.y())};  // no weight for neighbours
    }
    chart.pixel(page, x, y) = to_rgb8(photograph.color_at(at, 1 / chart.scale));
    const bool is_hidden = photograph.depth.is_hidden(at, (point - photograph.camera.ray_origin(at)).norm());
    if (is_inside && is_hidden)
      mark |= kHiddenBits;
    else if (photograph.depth.is_fringe(at))
      mark |= photograph.depth.is_foreign(at) ? kNearStepBit | kForeignBit : kNearStepBit;
  });
}

std::uint64_t fill_unused(const Chart& chart, int fringe_px, PartMap& map, ColorImage& page) {
  const auto pixel = [&](int x, int y) -> Rgb8& { return chart.pixel(page, x, y); };
  const auto mark = [&](int x, int y) -> std::uint16_t& { return chart.pixel(map, x, y); };
  std::uint64_t replaced = 0;
  Image<std::uint8_t> is_done(chart.shape.width * kBlock_px, chart.shape.height * kBlock_px);
  std::vector<std::pair<int, int>> filled;
  const auto fill_from = [&](const auto& is_source, int farthest, const auto& is_wanted) {
    for_owned_pixels(chart, [&](int x, int y) { is_done.at(x, y) |= std::uint8_t(is_source(mark(x, y))); });
    spread(
        chart, farthest, [&](int x, int y) { return is_done.at(x, y) != 0; },
        [&](int x, int y) { return is_wanted(mark(x, y)); },
        [&](int x, int y, int from_x, int from_y) {
          is_done.at(x, y) = 1;
          filled.emplace_back(x, y);
          pixel(x, y) = pixel(from_x, from_y);
          const std::uint16_t old = mark(x, y), part = mark(from_x, from_y) & kPartBits;
          replaced += is_used(old);
          if (!is_shown(old)) mark(x, y) = std::uint16_t(part | (is_used(old) ? kHiddenBits : kPaddingBit));
        });
  };
  const int all = (chart.shape.width + chart.shape.height) * kBlock_px;
  const int fringe = std::max(1, int(std::ceil(float(fringe_px) * chart.scale)));
  const auto is_clean = [](std::uint16_t m) { return is_shown(m) && !(m & kNearStepBit); };
  const auto is_any = [](std::uint16_t) { return true; };
  fill_from(is_clean, all, [](std::uint16_t m) { return (m & kForeignBit) != 0; });
  fill_from(is_clean, fringe, is_any);
  soften(chart, filled, is_done, 2 * fringe, map, page);
  fill_from(is_shown, all, is_any);
  fill_from([](std::uint16_t m) { return m != 0; }, all, is_any);  // where triangles lie between pixels
  return replaced;
}

void correct_chart(const Chart& chart, const Correction& correction, ColorImage& page) {
  for_owned_pixels(chart, [&](int x, int y) {
    Rgb8& pixel = chart.pixel(page, x, y);
    pixel = to_rgb8(to_vector(pixel) + correction.at(x, y));
  });
}

}  // namespace lapseam
