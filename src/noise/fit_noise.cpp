#include "noise/fit_noise.h"

#include <Eigen/Dense>
#include <algorithm>
#include <limits>
#include <vector>

namespace lapseam {
namespace {

// The relative error of a bin: chance (a median absolute deviation of n values is off by 1.17/√n of itself, and
// filtered neighbours are not independent), and how far the shape of real noise is from a parabola.
constexpr double kChance = 1.8, kShape = 0.03;
// A bin this many standard errors off the first fit counts half in the second: a corner or an edge fills it.
constexpr double kHalfWeight = 3;

// What another term must explain, in squared standard errors.
constexpr double kCostPerTerm = 6;

// Coefficients of 1, (r − pivot), (r − pivot)², none negative.
struct Parabola {
  double pivot = 0;
  Eigen::Vector3d coefficients = Eigen::Vector3d::Zero();
  double cost = std::numeric_limits<double>::infinity();
};

// Least squares with the terms of a bit mask; no fit if one comes out negative. Over all masks this is non-negative
// least squares, and of so few terms the simplest way to it.
Parabola fit_terms(std::span<const NoiseBin> bins, std::span<const double> weights, double pivot, unsigned mask) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Identity() * 1e-12;
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  // Scaled to the farthest range, so that the terms are of one size.
  const double scale = bins.back().range_m;
  const auto row_of = [&](const NoiseBin& bin) {
    const double t = (bin.range_m - pivot) / scale;
    const Eigen::Vector3d all(1, t, t * t);
    return Eigen::Vector3d((mask & 1) ? all[0] : 0, (mask & 2) ? all[1] : 0, (mask & 4) ? all[2] : 0);
  };
  for (std::size_t i = 0; i < bins.size(); ++i) {
    const Eigen::Vector3d row = row_of(bins[i]) / bins[i].sigma_m;
    normal += weights[i] * row * row.transpose();
    right += weights[i] * row;
  }
  Parabola fit;
  fit.pivot = pivot;
  const Eigen::Vector3d solution = normal.ldlt().solve(right);
  if (!(solution.minCoeff() >= -1e-15)) return fit;
  double cost = 0;
  int terms = 0;
  for (std::size_t i = 0; i < bins.size(); ++i) {
    const double error = row_of(bins[i]).dot(solution) / bins[i].sigma_m - 1;
    cost += weights[i] * error * error;
  }
  for (int k = 0; k < 3; ++k) terms += int(mask >> k) & 1;
  fit.coefficients = {std::max(0.0, solution[0]), std::max(0.0, solution[1]) / scale,
                      std::max(0.0, solution[2]) / (scale * scale)};
  fit.cost = cost + kCostPerTerm * terms;
  return fit;
}

NoiseModel expand(const Parabola& p) {
  const double c0 = p.coefficients[0], c1 = p.coefficients[1], c2 = p.coefficients[2];
  return {c0 - c1 * p.pivot + c2 * p.pivot * p.pivot, c1 - 2 * c2 * p.pivot, c2};
}

NoiseModel fit_weighted(std::span<const NoiseBin> bins, std::span<const double> weights) {
  Parabola best;
  // A pivot above zero lets the parabola's bottom lie where the sensor begins to see. It has to earn its place.
  const double nearest = bins.front().range_m;
  for (const double pivot : {0.0, 0.5 * nearest, nearest})
    for (unsigned mask = 1; mask < 8; ++mask) {
      Parabola fit = fit_terms(bins, weights, pivot, mask);
      if (pivot > 0) fit.cost += 0.5 * kCostPerTerm;
      const bool is_positive_at_zero = fit.pivot == 0 || expand(fit).s0_m > 0;
      if (is_positive_at_zero && fit.cost < best.cost) best = fit;
    }
  return expand(best);
}

}  // namespace

NoiseModel fit_noise(std::span<const NoiseBin> bins) {
  std::vector<double> weights;
  for (const NoiseBin& bin : bins) weights.push_back(1 / (kChance * kChance / bin.samples + kShape * kShape));
  const NoiseModel first = fit_weighted(bins, weights);
  for (std::size_t i = 0; i < bins.size(); ++i) {
    const double error = first.sigma(bins[i].range_m) / bins[i].sigma_m - 1;
    weights[i] /= 1 + weights[i] * error * error / (kHalfWeight * kHalfWeight);
  }
  return fit_weighted(bins, weights);
}

}  // namespace lapseam
