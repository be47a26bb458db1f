#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "io/codecs.h"
#include "io/colmap.h"
#include "io/exr.h"
#include "io/grid_scan.h"
#include "io/npy.h"
#include "io/range_grid.h"
#include "io/sens.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

/// Metres per unit of the range along a pixel's ray that one unit of distance makes: z/d of a pinhole.
double z_per_distance(const PinholeSensor& sensor, int u, int v) {
  const Eigen::Vector3d ray = sensor.unproject(u, v, 1.0);
  return ray.z() / ray.norm();
}

/// Stored values to the sensor's own r, and why there is none.
class Converter {
 public:
  explicit Converter(const RangeSource& range) : range_(range) {}

  /// 0 for what is no sample, which is then counted.
  float operator()(double stored, MissingSamples& missing, std::uint64_t times = 1) const {
    for (const double invalid : range_.invalid_values) {
      if (stored == invalid) {
        (stored == 0 ? missing.zero : missing.named) += times;
        return kInvalidRange;
      }
    }
    const double r = stored * range_.scale_m;
    // Also refuses what is finite as a double only, or vanishes as a float.
    if (r >= double(std::numeric_limits<float>::min()) && r <= double(std::numeric_limits<float>::max()))
      return float(r);
    (r < 0 && std::isfinite(r)   ? missing.negative
     : std::isfinite(r) && r < 1 ? missing.zero
                                 : missing.not_finite) += times;
    return kInvalidRange;
  }

 private:
  const RangeSource& range_;
};

template <typename Stored>
RangeImage convert(const Image<Stored>& stored, const RangeSource& source, MissingSamples& missing) {
  const Converter converter(source);
  RangeImage range(stored.width, stored.height);
  std::transform(stored.pixels.begin(), stored.pixels.end(), range.pixels.begin(),
                 [&](Stored value) { return converter(double(value), missing); });
  return range;
}

/// 16-bit images have few values: a table of them all costs less than a test per pixel, unless there are few pixels
/// too.
RangeImage convert(const Image<std::uint16_t>& stored, const RangeSource& source, MissingSamples& missing) {
  if (stored.pixels.size() < 65536) return convert<std::uint16_t>(stored, source, missing);
  std::vector<std::uint32_t> counts(65536);
  for (const std::uint16_t value : stored.pixels) ++counts[value];
  const Converter converter(source);
  std::vector<float> table(65536);
  for (std::size_t value = 0; value < table.size(); ++value)
    table[value] = converter(double(value), missing, counts[value]);
  RangeImage range(stored.width, stored.height);
  std::transform(stored.pixels.begin(), stored.pixels.end(), range.pixels.begin(),
                 [&](std::uint16_t value) { return table[value]; });
  return range;
}

RangeImage read_range(const Source& source, const RangeSource& range, MissingSamples& missing) {
  switch (range.format) {
    case RangeFormat::kPng16:
      return convert(read_gray16(source), range, missing);
    case RangeFormat::kExr:
      return convert(read_exr_range(source, range.channel), range, missing);
    case RangeFormat::kSens:
      return convert(read_sens_depth(source, range.index, range.offset), range, missing);
    case RangeFormat::kColmapDepth:
      return convert(read_colmap_depth(source), range, missing);
    case RangeFormat::kNpy:
      return convert(read_npy(source), range, missing);
    case RangeFormat::kMemory:
      if (!range.memory) source.refuse("range", "held in memory, but there is none");
      return convert(*range.memory, range, missing);
    default:
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
    view.missing.absent = std::uint64_t(std::count(view.range.pixels.begin(), view.range.pixels.end(), kInvalidRange));
  } catch (const InvalidInput& error) {
    source.refuse("range", error.what());
  }
}

void read_intensity(const ViewSource& view_source, View& view) {
  const std::filesystem::path& file = view_source.range.intensity_file;
  if (file.empty()) return;
  const Source source{file, view_source.name};
  const ColorImage image = read_color(source, 0);
  const ImageSize image_size{image.width, image.height}, range_size{view.range.width, view.range.height};
  if (image_size != range_size)
    source.refuse("range.intensity",
                  "the image is " + to_string(image_size) + ", the range image " + to_string(range_size));
  view.intensity = Image<std::uint8_t>(image.width, image.height);
  std::transform(image.pixels.begin(), image.pixels.end(), view.intensity.pixels.begin(),
                 [](const Rgb8& c) { return std::uint8_t((int(c.r) + int(c.g) + int(c.b)) / 3); });
}

ColorImage read_color_source(const Source& source, const ViewSource& view) {
  const ColorSource& color = *view.color;
  if (view.range.format == RangeFormat::kSens && color.file == view.range.file)
    return read_sens_color(source, color.index, color.offset);
  const bool is_of_scan = holds_scans(view.range.format) && color.file == view.range.file && color.index < kImageOfFile;
  if (!is_of_scan) return read_color(source, color.index);
  const std::unique_ptr<GridScan> scan = open_scan(source, view.range.format, color.index, color.offset,
                                                   ImageSize{width(color.camera), height(color.camera)}, nullptr);
  return load_scan_color(source, *scan, color.camera);
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
  if (holds_scans(range.format)) {
    const auto& sensor = view_source.sensor;
    const auto known_size = sensor ? std::optional<ImageSize>({width(*sensor), height(*sensor)}) : std::nullopt;
    const auto scan = open_scan(source, range.format, range.index, range.offset, known_size, nullptr);
    load_scan(source, *scan, sensor, view);
    return view;
  }
  view.range = read_range(source, range, view.missing);
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
  read_intensity(view_source, view);
  return view;
}

ColorImage load_color(const ViewSource& view_source) {
  if (!view_source.color) throw InvalidInput({}, view_source.name, "color", "the view has no colour image");
  const ColorSource& color = *view_source.color;
  const Source source{color.file, view_source.name};
  ColorImage image = color.memory ? *color.memory : read_color_source(source, view_source);
  const ImageSize image_size{image.width, image.height};
  const ImageSize camera_size{width(color.camera), height(color.camera)};
  if (image_size != camera_size)
    source.refuse("color", "the image is " + to_string(image_size) + ", its camera " + to_string(camera_size));
  return image;
}

}  // namespace lapseam
