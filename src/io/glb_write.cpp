// glTF 2.0 binary (Khronos Group 2021). Written by hand instead of with tinygltf: a model in tinygltf's form holds a
// copy of all buffers, and its writer makes another one, while here one stream at a time goes from the mesh to the
// file.
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

#include "io/gltf_vertices.h"
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
      : mesh_(mesh), file_(file), options_(options), welded_(weld_corners(mesh)) {
    if (options.quantize) grid_ = make_position_grid(mesh, welded_);
    if (options.compress)
      for (WeldedPage& page : welded_) reorder_for_packing(page);
  }

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
      const Eigen::Vector3d origin_m = mesh_.origin_m + grid_.low_m.cast<double>();
      if (!origin_m.isZero(0)) node["translation"] = {origin_m.x(), origin_m.y(), origin_m.z()};
      if (options_.quantize) node["scale"] = {grid_.step_m, grid_.step_m, grid_.step_m};
      scene["nodes"] = json::array({0});
      document_["nodes"] = json::array({std::move(node)});
      json primitives = json::array();
      for (const WeldedPage& page : welded_) primitives.push_back(describe_primitive(page));
      document_["meshes"][0]["primitives"] = std::move(primitives);
      for (const WeldedPage& page : welded_)
        if (page.page != kInvalidIndex) describe_image(page.page);
      document_["buffers"][0]["byteLength"] = binary_bytes_;
      if (options_.compress)
        document_["buffers"][1] = {{"byteLength", unpacked_bytes_},
                                   {"extensions", {{"EXT_meshopt_compression", {{"fallback", true}}}}}};
    }
    document_["scenes"][0] = std::move(scene);
  }

  // ---- streams: how each is stored, and its bytes; in the order of the file

  json describe_primitive(const WeldedPage& page) {
    json attributes = {{"POSITION", describe_positions(page)}};
    if (page.page != kInvalidIndex) {
      attributes["TEXCOORD_0"] =
          describe_vertices(texcoord_bytes(page), page.vertices.size(), options_.quantize ? kUint16 : kFloat32, "VEC2");
      if (options_.quantize) document_["accessors"].back()["normalized"] = true;
    } else if (!mesh_.colors.empty()) {
      attributes["COLOR_0"] = describe_vertices(color_bytes(page), page.vertices.size(), kUint16, "VEC4");
      document_["accessors"].back()["normalized"] = true;
    }
    const std::size_t count = page.indices.size();
    std::vector<char> packed;
    if (options_.compress) packed = pack_triangles(page.indices, page.vertices.size());
    const std::size_t indices =
        describe_stream(sizeof(std::uint32_t), count, std::move(packed), kIndexData, kUint32, "SCALAR");
    return {{"attributes", std::move(attributes)}, {"indices", indices}, {"material", describe_material(page)}};
  }

  std::size_t describe_positions(const WeldedPage& page) {
    const std::size_t index =
        describe_vertices(position_bytes(page), page.vertices.size(), options_.quantize ? kUint16 : kFloat32, "VEC3");
    const auto set_bounds = [&](const auto& value_of) {
      auto low = value_of(page.vertices.front()), high = low;
      for (const std::uint32_t vertex : page.vertices) {
        const auto value = value_of(vertex);
        for (std::size_t k = 0; k < 3; ++k) low[k] = std::min(low[k], value[k]), high[k] = std::max(high[k], value[k]);
      }
      document_["accessors"][index]["min"] = low;
      document_["accessors"][index]["max"] = high;
    };
    if (options_.quantize) {
      set_bounds([&](std::uint32_t vertex) { return quantize(grid_, mesh_.positions_m[vertex]); });
      // Vertex attributes begin at multiples of four bytes: the last two of each are empty.
      document_["bufferViews"].back()["byteStride"] = kQuantizedStride;
    } else {
      set_bounds([&](std::uint32_t vertex) {
        const Eigen::Vector3f& p = mesh_.positions_m[vertex];
        return std::array<float, 3>{p.x(), p.y(), p.z()};
      });
    }
    return index;
  }

  std::size_t describe_vertices(const std::vector<char>& bytes, std::size_t count, int component, const char* type) {
    const std::size_t stride = bytes.size() / count;
    std::vector<char> packed;
    if (options_.compress) packed = pack_vertices(bytes, stride);
    return describe_stream(stride, count, std::move(packed), kVertexData, component, type);
  }

  /// Each accessor has a buffer view of its own. Packed bytes are kept until they are written; others are made again
  /// then.
  std::size_t describe_stream(std::size_t stride, std::size_t count, std::vector<char> packed, int target,
                              int component, const char* type) {
    const std::size_t bytes = stride * count;
    if (options_.compress) {
      json view = {{"buffer", 1}, {"byteOffset", unpacked_bytes_}, {"byteLength", bytes}};
      view["extensions"]["EXT_meshopt_compression"] = {{"buffer", 0},
                                                       {"byteOffset", binary_bytes_},
                                                       {"byteLength", packed.size()},
                                                       {"byteStride", stride},
                                                       {"mode", target == kIndexData ? "TRIANGLES" : "ATTRIBUTES"},
                                                       {"count", count}};
      unpacked_bytes_ += (bytes + 3) / 4 * 4;
      binary_bytes_ += (packed.size() + 3) / 4 * 4;
      packed_.push_back(std::move(packed));
      document_["bufferViews"].push_back(std::move(view));
      use_extension("EXT_meshopt_compression", true);
    } else {
      describe_view(bytes);
    }
    document_["bufferViews"].back()["target"] = target;
    if (options_.quantize) use_extension("KHR_mesh_quantization", true);
    document_["accessors"].push_back({{"bufferView", document_["bufferViews"].size() - 1},
                                      {"componentType", component},
                                      {"type", type},
                                      {"count", count}});
    return document_["accessors"].size() - 1;
  }

  template <typename T>
  static std::vector<char> bytes_of(const std::vector<T>& values) {
    const char* begin = reinterpret_cast<const char*>(values.data());
    return std::vector<char>(begin, begin + values.size() * sizeof(T));
  }

  std::vector<char> position_bytes(const WeldedPage& page) const {
    std::vector<char> bytes(page.vertices.size() * (options_.quantize ? kQuantizedStride : 3 * sizeof(float)), 0);
    for (std::size_t i = 0; i < page.vertices.size(); ++i) {
      const Eigen::Vector3f& p = mesh_.positions_m[page.vertices[i]];
      if (options_.quantize)
        std::memcpy(&bytes[i * kQuantizedStride], quantize(grid_, p).data(), 3 * sizeof(std::uint16_t));
      else
        std::memcpy(&bytes[i * 3 * sizeof(float)], p.data(), 3 * sizeof(float));
    }
    return bytes;
  }

  std::vector<char> texcoord_bytes(const WeldedPage& page) const {
    if (!options_.quantize) return bytes_of(page.texcoords);
    std::vector<std::uint16_t> values;
    for (const Eigen::Vector2f& uv : page.texcoords)
      for (const float x : {uv.x(), uv.y()})
        values.push_back(std::uint16_t(std::lround(std::clamp(x, 0.0f, 1.0f) * 65535)));
    return bytes_of(values);
  }

  std::vector<char> color_bytes(const WeldedPage& page) const {
    static const std::array<std::uint16_t, 256> kLinearOf = make_linear_table();
    std::vector<std::uint16_t> values;
    for (const std::uint32_t vertex : page.vertices) {
      const Rgb8 c = mesh_.colors[vertex];
      values.insert(values.end(), {kLinearOf[c.r], kLinearOf[c.g], kLinearOf[c.b], std::uint16_t(65535)});
    }
    return bytes_of(values);
  }

  void use_extension(const char* name, bool is_required) {
    for (const char* list : {"extensionsUsed", "extensionsRequired"}) {
      if (list == std::string_view("extensionsRequired") && !is_required) continue;
      json& names = document_[list];
      if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    }
  }

  std::size_t describe_view(std::size_t size_bytes) {
    json& views = document_["bufferViews"];
    views.push_back({{"buffer", 0}, {"byteOffset", binary_bytes_}, {"byteLength", size_bytes}});
    binary_bytes_ += (size_bytes + 3) / 4 * 4;
    return views.size() - 1;
  }

  std::size_t describe_material(const WeldedPage& page) {
    const bool is_textured = page.page != kInvalidIndex;
    json surface = {{"metallicFactor", 0.0}, {"roughnessFactor", 1.0}};
    json material;
    if (is_textured) {
      surface["baseColorTexture"] = {{"index", document_["textures"].size()}};
      const std::size_t image = document_["textures"].size();
      json texture = {{"sampler", 0}};
      if (options_.texture_format == TextureFormat::kWebp) {
        texture["extensions"]["EXT_texture_webp"]["source"] = image;
        use_extension("EXT_texture_webp", true);
      } else {
        texture["source"] = image;
      }
      document_["textures"].push_back(std::move(texture));
    }
    material["pbrMetallicRoughness"] = std::move(surface);
    // What no image shows, and has colours made up of what is around it, can be told by this name.
    if (!is_textured && !mesh_.pages.empty()) material["name"] = page.is_unseen ? "unseen" : "vertex_colors";
    // Photographs have their light in them.
    if (!options_.is_lit && (is_textured || !mesh_.colors.empty())) {
      material["extensions"]["KHR_materials_unlit"] = json::object();
      use_extension("KHR_materials_unlit", false);
    }
    json& materials = document_["materials"];
    materials.push_back(std::move(material));
    return materials.size() - 1;
  }

  void describe_image(std::uint32_t page) {
    if (!document_.contains("samplers"))
      document_["samplers"][0] = {
          {"magFilter", kLinear}, {"minFilter", kLinearMipmapLinear}, {"wrapS", kClampToEdge}, {"wrapT", kClampToEdge}};
    images_.push_back(encode_page(mesh_.pages[page], options_.texture_format, options_.texture_quality));
    document_["images"].push_back(
        {{"bufferView", describe_view(images_.back().size())}, {"mimeType", mime_type(options_.texture_format)}});
  }

  std::string padded_json() const {
    std::string text = document_.dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    return text;
  }

  static void write_padded(OutputFile& out, const std::vector<char>& bytes) {
    out.write(bytes.data(), bytes.size());
    out.write(std::string_view("\0\0\0", (4 - bytes.size() % 4) % 4));
  }

  void write_binary(OutputFile& out) const {
    for (const std::vector<char>& bytes : packed_) write_padded(out, bytes);
    for (const WeldedPage& page : welded_) {
      if (options_.compress) break;
      write_padded(out, position_bytes(page));
      if (page.page != kInvalidIndex)
        write_padded(out, texcoord_bytes(page));
      else if (!mesh_.colors.empty())
        write_padded(out, color_bytes(page));
      write_padded(out, bytes_of(page.indices));
    }
    for (const std::vector<char>& image : images_) write_padded(out, image);
  }

  static constexpr std::size_t kQuantizedStride = 4 * sizeof(std::uint16_t);

  const Mesh& mesh_;
  const std::filesystem::path& file_;
  const WriteMeshOptions& options_;
  std::vector<WeldedPage> welded_;
  json document_;
  PositionGrid grid_;
  std::uint64_t binary_bytes_ = 0, unpacked_bytes_ = 0;
  std::vector<std::vector<char>> packed_;
  std::vector<std::vector<char>> images_;
};

}  // namespace

void write_glb(const Mesh& mesh, const std::filesystem::path& file, const WriteMeshOptions& options) {
  GlbWriter(mesh, file, options).run();
}

}  // namespace lapseam
