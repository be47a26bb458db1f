#include "sew/model_in_view.h"

namespace lapseam {
namespace {

// Beyond the outline's triangles a face must agree with the nearest sample to this share of the tolerance: about a
// standard deviation. With all of it, faces lean out over steps.
constexpr float kFootprintTolerance = 0.4f;

}  // namespace

ModelInView::ModelInView(const GrownModel& grown, std::uint32_t index, const Image<std::uint8_t>& wanted_samples,
                         int shift, bool is_all_in_focus)
    : model(grown),
      patch(grown.patches[index]),
      wanted(wanted_samples),
      canvas(patch, grown.mesh.origin_m, grown.options, shift),
      width(canvas.width()),
      height(canvas.height()),
      sample(width, height, 0),
      cell(width, height, 0),
      focus_(width / kTile_px + 1, height / kTile_px + 1, is_all_in_focus) {
  const std::size_t middle = patch.rays->directions.size() / 2;
  pixel_angle_ = (patch.rays->directions[middle].normalized() - patch.rays->directions[middle + 1].normalized()).norm();
  find_depth_blocks();
}

void ModelInView::focus_on_nothing() { std::fill(focus_.pixels.begin(), focus_.pixels.end(), std::uint8_t(0)); }

void ModelInView::focus_around(float u, float v, float radius_px) {
  const auto tile = [](float x, int size) { return std::clamp(int(x), 0, size - 1) / kTile_px; };
  for (int y = tile(v - radius_px, height); y <= tile(v + radius_px, height); ++y)
    for (int x = tile(u - radius_px, width); x <= tile(u + radius_px, width); ++x) focus_.at(x, y) = 1;
}

bool ModelInView::focus_on_wanted() {
  Image<std::uint8_t> has(focus_.width, focus_.height, 0);
  bool any = false;
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u)
      if (wanted.pixels[canvas.pixel(u, v)]) has.at(u / kTile_px, v / kTile_px) = any = true;
  for (int y = 0; y < has.height; ++y)
    for (int x = 0; x < has.width; ++x)
      if (has.at(x, y))
        for (int j = std::max(0, y - 1); j <= std::min(has.height - 1, y + 1); ++j)
          for (int i = std::max(0, x - 1); i <= std::min(has.width - 1, x + 1); ++i) focus_.at(i, j) = 1;
  return any;
}

bool ModelInView::is_in_focus(float u_low, float u_high, float v_low, float v_high) const {
  const auto tile = [](float x, int size) { return std::clamp(int(std::floor(x)), 0, size - 1) / kTile_px; };
  for (int v = tile(v_low, height); v <= tile(v_high, height); ++v)
    for (int u = tile(u_low, width); u <= tile(u_high, width); ++u)
      if (focus_.at(u, v)) return true;
  return false;
}

float ModelInView::pixel_size_m(const CanvasPoint& at) const {
  const int u = std::clamp(int(at.u), 0, width - 2), v = std::clamp(int(at.v), 0, height - 1);
  const std::size_t a = canvas.pixel(u, v), b = canvas.pixel(u + 1, v);
  return (patch.rays->point(a, at.r) - patch.rays->point(b, at.r)).norm();
}

float ModelInView::bulge_of(float extent_px) const {
  if (canvas.is_pinhole() || !canvas.is_central() || extent_px < 4) return 0;
  return 0.25f * extent_px * extent_px * pixel_angle_;
}

bool ModelInView::passes_through(const std::array<Eigen::Vector3f, 3>& corner, const Eigen::Vector3f& ray) {
  const float s0 = ray.dot(corner[0].cross(corner[1])), s1 = ray.dot(corner[1].cross(corner[2])),
              s2 = ray.dot(corner[2].cross(corner[0]));
  return (s0 >= 0 && s1 >= 0 && s2 >= 0) || (s0 <= 0 && s1 <= 0 && s2 <= 0);
}

void ModelInView::find_depth_blocks() {
  depth_ = Image<DepthBlock>(width / kDepthBlock_px + 1, height / kDepthBlock_px + 1);
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) {
      const std::size_t pixel = canvas.pixel(u, v);
      const float r = patch.view.range.pixels[pixel];
      if (!(r > 0)) continue;
      DepthBlock& block = depth_.at(u / kDepthBlock_px, v / kDepthBlock_px);
      block.low = std::min(block.low, r);
      block.high = std::max(block.high, r);
    }
  for (DepthBlock& block : depth_.pixels) {
    const float slack = kShadowFactor * canvas.largest_tolerance(block.high, 0);
    block.low -= slack;
    block.high += slack;
  }
}

bool ModelInView::is_at_measured_depth(int u0, int u1, int v0, int v1, float low_r, float high_r, float error_m) const {
  const float slack = kShadowFactor * canvas.largest_tolerance(0, error_m);
  for (int v = v0 / kDepthBlock_px; v <= v1 / kDepthBlock_px; ++v)
    for (int u = u0 / kDepthBlock_px; u <= u1 / kDepthBlock_px; ++u) {
      const DepthBlock& block = depth_.at(u, v);
      if (low_r <= block.high + slack && high_r >= block.low - slack) return true;
    }
  return false;
}

bool ModelInView::is_surface(float u, float v, float range, float error_m) const {
  const int x = int(std::floor(u)), y = int(std::floor(v));
  if (!is_cell_in(x, y)) return false;
  if (cell.at(x, y) & kBlocked) return false;
  const float s = u - float(x), t = v - float(y);
  const bool is_anti = (grid_cell(x, y) & PatchGrid::kAntiDiagonal) != 0;
  const int slot = is_anti ? (s + t > 1 ? 1 : 0) : (s > t ? 1 : 0);
  if (!exists(x, y, slot)) return is_in_footprint(u, v, range, error_m);
  const auto at = [&](int i, int j) { return patch.view.range.pixels[canvas.pixel(x + i, y + j)]; };
  float measured;
  if (is_anti)
    measured = slot == 0 ? at(0, 0) + s * (at(1, 0) - at(0, 0)) + t * (at(0, 1) - at(0, 0))
                         : at(1, 1) + (1 - s) * (at(0, 1) - at(1, 1)) + (1 - t) * (at(1, 0) - at(1, 1));
  else
    measured = slot == 0 ? at(0, 0) + s * (at(1, 1) - at(0, 1)) + t * (at(0, 1) - at(0, 0))
                         : at(0, 0) + s * (at(1, 0) - at(0, 0)) + t * (at(1, 1) - at(1, 0));
  const int nx = x + (s > 0.5f ? 1 : 0), ny = y + (t > 0.5f ? 1 : 0);
  const std::size_t nearest = canvas.has_sample(nx, ny) ? canvas.pixel(nx, ny) : canvas.pixel(x, y);
  const float slope = std::max({std::abs(at(1, 0) - at(0, 0)), std::abs(at(0, 1) - at(0, 0)),
                                std::abs(at(1, 1) - at(0, 1)), std::abs(at(1, 1) - at(1, 0))});
  const float slack = exists(x, y, 0) && exists(x, y, 1) ? slope : 0.0f;
  return std::abs(measured - range) <= canvas.tolerance(nearest, error_m) + slack;
}

// Beyond the triangles of the outline: a sample stands for half a spacing around it.
bool ModelInView::is_in_footprint(float u, float v, float range, float error_m) const {
  const int x = int(std::lround(u)), y = int(std::lround(v));
  if (!canvas.has_sample(x, y)) return false;
  const std::size_t nearest = canvas.pixel(x, y);
  return std::abs(patch.view.range.pixels[nearest] - range) <= kFootprintTolerance * canvas.tolerance(nearest, error_m);
}

}  // namespace lapseam
