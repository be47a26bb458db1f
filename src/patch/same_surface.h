#pragma once

// What every stage that compares a surface with a view's ranges takes for granted.

namespace lapseam {

/// 81°: where a view looks along a surface more than this, its ranges say nothing of a distance along the normal.
inline constexpr float kGrazingCosine = 0.15f;
/// The registration error is a median: twice as much covers most of what two views part by.
inline constexpr float kRegistrationFactor = 2.0f;

}  // namespace lapseam
