#pragma once

// The header of a PLY file (G. Turk, "The PLY Polygon File Format", 1994): what is in the body, and how it is stored.

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace lapseam {

enum class PlyFormat { kAscii, kLittleEndian, kBigEndian };
enum class PlyType : std::uint8_t { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

std::size_t size_bytes(PlyType type);
inline bool is_floating(PlyType type) { return type == PlyType::kFloat32 || type == PlyType::kFloat64; }

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat32;  ///< of a list: of its items
  bool is_list = false;
  PlyType count_type = PlyType::kUint8;
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;

  /// No row of this element takes fewer bytes.
  std::size_t min_row_bytes(PlyFormat format) const;
};

struct PlyHeader {
  PlyFormat format = PlyFormat::kAscii;
  std::vector<PlyElement> elements;
  std::optional<Eigen::Vector3d> origin_m;  ///< of our own `obj_info origin_m x y z`
  std::size_t body_offset = 0;              ///< bytes before the body
};

/// Throws InvalidInput with the file and the line that is wrong.
PlyHeader parse_ply_header(const std::filesystem::path& file, std::span<const char> bytes);

}  // namespace lapseam
