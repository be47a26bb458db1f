#include "lapseam/fill_holes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <unordered_map>

#include "core/disjoint_sets.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "sew_meshes/loops.h"

namespace lapseam {
namespace {

// The loop's own direction against the normals beside it: above this, the surface lies inside of the loop.
constexpr double kRimCosine = 0.3;
constexpr TriangleRule kFillRule = {.smallest_sine = 1e-4, .fold_cosine = -0.9};

void check_edges(const Mesh& mesh) {
  std::vector<std::uint64_t> edges;
  edges.reserve(3 * mesh.triangle_count());
  for (const Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) edges.push_back(std::uint64_t(t[k]) << 32 | t[(k + 1) % 3]);
  std::sort(edges.begin(), edges.end());
  const auto twice = std::adjacent_find(edges.begin(), edges.end());
  if (twice != edges.end())
    throw InvalidInput({}, {}, "triangles",
                       "two run from vertex " + std::to_string(*twice >> 32) + " to vertex " +
                           std::to_string(*twice & 0xFFFFFFFFu) + ", or one repeats a vertex");
}

/// Whether the loop runs around its surface: with the surface on its left, it turns as the surface's normals say.
bool is_rim(const LiveMesh& mesh, const Loop& loop) {
  Eigen::Vector3d area = Eigen::Vector3d::Zero(), normal = Eigen::Vector3d::Zero();
  const Eigen::Vector3d origin = mesh.position(loop[0]).cast<double>();
  double length = 0;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const std::uint32_t a = loop[i], b = loop[(i + 1) % loop.size()];
    const Eigen::Vector3d p = mesh.position(a).cast<double>() - origin, q = mesh.position(b).cast<double>() - origin;
    area += p.cross(q);
    normal += (q - p).norm() * mesh.area_normal(mesh.find(a, b)).stableNormalized();
    length += (q - p).norm();
  }
  return area.dot(normal) > kRimCosine * area.norm() * length;
}

/// The longest loop of each piece of surface: only that can be its rim. A small one that looks like a rim is a fold.
std::vector<std::uint8_t> find_longest_loops(const LiveMesh& mesh, const std::vector<Loop>& loops) {
  DisjointSets pieces(mesh.vertex_count());
  for (std::uint32_t t = 0; t < mesh.triangle_count(); ++t) {
    pieces.unite(mesh.triangle(t)[0], mesh.triangle(t)[1]);
    pieces.unite(mesh.triangle(t)[0], mesh.triangle(t)[2]);
  }
  std::unordered_map<std::uint32_t, std::pair<float, std::size_t>> longest;
  for (std::size_t i = 0; i < loops.size(); ++i) {
    float length = 0;
    for (std::size_t k = 0; k < loops[i].size(); ++k)
      length += (mesh.position(loops[i][k]) - mesh.position(loops[i][(k + 1) % loops[i].size()])).norm();
    auto& best = longest.try_emplace(pieces.find(loops[i][0]), -1.0f, 0u).first->second;
    if (length > best.first) best = {length, i};
  }
  std::vector<std::uint8_t> is_longest(loops.size(), 0);
  for (const auto& [piece, best] : longest) is_longest[best.second] = 1;
  return is_longest;
}

/// The largest distance between two vertices; exact up to a thousand, beyond that between every few.
double width_of(const LiveMesh& mesh, const Loop& loop) {
  const std::size_t step = 1 + loop.size() / 1000;
  float squared = 0;
  for (std::size_t i = 0; i < loop.size(); i += step)
    for (std::size_t j = 0; j < loop.size(); ++j)
      squared = std::max(squared, (mesh.position(loop[i]) - mesh.position(loop[j])).squaredNorm());
  return std::sqrt(double(squared));
}

}  // namespace

FillHolesReport fill_holes(Mesh& mesh, const FillHolesOptions& options, Context& context) {
  FillHolesReport report;
  check_mesh(mesh);
  check_edges(mesh);
  if (std::isnan(options.largest_m)) throw InvalidInput({}, {}, "largest_m", "is not a number");
  if (!(options.largest_m > 0) || mesh.triangles.empty()) return report;
  StageScope stage(context, "fill holes");
  if (mesh.triangle_tag.empty()) mesh.triangle_tag.assign(mesh.triangle_count(), TriangleTag::kMeasured);
  LiveMesh live(mesh);
  const std::size_t given = live.triangle_count();
  std::vector<Loop> holes = trace_loops(live, open_edges(live, context));
  const std::vector<std::uint8_t> is_longest = find_longest_loops(live, holes);
  for (std::size_t i = 0; i < holes.size(); ++i)
    if (is_longest[i] && is_rim(live, holes[i])) holes[i].clear();
  std::erase_if(holes, [](const Loop& loop) { return loop.empty(); });
  report.holes = holes.size();
  std::erase_if(holes, [&](const Loop& loop) { return width_of(live, loop) > options.largest_m; });
  report.holes_in_size = holes.size();
  if (holes.empty()) return report;
  // Short ones first: what they take is little, and long ones are more at ease with what is left.
  std::stable_sort(holes.begin(), holes.end(), [](const Loop& a, const Loop& b) { return a.size() < b.size(); });
  TriangleCheck check(live, {}, context);
  for (const Loop& loop : holes) {
    stage.advance();
    if (close_loop(live, check, loop, LoopGoal::kArea, kFillRule, TriangleTag::kFilled)) ++report.holes_filled;
  }
  std::vector<std::uint8_t> keep = live.alive();
  report.triangles = std::uint64_t(std::count(keep.begin() + std::ptrdiff_t(given), keep.end(), 1));
  const bool has_texture = !mesh.texcoords.empty();
  if (has_texture) mesh.texcoords.resize(mesh.triangle_count());
  if (!mesh.triangle_page.empty()) mesh.triangle_page.resize(mesh.triangle_count(), kInvalidIndex);
  if (!mesh.is_unseen.empty()) mesh.is_unseen.resize(mesh.triangle_count(), 1);
  if (std::find(keep.begin(), keep.end(), 0) != keep.end()) {
    // Only triangles that were tried go; vertices stay as they are, used or not.
    std::size_t out = given;
    for (std::size_t t = given; t < keep.size(); ++t) {
      if (!keep[t]) continue;
      mesh.triangles[out] = mesh.triangles[t];
      mesh.triangle_tag[out] = mesh.triangle_tag[t];
      if (!mesh.triangle_view.empty()) mesh.triangle_view[out] = mesh.triangle_view[t];
      ++out;
    }
    mesh.triangles.resize(out);
    mesh.triangle_tag.resize(out);
    if (!mesh.triangle_view.empty()) mesh.triangle_view.resize(out);
    if (has_texture) mesh.texcoords.resize(out);
    if (!mesh.triangle_page.empty()) mesh.triangle_page.resize(out);
    if (!mesh.is_unseen.empty()) mesh.is_unseen.resize(out);
  }
  if (report.holes_filled < report.holes_in_size)
    context.warn("fill holes: " + std::to_string(report.holes_in_size - report.holes_filled) +
                 " have no filling that meets nothing, and stay open");
  return report;
}

std::string to_json(const FillHolesReport& report) {
  const nlohmann::ordered_json json = {{"holes", report.holes},
                                       {"holes_in_size", report.holes_in_size},
                                       {"holes_filled", report.holes_filled},
                                       {"triangles", report.triangles}};
  return json.dump(2);
}

}  // namespace lapseam
