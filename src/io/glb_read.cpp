// glTF 2.0 binary: triangles of the scene's nodes, their colours, and the base colour textures.

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <map>
#include <utility>
#include <vector>

#include "io/gltf_document.h"
#include "io/mesh_formats.h"
#include "io/page_codec.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

using nlohmann::json;

constexpr std::uint64_t kTriangles = 4, kFan = 6;  // and 5, a strip, between them

std::uint8_t to_srgb(double linear) {
  if (!(linear > 0)) return 0;  // NaN too
  const double s = linear <= 0.0031308 ? linear * 12.92 : 1.055 * std::pow(linear, 1.0 / 2.4) - 0.055;
  return s < 1 ? std::uint8_t(s * 255.0 + 0.5) : std::uint8_t(255);
}

/// Joins vertices of equal position. glTF splits a vertex where texture coordinates differ; only the position, the same
/// to the last bit, still tells that the surface goes on. Vertices of different colours stay apart.
class VertexJoiner {
 public:
  explicit VertexJoiner(Mesh& mesh) : mesh_(mesh), slots_(64, kInvalidIndex) {}

  /// color: null when nothing is known about it; such a vertex takes the colour of any other at its place.
  std::uint32_t find_or_add(const Eigen::Vector3f& position, const Rgb8* color) {
    if (2 * (mesh_.positions_m.size() + 1) > slots_.size()) grow();
    std::size_t slot = first_slot(position);
    while (slots_[slot] != kInvalidIndex && !matches(slots_[slot], position, color)) slot = next_slot(slot);
    if (slots_[slot] == kInvalidIndex) {
      slots_[slot] = std::uint32_t(mesh_.positions_m.size());
      mesh_.positions_m.push_back(position);
      mesh_.colors.push_back({255, 255, 255});
      has_color_.push_back(0);
    }
    const std::uint32_t vertex = slots_[slot];
    if (color) {
      mesh_.colors[vertex] = *color;
      has_color_[vertex] = 1;
    }
    return vertex;
  }

 private:
  std::size_t first_slot(const Eigen::Vector3f& p) const {
    std::uint64_t h = 0;
    for (int axis = 0; axis < 3; ++axis) {
      h ^= std::bit_cast<std::uint32_t>(p[axis] + 0.0f);  // +0: −0 and 0 are equal
      h *= 0x9E3779B97F4A7C15u;
      h ^= h >> 29;
    }
    return std::size_t(h) & (slots_.size() - 1);
  }
  std::size_t next_slot(std::size_t slot) const { return (slot + 1) & (slots_.size() - 1); }

  bool matches(std::uint32_t vertex, const Eigen::Vector3f& position, const Rgb8* color) const {
    if (mesh_.positions_m[vertex] != position) return false;
    return !color || !has_color_[vertex] || mesh_.colors[vertex] == *color;
  }

  void grow() {
    slots_.assign(slots_.size() * 2, kInvalidIndex);
    for (std::size_t i = 0; i < mesh_.positions_m.size(); ++i) {
      std::size_t slot = first_slot(mesh_.positions_m[i]);
      while (slots_[slot] != kInvalidIndex) slot = next_slot(slot);
      slots_[slot] = std::uint32_t(i);
    }
  }

  Mesh& mesh_;
  std::vector<std::uint8_t> has_color_;
  std::vector<std::uint32_t> slots_;
};

struct Instance {
  std::uint64_t mesh;
  Eigen::Affine3d T_world_mesh;
};

class GlbReader {
 public:
  GlbReader(const std::filesystem::path& file, std::span<const char> bytes) : document_(file, bytes), joiner_(mesh_) {}

  Mesh run() {
    std::vector<Instance> instances = find_instances();
    take_origin(instances);
    for (const Instance& instance : instances) {
      const json& primitives = document_.item("meshes", instance.mesh).at("primitives");
      for (const json& primitive : primitives) read_primitive(primitive, instance.T_world_mesh);
    }
    if (!has_colors_) mesh_.colors.clear();
    if (mesh_.pages.empty()) {
      mesh_.texcoords.clear();
      mesh_.triangle_page.clear();
    }
    return std::move(mesh_);
  }

 private:
  // ---- the tree of nodes

  Eigen::Affine3d local_transform(const json& node) const {
    Eigen::Affine3d T = Eigen::Affine3d::Identity();
    std::array<double, 16> m{};
    if (document_.numbers(node, "matrix", m)) {
      T.matrix() = Eigen::Map<const Eigen::Matrix4d>(m.data());  // by columns, as in glTF
      return T;
    }
    std::array<double, 3> t{0, 0, 0}, s{1, 1, 1};
    std::array<double, 4> q{0, 0, 0, 1};
    document_.numbers(node, "translation", t);
    document_.numbers(node, "rotation", q);
    document_.numbers(node, "scale", s);
    const Eigen::Quaterniond rotation = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).normalized();
    return Eigen::Translation3d(t[0], t[1], t[2]) * rotation * Eigen::Scaling(s[0], s[1], s[2]);
  }

  std::vector<std::uint64_t> root_nodes() const {
    const json& root = document_.root();
    std::vector<std::uint64_t> nodes;
    if (!root.contains("scenes")) {
      // Without a scene, every node that is nobody's child.
      const std::size_t count = root.contains("nodes") ? root.at("nodes").size() : 0;
      std::vector<std::uint8_t> is_child(count, 0);
      for (std::size_t i = 0; i < count; ++i)
        for (const std::uint64_t child : children(document_.item("nodes", i)))
          if (child < count) is_child[child] = 1;
      for (std::size_t i = 0; i < count; ++i)
        if (!is_child[i]) nodes.push_back(i);
      return nodes;
    }
    const json& scene = document_.item("scenes", document_.integer(root, "scene", 0));
    return integers(scene, "nodes");
  }

  std::vector<std::uint64_t> integers(const json& object, const char* key) const {
    std::vector<std::uint64_t> values;
    if (!object.contains(key)) return values;
    for (const json& value : object.at(key)) {
      if (!value.is_number_unsigned()) document_.fail(key, "a non-negative integer is needed here");
      values.push_back(value.get<std::uint64_t>());
    }
    return values;
  }
  std::vector<std::uint64_t> children(const json& node) const { return integers(node, "children"); }

  std::vector<Instance> find_instances() const {
    struct Visit {
      std::uint64_t node;
      Eigen::Affine3d T_world_parent;
    };
    std::vector<Instance> instances;
    std::vector<Visit> stack;
    const std::vector<std::uint64_t> roots = root_nodes();
    for (auto root = roots.rbegin(); root != roots.rend(); ++root)
      stack.push_back({*root, Eigen::Affine3d::Identity()});
    std::vector<std::uint8_t> is_visited(document_.root().contains("nodes") ? document_.root().at("nodes").size() : 0,
                                         0);
    while (!stack.empty()) {
      const Visit visit = stack.back();
      stack.pop_back();
      const json& node = document_.item("nodes", visit.node);
      if (std::exchange(is_visited[visit.node], std::uint8_t(1)))
        document_.fail("nodes", "item " + std::to_string(visit.node) + " has two parents: the nodes are not a tree");
      const Eigen::Affine3d T_world_node = visit.T_world_parent * local_transform(node);
      if (node.contains("mesh")) instances.push_back({document_.integer(node, "mesh"), T_world_node});
      const std::vector<std::uint64_t> below = children(node);
      for (auto child = below.rbegin(); child != below.rend(); ++child) stack.push_back({*child, T_world_node});
    }
    return instances;
  }

  /// A translation that all instances share is the mesh's origin, and positions stay as they are in the file.
  void take_origin(std::vector<Instance>& instances) {
    if (instances.empty()) return;
    const Eigen::Vector3d origin_m = instances.front().T_world_mesh.translation();
    const bool is_shared = std::all_of(instances.begin(), instances.end(), [&](const Instance& instance) {
      return instance.T_world_mesh.translation() == origin_m;
    });
    mesh_.origin_m = is_shared ? origin_m : choose_origin(origin_m);
    for (Instance& instance : instances) instance.T_world_mesh.translation() -= mesh_.origin_m;
  }

  // ---- primitives

  void read_primitive(const json& primitive, const Eigen::Affine3d& T_world_mesh) {
    const std::uint64_t mode = document_.integer(primitive, "mode", kTriangles);
    if (mode < kTriangles || mode > kFan) return;  // points and lines
    const json& attributes = primitive.at("attributes");
    const GltfAccessor positions = document_.accessor(document_.integer(attributes, "POSITION"));
    if (positions.components() != 3) document_.fail("POSITION", "not three numbers");
    count_output(positions.count());
    const std::uint32_t page = page_of(primitive);
    const std::vector<Eigen::Vector2f> texcoords =
        page == kInvalidIndex ? std::vector<Eigen::Vector2f>() : read_texcoords(primitive, positions.count());
    const std::vector<std::uint32_t> vertices = read_vertices(primitive, positions, T_world_mesh);
    const bool is_mirrored = T_world_mesh.linear().determinant() < 0;
    for (Triangle corners : read_triangles(primitive, mode, vertices.size())) {
      if (is_mirrored) std::swap(corners[1], corners[2]);
      mesh_.triangles.push_back({vertices[corners[0]], vertices[corners[1]], vertices[corners[2]]});
      mesh_.triangle_page.push_back(texcoords.empty() ? kInvalidIndex : page);
      auto& uv = mesh_.texcoords.emplace_back();
      for (std::size_t i = 0; i < 3; ++i) uv[i] = texcoords.empty() ? Eigen::Vector2f(0, 0) : texcoords[corners[i]];
    }
  }

  /// Many nodes may show one mesh: what comes out must stay in proportion to the file.
  void count_output(std::size_t items) {
    constexpr std::size_t kAlwaysAllowed = 1 << 16, kMostItemsPerByte = 4;
    output_items_ += items;
    if (output_items_ > kAlwaysAllowed && output_items_ / kMostItemsPerByte > document_.file_bytes())
      document_.fail("nodes", "they repeat meshes too often for a file of this size");
  }

  std::vector<std::uint32_t> read_vertices(const json& primitive, const GltfAccessor& positions,
                                           const Eigen::Affine3d& T_world_mesh) {
    const std::vector<Rgb8> colors = read_colors(primitive, positions.count());
    std::vector<std::uint32_t> vertices(positions.count());
    for (std::size_t i = 0; i < vertices.size(); ++i) {
      const Eigen::Vector3d p(positions.value(i, 0), positions.value(i, 1), positions.value(i, 2));
      const Eigen::Vector3f position = (T_world_mesh * p).cast<float>();
      if (!position.allFinite()) document_.fail("POSITION", "vertex " + std::to_string(i) + " is not finite");
      vertices[i] = joiner_.find_or_add(position, colors.empty() ? nullptr : &colors[i]);
      if (mesh_.positions_m.size() >= kInvalidIndex) document_.fail("POSITION", "too many vertices");
    }
    return vertices;
  }

  /// Colours of the vertices times that of the material; empty when neither says anything.
  std::vector<Rgb8> read_colors(const json& primitive, std::size_t count) {
    std::array<double, 4> factor{1, 1, 1, 1};
    const bool has_factor = document_.numbers(surface_of(primitive), "baseColorFactor", factor);
    const json& attributes = primitive.at("attributes");
    const bool has_colors = attributes.contains("COLOR_0");
    const bool is_textured = surface_of(primitive).contains("baseColorTexture");
    if (is_textured || (!has_colors && !has_factor)) return {};
    has_colors_ = true;
    const Rgb8 plain{to_srgb(factor[0]), to_srgb(factor[1]), to_srgb(factor[2])};
    std::vector<Rgb8> colors(count, plain);
    if (!has_colors) return colors;
    const GltfAccessor accessor = document_.accessor(document_.integer(attributes, "COLOR_0"));
    if (accessor.count() != count || accessor.components() < 3) document_.fail("COLOR_0", "does not match POSITION");
    for (std::size_t i = 0; i < count; ++i)
      colors[i] = {to_srgb(accessor.value(i, 0) * factor[0]), to_srgb(accessor.value(i, 1) * factor[1]),
                   to_srgb(accessor.value(i, 2) * factor[2])};
    return colors;
  }

  std::vector<Triangle> read_triangles(const json& primitive, std::uint64_t mode, std::size_t vertex_count) {
    std::vector<std::uint32_t> order;
    if (primitive.contains("indices")) {
      const GltfAccessor indices = document_.accessor(document_.integer(primitive, "indices"));
      if (indices.components() != 1 || !indices.is_integer()) document_.fail("indices", "not integers");
      order.resize(indices.count());
      for (std::size_t i = 0; i < order.size(); ++i) order[i] = indices.integer(i);
    } else {
      order.resize(vertex_count);
      for (std::size_t i = 0; i < order.size(); ++i) order[i] = std::uint32_t(i);
    }
    count_output(order.size());
    for (const std::uint32_t index : order)
      if (index >= vertex_count)
        document_.fail("indices", "vertex " + std::to_string(index) + " of " + std::to_string(vertex_count));
    std::vector<Triangle> triangles;
    if (mode == kTriangles) {
      for (std::size_t i = 2; i < order.size(); i += 3) triangles.push_back({order[i - 2], order[i - 1], order[i]});
    } else {
      for (std::size_t i = 2; i < order.size(); ++i) {
        // Every other triangle of a strip is wound the other way.
        const std::size_t first = mode == kFan ? 0 : i % 2 == 0 ? i - 2 : i - 1;
        const std::size_t second = mode == kFan || i % 2 == 0 ? i - 1 : i - 2;
        triangles.push_back({order[first], order[second], order[i]});
      }
    }
    return triangles;
  }

  // ---- materials

  /// The material's pbrMetallicRoughness; an empty object when there is none.
  const json& surface_of(const json& primitive) const {
    static const json kNothing = json::object();
    if (!primitive.contains("material")) return kNothing;
    const json& material = document_.item("materials", document_.integer(primitive, "material"));
    const auto found = material.find("pbrMetallicRoughness");
    return found == material.end() ? kNothing : *found;
  }

  std::uint32_t page_of(const json& primitive) {
    const auto texture_info = surface_of(primitive).find("baseColorTexture");
    if (texture_info == surface_of(primitive).end()) return kInvalidIndex;
    const json& texture = document_.item("textures", document_.integer(*texture_info, "index"));
    const json* source = &texture;
    if (const auto found = texture.find("extensions"); found != texture.end() && found->contains("EXT_texture_webp"))
      source = &found->at("EXT_texture_webp");
    const std::uint64_t image = document_.integer(*source, "source");
    const auto [entry, is_new] = image_pages_.try_emplace(image, std::uint32_t(mesh_.pages.size()));
    if (is_new) mesh_.pages.push_back(decode_page(document_.image_bytes(image), document_.file()));
    return entry->second;
  }

  std::vector<Eigen::Vector2f> read_texcoords(const json& primitive, std::size_t count) const {
    const std::uint64_t set = document_.integer(surface_of(primitive).at("baseColorTexture"), "texCoord", 0);
    const std::string key = "TEXCOORD_" + std::to_string(set);
    const GltfAccessor accessor = document_.accessor(document_.integer(primitive.at("attributes"), key.c_str()));
    if (accessor.count() != count || accessor.components() != 2) document_.fail(key, "does not match POSITION");
    std::vector<Eigen::Vector2f> texcoords(count);
    for (std::size_t i = 0; i < count; ++i) {
      texcoords[i] = Eigen::Vector2d(accessor.value(i, 0), accessor.value(i, 1)).cast<float>();
      if (!texcoords[i].allFinite()) document_.fail(key, "not finite");
    }
    return texcoords;
  }

  GltfDocument document_;
  Mesh mesh_;
  VertexJoiner joiner_;
  bool has_colors_ = false;
  std::size_t output_items_ = 0;
  std::map<std::uint64_t, std::uint32_t> image_pages_;
};

}  // namespace

bool looks_like_glb(std::span<const char> bytes) {
  return bytes.size() >= 4 && std::memcmp(bytes.data(), "glTF", 4) == 0;
}

Mesh read_glb(const std::filesystem::path& file, std::span<const char> bytes) {
  try {
    return GlbReader(file, bytes).run();
  } catch (const json::exception& error) {
    // A value of another kind than glTF has there.
    throw InvalidInput(file, {}, "JSON", error.what());
  }
}

}  // namespace lapseam
