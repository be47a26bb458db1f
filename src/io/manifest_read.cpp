// scene.json, reading; docs/formats.md describes it.

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "io/angle_table.h"
#include "io/json_object.h"
#include "io/scene_formats.h"

namespace lapseam {
namespace {

using nlohmann::json;

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

/// A sensor of the manifest; without a model the range file holds it.
struct SensorEntry {
  std::optional<Sensor> sensor;
  std::optional<NoiseModel> noise;
};
using SensorTable = std::map<std::string, SensorEntry>;

NoiseModel read_noise(const json& value, const Source& source, const std::string& path) {
  const JsonObject object(
      value, source, path,
      {"s0_m", "s1", "s2_per_m", "floor_m", "correlation", "pointing_rad", "intensity_power", "intensity_reference"});
  const auto not_negative = [&](const char* key) {
    const double number = object.number_or(key, 0);
    if (number < 0) object.refuse(key, "must not be negative");
    return number;
  };
  NoiseModel noise{not_negative("s0_m"),    object.number_or("s1", 0),          not_negative("s2_per_m"),
                   not_negative("floor_m"), object.number_or("correlation", 1), not_negative("pointing_rad")};
  noise.intensity_power = not_negative("intensity_power");
  if (object.has("intensity_reference")) noise.intensity_reference = object.positive("intensity_reference");
  if (!(noise.correlation >= 1)) object.refuse("correlation", "must be at least 1");
  // A parabola about a best range falls at first.
  if (noise.s1 < 0 && noise.floor_m <= 0) object.refuse("s1", "may be negative only with a floor_m");
  if (noise.s0_m + std::max(noise.s1, 0.0) + noise.s2_per_m + noise.floor_m <= 0)
    source.refuse(path, "is zero everywhere; leave it out to have it estimated");
  return noise;
}

PinholeSensor read_pinhole(const json& value, const Source& source, const std::string& path) {
  const JsonObject object(value, source, path,
                          {"model", "noise", "width", "height", "fx", "fy", "cx", "cy", "distortion"});
  PinholeSensor sensor{object.size_px("width"),
                       object.size_px("height"),
                       object.positive("fx"),
                       object.positive("fy"),
                       object.number("cx"),
                       object.number("cy"),
                       {}};
  if (object.has("distortion")) {
    const JsonObject d(object.at("distortion"), source, object.path_of("distortion"), {"k1", "k2", "p1", "p2", "k3"});
    sensor.distortion.k1 = d.number_or("k1", 0);
    sensor.distortion.k2 = d.number_or("k2", 0);
    sensor.distortion.p1 = d.number_or("p1", 0);
    sensor.distortion.p2 = d.number_or("p2", 0);
    sensor.distortion.k3 = d.number_or("k3", 0);
  }
  return sensor;
}

/// Limits or table of one axis, in radians.
std::vector<double> read_axis(const JsonObject& object, const char* limits_key, const char* table_key, int count) {
  if (object.has(limits_key) && object.has(table_key))
    object.refuse(table_key, std::string("either this or ") + limits_key + ", not both");
  if (object.has(table_key)) {
    std::vector<double> angles = object.numbers(table_key);
    for (double& angle : angles) angle *= kRadPerDeg;
    check_angle_table(object.source(), object.path_of(table_key), angles, count);
    return angles;
  }
  const std::vector<double> limits_deg = object.numbers(limits_key);
  if (limits_deg.size() != 2) object.refuse(limits_key, "expected two angles, begin and end");
  if (limits_deg[0] == limits_deg[1]) object.refuse(limits_key, "begin and end are the same angle");
  if (std::abs(limits_deg[1] - limits_deg[0]) > 360) object.refuse(limits_key, "covers more than the full circle");
  return angles_between(limits_deg[0] * kRadPerDeg, limits_deg[1] * kRadPerDeg, count);
}

SphericalSensor read_spherical(const json& value, const Source& source, const std::string& path) {
  const JsonObject object(value, source, path,
                          {"model", "noise", "width", "height", "azimuth_deg", "elevation_deg", "azimuth_table_deg",
                           "elevation_table_deg"});
  const int width = object.size_px("width"), height = object.size_px("height");
  check_image_size(source, std::uint64_t(width), std::uint64_t(height), UINT64_MAX, 1);
  SphericalSensor sensor;
  sensor.azimuth_rad = read_axis(object, "azimuth_deg", "azimuth_table_deg", width);
  sensor.elevation_rad = read_axis(object, "elevation_deg", "elevation_table_deg", height);
  for (const double elevation_rad : sensor.elevation_rad)
    if (std::abs(elevation_rad) > 90.0 * kRadPerDeg * (1 + 1e-12))
      source.refuse(object.path_of("elevation_deg"), "elevations lie between -90 and 90 degrees");
  if (std::abs(sensor.azimuth_rad.back() - sensor.azimuth_rad.front()) >= 360.0 * kRadPerDeg)
    source.refuse(object.path_of("azimuth_table_deg"), "covers more than the full circle");
  return sensor;
}

OrthographicSensor read_orthographic(const json& value, const Source& source, const std::string& path) {
  const JsonObject object(value, source, path,
                          {"model", "noise", "width", "height", "pitch_x_m", "pitch_y_m", "cx", "cy"});
  const int width = object.size_px("width"), height = object.size_px("height");
  return {width,
          height,
          object.positive("pitch_x_m"),
          object.positive("pitch_y_m"),
          object.number_or("cx", (width - 1) / 2.0),
          object.number_or("cy", (height - 1) / 2.0)};
}

SensorEntry read_sensor(const json& value, const Source& source, const std::string& path) {
  if (!value.is_object()) source.refuse(path, "expected an object { }");
  const std::vector<std::string> models{"pinhole", "spherical", "orthographic", "in_file"};
  if (!value.contains("model")) source.refuse(path + ".model", "missing");
  const std::string model = value["model"].is_string() ? value["model"].get<std::string>() : value["model"].dump();
  SensorEntry entry;
  if (model == "pinhole") {
    entry.sensor = read_pinhole(value, source, path);
  } else if (model == "spherical") {
    entry.sensor = read_spherical(value, source, path);
  } else if (model == "orthographic") {
    entry.sensor = read_orthographic(value, source, path);
  } else if (model == "in_file") {
    const JsonObject check_keys(value, source, path, {"model", "noise"});
  } else {
    const std::string nearest = nearest_name(model, models);
    source.refuse(path + ".model", "'" + model + "' is not pinhole, spherical, orthographic or in_file" +
                                       (nearest.empty() ? "" : "; did you mean '" + nearest + "'?"));
  }
  if (value.contains("noise")) entry.noise = read_noise(value["noise"], source, path + ".noise");
  return entry;
}

/// Six rows of six numbers, symmetric, no negative variance; lengths in the manifest's unit.
PoseCovariance read_covariance(const json& value, const Source& source, double unit_m) {
  const char* const field = "pose_covariance";
  PoseCovariance out;
  if (!value.is_array() || value.size() != 6) source.refuse(field, "expected six rows of six numbers");
  for (std::size_t row = 0; row < 6; ++row) {
    if (!value[row].is_array() || value[row].size() != 6) source.refuse(field, "expected six rows of six numbers");
    for (std::size_t column = 0; column < 6; ++column) {
      const json& number = value[row][column];
      if (!number.is_number() || !std::isfinite(number.get<double>()))
        source.refuse(field, "expected six rows of six numbers");
      out(Eigen::Index(row), Eigen::Index(column)) =
          number.get<double>() * (row < 3 ? unit_m : 1) * (column < 3 ? unit_m : 1);
    }
  }
  if (!(out - out.transpose()).isZero(1e-6 * out.cwiseAbs().maxCoeff())) source.refuse(field, "is not symmetric");
  if (out.diagonal().minCoeff() < 0) source.refuse(field, "has a negative variance");
  return out;
}

/// What all views need of the manifest around them.
struct Manifest {
  std::filesystem::path file;
  double unit_m = 1;
  SensorTable sensors;

  const SensorEntry& sensor(const Source& source, const std::string& field, const std::string& id) const {
    const auto found = sensors.find(id);
    if (found != sensors.end()) return found->second;
    std::vector<std::string> ids;
    for (const auto& [known, entry] : sensors) ids.push_back(known);
    const std::string nearest = nearest_name(id, ids);
    source.refuse(field,
                  "there is no sensor '" + id + "'" + (nearest.empty() ? "" : "; did you mean '" + nearest + "'?"));
  }

  /// Relative to the manifest.
  std::filesystem::path resolve(const std::string& name) const {
    return (file.parent_path() / std::filesystem::path(name)).lexically_normal();
  }
};

RangeQuantity read_quantity(const JsonObject& object, const std::optional<Sensor>& sensor) {
  const std::string quantity = object.text("quantity");
  if (quantity == "distance") return RangeQuantity::kDistance;
  if (quantity != "z") object.refuse("quantity", "'" + quantity + "' is neither z nor distance");
  if (sensor && std::holds_alternative<SphericalSensor>(*sensor))
    object.refuse("quantity", "a spherical sensor measures distance, not z");
  return RangeQuantity::kZ;
}

/// Which scan or frame of a file with several.
std::uint32_t read_index(const JsonObject& object) {
  const double index = object.number("index");
  if (!(index >= 0 && index <= 4294967295.0 && index == std::floor(index)))
    object.refuse("index", "must be an integer that is not negative");
  return std::uint32_t(index);
}

void read_range(const Manifest& manifest, const json& value, const Source& source, ViewDraft& draft) {
  const JsonObject object(value, source, "range",
                          {"file", "index", "quantity", "scale_m", "invalid", "channel", "intensity"});
  RangeSource& range = draft.view.range;
  range.file = manifest.resolve(object.text("file"));
  if (object.has("index")) range.index = read_index(object);
  draft.has_quantity = object.has("quantity");
  if (draft.has_quantity) range.quantity = read_quantity(object, draft.view.sensor);
  draft.has_scale = object.has("scale_m");
  if (draft.has_scale) range.scale_m = object.positive("scale_m");
  if (object.has("invalid")) range.invalid_values = object.numbers("invalid");
  if (object.has("channel")) range.channel = object.text("channel");
  if (object.has("intensity")) range.intensity_file = manifest.resolve(object.text("intensity"));
}

ColorSource read_color(const Manifest& manifest, const json& value, const Source& source, const ViewSource& view) {
  const JsonObject object(value, source, "color", {"file", "index", "camera", "T_view_color"});
  ColorSource color;
  color.file = manifest.resolve(object.text("file"));
  if (object.has("index")) color.index = read_index(object);
  const std::string camera = object.has("camera") ? object.text("camera") : "same";
  const SensorEntry same{view.sensor, {}};
  const SensorEntry& entry = camera == "same" ? same : manifest.sensor(source, "color.camera", camera);
  if (!entry.sensor)
    object.refuse("camera", "'" + camera + "' has no model in the manifest, so it cannot be a colour camera");
  color.camera = *entry.sensor;
  if (object.has("T_view_color")) color.T_view_color = object.pose("T_view_color", manifest.unit_m);
  return color;
}

ViewDraft read_view(const Manifest& manifest, const json& value, std::size_t index) {
  // The name first, so that all other errors can tell it.
  const std::string place = "views[" + std::to_string(index) + "]";
  std::string name = place;
  if (value.is_object() && value.contains("name") && value["name"].is_string() &&
      !value["name"].get<std::string>().empty())
    name = value["name"].get<std::string>();
  const Source source{manifest.file, name};
  const JsonObject object(value, source, "",
                          {"name", "sensor", "T_world_view", "pose_covariance", "range", "color", "noise"});

  ViewDraft draft;
  ViewSource& view = draft.view;
  view.name = object.text("name");
  if (object.has("sensor")) {
    view.sensor_id = object.text("sensor");
    const SensorEntry& entry = manifest.sensor(source, "sensor", view.sensor_id);
    view.sensor = entry.sensor;
    view.noise = entry.noise;
  }
  if (object.has("noise")) view.noise = read_noise(object.at("noise"), source, "noise");
  draft.has_pose = object.has("T_world_view");
  if (draft.has_pose) view.T_world_view = object.pose("T_world_view", manifest.unit_m);
  if (object.has("pose_covariance"))
    view.pose_covariance = read_covariance(object.at("pose_covariance"), source, manifest.unit_m);
  read_range(manifest, object.at("range"), source, draft);
  if (object.has("color")) view.color = read_color(manifest, object.at("color"), source, view);
  return draft;
}

void check_format(const std::filesystem::path& file, const json& document) {
  const Source source{file, {}};
  if (!document.is_object() || !document.contains("format") || document["format"] != "lapseam-scene")
    source.refuse("format", "this JSON file is no scene: \"format\": \"lapseam-scene\" is missing");
  if (!document.contains("version")) source.refuse("version", "missing");
  if (!document["version"].is_number_integer() || document["version"] != 1)
    source.refuse("version", "is " + document["version"].dump() + "; this program reads version 1");
}

}  // namespace

Scene read_manifest(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context) {
  const json document = parse_json_file(file);
  check_format(file, document);
  const Source source{file, {}};
  const JsonObject object(document, source, "", {"format", "version", "name", "unit_m", "sensors", "views"});
  Manifest manifest;
  manifest.file = file;
  if (object.has("unit_m")) manifest.unit_m = object.positive("unit_m");
  if (object.has("sensors")) {
    if (!object.at("sensors").is_object()) object.refuse("sensors", "expected an object { }");
    for (const auto& item : object.at("sensors").items()) {
      if (item.key().empty() || item.key() == "same") object.refuse("sensors", "'" + item.key() + "' cannot be an id");
      manifest.sensors[item.key()] = read_sensor(item.value(), source, "sensors." + item.key());
    }
  }
  const json& views = object.at("views");
  if (!views.is_array()) object.refuse("views", "expected a list [ ] of views");
  SceneBuilder builder(file, options, context);
  builder.set_name(object.has("name") ? object.text("name") : file.stem().string());
  for (std::size_t i = 0; i < views.size(); ++i) builder.add([&] { return read_view(manifest, views[i], i); });
  return builder.finish();
}

}  // namespace lapseam
