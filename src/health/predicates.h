#pragma once

// Exact geometric predicates on float coordinates: rounding never gives a wrong sign.

#include <Eigen/Core>
#include <array>

namespace lapseam {

/// Sign of (b − a) × (c − a) · (d − a): +1 when d lies on the side that the normal of (a, b, c) points to.
int orient3d(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c, const Eigen::Vector3f& d);

/// Sign of (b − a) × (c − a): +1 when c lies left of a -> b.
int orient2d(const Eigen::Vector2f& a, const Eigen::Vector2f& b, const Eigen::Vector2f& c);

/// The coordinate plane in which the triangle keeps an area: 0 (yz), 1 (zx), 2 (xy), the one of the largest area if
/// rounding permits; −1 when the three points lie on one line.
int dominant_plane(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c);
inline Eigen::Vector2f drop_axis(const Eigen::Vector3f& p, int axis) { return {p[(axis + 1) % 3], p[(axis + 2) % 3]}; }

/// Do two closed triangles have a point in common? Neither may be of zero area.
bool do_triangles_meet(const std::array<Eigen::Vector3f, 3>& a, const std::array<Eigen::Vector3f, 3>& b);

/// Do the closed segment and the closed triangle have a point in common? The triangle may not be of zero area.
bool do_segment_and_triangle_meet(const Eigen::Vector3f& p, const Eigen::Vector3f& q,
                                  const std::array<Eigen::Vector3f, 3>& triangle);

}  // namespace lapseam
