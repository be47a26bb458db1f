#include "sew/grown_model.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <functional>
#include <unordered_set>

#include "core/parallel.h"
#include "mesh/edge_sides.h"
#include "mesh/outline_sizes.h"
#include "patch/by_view.h"
#include "patch/wide_normal.h"
#include "spatial/box.h"

namespace lapseam {
namespace {

constexpr std::size_t kChunk = 256;  // triangles

CoarseNormal normal_at(const Patch& patch, std::size_t pixel) {
  const auto w = std::size_t(patch.grid.width);
  const Eigen::Vector3f normal =
      patch.view.T_world_view.linear().cast<float>() * WideNormal(patch).at(int(pixel % w), int(pixel / w));
  return (normal * 127).array().round().matrix().cast<std::int8_t>();
}

// Triangles along Morton's curve through space: those that follow each other are near each other.
template <typename PositionOf>
std::vector<std::uint32_t> sorted_in_space(std::span<const Triangle> triangles, const PositionOf& position,
                                           Context& context) {
  constexpr float kSteps = 1 << 10;
  struct Place {
    std::uint32_t code, triangle;
    auto operator<=>(const Place&) const = default;
  };
  const auto middle = [&](const Triangle& t) -> Eigen::Vector3f {
    return (position(t[0]) + position(t[1]) + position(t[2])) / 3;
  };
  Eigen::AlignedBox3f box;
  for (const Triangle& t : triangles) box.extend(middle(t));
  const float scale = triangles.empty() ? 0.0f : (kSteps - 1) / std::max(box.sizes().maxCoeff(), 1e-9f);
  std::vector<Place> places(triangles.size());
  for (std::uint32_t t = 0; t < places.size(); ++t) {
    const Eigen::Vector3f at = scale * (middle(triangles[t]) - box.min());
    places[t] = {std::uint32_t(spread_bits(std::uint64_t(at.x())) | spread_bits(std::uint64_t(at.y())) << 1 |
                               spread_bits(std::uint64_t(at.z())) << 2),
                 t};
  }
  parallel_sort(context, places.begin(), places.end(), std::less<>());
  std::vector<std::uint32_t> order(places.size());
  std::transform(places.begin(), places.end(), order.begin(), [](const Place& place) { return place.triangle; });
  return order;
}

template <typename T>
void reorder(std::vector<T>& values, const std::vector<std::uint32_t>& order) {
  std::vector<T> sorted(order.size());
  std::transform(order.begin(), order.end(), sorted.begin(), [&](std::uint32_t i) { return values[i]; });
  values = std::move(sorted);
}

}  // namespace

bool is_before(const OpenEdge& x, const OpenEdge& y) {
  const std::uint64_t kx = undirected(x.a, x.b), ky = undirected(y.a, y.b);
  return kx != ky ? kx < ky : x.triangle < y.triangle;
}

std::uint32_t ModelAddition::add_vertex(std::size_t pixel, const Eigen::Vector3f& position_m) {
  positions_m.push_back(position_m);
  pixels.push_back(std::uint32_t(pixel));
  return first_vertex + std::uint32_t(positions_m.size() - 1);
}

std::uint32_t ModelAddition::add_triangle(const Triangle& triangle, TriangleTag tag) {
  triangles.push_back(triangle);
  tags.push_back(tag);
  return std::uint32_t(triangles.size() - 1);
}

void ModelAddition::finish(const GrownModel& model, Context& context) {
  const Patch& patch = model.patches[view];
  error_m.resize(pixels.size());
  normal.resize(pixels.size());
  parallel_for(context, pixels.size(), 1024, [&](std::size_t i) {
    error_m[i] = expected_error_m(patch, pixels[i]);
    normal[i] = normal_at(patch, pixels[i]);
  });
  const std::vector<std::uint32_t> order = sorted_in_space(
      triangles,
      [&](std::uint32_t v) -> const Eigen::Vector3f& {
        return is_own(v) ? positions_m[v - first_vertex] : model.mesh.positions_m[v];
      },
      context);
  std::vector<std::uint32_t> place(order.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) place[order[i]] = i;
  for (OpenEdge& side : sides) side.triangle = place[side.triangle];
  reorder(triangles, order);
  reorder(tags, order);
}

std::vector<std::uint8_t> GrownModel::accept(std::span<ModelAddition> additions, Context& context) {
  std::vector<std::uint8_t> is_accepted(additions.size(), 0), is_closed(open.size(), 0);
  std::vector<OpenEdge> sides, still_open;
  for (std::size_t i = 0; i < additions.size(); ++i) {
    ModelAddition& addition = additions[i];
    if (i > 0 && is_in_the_way(addition, is_closed)) continue;
    is_accepted[i] = 1;
    append(addition, context);
    for (const std::uint32_t place : addition.closed) {
      is_closed[place] = 1;
      sides.push_back(open[place]);
    }
    sides.insert(sides.end(), addition.sides.begin(), addition.sides.end());
    for (const OpenEdge& side : addition.sides) addition.chords.push_back(undirected(side.a, side.b));
    border_edges.add(std::move(addition.chords), context);
  }
  still_open.reserve(open.size() + sides.size());
  for (std::size_t i = 0; i < open.size(); ++i)
    if (!is_closed[i]) still_open.push_back(open[i]);
  parallel_sort(context, sides.begin(), sides.end(), is_before);
  for (std::size_t i = 0; i < sides.size();) {
    const std::uint64_t key = undirected(sides[i].a, sides[i].b);
    std::size_t end = i + 1;
    while (end < sides.size() && undirected(sides[end].a, sides[end].b) == key) ++end;
    if (end == i + 1) still_open.push_back(sides[i]);
    i = end;
  }
  open = std::move(still_open);
  return is_accepted;
}

void GrownModel::measure_outlines() {
  const std::vector<std::uint32_t> size_at = outline_sizes(mesh.vertex_count(), open);
  outline_size.resize(open.size());
  std::transform(open.begin(), open.end(), outline_size.begin(), [&](const OpenEdge& edge) { return size_at[edge.a]; });
}

// An edge between two vertices of the model that is none of its borders was not there when the addition was made.
bool GrownModel::is_in_the_way(const ModelAddition& addition, const std::vector<std::uint8_t>& is_closed) const {
  std::unordered_set<std::uint64_t> walls;  // membership only
  for (const std::uint32_t place : addition.closed) {
    if (is_closed[place]) return true;
    walls.insert(undirected(open[place].a, open[place].b));
  }
  return std::any_of(addition.sides.begin(), addition.sides.end(), [&](const OpenEdge& side) {
    const std::uint64_t key = undirected(side.a, side.b);
    return !addition.is_own(side.a) && !addition.is_own(side.b) && !walls.contains(key) && border_edges.contains(key);
  });
}

// Earlier additions may have moved where its vertices go.
void GrownModel::append(ModelAddition& addition, Context& context) {
  const auto moved_by = std::uint32_t(mesh.vertex_count()) - addition.first_vertex;
  const auto moved = [&](std::uint32_t v) { return addition.is_own(v) ? v + moved_by : v; };
  const auto append_all = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
  append_all(mesh.positions_m, addition.positions_m);
  append_all(mesh.vertex_pixel, addition.pixels);
  append_all(error_m, addition.error_m);
  append_all(normal, addition.normal);
  mesh.vertex_view.resize(mesh.vertex_count(), addition.view);
  for (Triangle& t : addition.triangles)
    for (std::uint32_t& v : t) v = moved(v);
  const std::size_t first = mesh.triangle_count();
  append_all(mesh.triangles, addition.triangles);
  append_all(mesh.triangle_tag, addition.tags);
  mesh.triangle_view.resize(mesh.triangle_count(), addition.view);
  for (const TriangleTag tag : addition.tags)
    ++(tag == TriangleTag::kSeam ? report.seam_triangles : report.measured_triangles);
  for (OpenEdge& side : addition.sides) side = {moved(side.a), moved(side.b), std::uint32_t(first) + side.triangle};
  for (std::uint64_t& chord : addition.chords)
    chord = undirected(moved(std::uint32_t(chord >> 32)), moved(std::uint32_t(chord)));
  add_chunks(first, context);
}

// Everything that is known of the border, from the triangles alone.
void GrownModel::find_border(Context& context) {
  constexpr std::size_t kVertices = 16384;  // at once
  const EdgeSides sides(mesh.triangles, mesh.vertex_count());
  open = parallel_collect<OpenEdge>(context, mesh.vertex_count(), kVertices, [&](std::size_t v, auto& found) {
    for (const EdgeSides::Side& side : sides.at(v)) {
      const auto is_same = [&](const EdgeSides::Side& other) { return other.higher == side.higher; };
      if (std::count_if(sides.at(v).begin(), sides.at(v).end(), is_same) != 1) continue;
      const Triangle& t = mesh.triangles[side.corner / 3];
      const std::uint32_t k = side.corner % 3;
      found.push_back({t[k], t[k == 2 ? 0 : k + 1], side.corner / 3});
    }
  });
  std::vector<std::uint8_t> on_border(mesh.vertex_count(), 0);
  for (const OpenEdge& edge : open) on_border[edge.a] = on_border[edge.b] = 1;
  const auto collect_keys = [&](std::size_t v, auto& found) {
    if (!on_border[v]) return;
    for (const EdgeSides::Side& side : sides.at(v))
      if (on_border[side.higher]) found.push_back(undirected(std::uint32_t(v), side.higher));
  };
  border_edges.clear();
  border_edges.add(parallel_collect<std::uint64_t>(context, mesh.vertex_count(), kVertices, collect_keys), context);
  chunks.clear();
  add_chunks(0, context);
}

void GrownModel::add_chunks(std::size_t begin, Context& context) {
  const std::size_t before = chunks.size();
  chunks.resize(before + (mesh.triangles.size() - begin + kChunk - 1) / kChunk);
  parallel_for(context, chunks.size() - before, 16, [&](std::size_t i) {
    const std::size_t first = begin + i * kChunk;
    Chunk chunk{first, std::min(first + kChunk, mesh.triangles.size()), Eigen::Vector3f::Zero(), 0, 0};
    Eigen::AlignedBox3f box;
    for (std::size_t t = chunk.first; t < chunk.last; ++t)
      for (const std::uint32_t v : mesh.triangles[t]) {
        box.extend(mesh.positions_m[v]);
        chunk.error_m = std::max(chunk.error_m, error_m[v]);
      }
    chunk.center = box.center();
    chunk.radius_m = 0.5f * box.diagonal().norm();
    chunks[before + i] = chunk;
  });
}

void GrownModel::sort_triangles(Context& context) {
  const std::vector<std::uint32_t> order = sorted_in_space(
      mesh.triangles, [&](std::uint32_t v) -> const Eigen::Vector3f& { return mesh.positions_m[v]; }, context);
  reorder(mesh.triangles, order);
  reorder(mesh.triangle_tag, order);
  reorder(mesh.triangle_view, order);
}

void GrownModel::replace(Mesh replacement, Context& context) {
  mesh = std::move(replacement);
  sort_triangles(context);
  error_m.resize(mesh.vertex_count());
  normal.resize(mesh.vertex_count());
  const VerticesByView vertices(mesh, patches.size());
  parallel_for(context, patches.size(), 1, [&](std::size_t i) {
    for (const std::uint32_t v : vertices.of(i)) {
      error_m[v] = expected_error_m(patches[i], mesh.vertex_pixel[v]);
      normal[v] = normal_at(patches[i], mesh.vertex_pixel[v]);
    }
    relieve(patches[i]);
  });
  find_border(context);
}

Mesh GrownModel::take() {
  Mesh taken = std::move(mesh);
  mesh = {};
  mesh.origin_m = taken.origin_m;
  error_m = {};
  normal = {};
  open = {};
  chunks = {};
  border_edges.clear();
  return taken;
}

}  // namespace lapseam
