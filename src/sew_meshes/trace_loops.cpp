#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <unordered_map>
#include <unordered_set>

#include "core/parallel.h"
#include "sew_meshes/loops.h"

namespace lapseam {
namespace {

constexpr std::size_t kTrianglesAtOnce = 4096;

std::uint64_t key(std::uint32_t a, std::uint32_t b) { return std::uint64_t(a) << 32 | b; }

class Tracer {
 public:
  explicit Tracer(const LiveMesh& mesh) : mesh_(mesh) {}

  void trace(std::uint32_t a, std::uint32_t b, std::vector<Loop>& loops) {
    if (is_passed_.contains(key(a, b))) return;
    Loop path = {a};
    place_.clear();
    place_[a] = 0;
    std::uint32_t from = a, at = b;
    while (true) {
      is_passed_.insert(key(from, at));
      if (const auto known = place_.find(at); known != place_.end()) {
        const std::size_t begin = known->second;
        if (path.size() - begin >= 3) loops.emplace_back(path.begin() + std::ptrdiff_t(begin), path.end());
        if (begin == 0) return;
        for (std::size_t i = begin + 1; i < path.size(); ++i) place_.erase(path[i]);
        path.resize(begin + 1);
      } else {
        place_[at] = path.size();
        path.push_back(at);
      }
      const std::uint32_t to = next_after(from, at);
      if (to == kInvalidIndex) return;
      from = at;
      at = to;
    }
  }

 private:
  /// Of the open edges that leave v and are not passed yet, the first one counter-clockwise from where we came.
  std::uint32_t next_after(std::uint32_t from, std::uint32_t v) {
    mesh_.open_out(v, out_);
    std::uint32_t best = kInvalidIndex;
    double best_turn = 1e9;
    Eigen::Vector3d normal = Eigen::Vector3d::Zero();
    if (out_.size() > 1) mesh_.for_each_around(v, [&](std::uint32_t t) { normal += mesh_.area_normal(t); });
    normal = normal.stableNormalized();
    const Eigen::Vector3d at = mesh_.position(v).cast<double>();
    const Eigen::Vector3d back = mesh_.position(from).cast<double>() - at;
    for (const std::uint32_t to : out_) {
      if (is_passed_.contains(key(v, to))) continue;
      const Eigen::Vector3d ahead = mesh_.position(to).cast<double>() - at;
      const Eigen::Vector3d flat_back = back - normal * normal.dot(back);
      double turn = std::atan2(normal.dot(flat_back.cross(ahead)), flat_back.dot(ahead));
      if (turn < 0) turn += 2 * std::numbers::pi;
      if (turn < best_turn) best = to, best_turn = turn;
    }
    return best;
  }

  const LiveMesh& mesh_;
  std::unordered_set<std::uint64_t> is_passed_;
  std::unordered_map<std::uint32_t, std::size_t> place_;  // of the vertices of the path
  std::vector<std::uint32_t> out_;
};

}  // namespace

std::vector<std::array<std::uint32_t, 2>> open_edges(const LiveMesh& mesh, Context& context) {
  using Edge = std::array<std::uint32_t, 2>;
  return parallel_collect<Edge>(context, mesh.triangle_count(), kTrianglesAtOnce, [&](std::size_t t, auto& edges) {
    if (!mesh.is_alive(std::uint32_t(t))) return;
    const Triangle& corners = mesh.triangle(std::uint32_t(t));
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = corners[k], b = corners[(k + 1) % 3];
      if (mesh.find(b, a) == kInvalidIndex) edges.push_back({a, b});
    }
  });
}

std::vector<Loop> trace_loops(const LiveMesh& mesh, std::span<const std::array<std::uint32_t, 2>> edges) {
  std::vector<Loop> loops;
  Tracer tracer(mesh);
  for (const auto& [a, b] : edges)
    if (mesh.is_open(a, b)) tracer.trace(a, b, loops);
  return loops;
}

}  // namespace lapseam
