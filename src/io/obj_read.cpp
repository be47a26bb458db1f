// Wavefront OBJ and MTL: v (with colours), vt, f, usemtl, mtllib; newmtl, Kd, map_Kd. The rest is skipped.

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <string>

#include "io/mesh_formats.h"
#include "io/output_file.h"
#include "io/page_codec.h"
#include "io/text_scan.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

/// What a material says about the surface: an image, else one colour, else nothing.
struct Material {
  std::string image_name;
  std::optional<Rgb8> color;
  std::uint32_t page = kInvalidIndex;
  bool has_page = false;  ///< page has been looked up
};

std::uint8_t to_channel(double value) {
  if (!(value > 0)) return 0;  // NaN too
  return value < 1 ? std::uint8_t(value * 255.0 + 0.5) : std::uint8_t(255);
}

/// Three numbers; nothing when one is missing or not a number.
std::optional<Eigen::Vector3d> take_vector3(std::string_view& words) {
  Eigen::Vector3d vector;
  for (int axis = 0; axis < 3; ++axis) {
    const auto value = parse_number<double>(take_word(words));
    if (!value) return std::nullopt;
    vector[axis] = *value;
  }
  return vector;
}

/// The file name after options such as "-s 1 1 1": the rest of the line, which may hold spaces, unless it has options.
std::string map_file_name(std::string_view words) {
  words = trim(words);
  if (!words.starts_with('-')) return std::string(words);
  std::string_view last;
  for (std::string_view word = take_word(words); !word.empty(); word = take_word(words)) last = word;
  return std::string(last);
}

/// Of a file that the OBJ file names, which must be a regular one: a device may have no end, a pipe no writer.
std::vector<char> read_named_file_bytes(const std::filesystem::path& file) {
  std::error_code ignored;
  const std::filesystem::file_status status = std::filesystem::status(file, ignored);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
    throw IoError(file, "cannot read: this is no regular file");
  return read_file_bytes(file);
}

std::map<std::string, Material> read_materials(const std::filesystem::path& file) {
  const std::vector<char> bytes = read_named_file_bytes(file);
  std::map<std::string, Material> materials;
  Material* current = nullptr;
  std::string_view rest(bytes.data(), bytes.size());
  while (!rest.empty()) {
    std::string_view words = take_line(rest);
    const std::string_view keyword = take_word(words);
    if (keyword == "newmtl") {
      current = &materials[std::string(trim(words))];
    } else if (current && keyword == "map_Kd") {
      current->image_name = map_file_name(words);
    } else if (current && keyword == "Kd") {
      if (const auto kd = take_vector3(words))
        current->color = Rgb8{to_channel(kd->x()), to_channel(kd->y()), to_channel(kd->z())};
    }
  }
  return materials;
}

class ObjReader {
 public:
  ObjReader(const std::filesystem::path& file, std::span<const char> bytes)
      : file_(file), rest_(bytes.data(), bytes.size()) {}

  Mesh run() {
    std::string joined;
    while (!rest_.empty()) {
      ++line_number_;
      std::string_view line = take_line(rest_);
      // A backslash at the end joins lines.
      if (line.ends_with('\\')) {
        joined.append(line.substr(0, line.size() - 1)).push_back(' ');
        if (!rest_.empty()) continue;
        line = {};
      }
      if (!joined.empty()) {
        joined.append(line);
        parse_line(joined);
        joined.clear();
      } else {
        parse_line(line);
      }
    }
    finish();
    return std::move(mesh_);
  }

 private:
  struct Corner {
    std::uint32_t vertex;
    std::uint32_t texcoord;  ///< kInvalidIndex: none
  };

  [[noreturn]] void fail(const std::string& problem) const {
    throw InvalidInput(file_, {}, "line " + std::to_string(line_number_), problem);
  }

  void parse_line(std::string_view line) {
    std::string_view words = line.substr(0, line.find('#'));
    const std::string_view keyword = take_word(words);
    if (keyword == "v") {
      add_vertex(words);
    } else if (keyword == "vt") {
      add_texcoord(words);
    } else if (keyword == "f") {
      add_face(words);
    } else if (keyword == "usemtl") {
      use_material(std::string(trim(words)));
    } else if (keyword == "mtllib") {
      add_library(std::string(trim(words)));
    }
  }

  void add_vertex(std::string_view words) {
    const auto position = take_vector3(words);
    if (!position || !position->allFinite()) fail("a vertex needs three finite coordinates");
    if (mesh_.positions_m.empty()) mesh_.origin_m = choose_origin(*position);
    mesh_.positions_m.push_back((*position - mesh_.origin_m).cast<float>());
    if (!mesh_.positions_m.back().allFinite()) fail("the position is too far away");
    if (mesh_.positions_m.size() >= kInvalidIndex) fail("more vertices than 32-bit indices can tell apart");
    const auto color = take_vector3(words);
    has_colors_ = has_colors_ || color;
    const Eigen::Vector3d c = color.value_or(Eigen::Vector3d::Ones());
    mesh_.colors.push_back({to_channel(c.x()), to_channel(c.y()), to_channel(c.z())});
  }

  void add_texcoord(std::string_view words) {
    const auto u = parse_number<float>(take_word(words));
    // A one-dimensional texture has no v.
    const std::string_view second = take_word(words);
    const auto v = second.empty() ? std::optional<float>(0.0f) : parse_number<float>(second);
    if (!u || !v || !std::isfinite(*u) || !std::isfinite(*v)) fail("a texture coordinate needs finite numbers");
    texcoords_.emplace_back(*u, 1.0f - *v);
  }

  /// OBJ counts from 1, and negative numbers from the end.
  std::uint32_t resolve(std::string_view word, std::size_t count, const char* what) const {
    const auto number = parse_number<std::int64_t>(word);
    const std::int64_t index = !number ? -1 : *number < 0 ? std::int64_t(count) + *number : *number - 1;
    if (index < 0 || index >= std::int64_t(count))
      fail("there is no " + std::string(what) + " " + std::string(word) + " among " + std::to_string(count));
    return std::uint32_t(index);
  }

  void add_face(std::string_view words) {
    polygon_.clear();
    bool has_texcoords = true;
    for (std::string_view word = take_word(words); !word.empty(); word = take_word(words)) {
      const std::size_t slash = word.find('/');
      Corner corner{resolve(word.substr(0, slash), mesh_.positions_m.size(), "vertex"), kInvalidIndex};
      if (slash != std::string_view::npos) {
        const std::string_view texcoord = word.substr(slash + 1, word.find('/', slash + 1) - slash - 1);
        if (!texcoord.empty()) corner.texcoord = resolve(texcoord, texcoords_.size(), "texture coordinate");
      }
      has_texcoords = has_texcoords && corner.texcoord != kInvalidIndex;
      polygon_.push_back(corner);
    }
    const std::uint32_t page = page_of_material(has_texcoords);
    for (std::size_t i = 2; i < polygon_.size(); ++i) add_triangle({polygon_[0], polygon_[i - 1], polygon_[i]}, page);
  }

  void add_triangle(const std::array<Corner, 3>& corners, std::uint32_t page) {
    mesh_.triangles.push_back({corners[0].vertex, corners[1].vertex, corners[2].vertex});
    mesh_.triangle_page.push_back(page);
    std::array<Eigen::Vector2f, 3> uv;
    for (std::size_t i = 0; i < 3; ++i)
      uv[i] = corners[i].texcoord == kInvalidIndex ? Eigen::Vector2f(0.5f, 0.5f) : texcoords_[corners[i].texcoord];
    mesh_.texcoords.push_back(uv);
  }

  void add_library(const std::string& name) {
    const std::filesystem::path library = file_.parent_path() / name;
    for (auto& [material_name, material] : read_materials(library)) {
      libraries_[material_name] = library;
      materials_[material_name] = std::move(material);
    }
    material_ = nullptr;
  }

  void use_material(const std::string& name) {
    const auto found = materials_.find(name);
    // A name that no library explains says nothing about the surface.
    material_ = found == materials_.end() ? nullptr : &found->second;
    if (material_) material_library_ = libraries_[name];
  }

  std::uint32_t page_of_material(bool has_texcoords) {
    if (!material_) return kInvalidIndex;
    if (!material_->image_name.empty()) {
      if (!has_texcoords) return kInvalidIndex;
      if (!material_->has_page)
        material_->page = page_of_image(material_library_.parent_path() / material_->image_name);
    } else if (!material_->has_page && material_->color && !has_colors_) {
      // A plain colour is a page of one pixel; colours of vertices say more.
      material_->page = std::uint32_t(mesh_.pages.size());
      mesh_.pages.emplace_back(1, 1, *material_->color);
    }
    material_->has_page = true;
    return material_->page;
  }

  std::uint32_t page_of_image(const std::filesystem::path& image) {
    const auto [entry, is_new] = image_pages_.try_emplace(image.string(), std::uint32_t(mesh_.pages.size()));
    if (is_new) mesh_.pages.push_back(decode_page(read_named_file_bytes(image), image));
    return entry->second;
  }

  void finish() {
    if (!has_colors_) mesh_.colors.clear();
    if (!mesh_.pages.empty()) return;
    mesh_.texcoords.clear();
    mesh_.triangle_page.clear();
  }

  const std::filesystem::path& file_;
  std::string_view rest_;
  std::size_t line_number_ = 0;
  Mesh mesh_;
  bool has_colors_ = false;
  std::vector<Eigen::Vector2f> texcoords_;
  std::vector<Corner> polygon_;
  std::map<std::string, Material> materials_;
  std::map<std::string, std::filesystem::path> libraries_;  ///< file in which a material is
  std::map<std::string, std::uint32_t> image_pages_;
  Material* material_ = nullptr;
  std::filesystem::path material_library_;
};

}  // namespace

bool looks_like_obj(std::span<const char> bytes) {
  static const std::set<std::string_view> kKeywords{"v", "vt", "vn", "vp", "f",      "l",
                                                    "p", "g",  "o",  "s",  "usemtl", "mtllib"};
  std::string_view rest(bytes.data(), bytes.size());
  while (!rest.empty()) {
    std::string_view words = take_line(rest);
    const std::string_view keyword = take_word(words);
    if (keyword.empty() || keyword.starts_with('#')) continue;
    return kKeywords.contains(keyword);
  }
  return false;
}

Mesh read_obj(const std::filesystem::path& file, std::span<const char> bytes) { return ObjReader(file, bytes).run(); }

}  // namespace lapseam
