#pragma once

// The angles of a spherical sensor's columns or rows: as two limits where they are uniform, else as a table.

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "io/source.h"

namespace lapseam {

/// Centres of `count` equal steps between the outer edges `begin` and `end`, by the formula of
/// SphericalSensor::from_limits.
std::vector<double> angles_between(double begin, double end, int count);

/// Edges from which angles_between gives this very table, bit for bit; nothing when there are none.
std::optional<std::pair<double, double>> exact_limits(const std::vector<double>& angles_rad);

/// Edges in degrees from which the table follows to within 1e-12 rad; nothing when it is not uniform.
std::optional<std::pair<double, double>> limits_in_degrees(const std::vector<double>& angles_rad);

/// Numbers with blanks between, each with as many digits as it takes to read it back exactly.
std::string to_text(const std::vector<double>& values);

/// Refuses a table of the wrong length, not finite, or not strictly monotone.
void check_angle_table(const Source& source, const std::string& field, const std::vector<double>& angles, int count);

}  // namespace lapseam
