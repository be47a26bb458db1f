#pragma once

// Builds GLB files by hand, right and wrong ones, independently of the writer.

#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace lapseam::test {

struct GlbBuilder {
  nlohmann::json document = {{"asset", {{"version", "2.0"}}}};
  std::string binary;

  template <typename T>
  std::size_t add_accessor(const std::vector<T>& values, int component_type, const char* type, std::size_t count,
                           nlohmann::json extra = nlohmann::json::object(), std::size_t stride = 0) {
    nlohmann::json view = {{"buffer", 0}, {"byteOffset", binary.size()}, {"byteLength", values.size() * sizeof(T)}};
    if (stride) view["byteStride"] = stride;
    binary.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
    binary.resize((binary.size() + 3) / 4 * 4);
    document["bufferViews"].push_back(view);
    extra["bufferView"] = document["bufferViews"].size() - 1;
    extra["componentType"] = component_type;
    extra["type"] = type;
    extra["count"] = count;
    document["accessors"].push_back(extra);
    return document["accessors"].size() - 1;
  }

  /// One triangle at the scene's only node.
  static GlbBuilder triangle() {
    GlbBuilder glb;
    glb.add_accessor(std::vector<float>{0, 0, 0, 1, 0, 0, 0, 1, 0}, 5126, "VEC3", 3);
    glb.add_accessor(std::vector<std::uint16_t>{0, 1, 2}, 5123, "SCALAR", 3);
    nlohmann::json primitive = {{"attributes", {{"POSITION", 0}}}, {"indices", 1}};
    glb.document["meshes"][0]["primitives"][0] = primitive;
    glb.document["nodes"][0]["mesh"] = 0;
    glb.document["scenes"][0]["nodes"][0] = 0;
    return glb;
  }

  std::string bytes() {
    document["buffers"][0]["byteLength"] = binary.size();
    return bytes_of(document.dump());
  }
  std::string bytes_of(std::string text) const {
    text.resize((text.size() + 3) / 4 * 4, ' ');
    std::string out = "glTF";
    const auto put = [&](std::uint32_t value) { out.append(reinterpret_cast<const char*>(&value), 4); };
    put(2);
    put(std::uint32_t(12 + 8 + text.size() + 8 + binary.size()));
    put(std::uint32_t(text.size()));
    out += "JSON" + text;
    put(std::uint32_t(binary.size()));
    out += std::string("BIN\0", 4) + binary;
    return out;
  }
};

}  // namespace lapseam::test
