#include "io/rigid.h"

#include <Eigen/SVD>
#include <cmath>
#include <cstdio>

namespace lapseam {
namespace {

constexpr double kRounding = 1e-12;

std::string format(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

/// What is wrong with a matrix that is no rotation, in the user's words.
std::string describe_defect(const Eigen::Matrix3d& rotation, double tolerance) {
  const Eigen::Vector3d lengths = rotation.colwise().norm();
  if (lengths.minCoeff() < tolerance) return "the rotation part has a zero column";
  const double spread = lengths.maxCoeff() - lengths.minCoeff();
  if (spread > tolerance) {
    return "the columns of the rotation part have lengths " + format(lengths[0]) + ", " + format(lengths[1]) + ", " +
           format(lengths[2]) + ", not 1: not a rigid motion";
  }
  if (std::abs(lengths[0] - 1) > tolerance / 2)
    return "contains a scale of " + format(lengths.mean()) + "; a pose must be rigid (see unit_m for units)";
  return "contains a shear; a pose must be rigid";
}

}  // namespace

Eigen::Isometry3d to_rigid(const Eigen::Matrix4d& matrix, const Source& source, const std::string& field,
                           double tolerance) {
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      if (std::isfinite(matrix(row, column))) continue;
      source.refuse(field, "row " + std::to_string(row) + ", column " + std::to_string(column) + " is not finite");
    }
  }
  if ((matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > 1e-9)
    source.refuse(field, "the last row must be 0 0 0 1");

  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = matrix.topRightCorner<3, 1>();
  Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
  const double deviation = (rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  // RᵀR doubles a deviation of R.
  if (!(deviation <= 2 * tolerance)) source.refuse(field, describe_defect(rotation, tolerance));
  if (rotation.determinant() < 0) source.refuse(field, "contains a reflection (determinant -1); a pose must be rigid");
  if (deviation > kRounding) {
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(rotation, Eigen::ComputeFullU | Eigen::ComputeFullV);
    rotation = svd.matrixU() * svd.matrixV().transpose();
  }
  pose.linear() = rotation;
  return pose;
}

}  // namespace lapseam
