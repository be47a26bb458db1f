#pragma once

// From the comparisons of pairs of views to one figure for the scene.

#include <optional>
#include <span>
#include <vector>

#include "lapseam/survey.h"
#include "survey/compare_views.h"

namespace lapseam {

/// Standard deviation across the surface that noise does not explain: 0 where it does. Nothing for too few samples.
std::optional<double> unexplained_error(std::span<const SampleDisagreement> disagreements);

/// Absolute ones, across b's surface.
std::vector<double> distances(const ViewComparison& found);

/// a seen by b, indices left at 0. Nothing when no sample of a lies on b's surface.
std::optional<PairSurvey> describe_pair(const ViewComparison& found, std::size_t samples_of_a);

/// errors: one per pair of views that could be compared.
RegistrationError summarize_registration(std::vector<double> errors_m);

}  // namespace lapseam
