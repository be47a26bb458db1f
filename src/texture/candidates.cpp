#include "texture/candidates.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

// Flatter than this an image shows a surface smeared.
constexpr float kLeastCosine = 0.1f;
// Colour from beside a jump may be that of the other side: worth e times coarser pixels, several times over.
constexpr float kFringeCost = 1.5f;
// The image that a triangle was measured with fits it best; another one has to be clearly better.
constexpr float kMeasuredBonus = 0.1f;
constexpr float kLargestCost = 12;
// From this level on a channel is overexposed: which colour is there nobody knows, and levelling cannot find out. So
// far around (white print on a dark cover is narrower, and sharp all the same), it is worth e times coarser pixels.
constexpr int kOverexposed = 250;
constexpr int kOverexposedReach_px = 4;
constexpr float kOverexposedCost = 1;
constexpr std::size_t kBlock = 64;
// Share of a cell's area that an image has to show.
constexpr float kShown = 0.98f;

/// Points of a triangle to look at: more of them the larger it is in the image.
template <typename Visit>
bool for_points(const std::array<Eigen::Vector3f, 3>& corners_m, float longest_px, float stride, const Visit& visit) {
  constexpr float kPulledIn = 0.9f;
  const int n = std::clamp(int(std::ceil(longest_px / (4 * stride))), 1, 24);
  const Eigen::Vector3f middle = (corners_m[0] + corners_m[1] + corners_m[2]) / 3;
  if (n == 1) return visit(middle);
  for (int i = 0; i <= n; ++i)
    for (int j = 0; i + j <= n; ++j) {
      const float a = float(i) / float(n), b = float(j) / float(n);
      const Eigen::Vector3f point = (1 - a - b) * corners_m[0] + a * corners_m[1] + b * corners_m[2];
      if (!visit(Eigen::Vector3f(middle + kPulledIn * (point - middle)))) return false;
    }
  return true;
}

}  // namespace

bool look_at_triangle(const std::array<Eigen::Vector3f, 3>& corners_m, const ColorCamera& camera,
                      const DepthImage& depth, TriangleSight& sight) {
  const Eigen::Vector3f middle = (corners_m[0] + corners_m[1] + corners_m[2]) / 3;
  Eigen::Vector2f pixel;
  if (!camera.project(middle, pixel)) return false;
  const Eigen::Vector3f normal = (corners_m[1] - corners_m[0]).cross(corners_m[2] - corners_m[0]);
  const float twice_area = normal.norm();
  const Eigen::Vector3f to = middle - camera.ray_origin(pixel);
  const float distance = to.norm();
  if (!(-normal.dot(to) >= kLeastCosine * twice_area * distance)) return false;
  if (!depth.is_visible(pixel, distance)) return false;
  std::array<Eigen::Vector2f, 3> corners_px;
  for (std::size_t k = 0; k < 3; ++k)
    if (!camera.project(corners_m[k], corners_px[k])) return false;
  if (camera.wraps()) unwrap(corners_px, camera.width());
  const Eigen::Vector2f ab = corners_px[1] - corners_px[0], ac = corners_px[2] - corners_px[0];
  const float twice_area_px = std::abs(ab.x() * ac.y() - ab.y() * ac.x());
  sight.density_px = twice_area > 0 ? std::sqrt(twice_area_px / twice_area) : 0;
  if (!(sight.density_px > 0) || !std::isfinite(sight.density_px)) return false;
  const float longest_px = std::max({ab.norm(), ac.norm(), (ac - ab).norm()});
  int points = 0, fringes = 0, hidden = 0;
  const bool is_seen = for_points(corners_m, longest_px, float(depth.stride), [&](const Eigen::Vector3f& point) {
    Eigen::Vector2f at;
    if (!camera.project(point, at)) return false;
    const float distance_there = (point - camera.ray_origin(at)).norm();
    if (!depth.is_visible(at, distance_there)) return false;
    ++points;
    fringes += depth.is_fringe(at);
    hidden += depth.is_hidden(at, distance_there);
    return true;
  });
  if (is_seen) sight.fringe = float(fringes) / float(points), sight.hidden = float(hidden) / float(points);
  return is_seen;
}

namespace {

/// A cell as candidates for it are judged.
class CellJudge {
 public:
  CellJudge(const Mesh& mesh, std::span<const std::uint32_t> triangles)
      : mesh_(mesh), triangles_(triangles.begin(), triangles.end()) {
    const auto area_m2 = [&](std::uint32_t i) {
      const auto c = corners_of(i);
      return 0.5f * (c[1] - c[0]).cross(c[2] - c[0]).norm();
    };
    // Largest first: where it is not seen, nothing else has to be looked at.
    std::stable_sort(triangles_.begin(), triangles_.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return area_m2(a) > area_m2(b); });
    for (const std::uint32_t i : triangles_) {
      area_m2_.push_back(area_m2(i));
      whole_m2_ += area_m2_.back();
      for (const Eigen::Vector3f& corner : corners_of(i)) box_.extend(corner);
    }
  }

  const Eigen::AlignedBox3f& box() const { return box_; }
  float area_m2() const { return whole_m2_; }

  /// density_px: mean over what is seen; hidden: share of what is not. False when too little is seen. largest_px: grows
  /// to the density of the largest triangle, if that is seen.
  bool judge(std::uint32_t view, const ColorCamera& camera, const DepthImage& depth, float& density_px, float& cost,
             float& hidden, float& largest_px) const {
    float missing = 0, seen = 0, squares = 0, fringe = 0, measured = 0, behind = 0;
    TriangleSight sight;
    for (std::size_t k = 0; k < triangles_.size(); ++k) {
      if (look_at_triangle(corners_of(triangles_[k]), camera, depth, sight)) {
        if (k == 0 && sight.hidden == 0) largest_px = std::max(largest_px, sight.density_px);
        seen += area_m2_[k];
        squares += area_m2_[k] * sight.density_px * sight.density_px;
        fringe += area_m2_[k] * sight.fringe;
        behind += area_m2_[k] * sight.hidden;
        measured += !mesh_.triangle_view.empty() && mesh_.triangle_view[triangles_[k]] == view ? area_m2_[k] : 0;
        continue;
      }
      missing += area_m2_[k];
      if (missing > (1 - kShown) * whole_m2_ || !is_inside(corners_of(triangles_[k]), camera)) return false;
    }
    if (!(seen > 0)) return false;
    density_px = std::sqrt(squares / seen);
    hidden = (missing + behind) / whole_m2_;
    cost =
        (kFringeCost * fringe - kMeasuredBonus * measured) / whole_m2_ + kLargestCost * hidden - std::log(density_px);
    return true;
  }

 private:
  std::array<Eigen::Vector3f, 3> corners_of(std::uint32_t i) const {
    const Triangle& t = mesh_.triangles[i];
    return {mesh_.positions_m[t[0]], mesh_.positions_m[t[1]], mesh_.positions_m[t[2]]};
  }
  static bool is_inside(const std::array<Eigen::Vector3f, 3>& corners_m, const ColorCamera& camera) {
    Eigen::Vector2f pixel;
    return std::all_of(corners_m.begin(), corners_m.end(),
                       [&](const Eigen::Vector3f& corner) { return camera.project(corner, pixel); });
  }

  const Mesh& mesh_;
  std::vector<std::uint32_t> triangles_;
  std::vector<float> area_m2_;
  float whole_m2_ = 0;
  Eigen::AlignedBox3f box_;
};

}  // namespace

Candidates find_candidates(const Mesh& mesh, const Cells& cells, const ColorCameras& cameras,
                           std::span<const DepthImage> depths, std::span<const float> blur, Context& context) {
  Candidates out;
  out.density_px.assign(cells.count(), 0);
  out.area_px.assign(cells.count(), 0);
  out.hidden.assign(cells.count(), 1);
  out.largest_px.assign(cells.count(), 0);
  std::vector<std::vector<Candidate>> of_cell(cells.count());
  parallel_for(context, cells.count(), kBlock, [&](std::size_t c) {
    const CellJudge cell(mesh, cells.of(c));
    std::vector<Candidate> list;
    for (std::uint32_t v = 0; v < cameras.size(); ++v) {
      float density_px = 0, cost = 0, hidden = 0;
      if (!cameras[v] || !cameras[v]->may_see(cell.box().center(), 0.5f * cell.box().diagonal().norm())) continue;
      if (!cell.judge(v, *cameras[v], depths[v], density_px, cost, hidden, out.largest_px[c])) continue;
      out.hidden[c] = std::min(out.hidden[c], hidden);
      list.push_back({v, blur[v] + cost, {}});
      out.density_px[c] = std::max(out.density_px[c], density_px);
    }
    out.area_px[c] = cell.area_m2() * out.density_px[c] * out.density_px[c];
    std::sort(list.begin(), list.end(), [](const Candidate& a, const Candidate& b) {
      return a.cost != b.cost ? a.cost < b.cost : a.view < b.view;
    });
    if (list.size() > kMostCandidates) list.resize(kMostCandidates);
    for (std::size_t k = list.size(); k-- > 0;) list[k].cost = std::min(list[k].cost - list[0].cost, kLargestCost);
    std::sort(list.begin(), list.end(), [](const Candidate& a, const Candidate& b) { return a.view < b.view; });
    list.shrink_to_fit();
    of_cell[c] = std::move(list);
  });
  out.begin.push_back(0);
  for (std::vector<Candidate>& list : of_cell) {
    out.all.insert(out.all.end(), list.begin(), list.end());
    out.begin.push_back(out.all.size());
    list = {};
  }
  return out;
}

namespace {

bool is_overexposed(const ColorImage& image, int u, int v) {
  constexpr int kReach = kOverexposedReach_px;
  constexpr std::array<std::array<int, 2>, 5> kAround = {
      {{0, 0}, {-kReach, 0}, {kReach, 0}, {0, -kReach}, {0, kReach}}};
  return std::all_of(kAround.begin(), kAround.end(), [&](const std::array<int, 2>& away) {
    const Rgb8 c = image.at(std::clamp(u + away[0], 0, image.width - 1), std::clamp(v + away[1], 0, image.height - 1));
    return std::max({c.r, c.g, c.b}) >= kOverexposed;
  });
}

}  // namespace

void sample_colors(const Mesh& mesh, const Cells& cells, std::span<const ViewSource> sources,
                   const ColorCameras& cameras, std::span<const ColorResponse> responses, Candidates& candidates,
                   Context& context) {
  struct Place {
    std::uint32_t cell;
    std::uint64_t candidate;
  };
  std::vector<std::vector<Place>> places_of_view(sources.size());
  for (std::uint32_t i = 0; i < cells.count(); ++i)
    for (std::uint64_t k = candidates.begin[i]; k < candidates.begin[i + 1]; ++k)
      places_of_view[candidates.all[k].view].push_back({i, k});
  parallel_for(context, sources.size(), 1, [&](std::size_t view) {
    if (places_of_view[view].empty()) return;
    const ColorImage image = load_color(sources[view]);
    for (const auto& [cell, candidate] : places_of_view[view]) {
      const Triangle& t = mesh.triangles[cells.of(cell).front()];
      Eigen::Vector2f pixel;
      if (!cameras[view]->project((mesh.positions_m[t[0]] + mesh.positions_m[t[1]] + mesh.positions_m[t[2]]) / 3,
                                  pixel))
        continue;
      const int u = std::clamp(int(std::lround(pixel.x())), 0, image.width - 1);
      const int v = std::clamp(int(std::lround(pixel.y())), 0, image.height - 1);
      const Rgb8 c = image.at(u, v);
      if (is_overexposed(image, u, v)) candidates.all[candidate].cost += kOverexposedCost;
      const Eigen::Vector3f color = Eigen::Vector3f(float(c.r), float(c.g), float(c.b))
                                        .cwiseProduct(responses[view].factor(cameras[view]->squared_radius(pixel)))
                                        .cwiseMin(255.0f);
      candidates.all[candidate].color = {std::uint8_t(color.x()), std::uint8_t(color.y()), std::uint8_t(color.z())};
    }
  });
}

}  // namespace lapseam
