#include "texture/foreign_colors.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace lapseam {
namespace {

constexpr std::array<std::pair<int, int>, 4> kFourBeside = {{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};
// Colours of two surfaces that are no farther apart are one: noise, and shading along a surface.
constexpr float kLeastContrast = 24;
// What lies behind is farther away by so much, as a share of the distance.
constexpr float kBehind = 0.02f;
constexpr float kErrors = 2;

class ForeignColors {
 public:
  ForeignColors(const ColorImage& image, bool wraps, double error_m, DepthImage& depth)
      : depth_(depth), wraps_(wraps), error_m_(float(error_m)), colors_(width(), height()) {
    for (int v = 0; v < height(); ++v)
      for (int u = 0; u < width(); ++u) colors_.at(u, v) = mean_of(image, u, v);
  }

  void run() {
    find_band();
    carry_own_colors();
    spread();
    for (std::size_t i = 0; i < is_foreign_.pixels.size(); ++i)
      if (is_foreign_.pixels[i]) depth_.is_near_step.pixels[i] = DepthImage::kForeign;
  }

 private:
  using Cell = std::pair<int, int>;

  int width() const { return depth_.distance_m.width; }
  int height() const { return depth_.distance_m.height; }
  bool is_fringe(int u, int v) const { return depth_.is_near_step.at(u, v) != 0; }
  float distance(int u, int v) const { return depth_.distance_m.at(u, v); }

  Eigen::Vector3f mean_of(const ColorImage& image, int u, int v) const {
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    float count = 0;
    const int s = depth_.stride;
    for (int y = v * s; y < std::min((v + 1) * s, image.height); ++y)
      for (int x = u * s; x < std::min((u + 1) * s, image.width); ++x, ++count)
        sum += Eigen::Vector3f(image.at(x, y).r, image.at(x, y).g, image.at(x, y).b);
    return sum / std::max(count, 1.0f);
  }

  /// visit(u, v) for a cell's neighbours.
  template <typename Visit>
  void for_beside(const Cell& cell, const Visit& visit) const {
    for (const auto& [du, dv] : kFourBeside) {
      int u = cell.first + du;
      const int v = cell.second + dv;
      if (wraps_) u = (u + width()) % width();
      if (u >= 0 && v >= 0 && u < width() && v < height()) visit(u, v);
    }
  }

  /// How many cells a surface may be beside its place there.
  int reach(int u, int v) const {
    const float d = distance(u, v);
    if (!(d > 0) || std::isinf(d) || !(depth_.angle_rad > 0)) return 0;
    const float px = std::min(kErrors * error_m_ / (depth_.angle_rad * d), kMostDisplacement_px);
    return int(std::ceil(px / float(depth_.stride)));
  }

  /// Steps from the fringe: of cells within reach of one.
  void find_band() {
    steps_ = Image<std::uint8_t>(width(), height(), kFar);
    std::vector<Cell> front, next;
    for (int v = 0; v < height(); ++v)
      for (int u = 0; u < width(); ++u)
        if (is_fringe(u, v)) steps_.at(u, v) = 0, front.emplace_back(u, v);
    for (int step = 1; !front.empty(); ++step, std::swap(front, next)) {
      next.clear();
      for (const Cell& cell : front)
        for_beside(cell, [&](int u, int v) {
          if (steps_.at(u, v) != kFar || step > reach(u, v)) return;
          steps_.at(u, v) = std::uint8_t(step);
          next.emplace_back(u, v);
          if (step == 1) rim_.emplace_back(u, v);
        });
    }
  }

  /// Outwards from what lies farther in than the band, on the same side: no path passes a fringe.
  void carry_own_colors() {
    own_ = Image<Eigen::Vector3f>(width(), height(), Eigen::Vector3f::Constant(-1));
    std::vector<Cell> front, next;
    for (int v = 0; v < height(); ++v)
      for (int u = 0; u < width(); ++u)
        if (steps_.at(u, v) == kFar) own_.at(u, v) = colors_.at(u, v), front.emplace_back(u, v);
    for (; !front.empty(); std::swap(front, next)) {
      next.clear();
      for (const Cell& cell : front)
        for_beside(cell, [&](int u, int v) {
          if (steps_.at(u, v) == 0 || own_.at(u, v).x() >= 0) return;
          own_.at(u, v) = own_.at(cell.first, cell.second);
          next.emplace_back(u, v);
        });
    }
  }

  /// The mean colour of what lies behind the jump beside a cell at the rim of a fringe. False where nothing does.
  bool look_behind(const Cell& cell, Eigen::Vector3f& color) const {
    const int radius = depth_.fringe_px / depth_.stride + 2;
    const float here = distance(cell.first, cell.second);
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    float count = 0;
    for (int dv = -radius; dv <= radius; ++dv)
      for (int du = -radius; du <= radius; ++du) {
        int u = cell.first + du;
        const int v = cell.second + dv;
        if (wraps_) u = (u + width()) % width();
        if (u < 0 || v < 0 || u >= width() || v >= height() || is_fringe(u, v)) continue;
        const float there = distance(u, v);
        if (std::isinf(there) || !(there > here * (1 + kBehind))) continue;
        sum += colors_.at(u, v);
        ++count;
      }
    color = sum / std::max(count, 1.0f);
    return count > 0;
  }

  /// From the fringe inwards, as long as colours are those from behind.
  void spread() {
    is_foreign_ = Image<std::uint8_t>(width(), height());
    Image<Eigen::Vector3f> other(width(), height(), Eigen::Vector3f::Zero());
    std::vector<Cell> front, next;
    const auto is_foreign = [&](int u, int v, const Eigen::Vector3f& behind) {
      const Eigen::Vector3f& own = own_.at(u, v);
      return own.x() >= 0 && (own - behind).norm() > kLeastContrast &&
             (colors_.at(u, v) - behind).norm() < (colors_.at(u, v) - own).norm();
    };
    const auto take = [&](int u, int v, const Eigen::Vector3f& behind) {
      if (is_foreign_.at(u, v) || steps_.at(u, v) == 0 || steps_.at(u, v) == kFar || !is_foreign(u, v, behind)) return;
      is_foreign_.at(u, v) = 1;
      other.at(u, v) = behind;
      next.emplace_back(u, v);
    };
    Eigen::Vector3f behind;
    for (const Cell& cell : rim_)
      if (look_behind(cell, behind)) take(cell.first, cell.second, behind);
    while (!next.empty()) {
      std::swap(front, next);
      next.clear();
      for (const Cell& cell : front)
        for_beside(cell, [&](int u, int v) { take(u, v, other.at(cell.first, cell.second)); });
    }
  }

  static constexpr std::uint8_t kFar = 255;

  DepthImage& depth_;
  bool wraps_;
  float error_m_;
  Image<Eigen::Vector3f> colors_;
  Image<std::uint8_t> steps_;
  Image<Eigen::Vector3f> own_;
  Image<std::uint8_t> is_foreign_;
  std::vector<Cell> rim_;
};

}  // namespace

void mark_foreign_colors(const ColorImage& image, bool wraps, double error_m, DepthImage& depth) {
  if (!depth.is_near_step.pixels.empty()) ForeignColors(image, wraps, error_m, depth).run();
}

}  // namespace lapseam
