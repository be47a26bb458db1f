#include "mend/outline_slivers.h"

#include <Eigen/Geometry>
#include <array>
#include <vector>

#include "mend/living_triangles.h"

namespace lapseam {
namespace {

constexpr double kNeedleSine = 0.342;   // 20°: sticks out, with two open edges
constexpr double kSliverSine = 0.0523;  // 3°: along the border

class Slivers {
 public:
  Slivers(LiveMesh& mesh, const Witnesses& witnesses) : mesh_(mesh), witnesses_(witnesses) {}

  std::uint64_t run(Context& context) {
    std::vector<std::uint32_t> doomed = living_triangles(mesh_, context, [&](std::uint32_t t) { return is_one(t); });
    std::uint64_t removed = 0;
    while (!doomed.empty()) {
      const std::uint32_t t = doomed.back();
      doomed.pop_back();
      if (!mesh_.is_alive(t)) continue;
      const Triangle corners = mesh_.triangle(t);
      mesh_.remove(t);
      ++removed;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t beside = mesh_.find(corners[(k + 1) % 3], corners[k]);
        if (beside != kInvalidIndex && is_one(beside)) doomed.push_back(beside);
      }
    }
    return removed;
  }

 private:
  // A needle of a seam goes however it is seen: nobody measured it, and it closes nothing.
  bool is_one(std::uint32_t t) const {
    const Triangle& c = mesh_.triangle(t);
    std::size_t open = 0, closed = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      if (mesh_.is_open(c[k], c[(k + 1) % 3]))
        ++open;
      else
        closed = k;
    }
    if (open == 0) return false;
    const bool is_needle = open > 1 && is_sharp(c[(closed + 2) % 3], c[closed], c[(closed + 1) % 3]);
    if (is_needle && mesh_.tag(t) == TriangleTag::kSeam) return true;
    const double sine = smallest_sine(mesh_.position(c[0]), mesh_.position(c[1]), mesh_.position(c[2]));
    return (is_needle || sine < kSliverSine) && is_edge_on(t);
  }

  bool is_sharp(std::uint32_t tip, std::uint32_t v, std::uint32_t w) const {
    const Eigen::Vector3f a = mesh_.position(v) - mesh_.position(tip), b = mesh_.position(w) - mesh_.position(tip);
    return a.dot(b) > 0 && double(a.cross(b).norm()) < kNeedleSine * double(a.norm()) * double(b.norm());
  }

  bool is_edge_on(std::uint32_t t) const {
    const Triangle& c = mesh_.triangle(t);
    const Eigen::Vector3f middle = (mesh_.position(c[0]) + mesh_.position(c[1]) + mesh_.position(c[2])) / 3;
    const Eigen::Vector3f normal = mesh_.area_normal(t).stableNormalized().cast<float>();
    return witnesses_.is_edge_on(mesh_.view(t), middle, normal);
  }

  LiveMesh& mesh_;
  const Witnesses& witnesses_;
};

}  // namespace

std::uint64_t remove_outline_slivers(LiveMesh& mesh, const Witnesses& witnesses, Context& context) {
  return Slivers(mesh, witnesses).run(context);
}

}  // namespace lapseam
