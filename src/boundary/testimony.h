#pragma once

// What one view says of what lies beyond an edge of a mesh.

#include <Eigen/Geometry>

#include "health/outline.h"
#include "lapseam/noise.h"
#include "lapseam/view.h"

namespace lapseam {

enum class Testimony : std::uint8_t { kNothing, kEnds, kGoesOn };

struct Statement {
  Testimony says = Testimony::kNothing;
  float error_m = 0;  ///< of the view there: what speaks for one view against another
};

/// A view that can be asked. Keeps references.
class Witness {
 public:
  Witness(const View& view, const NoiseModel& noise, const Eigen::Vector3d& mesh_origin_m, double registration_error_m);

  Statement ask(const OutlineFrame& edge) const;

 private:
  struct Tolerance;
  Tolerance tolerance_at(double range_m) const;
  bool is_on_surface(const Eigen::Vector3d& point, const Tolerance& tolerance) const;
  Testimony follow(const OutlineFrame& edge, const Tolerance& tolerance, double reach_m) const;
  Testimony look(const PixelRange& at, double drift_m, const Tolerance& tolerance) const;
  float sample(int u, int v) const;
  Eigen::Vector3d to_view(const Eigen::Vector3f& point_in_mesh) const;

  const View& view_;
  NoiseModel noise_;
  Eigen::Isometry3d T_view_mesh_;
  double registration_error_m_;
  double spacing_offset_m_, spacing_slope_;
  bool wraps_;
};

}  // namespace lapseam
