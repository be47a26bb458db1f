#include "sew_meshes/merged.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <string>

#include "lapseam/context.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

std::string name_of(std::size_t mesh) { return "mesh " + std::to_string(mesh); }

void check_inputs(std::span<const Mesh> meshes) {
  if (meshes.empty()) throw InvalidInput({}, {}, "meshes", "there are none");
  std::size_t vertices = 0, triangles = 0;
  for (std::size_t m = 0; m < meshes.size(); ++m) {
    if (meshes[m].triangles.empty()) throw InvalidInput({}, name_of(m), "triangles", "there are none");
    try {
      check_mesh(meshes[m]);
    } catch (const InvalidInput& error) {
      throw InvalidInput({}, name_of(m), {}, error.what());
    }
    vertices += meshes[m].vertex_count();
    triangles += meshes[m].triangle_count();
  }
  // Corners are counted in 32 bits, and the seam needs some too.
  if (vertices >= kInvalidIndex || triangles >= kInvalidIndex / 4)
    throw InvalidInput({}, {}, "meshes", "together too large: " + std::to_string(triangles) + " triangles");
}

/// Marks triangles that repeat a vertex, or run through an edge in a direction that an earlier one does already.
std::vector<std::uint8_t> find_sound_triangles(const Mesh& mesh) {
  struct Side {
    std::uint64_t edge;
    std::uint32_t triangle;
  };
  std::vector<std::uint8_t> is_sound(mesh.triangle_count(), 1);
  std::vector<Side> sides;
  sides.reserve(3 * mesh.triangle_count());
  for (std::uint32_t i = 0; i < mesh.triangle_count(); ++i) {
    const Triangle& t = mesh.triangles[i];
    is_sound[i] = t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    for (std::size_t k = 0; k < 3 && is_sound[i]; ++k) sides.push_back({std::uint64_t(t[k]) << 32 | t[(k + 1) % 3], i});
  }
  std::sort(sides.begin(), sides.end(),
            [](const Side& a, const Side& b) { return a.edge != b.edge ? a.edge < b.edge : a.triangle < b.triangle; });
  for (std::size_t i = 1; i < sides.size(); ++i)
    if (sides[i].edge == sides[i - 1].edge) is_sound[sides[i].triangle] = 0;
  return is_sound;
}

template <class T>
void append(std::vector<T>& to, const std::vector<T>& from) {
  to.insert(to.end(), from.begin(), from.end());
}

/// Of optional arrays, those stay that every input has.
template <class Member>
bool do_all_have(std::span<const Mesh> meshes, Member member) {
  return std::all_of(meshes.begin(), meshes.end(), [&](const Mesh& mesh) { return !(mesh.*member).empty(); });
}

void append_mesh(MergedMeshes& merged, const Mesh& input, std::span<const Mesh> meshes, SewnMesh& counts) {
  Mesh& out = merged.mesh;
  const auto first = std::uint32_t(out.vertex_count());
  const auto number = std::uint32_t(merged.first_vertex.size());
  merged.first_vertex.push_back(first);
  const Eigen::Vector3d shift = input.origin_m - out.origin_m;
  for (const Eigen::Vector3f& p : input.positions_m)
    out.positions_m.push_back((p.cast<double>() + shift).cast<float>());
  if (do_all_have(meshes, &Mesh::colors)) append(out.colors, input.colors);
  if (do_all_have(meshes, &Mesh::vertex_view)) append(out.vertex_view, input.vertex_view);
  if (do_all_have(meshes, &Mesh::vertex_pixel)) append(out.vertex_pixel, input.vertex_pixel);
  const bool has_view = do_all_have(meshes, &Mesh::triangle_view);
  const std::vector<std::uint8_t> is_sound = find_sound_triangles(input);
  counts.triangles = input.triangle_count();
  for (std::size_t i = 0; i < input.triangle_count(); ++i) {
    if (!is_sound[i]) {
      ++counts.defects;
      continue;
    }
    const Triangle& t = input.triangles[i];
    out.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
    if (has_view) out.triangle_view.push_back(input.triangle_view[i]);
    out.triangle_tag.push_back(input.triangle_tag.empty() ? TriangleTag::kMeasured : input.triangle_tag[i]);
    merged.triangle_mesh.push_back(number);
  }
}

}  // namespace

VertexFrames measure_vertices(const Mesh& mesh) {
  VertexFrames frames;
  std::vector<Eigen::Vector3d> normals(mesh.vertex_count(), Eigen::Vector3d::Zero());
  std::vector<std::uint32_t> sides(mesh.vertex_count(), 0);
  frames.spacing_m.assign(mesh.vertex_count(), 0);
  std::vector<float> middles;
  middles.reserve(mesh.triangle_count());
  for (const Triangle& t : mesh.triangles) {
    const Eigen::Vector3d a = mesh.positions_m[t[0]].cast<double>();
    const Eigen::Vector3d area2 =
        (mesh.positions_m[t[1]].cast<double>() - a).cross(mesh.positions_m[t[2]].cast<double>() - a);
    std::array<float, 3> lengths;
    for (std::size_t k = 0; k < 3; ++k) {
      lengths[k] = (mesh.positions_m[t[k]] - mesh.positions_m[t[(k + 1) % 3]]).norm();
      normals[t[k]] += area2;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      frames.spacing_m[t[k]] += lengths[k] + lengths[(k + 2) % 3];
      sides[t[k]] += 2;
    }
    std::sort(lengths.begin(), lengths.end());
    middles.push_back(lengths[1]);
  }
  frames.normals.resize(mesh.vertex_count());
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
    frames.normals[v] = normals[v].stableNormalized().cast<float>();
    if (sides[v]) frames.spacing_m[v] /= float(sides[v]);
  }
  if (middles.empty()) return frames;
  const auto median = middles.begin() + std::ptrdiff_t(middles.size() / 2);
  std::nth_element(middles.begin(), median, middles.end());
  frames.edge_length_m = *median;
  return frames;
}

std::uint32_t MergedMeshes::mesh_of_vertex(std::uint32_t v) const {
  return std::uint32_t(std::upper_bound(first_vertex.begin(), first_vertex.end(), v) - first_vertex.begin() - 1);
}

MergedMeshes merge_meshes(std::span<const Mesh> meshes, SewMeshesReport& report, Context& context) {
  check_inputs(meshes);
  MergedMeshes merged;
  merged.mesh.origin_m = meshes[0].origin_m;
  report.meshes.assign(meshes.size(), {});
  bool has_texture = false;
  for (std::size_t m = 0; m < meshes.size(); ++m) {
    context.throw_if_cancelled();
    append_mesh(merged, meshes[m], meshes, report.meshes[m]);
    has_texture = has_texture || !meshes[m].pages.empty();
    if (report.meshes[m].defects)
      context.warn(name_of(m) + ": " + std::to_string(report.meshes[m].defects) +
                   " triangles left out that repeat a vertex, or an edge in the direction of another triangle");
  }
  if (has_texture) context.warn("sewing: texture is not kept");
  merged.first_vertex.push_back(std::uint32_t(merged.mesh.vertex_count()));
  static_cast<VertexFrames&>(merged) = measure_vertices(merged.mesh);
  report.edge_length_m = double(merged.edge_length_m);
  return merged;
}

}  // namespace lapseam
