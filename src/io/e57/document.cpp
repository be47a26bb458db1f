#include "io/e57/document.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <pugixml.hpp>

#include "io/text_scan.h"

namespace lapseam {
namespace {

using pugi::xml_node;

/// Numbers of an element or attribute; what is empty or missing means `missing`.
class Reader {
 public:
  explicit Reader(const Source& source) : source_(source) {}

  double number(const std::string& field, std::string_view text, double missing) const {
    text = trim(text);
    if (text.empty()) return missing;
    const auto value = parse_number<double>(text);
    if (!value) source_.refuse(field, "'" + std::string(text.substr(0, 40)) + "' is not a number");
    return *value;
  }

  std::int64_t integer(const std::string& field, std::string_view text, std::int64_t missing) const {
    text = trim(text);
    if (text.empty()) return missing;
    const auto value = parse_number<std::int64_t>(text);
    if (!value) source_.refuse(field, "'" + std::string(text.substr(0, 40)) + "' is not an integer");
    return *value;
  }

  std::uint64_t size(const xml_node& node, const char* name) const {
    const std::int64_t value = integer(std::string(node.name()) + "." + name, node.attribute(name).value(), -1);
    if (value < 0) source_.refuse(std::string(node.name()) + "." + name, "missing or negative");
    return std::uint64_t(value);
  }

  /// The number in a child element, scaled where the element says so.
  double child(const xml_node& node, const char* name, double missing = 0) const {
    const xml_node child = node.child(name);
    if (!child) return missing;
    const double stored = number(name, child.child_value(), 0);
    if (std::string_view(child.attribute("type").value()) != "ScaledInteger") return stored;
    return stored * number(name, child.attribute("scale").value(), 1) +
           number(name, child.attribute("offset").value(), 0);
  }

  std::optional<E57Limits> limits(const xml_node& node, const char* low, const char* high) const {
    if (!node.child(low) || !node.child(high)) return std::nullopt;
    return E57Limits{child(node, low), child(node, high)};
  }

  Eigen::Isometry3d pose(const xml_node& node, const std::string& field) const {
    const xml_node r = node.child("rotation"), t = node.child("translation");
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    if (r) {
      const Eigen::Quaterniond q(child(r, "w"), child(r, "x"), child(r, "y"), child(r, "z"));
      constexpr double kTolerance = 1e-3;  // a wrong quaternion is off by far more
      if (!(std::abs(q.norm() - 1) < kTolerance))
        source_.refuse(field + ".rotation", "the quaternion has length " + std::to_string(q.norm()) + ", not 1");
      pose.linear() = q.normalized().toRotationMatrix();
    }
    if (t) pose.translation() = Eigen::Vector3d(child(t, "x"), child(t, "y"), child(t, "z"));
    if (!pose.matrix().allFinite()) source_.refuse(field + ".translation", "is not finite");
    return pose;
  }

  E57Field field(const xml_node& node) const {
    E57Field field;
    field.name = node.name();
    const std::string_view type = node.attribute("type").value();
    if (type == "Integer" || type == "ScaledInteger") {
      field.kind = type == "Integer" ? E57Field::Kind::kInteger : E57Field::Kind::kScaledInteger;
      using Limits = std::numeric_limits<std::int64_t>;
      field.minimum = integer(field.name + ".minimum", node.attribute("minimum").value(), Limits::min());
      field.maximum = integer(field.name + ".maximum", node.attribute("maximum").value(), Limits::max());
      if (field.minimum > field.maximum) source_.refuse(field.name, "the minimum is above the maximum");
      field.bits = std::bit_width(std::uint64_t(field.maximum) - std::uint64_t(field.minimum));
      field.scale = number(field.name + ".scale", node.attribute("scale").value(), 1);
      field.offset = number(field.name + ".offset", node.attribute("offset").value(), 0);
      if (!std::isfinite(field.scale) || !std::isfinite(field.offset))
        source_.refuse(field.name, "scale and offset must be finite");
    } else if (type == "Float") {
      const bool is_single = std::string_view(node.attribute("precision").value()) == "single";
      field.kind = is_single ? E57Field::Kind::kFloat : E57Field::Kind::kDouble;
      field.bits = is_single ? 32 : 64;
    } else if (type == "String") {
      field.kind = E57Field::Kind::kString;
      field.bits = 0;
    } else {
      source_.refuse(field.name, "'" + std::string(type.substr(0, 40)) + "' is no type of a field");
    }
    return field;
  }

 private:
  const Source& source_;
};

E57Scan read_scan(const Source& source, const xml_node& node) {
  const Reader reader(source);
  E57Scan scan;
  scan.guid = node.child_value("guid");
  scan.name = node.child_value("name");
  if (const xml_node pose = node.child("pose")) scan.T_world_scan = reader.pose(pose, "pose");
  const xml_node bounds = node.child("indexBounds"), colors = node.child("colorLimits");
  scan.rows = reader.limits(bounds, "rowMinimum", "rowMaximum");
  scan.columns = reader.limits(bounds, "columnMinimum", "columnMaximum");
  scan.intensity = reader.limits(node.child("intensityLimits"), "intensityMinimum", "intensityMaximum");
  scan.color = {reader.limits(colors, "colorRedMinimum", "colorRedMaximum"),
                reader.limits(colors, "colorGreenMinimum", "colorGreenMaximum"),
                reader.limits(colors, "colorBlueMinimum", "colorBlueMaximum")};
  const xml_node points = node.child("points");
  if (!points) source.refuse("points", "missing");
  scan.record_count = reader.size(points, "recordCount");
  scan.section_offset = reader.size(points, "fileOffset");
  for (const xml_node& child : points.child("prototype"))
    if (child.type() == pugi::node_element) scan.fields.push_back(reader.field(child));
  return scan;
}

void read_representation(const Reader& reader, const xml_node& node, E57Image& image) {
  for (const char* name : {"jpegImage", "pngImage"}) {
    const xml_node blob = node.child(name);
    if (!blob) continue;
    image.blob_offset = reader.size(blob, "fileOffset");
    image.blob_bytes = reader.size(blob, "length");
  }
  const auto pixels = [&](const char* name) {
    const double size = reader.child(node, name);
    return size >= 1 && size <= 1 << 30 ? int(size) : 0;
  };
  image.width = pixels("imageWidth");
  image.height = pixels("imageHeight");
  image.pixel_width = reader.child(node, "pixelWidth");
  image.pixel_height = reader.child(node, "pixelHeight");
  image.focal_m = reader.child(node, "focalLength");
  image.radius_m = reader.child(node, "radius");
  image.principal_x = reader.child(node, "principalPointX");
  image.principal_y = reader.child(node, "principalPointY");
}

E57Image read_image(const Source& source, const xml_node& node) {
  const Reader reader(source);
  E57Image image;
  image.guid = node.child_value("guid");
  image.name = node.child_value("name");
  image.scan_guid = node.child_value("associatedData3DGuid");
  if (const xml_node pose = node.child("pose")) image.T_world_image = reader.pose(pose, "images2D.pose");
  if (const xml_node pinhole = node.child("pinholeRepresentation")) {
    image.kind = E57Image::Kind::kPinhole;
    read_representation(reader, pinhole, image);
  } else if (const xml_node spherical = node.child("sphericalRepresentation")) {
    image.kind = E57Image::Kind::kSpherical;
    read_representation(reader, spherical, image);
  } else if (const xml_node cylindrical = node.child("cylindricalRepresentation")) {
    image.kind = E57Image::Kind::kCylindrical;
    read_representation(reader, cylindrical, image);
  }
  return image;
}

}  // namespace

int E57Scan::find(std::string_view wanted) const {
  const auto found = std::find_if(fields.begin(), fields.end(), [&](const E57Field& f) { return f.name == wanted; });
  return found == fields.end() ? -1 : int(found - fields.begin());
}

E57Document read_e57_document(PagedFile& file) {
  const std::string xml = file.read_xml();
  pugi::xml_document parsed;
  const pugi::xml_parse_result result = parsed.load_buffer(xml.data(), xml.size());
  if (!result)
    file.source().refuse("XML",
                         std::string("damaged at byte ") + std::to_string(result.offset) + ": " + result.description());
  const xml_node root = parsed.child("e57Root");
  if (!root) file.source().refuse("XML", "has no e57Root");
  E57Document document;
  for (const xml_node& node : root.child("data3D"))
    if (node.type() == pugi::node_element) document.scans.push_back(read_scan(file.source(), node));
  for (const xml_node& node : root.child("images2D"))
    if (node.type() == pugi::node_element) document.images.push_back(read_image(file.source(), node));
  return document;
}

}  // namespace lapseam
