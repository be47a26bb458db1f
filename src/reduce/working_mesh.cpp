#include "reduce/working_mesh.h"

#include <algorithm>
#include <unordered_map>

#include "core/parallel.h"

namespace lapseam {
namespace {

constexpr std::size_t kGrain = 16384;

void load_vertices(const Surface& surface, LoadedPiece& loaded) {
  const std::size_t n = loaded.names.size();
  loaded.piece.vertices.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint32_t name = loaded.names[i];
    if (surface.has_quadrics()) {
      loaded.piece.vertices[i] = surface.vertices[name];
    } else {
      loaded.piece.vertices[i].position_m = surface.positions_m[name];
      loaded.piece.vertices[i].source = name;
    }
  }
  if (surface.has_quadrics() || surface.sigma_m.empty()) return;
  loaded.squared_sigma.resize(n);
  for (std::size_t i = 0; i < n; ++i)
    loaded.squared_sigma[i] = surface.sigma_m[loaded.names[i]] * surface.sigma_m[loaded.names[i]];
}

template <typename T>
void gather(std::vector<T>& out, const std::vector<T>& in, const std::vector<std::uint32_t>& from, Context& context) {
  if (in.empty()) return;
  out.resize(from.size());
  parallel_for(context, from.size(), kGrain, [&](std::size_t i) { out[i] = in[from[i]]; });
}

// A triangle whose corners come from one view was measured by it; one whose corners come from several joins them, and
// shows the view that most of its corners come from. What was sewn or filled stays that.
void set_triangle_provenance(Mesh& out, const Mesh& source, const std::vector<std::uint32_t>& triangle_source,
                             Context& context) {
  gather(out.triangle_view, source.triangle_view, triangle_source, context);
  gather(out.triangle_tag, source.triangle_tag, triangle_source, context);
  if (out.vertex_view.empty()) return;
  parallel_for(context, out.triangle_count(), kGrain, [&](std::size_t i) {
    const Triangle& t = out.triangles[i];
    const std::uint32_t a = out.vertex_view[t[0]], b = out.vertex_view[t[1]], c = out.vertex_view[t[2]];
    if (!out.triangle_view.empty()) {
      if ((a == b || a == c) && a != kInvalidIndex) out.triangle_view[i] = a;
      if (b == c && b != kInvalidIndex) out.triangle_view[i] = b;
    }
    if (!out.triangle_tag.empty() && out.triangle_tag[i] == TriangleTag::kMeasured && !(a == b && b == c))
      out.triangle_tag[i] = TriangleTag::kSeam;
  });
}

}  // namespace

Surface surface_of(const Mesh& mesh, std::span<const float> sigma_m) {
  return {.positions_m = {reinterpret_cast<const std::byte*>(mesh.positions_m.data()), sizeof(Eigen::Vector3f),
                          mesh.vertex_count()},
          .triangles = mesh.triangles,
          .sigma_m = sigma_m,
          .vertices = {},
          .source = {}};
}

Surface surface_of(const WorkingMesh& mesh) {
  return {.positions_m = {reinterpret_cast<const std::byte*>(mesh.vertices.data()), sizeof(ReduceVertex),
                          mesh.vertices.size()},
          .triangles = mesh.triangles,
          .sigma_m = {},
          .vertices = mesh.vertices,
          .source = mesh.source};
}

LoadedPiece load_piece(const Surface& surface, const Partition& parts, std::size_t part) {
  LoadedPiece loaded;
  const auto own = parts.vertices_of(part);
  const auto triangles = parts.triangles_of(part);
  loaded.own = own.size();
  loaded.names.assign(own.begin(), own.end());
  std::unordered_map<std::uint32_t, std::uint32_t> foreign;
  loaded.piece.triangles.reserve(triangles.size());
  loaded.piece.source.reserve(triangles.size());
  loaded.piece.is_locked.assign(own.size(), 0);
  for (const std::uint32_t i : triangles) {
    Triangle local;
    bool crosses = false;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t v = surface.triangles[i][k];
      if (parts.part_of_vertex[v] == part) {
        local[k] = parts.rank_of_vertex[v];
        continue;
      }
      crosses = true;
      const auto [place, is_new] = foreign.try_emplace(v, std::uint32_t(loaded.names.size()));
      if (is_new) {
        loaded.names.push_back(v);
        loaded.piece.is_locked.push_back(1);
      }
      local[k] = place->second;
    }
    if (crosses)
      for (const std::uint32_t v : local) loaded.piece.is_locked[v] = 1;
    loaded.piece.triangles.push_back(local);
    loaded.piece.source.push_back(surface.source.empty() ? i : surface.source[i]);
  }
  load_vertices(surface, loaded);
  return loaded;
}

void PieceResults::store(std::size_t part, LoadedPiece loaded) {
  Piece& piece = loaded.piece;
  WorkingMesh& out = pieces_[part];
  std::vector<std::uint8_t> is_used(piece.vertices.size(), 0);
  std::size_t alive = 0;
  for (const Triangle& t : piece.triangles) {
    if (t[0] == kInvalidIndex) continue;
    for (const std::uint32_t v : t) is_used[v] = 1;
    ++alive;
  }
  out.triangles.reserve(alive);
  out.source.reserve(alive);
  for (std::size_t i = 0; i < piece.triangles.size(); ++i) {
    const Triangle& t = piece.triangles[i];
    // A triangle that crosses is in several pieces and the same in all: the part of its first corner keeps it.
    if (t[0] == kInvalidIndex || t[0] >= loaded.own) continue;
    out.triangles.push_back({loaded.names[t[0]], loaded.names[t[1]], loaded.names[t[2]]});
    out.source.push_back(piece.source[i]);
  }
  for (std::size_t v = 0; v < loaded.own; ++v) {
    if (!is_used[v]) continue;
    new_rank_[loaded.names[v]] = std::uint32_t(out.vertices.size());
    out.vertices.push_back(piece.vertices[v]);
  }
}

WorkingMesh PieceResults::join(Context& context) {
  std::vector<std::uint32_t> vertex_offset(pieces_.size() + 1, 0);
  std::size_t triangles = 0;
  for (std::size_t i = 0; i < pieces_.size(); ++i) {
    vertex_offset[i + 1] = vertex_offset[i] + std::uint32_t(pieces_[i].vertices.size());
    triangles += pieces_[i].triangles.size();
  }
  WorkingMesh out;
  out.vertices.reserve(vertex_offset.back());
  out.triangles.reserve(triangles);
  out.source.reserve(triangles);
  parallel_for(context, pieces_.size(), 1, [&](std::size_t i) {
    for (Triangle& t : pieces_[i].triangles)
      for (std::uint32_t& v : t) v = vertex_offset[parts_.part_of_vertex[v]] + new_rank_[v];
  });
  // One after the other: appending touches new memory only as fast as pieces give theirs back.
  for (WorkingMesh& piece : pieces_) {
    context.throw_if_cancelled();
    out.vertices.insert(out.vertices.end(), piece.vertices.begin(), piece.vertices.end());
    out.source.insert(out.source.end(), piece.source.begin(), piece.source.end());
    out.triangles.insert(out.triangles.end(), piece.triangles.begin(), piece.triangles.end());
    piece = {};
  }
  return out;
}

Mesh to_mesh(const WorkingMesh& reduced, const Mesh& source, Context& context) {
  Mesh out;
  out.origin_m = source.origin_m;
  std::vector<std::uint32_t> vertex_source(reduced.vertices.size());
  out.positions_m.resize(reduced.vertices.size());
  parallel_for(context, reduced.vertices.size(), kGrain, [&](std::size_t i) {
    out.positions_m[i] = reduced.vertices[i].position_m;
    vertex_source[i] = reduced.vertices[i].source;
  });
  out.triangles = reduced.triangles;
  gather(out.colors, source.colors, vertex_source, context);
  gather(out.vertex_view, source.vertex_view, vertex_source, context);
  gather(out.vertex_pixel, source.vertex_pixel, vertex_source, context);
  set_triangle_provenance(out, source, reduced.source, context);
  return out;
}

}  // namespace lapseam
