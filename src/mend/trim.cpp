// Based on: G. Turk, M. Levoy, Zippered Polygon Meshes from Range Images, 1994, §4 (borders lose what lies over another
// mesh).

#include "mend/trim.h"

#include <algorithm>
#include <vector>

#include "core/parallel.h"
#include "mend/living_triangles.h"

namespace lapseam {
namespace {

// Each round takes one ring; what lies over each other deeper than this was not left by sewing.
constexpr int kMostRings = 8;

class Trimmer {
 public:
  Trimmer(LiveMesh& mesh, const Layers& layers) : mesh_(mesh), layers_(layers) {}

  std::uint64_t run(Context& context) {
    std::vector<std::uint32_t> front =
        living_triangles(mesh_, context, [&](std::uint32_t t) { return is_at_border(t); });
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

  bool is_covered(std::uint32_t t) const { return layers_.is_covered(mesh_.triangle(t), Layers::Places::kMiddle); }

  // Of two that lie over each other the surer stays. Returns what borders on the removed ones.
  std::vector<std::uint32_t> remove(std::vector<std::uint32_t>& doomed, std::uint64_t& removed) {
    std::sort(doomed.begin(), doomed.end(), [&](std::uint32_t a, std::uint32_t b) {
      const bool is_seam_a = mesh_.tag(a) == TriangleTag::kSeam, is_seam_b = mesh_.tag(b) == TriangleTag::kSeam;
      if (is_seam_a != is_seam_b) return is_seam_a;
      const float error_a = layers_.error_of(mesh_.triangle(a)), error_b = layers_.error_of(mesh_.triangle(b));
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
  const Layers& layers_;
};

}  // namespace

std::uint64_t trim_double_layers(LiveMesh& mesh, const Layers& layers, Context& context) {
  return Trimmer(mesh, layers).run(context);
}

}  // namespace lapseam
