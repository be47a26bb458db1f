#include "io/gltf_document.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "io/gltf_vertices.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

using nlohmann::json;

static_assert(std::endian::native == std::endian::little, "glTF is read in the machine's byte order");

constexpr int kInt8 = 5120, kUint8 = 5121, kInt16 = 5122, kUint16 = 5123, kUint32 = 5125, kFloat32 = 5126;
constexpr std::uint32_t kJsonChunk = 0x4E4F534A, kBinaryChunk = 0x004E4942;

template <typename T>
T load(const char* data) {
  T value;
  std::memcpy(&value, data, sizeof value);
  return value;
}

std::size_t component_bytes(int type) {
  switch (type) {
    case kInt8:
    case kUint8:
      return 1;
    case kInt16:
    case kUint16:
      return 2;
    case kUint32:
    case kFloat32:
      return 4;
    default:
      return 0;
  }
}

int component_count(const std::string& type) {
  if (type == "SCALAR") return 1;
  if (type == "VEC2") return 2;
  if (type == "VEC3") return 3;
  if (type == "VEC4") return 4;
  return 0;
}

/// What JSON parsers say may span lines.
std::string first_line(const char* text) {
  const std::string all(text);
  return all.substr(0, all.find('\n'));
}

}  // namespace

double GltfAccessor::value(std::size_t index, int component) const {
  const char* at = data_ + index * stride_ + std::size_t(component) * component_bytes(component_type_);
  double raw = 0, most = 1;
  switch (component_type_) {
    case kInt8:
      raw = load<std::int8_t>(at), most = 127;
      break;
    case kUint8:
      raw = load<std::uint8_t>(at), most = 255;
      break;
    case kInt16:
      raw = load<std::int16_t>(at), most = 32767;
      break;
    case kUint16:
      raw = load<std::uint16_t>(at), most = 65535;
      break;
    case kUint32:
      raw = load<std::uint32_t>(at);
      break;
    default:
      raw = double(load<float>(at));
      break;
  }
  return is_normalized_ ? std::max(raw / most, -1.0) : raw;
}

std::uint32_t GltfAccessor::integer(std::size_t index) const {
  const char* at = data_ + index * stride_;
  switch (component_type_) {
    case kUint8:
      return load<std::uint8_t>(at);
    case kUint16:
      return load<std::uint16_t>(at);
    default:
      return load<std::uint32_t>(at);
  }
}

GltfDocument::GltfDocument(const std::filesystem::path& file, std::span<const char> bytes)
    : file_(file), file_bytes_(bytes.size()) {
  constexpr std::size_t kHeaderBytes = 12, kChunkHeaderBytes = 8;
  if (bytes.size() < kHeaderBytes + kChunkHeaderBytes) fail("header", "the file is truncated");
  if (load<std::uint32_t>(bytes.data() + 4) != 2) fail("header", "not glTF version 2");
  const std::size_t length = load<std::uint32_t>(bytes.data() + 8);
  if (length > bytes.size())
    fail("header", "the file is truncated: " + std::to_string(bytes.size()) + " bytes of " + std::to_string(length));
  std::span<const char> rest = bytes.subspan(kHeaderBytes, std::max(length, kHeaderBytes) - kHeaderBytes);
  bool has_json = false;
  while (rest.size() >= kChunkHeaderBytes) {
    const std::size_t chunk_bytes = load<std::uint32_t>(rest.data());
    const std::uint32_t kind = load<std::uint32_t>(rest.data() + 4);
    if (chunk_bytes > rest.size() - kChunkHeaderBytes) fail("chunk", "longer than the file");
    const std::span<const char> chunk = rest.subspan(kChunkHeaderBytes, chunk_bytes);
    rest = rest.subspan(kChunkHeaderBytes + chunk_bytes);
    if (kind == kJsonChunk && !has_json) {
      has_json = true;
      try {
        root_ = json::parse(chunk.begin(), chunk.end());
      } catch (const json::exception& error) {
        fail("JSON", first_line(error.what()));
      }
    } else if (kind == kBinaryChunk && binary_.empty()) {
      binary_ = chunk;
    }
  }
  if (!has_json || !root_.is_object()) fail("JSON", "missing");
  check_extensions();
}

void GltfDocument::fail(const std::string& field, const std::string& problem) const {
  throw InvalidInput(file_, {}, field, problem);
}

void GltfDocument::check_extensions() const {
  const auto required = root_.find("extensionsRequired");
  if (required == root_.end()) return;
  for (const json& name : *required)
    if (name != "KHR_materials_unlit" && name != "KHR_mesh_quantization" && name != "EXT_meshopt_compression" &&
        name != "EXT_texture_webp")
      fail("extensionsRequired", "the file cannot be read without the extension " + name.dump());
}

const json& GltfDocument::item(const char* array, std::uint64_t index) const {
  const auto found = root_.find(array);
  if (found == root_.end() || !found->is_array() || index >= found->size() || !(*found)[index].is_object())
    fail(array, "there is no item " + std::to_string(index));
  return (*found)[index];
}

std::uint64_t GltfDocument::integer(const json& object, const char* key) const {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_number_unsigned()) fail(key, "a non-negative integer is needed here");
  return found->get<std::uint64_t>();
}

std::uint64_t GltfDocument::integer(const json& object, const char* key, std::uint64_t fallback) const {
  return object.contains(key) ? integer(object, key) : fallback;
}

bool GltfDocument::numbers(const json& object, const char* key, std::span<double> out) const {
  const auto found = object.find(key);
  if (found == object.end()) return false;
  if (!found->is_array() || found->size() != out.size()) fail(key, std::to_string(out.size()) + " numbers are needed");
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (!(*found)[i].is_number()) fail(key, "not a number");
    out[i] = (*found)[i].get<double>();
    if (!std::isfinite(out[i])) fail(key, "not finite");
  }
  return true;
}

std::span<const char> GltfDocument::buffer_view(std::uint64_t index) const {
  const json& view = item("bufferViews", index);
  if (const auto found = view.find("extensions"); found != view.end() && found->contains("EXT_meshopt_compression"))
    return unpacked_view(index, found->at("EXT_meshopt_compression"));
  const json& buffer = item("buffers", integer(view, "buffer"));
  if (integer(view, "buffer") != 0 || buffer.contains("uri"))
    fail("buffers", "data outside of the GLB file are not supported");
  const std::uint64_t offset = integer(view, "byteOffset", 0), length = integer(view, "byteLength");
  if (offset > binary_.size() || length > binary_.size() - offset)
    fail("bufferViews", "item " + std::to_string(index) + " reaches beyond the end of the file");
  return binary_.subspan(offset, length);
}

std::span<const char> GltfDocument::unpacked_view(std::uint64_t index, const json& extension) const {
  if (const auto known = unpacked_.find(index); known != unpacked_.end()) return known->second;
  const std::string field = "bufferViews item " + std::to_string(index);
  const std::uint64_t offset = integer(extension, "byteOffset", 0), length = integer(extension, "byteLength");
  if (integer(extension, "buffer") != 0) fail(field, "data outside of the GLB file are not supported");
  if (offset > binary_.size() || length > binary_.size() - offset) fail(field, "reaches beyond the end of the file");
  if (extension.value("filter", "NONE") != "NONE") fail(field, "filters of EXT_meshopt_compression are not supported");
  std::vector<char>& bytes = unpacked_[index];
  if (!unpack(binary_.subspan(offset, length), extension.value("mode", ""), integer(extension, "count"),
              integer(extension, "byteStride"), bytes))
    fail(field, "damaged EXT_meshopt_compression");
  return bytes;
}

GltfAccessor GltfDocument::accessor(std::uint64_t index) const {
  const json& object = item("accessors", index);
  const std::string field = "accessors item " + std::to_string(index);
  if (object.contains("sparse") || !object.contains("bufferView")) fail(field, "sparse accessors are not supported");
  const std::uint64_t view_index = integer(object, "bufferView");
  const std::span<const char> view = buffer_view(view_index);
  GltfAccessor accessor;
  const std::uint64_t component_type = integer(object, "componentType"), count = integer(object, "count");
  accessor.component_type_ = component_type <= kFloat32 ? int(component_type) : 0;
  const auto type = object.find("type");
  accessor.components_ = type != object.end() && type->is_string() ? component_count(type->get<std::string>()) : 0;
  const std::size_t element_bytes = component_bytes(accessor.component_type_) * std::size_t(accessor.components_);
  if (element_bytes == 0) fail(field, "unknown type");
  const std::uint64_t stride = integer(item("bufferViews", view_index), "byteStride", element_bytes);
  const std::uint64_t offset = integer(object, "byteOffset", 0);
  // The last element need not be followed by a gap.
  const bool fits = stride >= element_bytes && offset <= view.size() && count <= view.size() &&
                    (count == 0 || (view.size() - offset >= element_bytes &&
                                    (view.size() - offset - element_bytes) / stride >= count - 1));
  if (!fits) fail(field, "reaches beyond the end of its data");
  accessor.data_ = view.data() + offset;
  accessor.stride_ = stride;
  accessor.count_ = count;
  const auto normalized = object.find("normalized");
  accessor.is_normalized_ = normalized != object.end() && normalized->is_boolean() && normalized->get<bool>();
  return accessor;
}

std::span<const char> GltfDocument::image_bytes(std::uint64_t index) const {
  const json& image = item("images", index);
  if (!image.contains("bufferView")) fail("images", "images outside of the GLB file are not supported");
  return buffer_view(integer(image, "bufferView"));
}

}  // namespace lapseam
