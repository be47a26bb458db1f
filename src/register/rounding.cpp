#include "register/rounding.h"

#include <algorithm>

#include "core/parallel.h"

namespace lapseam {
namespace {

std::vector<float> values_of(const RangeImage& range) {
  std::vector<float> out;
  float last = 0;
  for (const float r : range.pixels) {
    if (r > 0 && r != last) out.push_back(r);
    last = r;
  }
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

float halfway(float a, float b) { return 2 * a * b / (a + b); }

}  // namespace

std::vector<float> range_values(std::span<const View* const> views, Context& context) {
  std::vector<std::vector<float>> of_view(views.size());
  parallel_for(context, views.size(), 1, [&](std::size_t i) { of_view[i] = values_of(views[i]->range); });
  std::vector<float> out, merged;
  for (const std::vector<float>& values : of_view) {
    merged.clear();
    std::set_union(out.begin(), out.end(), values.begin(), values.end(), std::back_inserter(merged));
    std::swap(out, merged);
  }
  return out;
}

RangeImage within_rounding(const RangeImage& given, const RangeImage& smoothed, std::span<const float> values) {
  RangeImage out = given;
  for (std::size_t i = 0; i < given.size(); ++i) {
    const float r = given.pixels[i];
    if (!(r > 0) || !(smoothed.pixels[i] > 0)) continue;
    const auto at = std::lower_bound(values.begin(), values.end(), r);
    if (at == values.end() || *at != r) continue;
    const float low = at == values.begin() ? r : halfway(*(at - 1), r);
    const float high = at + 1 == values.end() ? r : halfway(r, *(at + 1));
    out.pixels[i] = std::clamp(smoothed.pixels[i], low, high);
  }
  return out;
}

}  // namespace lapseam
