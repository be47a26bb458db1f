#include "io/gltf_vertices.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <cmath>
#include <string_view>

namespace lapseam {

PositionGrid make_position_grid(const Mesh& mesh, const std::vector<WeldedPage>& pages) {
  constexpr float kLargest = 65535;
  PositionGrid grid;
  Eigen::Vector3f low = Eigen::Vector3f::Constant(3e38f), high = -low;
  for (const WeldedPage& page : pages)
    for (const std::uint32_t vertex : page.vertices) {
      low = low.cwiseMin(mesh.positions_m[vertex]);
      high = high.cwiseMax(mesh.positions_m[vertex]);
    }
  if (!(high.array() >= low.array()).all()) return grid;
  grid.low_m = low;
  const float extent = (high - low).maxCoeff();
  if (extent > 0) grid.step_m = extent / kLargest;
  return grid;
}

std::array<std::uint16_t, 3> quantize(const PositionGrid& grid, const Eigen::Vector3f& position_m) {
  std::array<std::uint16_t, 3> out{};
  for (std::size_t k = 0; k < 3; ++k) {
    const auto axis = Eigen::Index(k);
    out[k] = std::uint16_t(std::clamp(std::lround((position_m[axis] - grid.low_m[axis]) / grid.step_m), 0L, 65535L));
  }
  return out;
}

void reorder_for_packing(WeldedPage& page) {
  const std::size_t vertices = page.vertices.size(), indices = page.indices.size();
  meshopt_optimizeVertexCache(page.indices.data(), page.indices.data(), indices, vertices);
  std::vector<unsigned int> remap(vertices);
  meshopt_optimizeVertexFetchRemap(remap.data(), page.indices.data(), indices, vertices);
  meshopt_remapIndexBuffer(page.indices.data(), page.indices.data(), indices, remap.data());
  meshopt_remapVertexBuffer(page.vertices.data(), page.vertices.data(), vertices, sizeof(std::uint32_t), remap.data());
  if (!page.texcoords.empty())
    meshopt_remapVertexBuffer(page.texcoords.data(), page.texcoords.data(), vertices, sizeof(Eigen::Vector2f),
                              remap.data());
}

std::vector<char> pack_vertices(std::span<const char> bytes, std::size_t stride) {
  meshopt_encodeVertexVersion(0);
  const std::size_t count = bytes.size() / stride;
  std::vector<char> out(meshopt_encodeVertexBufferBound(count, stride));
  out.resize(meshopt_encodeVertexBuffer(reinterpret_cast<unsigned char*>(out.data()), out.size(), bytes.data(), count,
                                        stride));
  return out;
}

std::vector<char> pack_triangles(std::span<const std::uint32_t> indices, std::size_t vertex_count) {
  meshopt_encodeIndexVersion(1);
  std::vector<char> out(meshopt_encodeIndexBufferBound(indices.size(), vertex_count));
  out.resize(meshopt_encodeIndexBuffer(reinterpret_cast<unsigned char*>(out.data()), out.size(), indices.data(),
                                       indices.size()));
  return out;
}

bool unpack(std::span<const char> packed, std::string_view mode, std::size_t count, std::size_t stride,
            std::vector<char>& out) {
  // What the codec cannot do better than; a file that claims more is not worth its memory.
  constexpr std::size_t kMostBytesPerByte = 256;
  const auto* data = reinterpret_cast<const unsigned char*>(packed.data());
  if (stride == 0 || stride > 256 || count > (kMostBytesPerByte * packed.size() + 4096) / stride) return false;
  out.resize(count * stride);
  if (mode == "ATTRIBUTES")
    return stride % 4 == 0 && meshopt_decodeVertexBuffer(out.data(), count, stride, data, packed.size()) == 0;
  if (stride != 2 && stride != 4) return false;
  if (mode == "TRIANGLES")
    return count % 3 == 0 && meshopt_decodeIndexBuffer(out.data(), count, stride, data, packed.size()) == 0;
  return mode == "INDICES" && meshopt_decodeIndexSequence(out.data(), count, stride, data, packed.size()) == 0;
}

}  // namespace lapseam
