// Image2D entries of an E57 file as colour cameras.

#include <cmath>

#include "io/e57/compressed_vector.h"
#include "io/e57/e57.h"

namespace lapseam {
namespace {

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
  return std::nullopt;
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

std::optional<ColorSource> find_e57_image(const Source& source, std::uint32_t scan_index,
                                          const Eigen::Isometry3d& T_world_scan, bool has_own_color) {
  PagedFile file(source);
  const E57Document document = read_e57_document(file);
  const E57Scan& scan = document.scans.at(scan_index);
  std::optional<ColorSource> best;
  double best_field = 0;
  for (std::size_t i = 0; i < document.images.size(); ++i) {
    const E57Image& image = document.images[i];
    const bool is_of_scan = image.scan_guid.empty() ? document.scans.size() == 1 : image.scan_guid == scan.guid;
    const std::optional<Sensor> camera = is_of_scan ? camera_of(image) : std::nullopt;
    if (!camera) continue;
    const auto* pinhole = std::get_if<PinholeSensor>(&*camera);
    // A pinhole image shows a part of a scan only: the scan's own colours are worth more.
    if (pinhole && has_own_color) continue;
    const double field = pinhole ? std::atan(pinhole->width / pinhole->fx / 2) : 10.0;
    if (field <= best_field) continue;
    best_field = field;
    best.emplace();
    best->file = source.file;
    best->index = kImageOfFile + std::uint32_t(i);
    best->camera = *camera;
    best->T_view_color = T_world_scan.inverse() * to_our_axes(image);
  }
  return best;
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
