#include "noise/fit_noise.h"

#include <gtest/gtest.h>

#include <functional>
#include <vector>

namespace lapseam {
namespace {

std::vector<NoiseBin> bins_of(const std::function<double(double)>& sigma, double from, double to) {
  std::vector<NoiseBin> bins;
  for (int i = 0; i < 20; ++i) {
    const double r = from + (to - from) * i / 19;
    bins.push_back({r, sigma(r), 5000});
  }
  return bins;
}

TEST(FitNoise, ConstantStaysConstant) {
  const NoiseModel fit = fit_noise(bins_of([](double) { return 0.002; }, 1, 5));
  EXPECT_NEAR(fit.s0_m, 0.002, 1e-9);
  EXPECT_EQ(fit.s1, 0);
  EXPECT_EQ(fit.s2_per_m, 0);
}

TEST(FitNoise, OneBinIsEnough) {
  const std::vector<NoiseBin> one = {{2.0, 0.003, 400}};
  EXPECT_NEAR(fit_noise(one).sigma(2.0), 0.003, 1e-9);
}

TEST(FitNoise, ParabolaWithItsBottomInFront) {
  const auto truth = [](double r) { return 0.0012 + 0.0019 * (r - 0.4) * (r - 0.4); };
  const NoiseModel fit = fit_noise(bins_of(truth, 0.5, 4.4));
  for (double r = 0.5; r < 4.4; r += 0.1) EXPECT_NEAR(fit.sigma(r) / truth(r), 1, 0.08) << r;
}

TEST(FitNoise, FallingNoiseIsNotExtrapolatedBelowZero) {
  const NoiseModel fit = fit_noise(bins_of([](double r) { return 0.005 - 0.001 * r; }, 1, 4));
  for (const double r : {0.0, 1.0, 4.0, 10.0, 100.0}) EXPECT_GT(fit.sigma(r), 0) << r;
}

TEST(FitNoise, DoesNotFallWithRange) {
  for (const auto& shape : {std::function<double(double)>([](double r) { return 1e-3 * r; }),
                            std::function<double(double)>([](double r) { return 1e-3 * r * r; }),
                            std::function<double(double)>([](double r) { return 1e-3 + 1e-4 * r * r; })}) {
    const NoiseModel fit = fit_noise(bins_of(shape, 0.7, 6));
    for (double r = 0.7; r < 20; r += 0.3) EXPECT_LE(fit.sigma(r), fit.sigma(r + 0.3));
    for (double r = 0.7; r < 6; r += 0.3) EXPECT_NEAR(fit.sigma(r) / shape(r), 1, 0.05);
  }
}

}  // namespace
}  // namespace lapseam
