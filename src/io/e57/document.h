#pragma once

// What the XML section of an E57 file says of scans and images.

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/e57/paged_file.h"

namespace lapseam {

/// One field of a record: how it is packed, and what the packed number means.
struct E57Field {
  enum class Kind { kInteger, kScaledInteger, kFloat, kDouble, kString };
  std::string name;
  Kind kind = Kind::kDouble;
  std::int64_t minimum = 0, maximum = 0;  ///< integers
  double scale = 1, offset = 0;           ///< scaled integers
  int bits = 64;                          ///< a record; 0: always the minimum; strings: unknown, 0
};

struct E57Limits {
  double minimum = 0, maximum = 0;
};

struct E57Scan {
  std::string guid, name;
  std::optional<Eigen::Isometry3d> T_world_scan;
  std::uint64_t record_count = 0, section_offset = 0;  ///< physical
  std::vector<E57Field> fields;
  std::optional<E57Limits> rows, columns;  ///< indexBounds
  std::optional<E57Limits> intensity;
  std::array<std::optional<E57Limits>, 3> color;

  /// Index of a field; −1: there is none.
  int find(std::string_view name) const;
};

struct E57Image {
  enum class Kind { kOther, kPinhole, kSpherical, kCylindrical };
  std::string guid, name, scan_guid;
  std::optional<Eigen::Isometry3d> T_world_image;  ///< of the standard's camera frame
  Kind kind = Kind::kOther;
  std::uint64_t blob_offset = 0, blob_bytes = 0;
  int width = 0, height = 0;
  /// Pixels: metres (pinhole), radians (spherical), radians across and metres upwards (cylindrical).
  double focal_m = 0, radius_m = 0, pixel_width = 0, pixel_height = 0;
  double principal_x = 0, principal_y = 0;
};

struct E57Document {
  std::vector<E57Scan> scans;
  std::vector<E57Image> images;
};

E57Document read_e57_document(PagedFile& file);

}  // namespace lapseam
