// scene.json, writing: every value with as many digits as it takes to read it back exactly (angles: to 1e-12 rad).

#include <map>
#include <nlohmann/json.hpp>
#include <numbers>

#include "io/angle_table.h"
#include "io/noise_json.h"
#include "io/output_file.h"
#include "io/scene_formats.h"

namespace lapseam {
namespace {

using Json = nlohmann::ordered_json;

bool is_leaf(const Json& value) {
  if (!value.is_structured()) return true;
  if (value.is_object()) return false;
  for (const Json& item : value)
    if (item.is_structured()) return false;
  return true;
}

void print_leaf(const Json& value, std::string& out) {
  if (!value.is_array()) {
    out += value.dump();
    return;
  }
  out += '[';
  for (std::size_t i = 0; i < value.size(); ++i) out += (i ? ", " : "") + value[i].dump();
  out += ']';
}

/// One line for lists of numbers, so that a matrix is four lines.
void print(const Json& value, int indent, std::string& out) {
  if (is_leaf(value)) return print_leaf(value, out);
  const std::string margin(std::size_t(indent + 2), ' ');
  out += value.is_object() ? "{\n" : "[\n";
  std::size_t left = value.size();
  for (auto it = value.begin(); it != value.end(); ++it) {
    out += margin;
    if (value.is_object()) out += Json(it.key()).dump() + ": ";
    print(*it, indent + 2, out);
    out += --left ? ",\n" : "\n";
  }
  out += std::string(std::size_t(indent), ' ') + (value.is_object() ? '}' : ']');
}

Json to_json(const Eigen::Isometry3d& pose) {
  Json rows = Json::array();
  for (int row = 0; row < 4; ++row) {
    Json numbers = Json::array();
    for (int column = 0; column < 4; ++column) numbers.push_back(pose.matrix()(row, column));
    rows.push_back(std::move(numbers));
  }
  return rows;
}

Json to_json(const PoseCovariance& covariance) {
  Json rows = Json::array();
  for (int row = 0; row < 6; ++row) {
    Json numbers = Json::array();
    for (int column = 0; column < 6; ++column) numbers.push_back(covariance(row, column));
    rows.push_back(std::move(numbers));
  }
  return rows;
}

void put_axis(Json& object, const char* limits_key, const char* table_key, const std::vector<double>& angles_rad) {
  if (const auto limits = limits_in_degrees(angles_rad)) {
    object[limits_key] = {limits->first, limits->second};
    return;
  }
  Json table = Json::array();
  for (const double angle_rad : angles_rad) table.push_back(angle_rad * (180.0 / std::numbers::pi));
  object[table_key] = std::move(table);
}

void put_model(Json& object, const PinholeSensor& sensor) {
  object["fx"] = sensor.fx;
  object["fy"] = sensor.fy;
  object["cx"] = sensor.cx;
  object["cy"] = sensor.cy;
  const BrownDistortion& d = sensor.distortion;
  if (!d.is_zero()) object["distortion"] = {{"k1", d.k1}, {"k2", d.k2}, {"p1", d.p1}, {"p2", d.p2}, {"k3", d.k3}};
}

void put_model(Json& object, const SphericalSensor& sensor) {
  put_axis(object, "azimuth_deg", "azimuth_table_deg", sensor.azimuth_rad);
  put_axis(object, "elevation_deg", "elevation_table_deg", sensor.elevation_rad);
}

void put_model(Json& object, const OrthographicSensor& sensor) {
  object["pitch_x_m"] = sensor.pitch_x_m;
  object["pitch_y_m"] = sensor.pitch_y_m;
  object["cx"] = sensor.cx;
  object["cy"] = sensor.cy;
}

void put_model(Json&, const MeasuredGridSensor&) {}

/// What has a number for every pixel is in its range file, whether that has been read already or not.
bool is_in_file(const std::optional<Sensor>& sensor) {
  if (!sensor || std::holds_alternative<MeasuredGridSensor>(*sensor)) return true;
  const auto* spherical = std::get_if<SphericalSensor>(&*sensor);
  return spherical && spherical->warp;
}

/// Scans of points are their own sensors, whatever was found in them.
bool is_in_file(const ViewSource& view) {
  const RangeFormat format = view.range.format;
  const bool holds_points = format == RangeFormat::kE57 || format == RangeFormat::kPtx || format == RangeFormat::kPcd;
  return holds_points || is_in_file(view.sensor);
}

Json to_json(const std::optional<Sensor>& sensor) {
  if (is_in_file(sensor)) return {{"model", "in_file"}};
  Json object;
  object["model"] = kind_name(*sensor);
  object["width"] = width(*sensor);
  object["height"] = height(*sensor);
  std::visit([&](const auto& model) { put_model(object, model); }, *sensor);
  return object;
}

/// Gives each different sensor an id, its own where that is free.
class SensorTable {
 public:
  std::string id_of(const std::string& wanted, const std::optional<Sensor>& sensor) {
    const std::string stem = wanted.empty() || wanted == "same" ? "sensor" : wanted;
    std::string id = stem;
    for (int i = 2;; ++i) {
      const auto [entry, is_new] = sensors_.try_emplace(id, sensor);
      if (is_new) order_.push_back(id);
      if (is_new || is_same(entry->second, sensor)) return id;
      id = stem + "-" + std::to_string(i);
    }
  }

  Json to_document() const {
    Json document = Json::object();
    for (const std::string& id : order_) document[id] = to_json(sensors_.at(id));
    return document;
  }

 private:
  static bool is_same(const std::optional<Sensor>& a, const std::optional<Sensor>& b) {
    if (is_in_file(a) || is_in_file(b)) return is_in_file(a) == is_in_file(b);
    return is_same_sensor(*a, *b);
  }

  std::map<std::string, std::optional<Sensor>> sensors_;
  std::vector<std::string> order_;
};

class Writer {
 public:
  Writer(const Scene& scene, const std::filesystem::path& file)
      : scene_(scene), file_(file), folder_(std::filesystem::absolute(file).lexically_normal().parent_path()) {}

  std::string run() {
    Json views = Json::array();
    for (const ViewSource& view : scene_.views) views.push_back(to_view(view));
    Json document;
    document["format"] = "lapseam-scene";
    document["version"] = 1;
    if (!scene_.name.empty()) document["name"] = scene_.name;
    document["sensors"] = sensors_.to_document();
    document["views"] = std::move(views);
    std::string text;
    print(document, 0, text);
    return text + "\n";
  }

 private:
  /// Relative where it lies below the manifest's folder, so that the folder can be moved as a whole.
  std::string store(const std::filesystem::path& path) const {
    const std::filesystem::path absolute = std::filesystem::absolute(path).lexically_normal();
    const std::filesystem::path relative = absolute.lexically_relative(folder_);
    const bool is_below = !relative.empty() && *relative.begin() != "..";
    return (is_below ? relative : absolute).generic_string();
  }

  Json to_view(const ViewSource& view) {
    if (view.range.format == RangeFormat::kMemory)
      throw InvalidInput(file_, view.name, "range", "is held in memory; write it to a file first");
    Json object;
    object["name"] = view.name;
    object["sensor"] = sensors_.id_of(view.sensor_id, is_in_file(view) ? std::nullopt : view.sensor);
    object["T_world_view"] = to_json(view.T_world_view);
    if (view.pose_covariance) object["pose_covariance"] = to_json(*view.pose_covariance);
    object["range"] = to_range(view);
    // Colours in a measured grid's own file are found there again, and their camera is nowhere else.
    const bool is_color_in_file = view.color && is_in_file(view) && view.color->file == view.range.file;
    if (view.color && !is_color_in_file) object["color"] = to_color(view);
    if (view.noise) object["noise"] = noise_to_json(*view.noise);
    return object;
  }

  Json to_range(const ViewSource& view) const {
    const RangeSource& range = view.range;
    Json object;
    object["file"] = store(range.file);
    if (range.index > 0) object["index"] = range.index;
    const bool is_spherical = view.sensor && std::holds_alternative<SphericalSensor>(*view.sensor);
    if (!is_in_file(view))
      object["quantity"] = is_spherical || range.quantity == RangeQuantity::kDistance ? "distance" : "z";
    object["scale_m"] = range.scale_m;
    if (!range.invalid_values.empty()) object["invalid"] = range.invalid_values;
    if (!range.channel.empty()) object["channel"] = range.channel;
    if (!range.intensity_file.empty()) object["intensity"] = store(range.intensity_file);
    return object;
  }

  Json to_color(const ViewSource& view) {
    const ColorSource& color = *view.color;
    if (color.memory) throw InvalidInput(file_, view.name, "color", "is held in memory; write it to a file first");
    if (is_in_file(color.camera))
      throw InvalidInput(file_, view.name, "color.camera", "a measured grid has no model that a manifest could hold");
    const bool has_same_camera = view.sensor && is_same_sensor(color.camera, *view.sensor);
    Json object;
    object["file"] = store(color.file);
    if (color.index > 0) object["index"] = color.index;
    object["camera"] = has_same_camera ? "same" : sensors_.id_of(view.sensor_id + "-color", color.camera);
    if (color.T_view_color.matrix() != Eigen::Matrix4d::Identity())
      object["T_view_color"] = to_json(color.T_view_color);
    return object;
  }

  const Scene& scene_;
  const std::filesystem::path& file_;
  std::filesystem::path folder_;
  SensorTable sensors_;
};

}  // namespace

void write_scene(const Scene& scene, const std::filesystem::path& file) {
  std::string text;
  try {
    text = Writer(scene, file).run();
  } catch (const nlohmann::json::exception& error) {
    throw InvalidInput(file, {}, {}, std::string("a name or path is not valid UTF-8: ") + error.what());
  }
  OutputFile output(file);
  output.write(text);
  output.commit();
}

}  // namespace lapseam
