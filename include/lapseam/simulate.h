#pragma once

// Scanning scenes that are known exactly: a scene, a rig of sensors, a trajectory, and what the sensors would measure.
// World frame: metres, z up. Everything follows from seeds; the same bytes come out for any number of threads, because
// each random number is a hash of (seed, view, pixel) and not a draw from a sequence.

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "lapseam/image.h"
#include "lapseam/mesh.h"
#include "lapseam/noise.h"
#include "lapseam/sensor.h"
#include "lapseam/view.h"

namespace lapseam {

class Context;

// ---- scenes

/// Procedural albedo. Flat patterns lie in the two axes of the pattern frame that the surface faces least.
enum class Pattern : std::uint8_t {
  kPlain,
  kChecker,
  kTiles,
  kPlanks,
  kWood,
  kStripes,
  kMarble,
  kText,
  kPicture,
  kWeave,
  kDots,
  kSpine
};

struct Material {
  Pattern pattern = Pattern::kPlain;
  Eigen::Vector3f color_a = Eigen::Vector3f::Constant(0.6f);  ///< linear reflectance, 0 to 1
  Eigen::Vector3f color_b = Eigen::Vector3f::Constant(0.3f);
  float scale_m = 0.1f;      ///< size of one repeat
  float glow = 0;            ///< light given off, in units of well-lit white
  bool is_specular = false;  ///< mirrors an active sensor's light away
  std::uint32_t seed = 0;
  Eigen::Isometry3f T_pattern_world = Eigen::Isometry3f::Identity();
};

/// A flat lamp, centre ± edge_u ± edge_v, that shines towards edge_u × edge_v.
struct AreaLight {
  Eigen::Vector3f center = Eigen::Vector3f::Zero(), edge_u = Eigen::Vector3f::Zero(), edge_v = Eigen::Vector3f::Zero();
  Eigen::Vector3f radiance = Eigen::Vector3f::Ones();
};

struct SimulatedScene {
  std::string name;
  /// The truth. Triangles wind counter-clockwise seen from free space.
  Mesh mesh;
  std::vector<Material> materials;
  std::vector<std::uint32_t> triangle_material;  ///< kInvalidIndex, or no entries: the mesh's own texture or colours
  std::vector<AreaLight> lights;
  float ambient = 0.35f;      ///< light from everywhere, relative to the lamps' mean
  bool is_interior = false;   ///< scanned from within (walk, stations) rather than from around (orbit, axes)
  bool is_two_sided = false;  ///< sensors see the backs of triangles too
};

struct RoomOptions {
  double width_m = 6, depth_m = 5, height_m = 2.8;  ///< along x, y, z; at least 4.5 × 4 × 2.4
  std::uint64_t seed = 1;                           ///< arrangement, books, colours
};
/// A furnished room: window recess, door, table, chairs, sofa, shelf with books, cables and rods of 5 and 10 mm, a 15
/// mm partition, vases, cushions, pictures. Throws InvalidInput for a room too small or over 60 m.
SimulatedScene make_room(const RoomOptions& options = {});
/// Within 1.3e-5 radii of the true sphere around the origin.
SimulatedScene make_sphere_scene(double radius_m = 0.5);
SimulatedScene make_box_scene(const Eigen::Vector3d& size_m = {0.8, 0.6, 0.5});
/// A bare 4 × 4 × 2.5 m room of thin things: a partition of the given thickness, upright rods of 3 to 20 mm diameter, a
/// door leaf of 40 mm that stands ajar, an open book with boards of 3 mm.
SimulatedScene make_partition_scene(double thickness_m = 0.015);
/// Any mesh, with its texture or vertex colours, and lamps around it. Throws InvalidInput when it has no triangle.
SimulatedScene make_mesh_scene(Mesh mesh, std::string name);

// ---- sensors

/// How measurements differ from the truth. All figures are about the sensor's own r.
struct SensorEffects {
  NoiseModel noise;                         ///< standard deviation over range
  double incidence_1 = 0, incidence_2 = 0;  ///< times 1 + incidence_1·θ + incidence_2·θ², θ from the normal, radians
  double quantization_m = 0;  ///< ranges are rounded to steps of quantization_m + quantization_2_per_m·r²
  double quantization_2_per_m = 0;
  double min_range_m = 0, max_range_m = 1e6;
  double grazing_cosine = 0;  ///< below it a sample is lost with grazing_dropout probability
  double grazing_dropout = 1;
  double dark_dropout = 0;        ///< probability of losing a sample on a surface darker than 4 %
  double specular_dropout = 0;    ///< probability on specular materials, more than 20° off the normal
  bool has_mixed_pixels = false;  ///< samples at depth edges average over their footprint: flying pixels
  double pose_sigma_m = 0;        ///< error of the written pose, each axis
  double pose_sigma_rad = 0;      ///< rotation vector, each axis, about the sensor
  double exposure_sigma = 0;      ///< of the natural logarithm of each view's gain
};

struct SensorRig {
  std::string id;
  Sensor sensor;                     ///< pinhole, spherical or orthographic
  std::optional<ColorSource> color;  ///< its camera and T_view_color; files are ignored
  SensorEffects effects;
};

/// Kinect-like: σ = 1.2 mm + 1.9 mm/m² · (z − 0.4 m)², 0.4 to 4.5 m, grazing under cosine 0.08 lost.
SensorRig make_rgbd_rig(int width = 640, int height = 480, double focal_px = 0);  ///< focal 0: 525/640 of the width
/// Terrestrial laser scanner, full circle, σ = 2 mm, 0.3 to 60 m; colour along the same rays.
SensorRig make_laser_rig(int width = 2000, int height = 1000, double el_top_rad = 1.5707963267948966,
                         double el_bottom_rad = -1.0471975511965976);
/// Parallel rays over extent_m in the shorter direction, σ = 0.1 mm.
SensorRig make_ortho_rig(int width, int height, double extent_m);
/// Noise σ times scale; at 0 quantisation, dropouts and mixed pixels go too. Range limits, pose and exposure stay.
SensorEffects scaled(const SensorEffects& effects, double scale);

// ---- trajectories

enum class Trajectory {
  kWalk,      ///< hand-held through free space, looking where something was not seen yet
  kOrbit,     ///< rings around the scene, looking at its middle
  kStations,  ///< tripods in free space, spread to see as much as possible
  kAxes,      ///< 6 axis-aligned directions, then 8 corners, then 12 edges: up to 26
};

struct TrajectoryOptions {
  Trajectory kind = Trajectory::kWalk;
  int views = 100;
  int rings = 1;
  double elevation_rad = 0.35;  ///< of a single ring; several rings spread from −60° to 60°
  double distance_m = 0;        ///< from the middle, orbit and axes; 0: the whole scene fits the image
  std::uint64_t seed = 1;
};
/// Planned views: names, sensors, true poses; no files. Throws InvalidInput when there is no room to stand.
std::vector<ViewSource> make_trajectory(const SimulatedScene& scene, const SensorRig& rig,
                                        const TrajectoryOptions& options, Context& context);
/// Views at the poses of a text file: a line each, `tx ty tz qx qy qz qw` or 16 numbers of T_world_view row by row.
std::vector<ViewSource> read_trajectory(const std::filesystem::path& file, const SensorRig& rig);

// ---- measurement

struct SimulatedView {
  /// As measured, at the pose as written; with intensities (reflectance times cosine of the incidence, of 255) where
  /// the noise depends on them.
  View view;
  ColorImage color;       ///< empty without a colour camera
  RangeImage true_range;  ///< noiseless, at pixel centres, within the range limits
  Eigen::Isometry3d T_world_view_true = Eigen::Isometry3d::Identity();
  double exposure_gain = 1;
};

/// Holds the scene's BVH and its light. The scene must outlive it. Const and thread-safe.
class Simulator {
 public:
  /// Without colour the scene's light is not computed, and views with a colour camera are refused.
  Simulator(const SimulatedScene& scene, std::uint64_t seed, Context& context, bool has_color = true);
  ~Simulator();
  /// The view's place in the scene seeds its noise. Throws InvalidInput for a measured-grid sensor.
  SimulatedView simulate(const ViewSource& planned, std::uint32_t view_index, const SensorEffects& effects,
                         Context& context) const;
  /// simulate() on the calling thread alone, for loops that run over views.
  SimulatedView simulate_serially(const ViewSource& planned, std::uint32_t view_index,
                                  const SensorEffects& effects) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

std::vector<SimulatedView> simulate_views(const SimulatedScene& scene, const std::vector<ViewSource>& planned,
                                          const SensorEffects& effects, std::uint64_t seed, Context& context);

struct FolderOptions {
  RangeFormat range_format = RangeFormat::kExr;  ///< kExr or kPng16
  bool has_color = true;
  bool declares_noise = false;  ///< write the noise model into scene.json instead of leaving it to guess
  std::uint64_t seed = 1;
};
struct FolderReport {
  std::size_t views = 0, samples = 0, empty_views = 0;
};
/// Writes scene.json, range/, color/, and truth/{mesh.ply, scene.json, range/, views.csv}. At most one view per thread
/// is in memory. Views that measured nothing are warned of and left out.
FolderReport simulate_to_folder(const SimulatedScene& scene, const std::vector<ViewSource>& planned,
                                const SensorEffects& effects, const std::filesystem::path& folder,
                                const FolderOptions& options, Context& context);

}  // namespace lapseam
