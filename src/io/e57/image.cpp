// Image2D entries of an E57 file as colour cameras.

#include <algorithm>
#include <cmath>

#include "io/e57/compressed_vector.h"
#include "io/e57/e57.h"

namespace lapseam {
namespace {

/// Columns are as far apart in azimuth as those of a panorama; rows, as high on a cylinder round the z axis: a table of
/// elevations.
std::optional<Sensor> cylinder_of(const E57Image& image) {
  const double half_width = image.width * image.pixel_width / 2, row_height = image.pixel_height / image.radius_m;
  if (!(half_width > 0 && half_width < 3.2 && row_height > 0 && std::isfinite(row_height * image.principal_y)))
    return std::nullopt;
  SphericalSensor sensor =
      SphericalSensor::from_limits(image.width, image.height, half_width, -half_width, 1, -1);  // rows: below
  for (int v = 0; v < image.height; ++v)
    sensor.elevation_rad[std::size_t(v)] = std::atan((image.principal_y - (v + 0.5)) * row_height);
  // So far up or down that rows run together.
  if (!(sensor.elevation_rad[0] > sensor.elevation_rad[1]) ||
      !std::is_sorted(sensor.elevation_rad.rbegin(), sensor.elevation_rad.rend()))
    return std::nullopt;
  return sensor;
}

/// The camera of an image, in our axes; nothing where the file does not say enough.
std::optional<Sensor> camera_of(const E57Image& image) {
  if (image.blob_bytes == 0 || image.width < 2 || image.height < 2 || !image.T_world_image) return std::nullopt;
  if (image.kind == E57Image::Kind::kPinhole) {
    const double fx = image.focal_m / image.pixel_width, fy = image.focal_m / image.pixel_height;
    if (!(fx > 0 && fy > 0 && std::isfinite(fx + fy + image.principal_x + image.principal_y))) return std::nullopt;
    // Skyboxes have their principal points at half their width: the first pixel begins at 0.
    return PinholeSensor{image.width, image.height, fx, fy, image.principal_x - 0.5, image.principal_y - 0.5, {}};
  }
  if (image.kind == E57Image::Kind::kSpherical) {
    const double half_width = image.width * image.pixel_width / 2, half_height = image.height * image.pixel_height / 2;
    if (!(half_width > 0 && half_width < 3.2 && half_height > 0 && half_height < 1.6)) return std::nullopt;
    return SphericalSensor::from_limits(image.width, image.height, half_width, -half_width, half_height, -half_height);
  }
  if (image.kind == E57Image::Kind::kCylindrical) return cylinder_of(image);
  return std::nullopt;
}

/// How much of the surroundings a camera sees, to compare by; panoramas see most.
double field_of(const Sensor& camera) {
  const auto* pinhole = std::get_if<PinholeSensor>(&camera);
  return pinhole ? std::atan(pinhole->width / pinhole->fx / 2) : 10.0;
}

/// The standard's pinhole cameras look along −z with y up; ours along z with y down. Panoramas have z up in both.
Eigen::Isometry3d to_our_axes(const E57Image& image) {
  Eigen::Isometry3d T = *image.T_world_image;
  if (image.kind == E57Image::Kind::kPinhole) T.linear() = T.linear() * Eigen::Vector3d(1, -1, -1).asDiagonal();
  return T;
}

const E57Image& image_at(const Source& source, const E57Document& document, std::uint32_t index) {
  if (index >= document.images.size())
    source.refuse("color.index", "there is no image " + std::to_string(index) + "; the file has " +
                                     std::to_string(document.images.size()));
  return document.images[index];
}

}  // namespace

std::vector<ColorSource> find_e57_images(const Source& source, std::uint32_t scan_index,
                                         const Eigen::Isometry3d& T_world_scan) {
  PagedFile file(source);
  const E57Document document = read_e57_document(file);
  const E57Scan& scan = document.scans.at(scan_index);
  std::vector<ColorSource> found;
  for (std::size_t i = 0; i < document.images.size(); ++i) {
    const E57Image& image = document.images[i];
    const bool is_of_scan = image.scan_guid.empty() ? document.scans.size() == 1 : image.scan_guid == scan.guid;
    // A table of angles for a panorama is not made before it is known that the file can hold one.
    constexpr std::uint64_t kMostPixelsPerByte = 4096, kAlwaysFine = 1 << 16;
    const std::uint64_t bytes = std::min(image.blob_bytes, file.logical_bytes());
    const bool is_there =
        std::uint64_t(image.width) * std::uint64_t(image.height) <= bytes * kMostPixelsPerByte + kAlwaysFine;
    const std::optional<Sensor> camera = is_of_scan && is_there ? camera_of(image) : std::nullopt;
    if (!camera) continue;
    ColorSource& color = found.emplace_back();
    color.file = source.file;
    color.index = kImageOfFile + std::uint32_t(i);
    color.camera = *camera;
    color.T_view_color = T_world_scan.inverse() * to_our_axes(image);
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const ColorSource& a, const ColorSource& b) { return field_of(a.camera) > field_of(b.camera); });
  return found;
}

ColorImage read_e57_image(const Source& source, std::uint32_t image_index) {
  PagedFile file(source);
  const E57Document document = read_e57_document(file);
  const E57Image& image = image_at(source, document, image_index);
  const std::vector<char> bytes = read_e57_blob(file, image.blob_offset, image.blob_bytes);
  const bool is_png = bytes.size() > 4 && bytes[1] == 'P' && bytes[2] == 'N' && bytes[3] == 'G';
  return is_png ? decode_png(source, bytes) : decode_jpeg(source, bytes);
}

ImageSize probe_e57_image(const Source& source, std::uint32_t image_index) {
  PagedFile file(source);
  const E57Document document = read_e57_document(file);
  const E57Image& image = image_at(source, document, image_index);
  return {image.width, image.height};
}

}  // namespace lapseam
