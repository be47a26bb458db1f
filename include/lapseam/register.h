#pragma once

// Registration: from roughly placed views to poses under which the views are one surface.

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "lapseam/image.h"
#include "lapseam/noise.h"
#include "lapseam/sensor.h"
#include "lapseam/view.h"

namespace lapseam {

class Context;

struct RegisterOptions {
  /// Views that stay where they are, by place; none: the first of all that are linked.
  std::vector<std::uint32_t> fixed{};
  /// Pictures on flat walls tell what geometry does not.
  bool use_color = true;
  /// How far points of one surface may be apart at first, metres; 0: a tenth of what a view sees. A view that moves
  /// farther is taken for lost.
  double capture_m = 0;
  /// Find what sensors are off by, along with the poses. Depth cameras (pinhole sensors with eight views or more)
  /// measure some parts of their images too far or too near, always alike. Scanners that turn or tilt a line of samples
  /// (spherical sensors) have lines at other angles than they say, in each scan anew.
  bool calibrate = false;
};

/// What a depth camera is off by: its inverse range is to be raised by an offset, bilinear between nodes that are
/// spread evenly over the image, from corner to corner, row by row.
struct RangeCorrection {
  int columns = 0, rows = 0;
  std::vector<double> offset_per_m{};
};
/// The range image without what the sensor is off by.
RangeImage corrected(const RangeImage& range, const RangeCorrection& correction);

/// The sensor with the azimuth of each column raised.
SphericalSensor corrected(const SphericalSensor& sensor, std::span<const double> offset_rad);

/// A view's picture, as ColorSource describes it.
struct ViewPicture {
  ColorImage image;
  Sensor camera;
  Eigen::Isometry3d T_view_color = Eigen::Isometry3d::Identity();
};
/// Called once per view, from worker threads. Empty, or nothing for a view: geometry alone.
using PictureOf = std::function<std::optional<ViewPicture>(std::size_t view)>;

enum class ViewPlacement : std::uint8_t {
  kFixed,     ///< as asked for, or the first of those that are linked
  kPlaced,    ///< moved to where it agrees best
  kUnlinked,  ///< overlaps no other view: left where it was
  kRefused,   ///< agreed less than before, or was lost: left where it was
};
const char* name_of(ViewPlacement placement);

struct PlacedView {
  Eigen::Isometry3d T_world_view = Eigen::Isometry3d::Identity();
  PoseCovariance covariance = PoseCovariance::Zero();  ///< against the fixed views; zero where nothing moved
  ViewPlacement placement = ViewPlacement::kPlaced;
  double moved_m = 0, turned_rad = 0;
  /// By how many standard deviations it pulls harder against the others, or fits less, than views of the scene do.
  double strain = 0;
  std::string problem;  ///< why it was left, or, of a view that was placed, may be wrong; empty: neither
  /// What the azimuths of a scanner's columns are to be raised by, as calibrated; empty: as they are.
  std::vector<double> line_offset_rad{};
};

/// What is to be told of a view, in a line; empty: nothing.
std::string warning_about(const std::string& name, const PlacedView& view);

/// How far apart the surfaces of two views are, along their normals, where both are smooth and within the capture
/// range.
struct PairResidual {
  double median_m = 0, p90_m = 0;  ///< of the absolute values
  std::uint64_t matches = 0;
};

struct RegisteredPair {
  std::uint32_t a = 0, b = 0;
  double overlap = 0;  ///< share of the surfels of the one that lie on the other, the larger of both
  PairResidual before, after;
  double unexplained_m = 0;  ///< standard deviation of the residuals that noise does not explain
  double tension = 0;        ///< how hard it pulls against the other pairs; 1: as noise would
  std::string problem;       ///< why it was left out; empty: it was not
};

/// A motion that nothing in the data forbids or asks for. No view was moved along it.
struct Sliding {
  std::vector<std::uint32_t> views;                       ///< that move by half of the largest motion or more
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();  ///< of the view that moves most; the larger part is 1 …
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();     ///< … this one times the radius of what the view sees
  double certainty = 0;  ///< information over what the errors of normals feign; under 4 is none
};

struct RegisterReport {
  double capture_m = 0, capture_rad = 0;  ///< how far surfaces could be apart; and at the rim of what a view sees
  double variance_factor = 1;             ///< mean tension; the covariances are multiplied by it where it is over 1
  int iterations = 0;
  std::size_t parts = 0;  ///< sets of linked views; more than one cannot be placed against each other
  std::vector<RegisteredPair> pairs;
  std::vector<Sliding> sliding;
};

struct RegisterResult {
  std::vector<PlacedView> views;
  RegisterReport report;
  std::map<std::string, RangeCorrection> corrections;  ///< by sensor id; of those that were found to need one
};

/// Moves all views at once until their surfaces agree: projective and closest-point matches, distances along normals
/// weighted by the noise, robust, coarse to fine over pyramids of the range images, all pairs in one set of normal
/// equations. Nothing gets worse: what agrees less than before stays where it was. views: loaded, not smoothed; noise:
/// one for each. Same results for any number of threads. About 0.2 s per view of 640 × 480 and core where each overlaps
/// twenty others. Throws InvalidInput when sizes differ or a fixed view does not exist.
RegisterResult register_views(std::span<const View> views, std::span<const NoiseModel> noise, const PictureOf& pictures,
                              const RegisterOptions& options, Context& context);

}  // namespace lapseam
