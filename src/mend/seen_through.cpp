#include "mend/seen_through.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "core/parallel.h"
#include "mend/living_triangles.h"
#include "spatial/ray_scene.h"

namespace lapseam {
namespace {

constexpr std::size_t kTrianglesAtOnce = 256;
// One view against another says nothing; nor do two against one, if any of them may be off.
constexpr std::uint32_t kFewestViews = 3;
// Rims of two views part by up to so many times the median disagreement, hardly ever by more.
constexpr double kReachFactor = 3;

enum class Fate : std::uint8_t { kUnasked, kStays, kGoes };

class Rims {
 public:
  Rims(LiveMesh& mesh, const TriangleCheck& check, const Witnesses& witnesses, std::span<const float> error_m,
       const OverlapOptions& options)
      : mesh_(mesh),
        check_(check),
        witnesses_(witnesses),
        error_m_(error_m),
        reach_m_(float(kReachFactor * options.registration_error_m)),
        fates_(mesh.triangle_count(), Fate::kUnasked) {}

  std::uint64_t run(Context& context) {
    const std::vector<std::uint32_t> doomed = find_doomed(context);
    if (doomed.empty()) return 0;
    const std::vector<std::uint8_t> is_beside = are_beside_surface(doomed, context);
    const std::vector<std::uint32_t> going = choose(doomed, is_beside);
    for (const std::uint32_t t : going) mesh_.remove(t);
    return going.size();
  }

 private:
  // Ring by ring, as long as what is at the border is seen through. In rising order.
  std::vector<std::uint32_t> find_doomed(Context& context) {
    std::vector<std::uint32_t> doomed;
    std::vector<std::uint32_t> front =
        living_triangles(mesh_, context, [&](std::uint32_t t) { return is_at_border(t); });
    while (!front.empty()) {
      parallel_for(context, front.size(), kTrianglesAtOnce, [&](std::size_t i) {
        fates_[front[i]] = is_seen_through(front[i]) ? Fate::kGoes : Fate::kStays;
        witnesses_.relieve();
      });
      std::vector<std::uint32_t> beside;
      for (const std::uint32_t t : front) {
        if (fates_[t] != Fate::kGoes) continue;
        doomed.push_back(t);
        for_each_neighbor(t, [&](std::uint32_t s) {
          if (fates_[s] == Fate::kUnasked) beside.push_back(s);
        });
      }
      std::sort(beside.begin(), beside.end());
      beside.erase(std::unique(beside.begin(), beside.end()), beside.end());
      front = std::move(beside);
    }
    std::sort(doomed.begin(), doomed.end());
    return doomed;
  }

  // Of each that is doomed: whether something that stays is within reach.
  std::vector<std::uint8_t> are_beside_surface(std::span<const std::uint32_t> doomed, Context& context) const {
    std::vector<std::uint32_t> staying;
    for (const std::uint32_t t : doomed) {
      Box box;
      box.extend(middle_of(t));
      box.low.array() -= reach_m_;
      box.high.array() += reach_m_;
      for (const std::uint32_t s : check_.find_near(box))
        if (fates_[s] != Fate::kGoes) staying.push_back(s);
    }
    std::sort(staying.begin(), staying.end());
    staying.erase(std::unique(staying.begin(), staying.end()), staying.end());
    std::vector<Triangle> triangles;
    triangles.reserve(staying.size());
    for (const std::uint32_t s : staying) triangles.push_back(mesh_.triangle(s));
    const RayScene surface(mesh_.positions(), triangles, context);
    std::vector<std::uint8_t> is_beside(doomed.size());
    parallel_for(context, doomed.size(), kTrianglesAtOnce, [&](std::size_t i) {
      is_beside[i] = surface.closest(middle_of(doomed[i]), reach_m_).triangle != kInvalidIndex;
    });
    return is_beside;
  }

  // Connected parts of what is doomed go as far as they are beside what stays, if most of their area is.
  std::vector<std::uint32_t> choose(std::span<const std::uint32_t> doomed,
                                    std::span<const std::uint8_t> is_beside) const {
    std::vector<std::uint32_t> going;
    std::vector<std::uint8_t> is_visited(doomed.size(), 0);
    std::vector<std::size_t> part;
    for (std::size_t first = 0; first < doomed.size(); ++first) {
      if (is_visited[first]) continue;
      is_visited[first] = 1;
      part.assign(1, first);
      double area_beside = 0, area_apart = 0;
      for (std::size_t i = 0; i < part.size(); ++i) {
        (is_beside[part[i]] ? area_beside : area_apart) += mesh_.area_normal(doomed[part[i]]).norm();
        for_each_neighbor(doomed[part[i]], [&](std::uint32_t s) {
          if (fates_[s] != Fate::kGoes) return;
          const auto at = std::size_t(std::lower_bound(doomed.begin(), doomed.end(), s) - doomed.begin());
          if (is_visited[at]) return;
          is_visited[at] = 1;
          part.push_back(at);
        });
      }
      if (area_beside <= area_apart) continue;
      for (const std::size_t i : part)
        if (is_beside[i]) going.push_back(doomed[i]);
    }
    return going;
  }

  bool is_at_border(std::uint32_t t) const {
    const Triangle& c = mesh_.triangle(t);
    return mesh_.is_open(c[0], c[1]) || mesh_.is_open(c[1], c[2]) || mesh_.is_open(c[2], c[0]);
  }

  template <typename Visit>
  void for_each_neighbor(std::uint32_t t, const Visit& visit) const {
    const Triangle& c = mesh_.triangle(t);
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t beside = mesh_.find(c[(k + 1) % 3], c[k]);
      if (beside != kInvalidIndex) visit(beside);
    }
  }

  Eigen::Vector3f middle_of(std::uint32_t t) const {
    const Triangle& c = mesh_.triangle(t);
    return (mesh_.position(c[0]) + mesh_.position(c[1]) + mesh_.position(c[2])) / 3;
  }

  bool is_seen_through(std::uint32_t t) const {
    const Triangle& c = mesh_.triangle(t);
    const Eigen::Vector3f normal = mesh_.area_normal(t).stableNormalized().cast<float>();
    const Eigen::Vector3f middle = middle_of(t);
    const float error = std::max({error_m_[c[0]], error_m_[c[1]], error_m_[c[2]]});
    const ViewCount count = witnesses_.count(witnesses_.find_views(middle, 0), middle, normal, error);
    return count.empty >= kFewestViews && count.empty > count.surface;
  }

  LiveMesh& mesh_;
  const TriangleCheck& check_;
  const Witnesses& witnesses_;
  std::span<const float> error_m_;
  float reach_m_;
  std::vector<Fate> fates_;
};

}  // namespace

std::uint64_t remove_seen_through(LiveMesh& mesh, const TriangleCheck& check, const Witnesses& witnesses,
                                  std::span<const float> error_m, const OverlapOptions& options, Context& context) {
  if (!options.remove_seen_through || !(options.registration_error_m > 0)) return 0;
  return Rims(mesh, check, witnesses, error_m, options).run(context);
}

}  // namespace lapseam
