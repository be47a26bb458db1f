// glTF 2.0 binary (Khronos Group 2021). Written by hand instead of with tinygltf: a model in tinygltf's form holds a
// copy of all buffers, and its writer makes another one, while here vertices go from the mesh straight to the file.
//
// World axes are kept as they are: whether the world is z-up or y-up is not known, and a viewer can turn the model.
// Materials are single-sided (the mesh is consistently oriented, and one can look into a room from outside).

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

#include "io/mesh_formats.h"
#include "io/output_file.h"
#include "io/page_codec.h"
#include "io/weld_corners.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

using nlohmann::json;

static_assert(std::endian::native == std::endian::little, "binary files are written in the machine's byte order");

constexpr int kUint16 = 5123, kUint32 = 5125, kFloat32 = 5126;  // glTF component types
constexpr int kVertexData = 34962, kIndexData = 34963;          // buffer view targets
constexpr int kLinear = 9729, kLinearMipmapLinear = 9987, kClampToEdge = 33071;

/// glTF colours are linear; 16 bits keep all 256 sRGB values apart.
std::array<std::uint16_t, 256> make_linear_table() {
  std::array<std::uint16_t, 256> table{};
  for (int i = 0; i < 256; ++i) {
    const double s = i / 255.0;
    const double linear = s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4);
    table[std::size_t(i)] = std::uint16_t(std::lround(linear * 65535.0));
  }
  return table;
}

class GlbWriter {
 public:
  GlbWriter(const Mesh& mesh, const std::filesystem::path& file, const WriteMeshOptions& options)
      : mesh_(mesh), file_(file), options_(options), welded_(weld_corners(mesh)) {}

  void run() {
    describe();
    const std::string text = padded_json();
    constexpr std::uint64_t kHeaderBytes = 12, kChunkHeaderBytes = 8;
    const std::uint64_t binary_part = binary_bytes_ > 0 ? kChunkHeaderBytes + binary_bytes_ : 0;
    const std::uint64_t total = kHeaderBytes + kChunkHeaderBytes + text.size() + binary_part;
    if (total > std::numeric_limits<std::uint32_t>::max())
      throw InvalidInput(file_, {}, {}, "a GLB file cannot be over 4 GiB; write a .ply instead");

    OutputFile out(file_);
    out.write("glTF");
    out.put(std::uint32_t(2));
    out.put(std::uint32_t(total));
    out.put(std::uint32_t(text.size()));
    out.write("JSON");
    out.write(text);
    if (binary_bytes_ > 0) {
      out.put(std::uint32_t(binary_bytes_));
      out.write(std::string_view("BIN\0", 4));
      write_binary(out);
    }
    out.commit();
  }

 private:
  void describe() {
    document_["asset"] = {{"version", "2.0"}, {"generator", "lapseam"}};
    document_["scene"] = 0;
    json scene = json::object();
    if (!welded_.empty()) {
      json node = {{"mesh", 0}};
      if (!mesh_.origin_m.isZero(0)) node["translation"] = {mesh_.origin_m.x(), mesh_.origin_m.y(), mesh_.origin_m.z()};
      scene["nodes"] = json::array({0});
      document_["nodes"] = json::array({std::move(node)});
      json primitives = json::array();
      for (const WeldedPage& page : welded_) primitives.push_back(describe_primitive(page));
      document_["meshes"][0]["primitives"] = std::move(primitives);
      for (const WeldedPage& page : welded_)
        if (page.page != kInvalidIndex) describe_image(page.page);
      document_["buffers"][0]["byteLength"] = binary_bytes_;
    }
    document_["scenes"][0] = std::move(scene);
  }

  json describe_primitive(const WeldedPage& page) {
    const std::size_t count = page.vertices.size();
    json attributes = {{"POSITION", describe_positions(page)}};
    const bool is_textured = page.page != kInvalidIndex;
    if (is_textured) {
      attributes["TEXCOORD_0"] =
          describe_accessor(count * sizeof(Eigen::Vector2f), kVertexData, kFloat32, "VEC2", count);
    } else if (!mesh_.colors.empty()) {
      attributes["COLOR_0"] = describe_accessor(count * kColorBytes, kVertexData, kUint16, "VEC4", count);
      document_["accessors"].back()["normalized"] = true;
    }
    const std::size_t index_count = page.indices.size();
    const std::size_t indices =
        describe_accessor(index_count * sizeof(std::uint32_t), kIndexData, kUint32, "SCALAR", index_count);
    return {{"attributes", std::move(attributes)}, {"indices", indices}, {"material", describe_material(page.page)}};
  }

  std::size_t describe_positions(const WeldedPage& page) {
    Eigen::Vector3f low = mesh_.positions_m[page.vertices.front()], high = low;
    for (const std::uint32_t vertex : page.vertices) {
      low = low.cwiseMin(mesh_.positions_m[vertex]);
      high = high.cwiseMax(mesh_.positions_m[vertex]);
    }
    const std::size_t count = page.vertices.size();
    const std::size_t index = describe_accessor(count * 3 * sizeof(float), kVertexData, kFloat32, "VEC3", count);
    document_["accessors"][index]["min"] = {low.x(), low.y(), low.z()};
    document_["accessors"][index]["max"] = {high.x(), high.y(), high.z()};
    return index;
  }

  /// Each accessor has a buffer view of its own, in the order in which write_binary writes them.
  std::size_t describe_accessor(std::size_t size_bytes, int target, int component, const char* type,
                                std::size_t count) {
    json& accessors = document_["accessors"];
    const std::size_t view = describe_view(size_bytes);
    document_["bufferViews"][view]["target"] = target;
    accessors.push_back({{"bufferView", view}, {"componentType", component}, {"type", type}, {"count", count}});
    return accessors.size() - 1;
  }

  std::size_t describe_view(std::size_t size_bytes) {
    json& views = document_["bufferViews"];
    views.push_back({{"buffer", 0}, {"byteOffset", binary_bytes_}, {"byteLength", size_bytes}});
    binary_bytes_ += (size_bytes + 3) / 4 * 4;
    return views.size() - 1;
  }

  std::size_t describe_material(std::uint32_t page) {
    const bool is_textured = page != kInvalidIndex;
    json surface = {{"metallicFactor", 0.0}, {"roughnessFactor", 1.0}};
    json material;
    if (is_textured) {
      surface["baseColorTexture"] = {{"index", document_["textures"].size()}};
      document_["textures"].push_back({{"source", document_["textures"].size()}, {"sampler", 0}});
    }
    material["pbrMetallicRoughness"] = std::move(surface);
    // Photographs have their light in them.
    if (is_textured || !mesh_.colors.empty()) {
      material["extensions"]["KHR_materials_unlit"] = json::object();
      document_["extensionsUsed"] = json::array({"KHR_materials_unlit"});
    }
    json& materials = document_["materials"];
    materials.push_back(std::move(material));
    return materials.size() - 1;
  }

  void describe_image(std::uint32_t page) {
    if (!document_.contains("samplers"))
      document_["samplers"][0] = {
          {"magFilter", kLinear}, {"minFilter", kLinearMipmapLinear}, {"wrapS", kClampToEdge}, {"wrapT", kClampToEdge}};
    images_.push_back(encode_jpeg(mesh_.pages[page], options_.jpeg_quality));
    document_["images"].push_back({{"bufferView", describe_view(images_.back().size())}, {"mimeType", "image/jpeg"}});
  }

  std::string padded_json() const {
    std::string text = document_.dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    return text;
  }

  void write_binary(OutputFile& out) const {
    static const std::array<std::uint16_t, 256> kLinearOf = make_linear_table();
    for (const WeldedPage& page : welded_) {
      for (const std::uint32_t vertex : page.vertices) out.write(mesh_.positions_m[vertex].data(), 3 * sizeof(float));
      if (page.page != kInvalidIndex) {
        out.write(page.texcoords.data(), page.texcoords.size() * sizeof(Eigen::Vector2f));
      } else if (!mesh_.colors.empty()) {
        for (const std::uint32_t vertex : page.vertices) {
          const Rgb8 c = mesh_.colors[vertex];
          out.put(std::array<std::uint16_t, 4>{kLinearOf[c.r], kLinearOf[c.g], kLinearOf[c.b], 65535});
        }
      }
      out.write(page.indices.data(), page.indices.size() * sizeof(std::uint32_t));
    }
    for (const std::vector<char>& image : images_) {
      out.write(image.data(), image.size());
      out.write(std::string_view("\0\0\0", (4 - image.size() % 4) % 4));
    }
  }

  static constexpr std::size_t kColorBytes = 4 * sizeof(std::uint16_t);

  const Mesh& mesh_;
  const std::filesystem::path& file_;
  const WriteMeshOptions& options_;
  std::vector<WeldedPage> welded_;
  json document_;
  std::uint64_t binary_bytes_ = 0;
  std::vector<std::vector<char>> images_;
};

}  // namespace

void write_glb(const Mesh& mesh, const std::filesystem::path& file, const WriteMeshOptions& options) {
  GlbWriter(mesh, file, options).run();
}

}  // namespace lapseam
