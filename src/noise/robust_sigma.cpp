#include "noise/robust_sigma.h"

#include <algorithm>

namespace lapseam {
namespace {

// Sizes beyond this many standard deviations are edges; the medians of a normal distribution's sizes, all and below
// that.
constexpr double kEdge = 2.5, kMedianOfAll = 0.67449, kMedianBelowEdge = 0.66479;

double median_of(std::vector<float>& values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return double(*middle);
}

}  // namespace

double robust_sigma(std::vector<float>& sizes) {
  double sigma = median_of(sizes) / kMedianOfAll;
  for (int pass = 0; pass < 5; ++pass) {
    const auto limit = float(kEdge * sigma);
    std::erase_if(sizes, [&](float x) { return x > limit; });
    if (sizes.empty()) break;
    sigma = median_of(sizes) / kMedianBelowEdge;
  }
  return sigma;
}

}  // namespace lapseam
