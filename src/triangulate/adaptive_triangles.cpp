// Based on: W. Evans, D. Kirkpatrick, G. Townsend, Right-Triangulated Irregular Networks, 2001.

#include "triangulate/adaptive_triangles.h"

#include <algorithm>
#include <limits>

namespace lapseam {
namespace {

constexpr int kBlock = 32;  // cells along the side of the largest square; two triangles each

struct At {
  int u, v;
};

// Hypotenuse a–b, right angle at c; turns left with up being −v.
struct RightTriangle {
  At a, b, c;
  At middle() const { return {(a.u + b.u) / 2, (a.v + b.v) / 2}; }
  // Whether the hypotenuse has a sample in its middle.
  bool is_divisible() const { return std::max(std::abs(a.u - b.u), std::abs(a.v - b.v)) > 1; }
  RightTriangle first() const { return {c, a, middle()}; }
  RightTriangle second() const { return {b, c, middle()}; }
};

// All divisible triangles of one block, by level, largest first.
std::vector<std::vector<RightTriangle>> make_levels() {
  const RightTriangle upper{{0, 0}, {kBlock, kBlock}, {kBlock, 0}}, lower{{kBlock, kBlock}, {0, 0}, {0, kBlock}};
  std::vector<std::vector<RightTriangle>> levels = {{upper, lower}};
  for (;;) {
    std::vector<RightTriangle> next;
    for (const RightTriangle& t : levels.back())
      for (const RightTriangle& child : {t.first(), t.second()})
        if (child.is_divisible()) next.push_back(child);
    if (next.empty()) return levels;
    levels.push_back(std::move(next));
  }
}

class Network {
 public:
  Network(const Image<std::uint8_t>& is_full, const SampleDeviation& deviation)
      : is_full_(is_full), deviation_(deviation), error_(is_full.width, is_full.height, 0.0f) {
    // Blocks without a full cell still say where the outline of their neighbours is.
    for (int v = 0; v < is_full.height; v += kBlock)
      for (int u = 0; u < is_full.width; u += kBlock)
        if (has_full_cell(u - 1, v - 1)) blocks_.push_back({u, v});
    // So do the first row and column, which no block lies before.
    for (int u = 0; u < is_full.width; ++u) error_.at(u, 0) = kMustSplit;
    for (int v = 0; v < is_full.height; ++v) error_.at(0, v) = kMustSplit;
  }

  std::vector<SampleTriangle> run() {
    static const std::vector<std::vector<RightTriangle>> levels = make_levels();
    for (auto level = levels.rbegin(); level != levels.rend(); ++level)
      for (const At& block : blocks_)
        for (const RightTriangle& t : *level) measure(moved(t, block), level == levels.rbegin());
    for (const At& block : blocks_)
      for (const RightTriangle& t : levels.front()) emit(moved(t, block));
    return std::move(triangles_);
  }

 private:
  static constexpr float kMustSplit = std::numeric_limits<float>::infinity();

  static RightTriangle moved(RightTriangle t, const At& by) {
    for (At* p : {&t.a, &t.b, &t.c}) p->u += by.u, p->v += by.v;
    return t;
  }

  // In the block that begins one cell after (u0, v0), or right around it.
  bool has_full_cell(int u0, int v0) const {
    for (int v = std::max(0, v0); v < std::min(v0 + kBlock + 2, is_full_.height - 1); ++v)
      for (int u = std::max(0, u0); u < std::min(u0 + kBlock + 2, is_full_.width - 1); ++u)
        if (is_full_.at(u, v)) return true;
    return false;
  }

  bool is_in(const At& p) const { return p.u < is_full_.width && p.v < is_full_.height; }
  std::uint32_t index(const At& p) const { return std::uint32_t(is_full_.index(p.u, p.v)); }

  // Of a triangle of half a cell: the cell.
  bool is_cell_full(const RightTriangle& t) const {
    const int u = std::min({t.a.u, t.b.u, t.c.u}), v = std::min({t.a.v, t.b.v, t.c.v});
    return u + 1 < is_full_.width && v + 1 < is_full_.height && is_full_.at(u, v);
  }

  void measure(const RightTriangle& t, bool is_smallest) {
    const At m = t.middle();
    if (!is_in(m)) return;
    float& error = error_.at(m.u, m.v);
    if (error == kMustSplit) return;
    const RightTriangle first = t.first(), second = t.second();
    if (!is_in(t.a) || !is_in(t.b) || !is_in(t.c)) {
      error = kMustSplit;
    } else if (is_smallest) {
      if (!is_cell_full(first) || !is_cell_full(second)) error = kMustSplit;
    } else {
      const At p = first.middle(), q = second.middle();
      error = std::max({error, error_.at(p.u, p.v), error_.at(q.u, q.v)});
    }
    if (error <= 1) error = std::max(error, deviation_(index(t.a), index(t.b), index(t.c), index(m)));
  }

  void emit(const RightTriangle& t) {
    if (!t.is_divisible()) {
      if (is_cell_full(t)) triangles_.push_back({index(t.a), index(t.b), index(t.c)});
      return;
    }
    const At m = t.middle();
    if (is_in(m) && error_.at(m.u, m.v) <= 1) {
      triangles_.push_back({index(t.a), index(t.b), index(t.c)});
      return;
    }
    if (!is_in({std::min({t.a.u, t.b.u, t.c.u}), std::min({t.a.v, t.b.v, t.c.v})})) return;
    emit(t.first());
    emit(t.second());
  }

  const Image<std::uint8_t>& is_full_;
  const SampleDeviation& deviation_;
  Image<float> error_;  // of the sample in the middle of a hypotenuse, and all below it
  std::vector<At> blocks_;
  std::vector<SampleTriangle> triangles_;
};

}  // namespace

std::vector<SampleTriangle> adaptive_triangles(const Image<std::uint8_t>& is_full, const SampleDeviation& deviation) {
  return Network(is_full, deviation).run();
}

}  // namespace lapseam
