#include "io/exr_attributes.h"

#include <ImfDoubleAttribute.h>
#include <ImfMatrixAttribute.h>
#include <ImfStandardAttributes.h>
#include <ImfStringAttribute.h>
#include <ImfVecAttribute.h>

#include <array>
#include <cmath>

#include "io/angle_table.h"
#include "io/rigid.h"
#include "io/text_scan.h"

namespace lapseam {
namespace {

using Imath::M44d;
using Imath::V2d;
using Imath::V3d;

constexpr const char* kSensor = "lapseam:sensor";
constexpr const char* kViewToWorld = "lapseam:viewToWorld";
constexpr const char* kQuantity = "lapseam:quantity";
constexpr const char* kFocalLength = "lapseam:focalLength";
constexpr const char* kPrincipalPoint = "lapseam:principalPoint";
constexpr const char* kRadialDistortion = "lapseam:radialDistortion";
constexpr const char* kTangentialDistortion = "lapseam:tangentialDistortion";
constexpr const char* kPitch = "lapseam:pitch";
constexpr const char* kProjection = "lapseam:projection";
constexpr const char* kForward = "lapseam:forward";
constexpr const char* kRangeOffset = "lapseam:rangeOffset";
constexpr const char* kFitRms = "lapseam:fitRms";

/// An axis of a spherical sensor: limits where they give the table back to the last bit, else the table as text.
struct AxisNames {
  const char* limits;
  const char* table;
};
constexpr AxisNames kAzimuth{"lapseam:azimuthLimits", "lapseam:azimuthTable"};
constexpr AxisNames kElevation{"lapseam:elevationLimits", "lapseam:elevationTable"};

bool is_finite(double value) { return std::isfinite(value); }
bool is_finite(const V2d& v) { return is_finite(v.x) && is_finite(v.y); }
bool is_finite(const V3d& v) { return is_finite(v.x) && is_finite(v.y) && is_finite(v.z); }
bool is_finite(const std::string&) { return true; }
bool is_finite(const M44d&) { return true; }  // to_rigid and the fit check look closer

/// Typed access that names file, view and attribute when something is wrong.
class Attributes {
 public:
  Attributes(const Source& source, const Imf::Header& header) : source_(source), header_(header) {}

  bool has(const char* name) const { return header_.find(name) != header_.end(); }

  template <typename T>
  std::optional<T> find(const char* name) const {
    if (!has(name)) return std::nullopt;
    const auto* attribute = header_.findTypedAttribute<Imf::TypedAttribute<T>>(name);
    if (!attribute) {
      source_.refuse(name, std::string("has type ") + header_[name].typeName() + ", expected " +
                               Imf::TypedAttribute<T>::staticTypeName());
    }
    if (!is_finite(attribute->value())) source_.refuse(name, "is not finite");
    return attribute->value();
  }

  template <typename T>
  T get(const char* name) const {
    auto value = find<T>(name);
    if (!value) source_.refuse(name, "missing; this file's " + std::string(kSensor) + " needs it");
    return *value;
  }

 private:
  const Source& source_;
  const Imf::Header& header_;
};

// ---- reading

Eigen::Matrix4d to_eigen(const M44d& matrix) {
  Eigen::Matrix4d result;  // OpenEXR multiplies row vectors from the left
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) result(row, column) = matrix[column][row];
  return result;
}

PinholeSensor read_pinhole(const Source& source, const Attributes& attributes, ImageSize size) {
  const V2d focal = attributes.get<V2d>(kFocalLength), center = attributes.get<V2d>(kPrincipalPoint);
  if (!(focal.x > 0 && focal.y > 0)) source.refuse(kFocalLength, "must be positive");
  PinholeSensor sensor{size.width, size.height, focal.x, focal.y, center.x, center.y, {}};
  if (const auto radial = attributes.find<V3d>(kRadialDistortion)) {
    sensor.distortion.k1 = radial->x;
    sensor.distortion.k2 = radial->y;
    sensor.distortion.k3 = radial->z;
  }
  if (const auto tangential = attributes.find<V2d>(kTangentialDistortion)) {
    sensor.distortion.p1 = tangential->x;
    sensor.distortion.p2 = tangential->y;
  }
  return sensor;
}

std::vector<double> read_axis(const Source& source, const Attributes& attributes, const AxisNames& names, int count) {
  if (const auto limits = attributes.find<V2d>(names.limits)) {
    if (limits->x == limits->y) source.refuse(names.limits, "begin and end are the same angle");
    return angles_between(limits->x, limits->y, count);
  }
  const auto text = attributes.find<std::string>(names.table);
  if (!text) source.refuse(names.limits, "missing, and so is " + std::string(names.table));
  std::vector<double> angles_rad;
  std::string_view rest = *text;
  for (std::string_view word = take_word(rest); !word.empty(); word = take_word(rest)) {
    const auto angle = parse_number<double>(word);
    if (!angle) source.refuse(names.table, "'" + std::string(word) + "' is not a number");
    angles_rad.push_back(*angle);
  }
  check_angle_table(source, names.table, angles_rad, count);
  return angles_rad;
}

OrthographicSensor read_orthographic(const Source& source, const Attributes& attributes, ImageSize size) {
  const V2d pitch = attributes.get<V2d>(kPitch), center = attributes.get<V2d>(kPrincipalPoint);
  if (!(pitch.x > 0 && pitch.y > 0)) source.refuse(kPitch, "must be positive");
  return {size.width, size.height, pitch.x, pitch.y, center.x, center.y};
}

void read_own_sensor(const Source& source, const Attributes& attributes, ExrHeader& header) {
  const auto kind = attributes.get<std::string>(kSensor);
  if (kind == "pinhole") {
    header.sensor = read_pinhole(source, attributes, header.size);
  } else if (kind == "spherical") {
    SphericalSensor sensor;
    sensor.azimuth_rad = read_axis(source, attributes, kAzimuth, header.size.width);
    sensor.elevation_rad = read_axis(source, attributes, kElevation, header.size.height);
    header.sensor = std::move(sensor);
  } else if (kind == "orthographic") {
    header.sensor = read_orthographic(source, attributes, header.size);
  } else if (kind == "measured_grid") {
    header.is_measured_grid = true;
  } else {
    source.refuse(kSensor,
                  "'" + kind + "' is no sensor model; expected pinhole, spherical, orthographic or measured_grid");
  }
}

/// The pinhole sensor that worldToNDC describes, in pixels of the data window, and by `signs` the axes of the
/// renderer's camera frame, each 1 or −1 times ours (x right, y down, z forward). NDC is taken to be [−1, 1]² over the
/// display window, y up, as renderers with an OpenGL heritage write it.
PinholeSensor read_projection(const Source& source, const Imf::Header& attributes, const Eigen::Matrix4d& camera_world,
                              ImageSize size, Eigen::Vector3d& signs) {
  const Eigen::Matrix4d ndc_world = to_eigen(M44d(Imf::worldToNDC(attributes)));
  const Eigen::Matrix4d ndc_camera = ndc_world * camera_world.inverse();
  const double w = ndc_camera(3, 2);
  const bool is_perspective = ndc_camera.allFinite() && std::abs(w) > 1e-6 &&
                              std::abs(ndc_camera(3, 3)) < 1e-3 * std::abs(w) && ndc_camera(0, 0) != 0 &&
                              ndc_camera(1, 1) != 0;
  if (!is_perspective) source.refuse("worldToNDC", "is not a perspective projection of worldToCamera");
  const double scale_x = ndc_camera(0, 0) / std::abs(w), scale_y = ndc_camera(1, 1) / std::abs(w);
  signs = {scale_x > 0 ? 1.0 : -1.0, scale_y > 0 ? -1.0 : 1.0, w > 0 ? 1.0 : -1.0};

  const Imath::Box2i display = attributes.displayWindow(), data = attributes.dataWindow();
  const double width = display.max.x - double(display.min.x) + 1, height = display.max.y - double(display.min.y) + 1;
  PinholeSensor sensor;
  sensor.width = size.width;
  sensor.height = size.height;
  sensor.fx = std::abs(scale_x) * width / 2;
  sensor.fy = std::abs(scale_y) * height / 2;
  sensor.cx = (1 + ndc_camera(0, 2) / w) * width / 2 - 0.5 + display.min.x - data.min.x;
  sensor.cy = (1 - ndc_camera(1, 2) / w) * height / 2 - 0.5 + display.min.y - data.min.y;
  if (!(sensor.fx > 0 && sensor.fy > 0)) source.refuse("worldToNDC", "has no focal length");
  return sensor;
}

/// The standard attributes, where ours are missing: worldToCamera alone gives a pose, with worldToNDC also a sensor.
void read_standard(const Source& source, const Imf::Header& attributes, ExrHeader& header) {
  if (!Imf::hasWorldToCamera(attributes)) return;
  const Eigen::Matrix4d camera_world = to_eigen(M44d(Imf::worldToCamera(attributes)));
  if (!camera_world.allFinite()) source.refuse("worldToCamera", "is not finite");
  // Without a projection the handedness tells the conventions apart: right-handed cameras look along −z (OpenGL),
  // left-handed ones along +z (RenderMan); y is up in both.
  const bool is_left_handed = camera_world.topLeftCorner<3, 3>().determinant() < 0;
  Eigen::Vector3d signs(1, -1, is_left_handed ? 1 : -1);
  if (Imf::hasWorldToNDC(attributes)) {
    const PinholeSensor sensor = read_projection(source, attributes, camera_world, header.size, signs);
    if (!header.sensor && !header.is_measured_grid) header.sensor = sensor;
  }
  if (header.T_world_view) return;
  const Eigen::Matrix4d view_camera = signs.homogeneous().asDiagonal();
  // Floats: rigid to about 1e-6; to_rigid takes that out.
  header.T_world_view = to_rigid(view_camera * camera_world, source, "worldToCamera").inverse();
}

// ---- writing

M44d to_imath(const Eigen::Matrix4d& matrix) {
  M44d result;
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) result[column][row] = matrix(row, column);
  return result;
}

template <typename T>
void put(Imf::Header& attributes, const char* name, const T& value) {
  attributes.insert(name, Imf::TypedAttribute<T>(value));
}

void put_axis(Imf::Header& attributes, const AxisNames& names, const std::vector<double>& angles_rad) {
  if (const auto limits = exact_limits(angles_rad)) {
    put(attributes, names.limits, V2d(limits->first, limits->second));
    return;
  }
  put(attributes, names.table, to_text(angles_rad));
}

void put_sensor(Imf::Header& attributes, const PinholeSensor& sensor) {
  put(attributes, kFocalLength, V2d(sensor.fx, sensor.fy));
  put(attributes, kPrincipalPoint, V2d(sensor.cx, sensor.cy));
  const BrownDistortion& d = sensor.distortion;
  if (d.is_zero()) return;
  put(attributes, kRadialDistortion, V3d(d.k1, d.k2, d.k3));
  put(attributes, kTangentialDistortion, V2d(d.p1, d.p2));
}

void put_sensor(Imf::Header& attributes, const SphericalSensor& sensor) {
  put_axis(attributes, kAzimuth, sensor.azimuth_rad);
  put_axis(attributes, kElevation, sensor.elevation_rad);
}

void put_sensor(Imf::Header& attributes, const OrthographicSensor& sensor) {
  put(attributes, kPitch, V2d(sensor.pitch_x_m, sensor.pitch_y_m));
  put(attributes, kPrincipalPoint, V2d(sensor.cx, sensor.cy));
}

void put_sensor(Imf::Header& attributes, const MeasuredGridSensor& sensor) {
  Eigen::Matrix4d rows;
  for (int i = 0; i < 4; ++i) rows.row(i) = sensor.rational[std::size_t(i)].transpose();
  put(attributes, kProjection, to_imath(rows));
  put(attributes, kForward, V3d(sensor.forward.x(), sensor.forward.y(), sensor.forward.z()));
  put(attributes, kRangeOffset, sensor.range_offset_m);
  put(attributes, kFitRms, sensor.fit_rms_px);
}

}  // namespace

void read_attributes(const Source& source, const Imf::Header& attributes, ExrHeader& header) {
  const Attributes own(source, attributes);
  if (own.has(kSensor)) read_own_sensor(source, own, header);
  if (const auto pose = own.find<M44d>(kViewToWorld))
    header.T_world_view = to_rigid(to_eigen(*pose), source, kViewToWorld);
  if (const auto quantity = own.find<std::string>(kQuantity)) {
    if (*quantity != "z" && *quantity != "distance") source.refuse(kQuantity, "must be z or distance");
    header.quantity = *quantity == "z" ? RangeQuantity::kZ : RangeQuantity::kDistance;
  }
  const bool has_sensor = header.sensor || header.is_measured_grid;
  if (!has_sensor || !header.T_world_view) read_standard(source, attributes, header);
}

MeasuredGridSensor read_measured_grid_attributes(const Source& source, const Imf::Header& attributes, ImageSize size) {
  const Attributes own(source, attributes);
  MeasuredGridSensor sensor;
  sensor.width = size.width;
  sensor.height = size.height;
  const Eigen::Matrix4d rows = to_eigen(own.get<M44d>(kProjection));
  if (!rows.allFinite()) source.refuse(kProjection, "is not finite");
  for (int i = 0; i < 4; ++i) sensor.rational[std::size_t(i)] = rows.row(i).transpose();
  const V3d forward = own.get<V3d>(kForward);
  sensor.forward = {forward.x, forward.y, forward.z};
  if (std::abs(sensor.forward.norm() - 1) > 1e-6) source.refuse(kForward, "is not a unit vector");
  sensor.range_offset_m = own.get<double>(kRangeOffset);
  sensor.fit_rms_px = own.get<double>(kFitRms);
  return sensor;
}

void write_attributes(const Sensor& sensor, const Eigen::Isometry3d& T_world_view, Imf::Header& attributes) {
  put(attributes, kSensor, std::string(kind_name(sensor)));
  put(attributes, kViewToWorld, to_imath(T_world_view.matrix()));
  const bool is_spherical = std::holds_alternative<SphericalSensor>(sensor);
  put(attributes, kQuantity, std::string(is_spherical ? "distance" : "z"));
  std::visit([&](const auto& model) { put_sensor(attributes, model); }, sensor);
}

}  // namespace lapseam
