#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "io/codecs.h"
#include "io/exr.h"
#include "io/range_grid.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

/// Metres per unit of the range along a pixel's ray that one unit of distance makes: z/d of a pinhole.
double z_per_distance(const PinholeSensor& sensor, int u, int v) {
  const Eigen::Vector3d ray = sensor.unproject(u, v, 1.0);
  return ray.z() / ray.norm();
}

/// Stored values to the sensor's own r, in place.
class Converter {
 public:
  explicit Converter(const RangeSource& range) : range_(range) {}

  /// 0 for what is no sample: not positive, not finite, or one of the values that mean so.
  float operator()(double stored) const {
    for (const double invalid : range_.invalid_values)
      if (stored == invalid) return kInvalidRange;
    const double r = stored * range_.scale_m;
    // Also refuses what is finite as a double only, or vanishes as a float.
    const bool is_sample =
        r >= double(std::numeric_limits<float>::min()) && r <= double(std::numeric_limits<float>::max());
    return is_sample ? float(r) : kInvalidRange;
  }

 private:
  const RangeSource& range_;
};

template <typename Stored>
RangeImage convert(const Image<Stored>& stored, const RangeSource& source) {
  const Converter converter(source);
  RangeImage range(stored.width, stored.height);
  std::transform(stored.pixels.begin(), stored.pixels.end(), range.pixels.begin(),
                 [&](Stored value) { return converter(double(value)); });
  return range;
}

/// 16-bit images have few values: a table of them all costs less than a test per pixel.
RangeImage convert(const Image<std::uint16_t>& stored, const RangeSource& source) {
  const Converter converter(source);
  std::vector<float> table(65536);
  for (std::size_t value = 0; value < table.size(); ++value) table[value] = converter(double(value));
  RangeImage range(stored.width, stored.height);
  std::transform(stored.pixels.begin(), stored.pixels.end(), range.pixels.begin(),
                 [&](std::uint16_t value) { return table[value]; });
  return range;
}

RangeImage read_range(const Source& source, const RangeSource& range) {
  switch (range.format) {
    case RangeFormat::kPng16:
      return convert(read_gray16(source), range);
    case RangeFormat::kExr:
      return convert(read_exr_range(source, range.channel), range);
    case RangeFormat::kMemory:
      if (!range.memory) source.refuse("range", "held in memory, but there is none");
      return convert(*range.memory, range);
    case RangeFormat::kStanfordGrid:
      break;
  }
  source.refuse("range", "unexpected format");
}

void distance_to_z(const PinholeSensor& sensor, RangeImage& range) {
  for (int v = 0; v < range.height; ++v) {
    for (int u = 0; u < range.width; ++u) {
      float& r = range.at(u, v);
      if (r > 0) r = float(double(r) * z_per_distance(sensor, u, v));
    }
  }
}

Sensor sensor_in_file(const Source& source, const RangeSource& range) {
  if (range.format != RangeFormat::kExr) source.refuse("sensor", "missing");
  const ExrHeader header = read_exr_header(source);
  if (header.sensor) return *header.sensor;
  if (header.is_measured_grid) return read_exr_measured_grid(source);
  source.refuse("sensor", "missing, and the EXR file has no sensor attributes");
}

void load_grid(const Source& source, const RangeSource& range, View& view) {
  const RangeGrid grid = read_range_grid(source, range.scale_m);
  // The scanners of these files look along −z, with +y up.
  const Eigen::Vector3d toward_scene(0, 0, -1);
  try {
    MeasuredGrid measured = fit_measured_grid(grid.width, grid.height, grid.points_m, toward_scene);
    view.sensor = std::move(measured.sensor);
    view.range = std::move(measured.range);
  } catch (const InvalidInput& error) {
    source.refuse("range", error.what());
  }
}

}  // namespace

View load_view(const ViewSource& view_source) {
  const RangeSource& range = view_source.range;
  const Source source{range.file, view_source.name};
  View view;
  view.name = view_source.name;
  view.sensor_id = view_source.sensor_id;
  view.T_world_view = view_source.T_world_view;
  if (range.format == RangeFormat::kStanfordGrid) {
    load_grid(source, range, view);
    return view;
  }
  view.range = read_range(source, range);
  view.sensor = view_source.sensor ? *view_source.sensor : sensor_in_file(source, range);

  const ImageSize image_size{view.range.width, view.range.height};
  const ImageSize sensor_size{width(view.sensor), height(view.sensor)};
  if (image_size != sensor_size)
    source.refuse("size", "the range image is " + to_string(image_size) + ", its sensor " + to_string(sensor_size));
  const auto* pinhole = std::get_if<PinholeSensor>(&view.sensor);
  if (pinhole && range.quantity == RangeQuantity::kDistance) distance_to_z(*pinhole, view.range);
  const bool has_sample =
      std::any_of(view.range.pixels.begin(), view.range.pixels.end(), [](float r) { return r > 0; });
  if (!has_sample) source.refuse("range", "the range image has no valid sample");
  return view;
}

ColorImage load_color(const ViewSource& view_source) {
  if (!view_source.color) throw InvalidInput({}, view_source.name, "color", "the view has no colour image");
  const ColorSource& color = *view_source.color;
  const Source source{color.file, view_source.name};
  ColorImage image = color.memory ? *color.memory : read_color(source);
  const ImageSize image_size{image.width, image.height};
  const ImageSize camera_size{width(color.camera), height(color.camera)};
  if (image_size != camera_size)
    source.refuse("color", "the image is " + to_string(image_size) + ", its camera " + to_string(camera_size));
  return image;
}

}  // namespace lapseam
