#pragma once

// Pictures of a mesh, by ray casting: to look at results, and above all at their faults.

#include <Eigen/Geometry>
#include <memory>

#include "lapseam/image.h"
#include "lapseam/mesh.h"
#include "lapseam/sensor.h"

namespace lapseam {

class Context;

/// Any sensor makes a camera, so a view can be looked at as it was measured.
struct RenderCamera {
  Sensor sensor;
  Eigen::Isometry3d T_world_camera = Eigen::Isometry3d::Identity();
  /// Size of the picture, which always shows the sensor's whole image; 0: one pixel a sample.
  int width = 0, height = 0;
};

/// A pinhole camera at eye_m that sees target_m in its middle. Throws InvalidInput when the two are the same point.
struct LookAt {
  Eigen::Vector3d eye_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d target_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d up = Eigen::Vector3d::Zero();  ///< zero: y
  double fov_rad = 0.87;                         ///< of the picture's height
  int width = 1280, height = 960;
};
RenderCamera look_at_camera(const LookAt& settings);

/// A pinhole camera outside of the mesh, as near as it can be while seeing all of it. Azimuth 0 is in front: at +z when
/// y is up, at −y when z is up; it grows to the right. Throws InvalidInput when the mesh has no triangles.
struct Orbit {
  double azimuth_rad = 0.52;
  double elevation_rad = 0.35;
  double zoom = 1;                               ///< magnifies the middle of the picture
  Eigen::Vector3d up = Eigen::Vector3d::Zero();  ///< zero: guess_up(mesh)
  double fov_rad = 0.6;
  int width = 1280, height = 960;
};
RenderCamera orbit_camera(const Mesh& mesh, const Orbit& settings);

/// The coordinate axis that most of the area lies across (floors, ceilings, tables), if that is over a fifth of all;
/// else y, the custom for single objects. Points to where more of that area faces.
Eigen::Vector3d guess_up(const Mesh& mesh);

enum class RenderMode {
  kShaded,      ///< grey clay, lit from the camera
  kTextured,    ///< texture pages, unlit; triangles without one as kColors
  kColors,      ///< vertex colours, unlit
  kProvenance,  ///< a colour per view; seams white, filled holes magenta
};

struct RenderOptions {
  RenderMode mode = RenderMode::kShaded;
  bool smooth_normals = false;  ///< off: every triangle shows
  bool cull_backfaces = false;  ///< look through surfaces from behind; off: backs are dull red
  bool show_boundary = false;   ///< yellow: edges of one triangle; cyan: of three or more, or of two wound alike
  bool show_wireframe = false;
  int samples_per_side = 3;  ///< rays per pixel, squared; 1 to 8
  double boundary_width_px = 2.5;
  double wireframe_width_px = 0.7;
  Rgb8 background{30, 32, 36};
};

/// A picture, and the share of each pixel's rays that met a front face, 0 to 1.
struct CoveredPicture {
  ColorImage image;
  Image<float> coverage;
};

/// Builds what rays need once, for any number of pictures. The mesh has to live as long.
class Renderer {
 public:
  Renderer(const Mesh& mesh, Context& context);
  ~Renderer();
  Renderer(Renderer&&) noexcept;
  Renderer& operator=(Renderer&&) noexcept;

  /// The same bytes for any number of threads. Throws InvalidInput for a mode that the mesh has no data for (a textured
  /// picture needs pages or vertex colours), a picture over kMaxPixels, or options out of their range.
  ColorImage render(const RenderCamera& camera, const RenderOptions& options, Context& context) const;
  CoveredPicture render_covered(const RenderCamera& camera, const RenderOptions& options, Context& context) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// One picture.
ColorImage render(const Mesh& mesh, const RenderCamera& camera, const RenderOptions& options, Context& context);

}  // namespace lapseam
