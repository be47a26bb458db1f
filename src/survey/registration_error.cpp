#include "survey/registration_error.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

constexpr std::size_t kFewestSamples = 40;
constexpr int kProbeSamples = 600;
// Median absolute value of a normal distribution.
constexpr double kMedianOfNormal = 0.67449;
// Noise is known to about a tenth, and its neighbours' share of it less well: up to here it explains what is seen.
constexpr double kNoiseSlack = 1.25;
// Standard error of a median absolute deviation of n values, times √n, of which three are allowed.
constexpr double kChance = 3 * 1.17;

}  // namespace

std::optional<double> unexplained_error(std::span<const SampleDisagreement> disagreements) {
  if (disagreements.size() < kFewestSamples) return std::nullopt;
  std::vector<double> relative, sigma;
  for (const SampleDisagreement& d : disagreements) {
    relative.push_back(std::abs(d.along_ray_m) / d.sigma_m);
    sigma.push_back(d.sigma_m * d.cosine);
  }
  const double factor = quantile(relative, 0.5) / kMedianOfNormal;
  const double explained = kNoiseSlack + kChance / std::sqrt(double(disagreements.size()));
  if (factor <= explained) return 0.0;
  return quantile(sigma, 0.5) * std::sqrt(factor * factor - 1);
}

RegistrationError summarize_registration(std::vector<double> errors_m) {
  RegistrationError out;
  out.pairs = errors_m.size();
  out.median_m = quantile(errors_m, 0.5);
  out.p90_m = quantile(errors_m, 0.9);
  return out;
}

std::vector<double> distances(const ViewComparison& found) {
  std::vector<double> out;
  out.reserve(found.disagreements.size());
  for (const SampleDisagreement& d : found.disagreements) out.push_back(std::abs(d.across_m));
  return out;
}

std::optional<PairSurvey> describe_pair(const ViewComparison& found, std::size_t samples_of_a) {
  if (found.on_surface == 0) return std::nullopt;
  PairSurvey pair;
  pair.overlap = double(found.on_surface) / double(samples_of_a);
  pair.compared = found.disagreements.size();
  std::vector<double> across, absolute = distances(found);
  for (const SampleDisagreement& d : found.disagreements) across.push_back(d.across_m);
  pair.median_m = quantile(across, 0.5);
  pair.median_absolute_m = quantile(absolute, 0.5);
  pair.p90_absolute_m = quantile(absolute, 0.9);
  return pair;
}

RegistrationError estimate_registration_error(std::span<const View> views, std::span<const NoiseModel> noise,
                                              Context& context) {
  return survey_disagreement(views, noise, context).error;
}

Disagreement survey_disagreement(std::span<const View> views, std::span<const NoiseModel> noise, Context& context) {
  if (views.size() != noise.size()) throw InvalidInput({}, {}, "noise", "not one model for each view");
  std::vector<ViewProbe> probes(views.size());
  parallel_for(context, views.size(), 1,
               [&](std::size_t i) { probes[i] = make_probe(views[i], noise[i], kProbeSamples); });
  const std::size_t n = views.size();
  std::vector<std::optional<double>> errors(n * n);
  std::vector<std::optional<PairSurvey>> pairs(n * n);
  std::vector<std::vector<double>> apart(n * n);
  parallel_for(context, n * n, 16, [&](std::size_t k) {
    const std::size_t a = k / n, b = k % n;
    if (a == b) return;
    const ViewComparison found = compare_views(probes[a], views[b], noise[b], probes[b]);
    errors[k] = unexplained_error(found.disagreements);
    pairs[k] = describe_pair(found, probes[a].samples.size());
    if (!pairs[k]) return;
    pairs[k]->a = std::uint32_t(a);
    pairs[k]->b = std::uint32_t(b);
    apart[k] = distances(found);
  });
  Disagreement out;
  std::vector<double> told, all;
  for (std::size_t k = 0; k < n * n; ++k) {
    if (errors[k]) told.push_back(*errors[k]);
    if (pairs[k]) out.pairs.push_back(*pairs[k]);
    all.insert(all.end(), apart[k].begin(), apart[k].end());
  }
  out.distance_m = quantile(all, 0.5);
  out.error = summarize_registration(std::move(told));
  return out;
}

}  // namespace lapseam
