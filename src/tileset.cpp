#include "lapseam/tileset.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>

#include "core/parallel.h"
#include "io/output_file.h"
#include "io/output_folder.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "lapseam/reduce.h"
#include "lapseam/texture.h"
#include "spatial/ray_scene.h"

namespace lapseam {
namespace {

using Json = nlohmann::ordered_json;

struct Tile {
  std::vector<std::uint32_t> triangles;  ///< of the whole mesh
  Eigen::AlignedBox3f box;
  std::vector<std::size_t> children;
  int level = 0;
  double error_m = 0;
};

/// The triangles of a tile as a mesh of its own; `vertices` gets their vertices in the whole mesh.
Mesh extract(const Mesh& mesh, const std::vector<Rgb8>& colors, const std::vector<std::uint32_t>& triangles,
             std::vector<std::uint32_t>& vertices) {
  vertices.clear();
  for (const std::uint32_t t : triangles)
    vertices.insert(vertices.end(), mesh.triangles[t].begin(), mesh.triangles[t].end());
  std::sort(vertices.begin(), vertices.end());
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  const auto local = [&](std::uint32_t vertex) {
    return std::uint32_t(std::lower_bound(vertices.begin(), vertices.end(), vertex) - vertices.begin());
  };
  Mesh part;
  for (const std::uint32_t vertex : vertices) {
    part.positions_m.push_back(mesh.positions_m[vertex]);
    if (!colors.empty()) part.colors.push_back(colors[vertex]);
  }
  for (const std::uint32_t t : triangles) {
    const Triangle& whole = mesh.triangles[t];
    part.triangles.push_back({local(whole[0]), local(whole[1]), local(whole[2])});
  }
  return part;
}

class TilesetWriter {
 public:
  TilesetWriter(const Mesh& mesh, const TilesetOptions& options, Context& context)
      : mesh_(mesh),
        colors_(mesh.triangle_page.empty() ? mesh.colors : vertex_colors(mesh, context)),
        options_(options),
        context_(context) {}

  TilesetReport write(const std::filesystem::path& folder) {
    split();
    StageScope stage(context_, "write tiles", tiles_.size());
    std::filesystem::create_directories(folder / "tiles");
    // One after another: a reduction uses all threads. From the leaves up, so that errors grow that way.
    for (std::size_t i = tiles_.size(); i-- > 0;) {
      write_tile(i, folder / "tiles" / file_name(i));
      stage.advance();
    }
    Json document;
    document["asset"] = {{"version", "1.1"}, {"generator", "lapseam"}};
    document["geometricError"] = 2 * std::max(tiles_[0].error_m, 1e-6 + double(tiles_[0].box.diagonal().norm()) / 16);
    document["root"] = describe(0);
    const Eigen::Vector3d o = mesh_.origin_m;
    if (!o.isZero(0)) document["root"]["transform"] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, o.x(), o.y(), o.z(), 1};
    OutputFile out(folder / "tileset.json");
    out.write(document.dump(1));
    out.commit();
    return report_;
  }

 private:
  static std::string file_name(std::size_t i) { return std::to_string(i) + ".glb"; }

  Eigen::Vector3f center_of(std::uint32_t t) const {
    const Triangle& corners = mesh_.triangles[t];
    return (mesh_.positions_m[corners[0]] + mesh_.positions_m[corners[1]] + mesh_.positions_m[corners[2]]) / 3.0f;
  }

  /// In halves across the longest side, until they are small enough. Parents come before their children.
  void split() {
    Tile root;
    root.triangles.resize(mesh_.triangle_count());
    std::iota(root.triangles.begin(), root.triangles.end(), 0u);
    tiles_.push_back(std::move(root));
    for (std::size_t i = 0; i < tiles_.size(); ++i) {
      for (const std::uint32_t t : tiles_[i].triangles)
        for (const std::uint32_t vertex : mesh_.triangles[t]) tiles_[i].box.extend(mesh_.positions_m[vertex]);
      report_.levels = std::max(report_.levels, tiles_[i].level + 1);
      if (tiles_[i].triangles.size() > options_.max_triangles) split_tile(i);
    }
    report_.tiles = tiles_.size();
  }

  void split_tile(std::size_t i) {
    // Four at a time where there are that many: a tree of halves would have twice the levels.
    std::vector<std::vector<std::uint32_t>> parts{tiles_[i].triangles};
    for (int round = 0; round < 2; ++round) {
      std::vector<std::vector<std::uint32_t>> halves;
      for (std::vector<std::uint32_t>& part : parts) {
        if (round > 0 && part.size() <= options_.max_triangles) {
          halves.push_back(std::move(part));
          continue;
        }
        auto [low, high] = halve(std::move(part));
        halves.push_back(std::move(low));
        halves.push_back(std::move(high));
      }
      parts = std::move(halves);
    }
    for (std::vector<std::uint32_t>& part : parts) {
      Tile child;
      child.triangles = std::move(part);
      child.level = tiles_[i].level + 1;
      tiles_[i].children.push_back(tiles_.size());
      tiles_.push_back(std::move(child));
    }
  }

  std::pair<std::vector<std::uint32_t>, std::vector<std::uint32_t>> halve(std::vector<std::uint32_t> part) const {
    Eigen::AlignedBox3f box;
    for (const std::uint32_t t : part) box.extend(center_of(t));
    int axis = 0;
    box.sizes().maxCoeff(&axis);
    const auto middle = part.begin() + std::ptrdiff_t(part.size() / 2);
    std::nth_element(part.begin(), middle, part.end(), [&](std::uint32_t a, std::uint32_t b) {
      const float x = center_of(a)[axis], y = center_of(b)[axis];
      return x != y ? x < y : a < b;
    });
    std::vector<std::uint32_t> high(middle, part.end());
    part.erase(middle, part.end());
    std::sort(part.begin(), part.end());
    std::sort(high.begin(), high.end());
    return {std::move(part), std::move(high)};
  }

  void write_tile(std::size_t i, const std::filesystem::path& file) {
    Tile& tile = tiles_[i];
    std::vector<std::uint32_t> vertices;
    Mesh part = extract(mesh_, colors_, tile.triangles, vertices);
    if (tile.children.empty()) {
      ++report_.leaves;
    } else {
      const Mesh full = part;
      part = reduce(full, {}, {.max_triangles = options_.max_triangles}, context_).mesh;
      tile.error_m = fit(full, part);
      for (const std::size_t child : tile.children) tile.error_m = std::max(tile.error_m, tiles_[child].error_m);
    }
    if (i == 0) report_.root_error_m = tile.error_m;
    // Viewers turn glTF's y up into z up; turned the other way before, tiles stay where they are.
    for (Eigen::Vector3f& p : part.positions_m) p = Eigen::Vector3f(p.x(), p.z(), -p.y());
    write_mesh(part, file);
    tile.triangles = {};
  }

  /// The largest distance from the vertices to the reduced surface, whose vertices get the mean of the colours around
  /// them: one of these alone would speckle.
  double fit(const Mesh& full, Mesh& reduced) const {
    const RayScene surface(reduced.positions_m, reduced.triangles, context_);
    std::vector<float> distances(full.vertex_count());
    std::vector<std::uint32_t> nearest(full.vertex_count());
    parallel_blocks(context_, distances.size(), 4096, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k != end; ++k) {
        const ClosestPoint closest = surface.closest(full.positions_m[k]);
        distances[k] = closest.distance;
        const Triangle& t = reduced.triangles[closest.triangle];
        const auto off = [&](std::uint32_t v) { return (reduced.positions_m[v] - closest.point).squaredNorm(); };
        nearest[k] = *std::min_element(t.begin(), t.end(), [&](std::uint32_t a, std::uint32_t b) {
          return off(a) != off(b) ? off(a) < off(b) : a < b;
        });
      }
    });
    if (!full.colors.empty()) average_colors(full, nearest, reduced);
    return double(*std::max_element(distances.begin(), distances.end()));
  }

  static void average_colors(const Mesh& full, const std::vector<std::uint32_t>& nearest, Mesh& reduced) {
    std::vector<Eigen::Array4d> sum(reduced.vertex_count(), Eigen::Array4d::Zero());
    for (std::size_t k = 0; k < nearest.size(); ++k) {
      const Rgb8 c = full.colors[k];
      sum[nearest[k]] += Eigen::Array4d(c.r, c.g, c.b, 1);
    }
    for (std::size_t v = 0; v < sum.size(); ++v) {
      if (sum[v][3] == 0) continue;  // keeps its own
      const Eigen::Array4d mean = sum[v] / sum[v][3] + 0.5;
      reduced.colors[v] = {std::uint8_t(mean[0]), std::uint8_t(mean[1]), std::uint8_t(mean[2])};
    }
  }

  Json describe(std::size_t i) const {
    const Tile& tile = tiles_[i];
    const Eigen::Vector3f center = tile.box.center();
    const Eigen::Vector3f half = (tile.box.sizes() / 2).cwiseMax(1e-4f);
    Json out;
    out["boundingVolume"]["box"] = {center.x(), center.y(), center.z(), half.x(), 0, 0, 0, half.y(), 0, 0, 0, half.z()};
    out["geometricError"] = tile.error_m;
    out["refine"] = "REPLACE";
    out["content"]["uri"] = "tiles/" + file_name(i);
    for (const std::size_t child : tile.children) out["children"].push_back(describe(child));
    return out;
  }

  const Mesh& mesh_;
  const std::vector<Rgb8> colors_;
  const TilesetOptions& options_;
  Context& context_;
  std::vector<Tile> tiles_;
  TilesetReport report_;
};

}  // namespace

TilesetReport write_tileset(const Mesh& mesh, const std::filesystem::path& folder, const TilesetOptions& options,
                            Context& context) {
  check_mesh(mesh);
  if (mesh.triangle_count() == 0) throw InvalidInput(folder, {}, "triangles", "a mesh without triangles has no tiles");
  if (options.max_triangles < 1000) throw InvalidInput(folder, {}, "max_triangles", "must be at least 1000");
  OutputFolder output(folder);
  const TilesetReport report = TilesetWriter(mesh, options, context).write(output.path());
  output.commit();
  return report;
}

}  // namespace lapseam
