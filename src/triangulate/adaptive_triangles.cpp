// Based on: W. Evans, D. Kirkpatrick, G. Townsend, Right-Triangulated Irregular Networks, 2001.

#include "triangulate/adaptive_triangles.h"

#include <algorithm>
#include <array>

#include "core/parallel.h"

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
  Network(const Image<std::uint8_t>& is_full, const SampleDeviation& deviation, Context& context)
      : is_full_(is_full), deviation_(deviation), context_(context), must_split_(is_full.width, is_full.height, 0) {
    // Blocks without a full cell still say where the outline of their neighbours is.
    for (int v = 0; v < is_full.height; v += kBlock)
      for (int u = 0; u < is_full.width; u += kBlock)
        if (has_full_cell(u - 1, v - 1)) {
          blocks_.push_back({u, v});
          apart_[std::size_t(u / kBlock % 2 + v / kBlock % 2 * 2)].push_back({u, v});
        }
    // So do the first row and column, which no block lies before.
    for (int u = 0; u < is_full.width; ++u) must_split_.at(u, 0) = 1;
    for (int v = 0; v < is_full.height; ++v) must_split_.at(0, v) = 1;
  }

  std::vector<SampleTriangle> run() {
    static const std::vector<std::vector<RightTriangle>> levels = make_levels();
    // What a block finds out along its outline is for its neighbours as well: before the next level, and never while
    // they are at work themselves.
    for (auto level = levels.rbegin(); level != levels.rend(); ++level)
      for (const std::vector<At>& blocks : apart_)
        parallel_for(context_, blocks.size(), kGrain, [&](std::size_t i) {
          for (const RightTriangle& t : *level) measure(moved(t, blocks[i]), level == levels.rbegin());
        });
    return parallel_collect<SampleTriangle>(context_, blocks_.size(), kGrain,
                                            [&](std::size_t i, std::vector<SampleTriangle>& found) {
                                              for (const RightTriangle& t : levels.front())
                                                emit(moved(t, blocks_[i]), found);
                                            });
  }

 private:
  static constexpr std::size_t kGrain = 8;  // blocks

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
    std::uint8_t& must_split = must_split_.at(m.u, m.v);
    if (must_split) return;
    const RightTriangle first = t.first(), second = t.second();
    if (!is_in(t.a) || !is_in(t.b) || !is_in(t.c)) {
      must_split = 1;
    } else if (is_smallest) {
      must_split = !is_cell_full(first) || !is_cell_full(second);
    } else {
      const At p = first.middle(), q = second.middle();
      must_split = must_split_.at(p.u, p.v) | must_split_.at(q.u, q.v);
    }
    if (!must_split) must_split = deviation_(index(t.a), index(t.b), index(t.c), index(m)) > 1;
  }

  void emit(const RightTriangle& t, std::vector<SampleTriangle>& found) const {
    if (!t.is_divisible()) {
      if (is_cell_full(t)) found.push_back({index(t.a), index(t.b), index(t.c)});
      return;
    }
    const At m = t.middle();
    if (is_in(m) && !must_split_.at(m.u, m.v)) {
      found.push_back({index(t.a), index(t.b), index(t.c)});
      return;
    }
    if (!is_in({std::min({t.a.u, t.b.u, t.c.u}), std::min({t.a.v, t.b.v, t.c.v})})) return;
    emit(t.first(), found);
    emit(t.second(), found);
  }

  const Image<std::uint8_t>& is_full_;
  const SampleDeviation& deviation_;
  Context& context_;
  Image<std::uint8_t> must_split_;  // triangles with this sample in the middle of their hypotenuse
  std::vector<At> blocks_;
  std::array<std::vector<At>, 4> apart_;  // the same; those of each part have no side or corner in common
};

}  // namespace

std::vector<SampleTriangle> adaptive_triangles(const Image<std::uint8_t>& is_full, const SampleDeviation& deviation,
                                               Context& context) {
  return Network(is_full, deviation, context).run();
}

}  // namespace lapseam
