// Based on: G. Turk, M. Levoy, Zippered Polygon Meshes from Range Images, 1994, §4 (borders lose what lies over another
// mesh).

#include "mend/trim.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/parallel.h"

namespace lapseam {
namespace {

// Surfaces that face apart by more are two sides of a sheet, or meet in a crease.
constexpr double kSameLayerCosine = 0.5;
// Each round takes one ring; what lies over each other deeper than this was not left by sewing.
constexpr int kMostRings = 8;
constexpr double kRegistrationFactor = 2;  // twice the median disagreement covers most of it

class Trimmer {
 public:
  Trimmer(LiveMesh& mesh, const TriangleCheck& check, std::span<const float> error_m, const OverlapOptions& options)
      : mesh_(mesh), check_(check), error_m_(error_m), options_(options) {}

  std::uint64_t run(Context& context) {
    std::vector<std::uint32_t> front;
    for (std::uint32_t t = 0; t < mesh_.triangle_count(); ++t)
      if (is_at_border(t)) front.push_back(t);
    std::uint64_t removed = 0;
    for (int ring = 0; ring < kMostRings && !front.empty(); ++ring) {
      std::vector<std::uint8_t> covered(front.size(), 0);
      parallel_for(context, front.size(), 256, [&](std::size_t i) { covered[i] = is_covered(front[i]); });
      std::vector<std::uint32_t> doomed;
      for (std::size_t i = 0; i < front.size(); ++i)
        if (covered[i]) doomed.push_back(front[i]);
      front = remove(doomed, removed);
    }
    return removed;
  }

 private:
  bool is_at_border(std::uint32_t t) const {
    const Triangle& c = mesh_.triangle(t);
    return mesh_.is_on_border(c[0]) || mesh_.is_on_border(c[1]) || mesh_.is_on_border(c[2]);
  }

  float error_of(const Triangle& t) const { return std::max({error_m_[t[0]], error_m_[t[1]], error_m_[t[2]]}); }

  bool is_covered(std::uint32_t t) const {
    const Triangle& c = mesh_.triangle(t);
    const Eigen::Vector3d normal = mesh_.area_normal(t).stableNormalized();
    const Eigen::Vector3f middle = (mesh_.position(c[0]) + mesh_.position(c[1]) + mesh_.position(c[2])) / 3;
    const double layer_m =
        options_.noise_factor * double(error_of(c)) + kRegistrationFactor * options_.registration_error_m;
    Box box;
    box.extend(middle);
    box.low.array() -= float(layer_m);
    box.high.array() += float(layer_m);
    for (const std::uint32_t s : check_.find_near(box))
      if (s != t && lies_over(c, mesh_.triangle(s), middle.cast<double>(), normal, layer_m)) return true;
    return false;
  }

  bool lies_over(const Triangle& c, const Triangle& d, const Eigen::Vector3d& middle, const Eigen::Vector3d& normal,
                 double layer_m) const {
    for (const std::uint32_t v : c)
      if (v == d[0] || v == d[1] || v == d[2]) return false;
    const Eigen::Vector3d other = mesh_.area_normal(d).stableNormalized();
    if (other.dot(normal) < kSameLayerCosine) return false;
    const auto corner = [&](std::size_t k) -> Eigen::Vector3d { return mesh_.position(d[k % 3]).cast<double>(); };
    if (std::abs(other.dot(middle - corner(0))) > layer_m) return false;
    for (std::size_t k = 0; k < 3; ++k)
      if (other.dot((corner(k + 1) - corner(k)).cross(middle - corner(k))) < 0) return false;
    return true;
  }

  // Of two that lie over each other the surer stays. Returns what borders on the removed ones.
  std::vector<std::uint32_t> remove(std::vector<std::uint32_t>& doomed, std::uint64_t& removed) {
    std::sort(doomed.begin(), doomed.end(), [&](std::uint32_t a, std::uint32_t b) {
      const bool is_seam_a = mesh_.tag(a) == TriangleTag::kSeam, is_seam_b = mesh_.tag(b) == TriangleTag::kSeam;
      if (is_seam_a != is_seam_b) return is_seam_a;
      const float error_a = error_of(mesh_.triangle(a)), error_b = error_of(mesh_.triangle(b));
      return error_a != error_b ? error_a > error_b : a > b;
    });
    std::vector<std::uint32_t> beside;
    for (const std::uint32_t t : doomed) {
      if (!is_covered(t)) continue;
      const Triangle corners = mesh_.triangle(t);
      mesh_.remove(t);
      ++removed;
      for (const std::uint32_t v : corners) mesh_.for_each_around(v, [&](std::uint32_t s) { beside.push_back(s); });
    }
    std::sort(beside.begin(), beside.end());
    beside.erase(std::unique(beside.begin(), beside.end()), beside.end());
    std::erase_if(beside, [&](std::uint32_t t) { return !mesh_.is_alive(t); });
    return beside;
  }

  LiveMesh& mesh_;
  const TriangleCheck& check_;
  std::span<const float> error_m_;
  const OverlapOptions& options_;
};

}  // namespace

std::uint64_t trim_double_layers(LiveMesh& mesh, const TriangleCheck& check, std::span<const float> error_m,
                                 const OverlapOptions& options, Context& context) {
  return Trimmer(mesh, check, error_m, options).run(context);
}

}  // namespace lapseam
