// Based on: V. Lempitsky, D. Ivanov, Seamless Mosaicing of Image-Based Texture Maps, 2007, and M. Waechter, N. Moehrle,
// M. Goesele, Let There Be Color!, 2014. The offsets live on a grid in each chart instead of on the mesh's vertices:
// the same for small triangles and for large ones, and far fewer unknowns.

#include "texture/level.h"

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/Sparse>
#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "texture/stretch.h"

namespace lapseam {
namespace {

constexpr int kNode_px = 2 * kBlock_px;  // between the nodes of the offset's grid
// What a difference between neighbouring nodes weighs against a step that is left at one place of a border.
constexpr double kSmoothness = 40;
// Of each node, against offsets that are not needed.
// Half of a border sample's weight: a
// border moves the colours of its surroundings, and charts far from any keep theirs. Weaker, false differences of
// misplaced views add up over many charts, which costs half a decibel in views held out.
constexpr double kOffsetPrior = 0.5;
constexpr int kRounds = 3;  // of reweighting
// Steps far beyond the usual ones are rather an edge of the picture that lies elsewhere in the other image; so many
// levels are usual in any case.
constexpr double kUsualStep = 1.5;
constexpr float kSampleSpacing_px = 1;
// What is left of steps is mostly edges of the picture that are misplaced: they are not to be spread far.
constexpr int kFalloff_px = 2;
constexpr int kLocalRounds = 12;

/// Bilinear weights of the four pixels around a place.
struct Footprint {
  std::array<std::uint32_t, 4> slot;
  std::array<float, 4> weight;
};

struct Place {
  std::uint32_t chart, part;  // part: of all charts
  Eigen::Vector2f at;         // pixel of the chart
};

struct SeamSample {
  std::array<Place, 2> side;
  std::array<Footprint, 2> pixels;
  Eigen::Vector3f step;  // what the second side is brighter

  bool is_inner() const { return side[0].chart == side[1].chart; }
};

/// A side of a sample within a chart.
struct InnerSide {
  std::uint32_t sample, side;
  Eigen::Vector3f point_m;
};

/// A side of a sample in a triangle that may lie over surface it is not beside.
struct SlenderSide {
  std::uint32_t sample;
  Eigen::Vector2f at;
  Eigen::Vector3f point_m;
};

struct Cell {
  int x, y;
  float fx, fy;
};
Cell cell_of(const Eigen::Vector2f& at, float size_px, int columns, int rows) {
  const float x = std::clamp(at.x() / size_px, 0.0f, float(columns - 1));
  const float y = std::clamp(at.y() / size_px, 0.0f, float(rows - 1));
  const int x0 = std::min(int(x), std::max(columns - 2, 0)), y0 = std::min(int(y), std::max(rows - 2, 0));
  return {x0, y0, x - float(x0), y - float(y0)};
}

std::array<float, 4> bilinear(const Cell& c) {
  return {(1 - c.fx) * (1 - c.fy), c.fx * (1 - c.fy), (1 - c.fx) * c.fy, c.fx * c.fy};
}

/// The grid of one part: nodes at multiples of kNode_px in its chart, those around which it has no pixel left out.
struct NodeGrid {
  int columns = 0, rows = 0;
  std::vector<std::uint32_t> node;  // kInvalidIndex: left out
};

Levelling::Steps quantiles(std::vector<double> steps) {
  if (steps.empty()) return {};
  std::sort(steps.begin(), steps.end());
  return {steps[steps.size() / 2], steps[steps.size() * 95 / 100]};
}

}  // namespace

struct Levelling::Impl {
  const Mesh& mesh;
  const Charts& charts;
  const std::vector<ColorImage>* pages = nullptr;
  const std::vector<PartMap>* map = nullptr;
  std::vector<std::uint32_t> first_part;  // of each chart, among those of all
  std::vector<NodeGrid> grids;            // of each part
  std::size_t node_count = 0;
  std::vector<SeamSample> samples;
  std::vector<std::vector<InnerSide>> inner_sides;      // of each view
  std::vector<std::vector<SlenderSide>> slender_sides;  // of each chart
  std::vector<std::array<Eigen::Vector3f, 2>> inner_colors;
  std::vector<Eigen::Vector3f> offset;    // of each node
  std::vector<std::uint64_t> slot_pixel;  // chart << 32 | pixel of the chart, sorted
  std::vector<Eigen::Vector3f> slot_value;
  Steps before, after, inner_before, inner_after;

  Impl(const Mesh& m, const Charts& all, const std::vector<SharedEdge>& edges) : mesh(m), charts(all) {
    std::uint32_t parts = 0;
    for (const Chart& chart : charts.charts) {
      first_part.push_back(parts);
      parts += std::uint32_t(chart.parts.size());
    }
    find_samples(edges);
    // Not known yet.
    inner_colors.assign(samples.size(), {Eigen::Vector3f::Constant(-1), Eigen::Vector3f::Constant(-1)});
  }

  void solve(Context& context) {
    parallel_for(context, samples.size(), 4096, [&](std::size_t i) { measure(i); });
    drop_misplaced(context);
    inner_colors.clear();
    drop_unknown();
    make_grids();
    const auto before_of = [](const SeamSample& sample) { return sample.step; };
    const auto is_inner = [](const SeamSample& sample) { return sample.is_inner(); };
    const auto is_any = [&](const SeamSample& sample) { return view_of(sample.side[0]) != view_of(sample.side[1]); };
    before = steps_of(before_of, is_any), inner_before = steps_of(before_of, is_inner);
    solve_offsets(context);
    spread_rest(context);
    const auto after_of = [&](const SeamSample& sample) {
      return Eigen::Vector3f(rest_of(sample) + local_at(sample.pixels[1]) - local_at(sample.pixels[0]));
    };
    after = steps_of(after_of, is_any), inner_after = steps_of(after_of, is_inner);
  }

  std::uint32_t view_of(const Place& place) const {
    return charts.charts[place.chart].parts[place.part - first_part[place.chart]];
  }

  template <typename StepOf, typename IsWanted>
  Steps steps_of(const StepOf& step_of, const IsWanted& is_wanted) const {
    std::vector<double> steps;
    for (const SeamSample& sample : samples)
      if (is_wanted(sample)) steps.push_back(double(step_of(sample).norm()) / std::sqrt(3.0));
    return quantiles(std::move(steps));
  }

  /// Mark of a chart's pixel.
  std::uint16_t mark_at(const Chart& chart, int x, int y) const {
    return chart.pixel((*map)[std::size_t(chart.place.page)], x, y);
  }

  // ---- samples

  void find_samples(const std::vector<SharedEdge>& edges) {
    std::uint32_t views = 0;
    for (const std::uint32_t view : charts.view_of_triangle)
      if (view != kInvalidIndex) views = std::max(views, view + 1);
    inner_sides.resize(views);
    slender_sides.resize(charts.charts.size());
    const auto part = [&](std::uint32_t i) {
      return first_part[charts.chart_of_triangle[i]] + charts.part_of_triangle[i];
    };
    for (const SharedEdge& edge : edges) {
      const std::uint32_t a = charts.chart_of_triangle[edge.a], b = charts.chart_of_triangle[edge.b];
      if (a == kInvalidIndex || b == kInvalidIndex || part(edge.a) == part(edge.b)) continue;
      const auto &pa = charts.pixels[edge.a], &pb = charts.pixels[edge.b];
      const std::size_t a0 = edge.corner_a, a1 = (a0 + 1) % 3;
      std::size_t b0 = edge.corner_b, b1 = (b0 + 1) % 3;
      if (mesh.triangles[edge.b][b0] != mesh.triangles[edge.a][a0]) std::swap(b0, b1);
      const Eigen::Vector3f from_m = mesh.positions_m[mesh.triangles[edge.a][a0]];
      const Eigen::Vector3f along_m = mesh.positions_m[mesh.triangles[edge.a][a1]] - from_m;
      const float length_px = std::max((pa[a1] - pa[a0]).norm(), (pb[b1] - pb[b0]).norm());
      const int count = std::max(1, int(std::ceil(length_px / kSampleSpacing_px)));
      for (int k = 0; k < count; ++k) {
        const float t = (float(k) + 0.5f) / float(count);
        const auto number = std::uint32_t(samples.size());
        samples.push_back({{Place{a, part(edge.a), pa[a0] + t * (pa[a1] - pa[a0])},
                            Place{b, part(edge.b), pb[b0] + t * (pb[b1] - pb[b0])}},
                           {},
                           Eigen::Vector3f::Zero()});
        add_slender(number, edge.a, a, samples.back().side[0].at, from_m + t * along_m);
        add_slender(number, edge.b, b, samples.back().side[1].at, from_m + t * along_m);
        if (a != b) continue;
        inner_sides[charts.view_of_triangle[edge.a]].push_back({number, 0, from_m + t * along_m});
        inner_sides[charts.view_of_triangle[edge.b]].push_back({number, 1, from_m + t * along_m});
      }
    }
  }

  void add_slender(std::uint32_t sample, std::uint32_t triangle, std::uint32_t chart, const Eigen::Vector2f& at,
                   const Eigen::Vector3f& point_m) {
    if (is_slender(charts.pixels[triangle])) slender_sides[chart].push_back({sample, at, point_m});
  }

  /// Samples at slivers that lie over other surface: the page shows that there, and it is not what has to be levelled.
  void drop_misplaced(Context& context) {
    constexpr float kSameSurface_px = 8;
    std::vector<std::vector<std::uint32_t>> dropped(charts.charts.size());
    parallel_for(context, charts.charts.size(), 1, [&](std::size_t c) {
      if (slender_sides[c].empty()) return;
      const Chart& chart = charts.charts[c];
      Image<std::uint32_t> shown(chart.shape.width * kBlock_px, chart.shape.height * kBlock_px, kInvalidIndex);
      for (const std::uint32_t i : chart.triangles)
        if (!is_slender(charts.pixels[i]))
          for_pixels(charts.pixels[i], 0, [&](int x, int y, float, float) { shown.at(x, y) = i; });
      for (const SlenderSide& side : slender_sides[c]) {
        const int x = std::clamp(int(std::lround(side.at.x())), 0, shown.width - 1);
        const int y = std::clamp(int(std::lround(side.at.y())), 0, shown.height - 1);
        const std::uint32_t i = shown.at(x, y);
        if (i == kInvalidIndex) continue;
        if (distance_px(i, side) > kSameSurface_px) dropped[c].push_back(side.sample);
      }
    });
    for (const std::vector<std::uint32_t>& some : dropped)
      for (const std::uint32_t i : some) samples[i].side[0].part = samples[i].side[1].part;  // see drop_unknown
    slender_sides.clear();
  }

  /// Between a point and what a triangle's plane shows at its pixel, in pixels of the triangle.
  float distance_px(std::uint32_t i, const SlenderSide& side) const {
    const Corners& p = charts.pixels[i];
    const Triangle& t = mesh.triangles[i];
    const Eigen::Vector2f ab = p[1] - p[0], ac = p[2] - p[0], ap = side.at - p[0];
    const Eigen::Vector3f ab_m = mesh.positions_m[t[1]] - mesh.positions_m[t[0]];
    const Eigen::Vector3f ac_m = mesh.positions_m[t[2]] - mesh.positions_m[t[0]];
    const float area = ab.x() * ac.y() - ab.y() * ac.x();
    const float b1 = (ap.x() * ac.y() - ap.y() * ac.x()) / area, b2 = (ab.x() * ap.y() - ab.y() * ap.x()) / area;
    const float pixel_m = std::sqrt(ab_m.cross(ac_m).norm() / std::abs(area));
    return (mesh.positions_m[t[0]] + b1 * ab_m + b2 * ac_m - side.point_m).norm() / std::max(pixel_m, 1e-12f);
  }

  /// Where a jump of depth is near, the page shows something else, or what an image shows is not the surface.
  void look(std::uint32_t view, const Photograph& photograph) {
    if (view >= inner_sides.size()) return;
    for (const InnerSide& inner : inner_sides[view]) {
      Eigen::Vector2f pixel;
      if (!photograph.camera.project(inner.point_m, pixel) || photograph.depth.is_fringe(pixel) ||
          photograph.depth.is_hidden(pixel, (inner.point_m - photograph.camera.ray_origin(pixel)).norm()))
        continue;
      const Chart& chart = charts.charts[samples[inner.sample].side[0].chart];
      inner_colors[inner.sample][inner.side] = photograph.color_at(pixel, 1 / chart.scale);
    }
  }

  void measure(std::size_t i) {
    SeamSample& sample = samples[i];
    if (!sample.is_inner()) {
      sample.step = color_at(sample.side[1]) - color_at(sample.side[0]);
    } else if (inner_colors[i][0].x() < 0 || inner_colors[i][1].x() < 0) {
      sample.side[0].part = sample.side[1].part;  // see drop_unknown
    } else {
      sample.step = inner_colors[i][1] - inner_colors[i][0];
    }
  }

  void drop_unknown() {
    samples.erase(std::remove_if(samples.begin(), samples.end(),
                                 [](const SeamSample& sample) { return sample.side[0].part == sample.side[1].part; }),
                  samples.end());
  }

  Eigen::Vector3f color_at(const Place& place) const {
    const Chart& chart = charts.charts[place.chart];
    const ColorImage& page = (*pages)[std::size_t(chart.place.page)];
    const Cell c = cell_of(place.at, 1, chart.shape.width * kBlock_px, chart.shape.height * kBlock_px);
    const std::array<float, 4> weights = bilinear(c);
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    for (std::size_t k = 0; k < 4; ++k) {
      const Rgb8 p = chart.pixel(page, c.x + int(k % 2), c.y + int(k / 2));
      sum += weights[k] * Eigen::Vector3f(float(p.r), float(p.g), float(p.b));
    }
    return sum;
  }

  // ---- the slow part

  void make_grids() {
    for (const Chart& chart : charts.charts)
      for (std::size_t part = 0; part < chart.parts.size(); ++part) {
        NodeGrid& grid = grids.emplace_back();
        grid.columns = (chart.shape.width * kBlock_px + kNode_px - 1) / kNode_px + 1;
        grid.rows = (chart.shape.height * kBlock_px + kNode_px - 1) / kNode_px + 1;
        grid.node.assign(std::size_t(grid.columns) * std::size_t(grid.rows), kInvalidIndex);
      }
    const auto want = [&](std::uint32_t part, int column, int row) {
      NodeGrid& grid = grids[part];
      for (const int dy : {0, 1})
        for (const int dx : {0, 1})
          grid.node[std::size_t(row + dy) * std::size_t(grid.columns) + std::size_t(column + dx)] = 0;
    };
    for (std::size_t c = 0; c < charts.charts.size(); ++c) {
      const Chart& chart = charts.charts[c];
      for (int y = 0; y < chart.shape.height * kBlock_px; ++y)
        for (int x = 0; x < chart.shape.width * kBlock_px; ++x)
          if (chart.owns(x, y) && mark_at(chart, x, y) != 0)
            want(first_part[c] + std::uint32_t(part_of(mark_at(chart, x, y))), x / kNode_px, y / kNode_px);
    }
    for (const SeamSample& sample : samples)
      for (const Place& place : sample.side) {
        const NodeGrid& grid = grids[place.part];
        const Cell cell = cell_of(place.at, float(kNode_px), grid.columns, grid.rows);
        want(place.part, cell.x, cell.y);
      }
    for (NodeGrid& grid : grids)
      for (std::uint32_t& node : grid.node)
        if (node != kInvalidIndex) node = std::uint32_t(node_count++);
  }

  /// Nodes around a place, and their weights.
  std::array<std::pair<std::uint32_t, float>, 4> nodes_at(const Place& place) const {
    const NodeGrid& grid = grids[place.part];
    const Cell c = cell_of(place.at, float(kNode_px), grid.columns, grid.rows);
    const std::array<float, 4> weights = bilinear(c);
    std::array<std::pair<std::uint32_t, float>, 4> out;
    for (std::size_t k = 0; k < 4; ++k)
      out[k] = {grid.node[std::size_t(c.y + int(k / 2)) * std::size_t(grid.columns) + std::size_t(c.x + int(k % 2))],
                weights[k]};
    return out;
  }

  Eigen::Vector3f offset_at(const Place& place) const {
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    for (const auto& [node, weight] : nodes_at(place))
      if (node != kInvalidIndex) sum += weight * offset[node];
    return sum;
  }

  void solve_offsets(Context& context) {
    offset.assign(node_count, Eigen::Vector3f::Zero());
    if (samples.empty()) return;
    sort_by_nodes();
    const auto n = Eigen::Index(node_count);
    std::vector<double> weight(samples.size(), 1);
    // Conjugate gradients: well conditioned by the prior, and many times faster here than factorization.
    Eigen::ConjugateGradient<Eigen::SparseMatrix<double, Eigen::RowMajor>, Eigen::Lower | Eigen::Upper> solver;
    solver.setTolerance(1e-4);
    Eigen::MatrixX3d x = Eigen::MatrixX3d::Zero(n, 3);
    for (int round = 0; round < kRounds; ++round) {
      context.throw_if_cancelled();
      Eigen::MatrixX3d right = Eigen::MatrixX3d::Zero(n, 3);
      std::vector<Eigen::Triplet<double>> entries = smoothness();
      add_samples(weight, entries, right);
      Eigen::SparseMatrix<double, Eigen::RowMajor> matrix(n, n);
      matrix.setFromTriplets(entries.begin(), entries.end());
      solver.compute(matrix);
      x = solver.solveWithGuess(right, x);
      for (Eigen::Index k = 0; k < n; ++k) offset[std::size_t(k)] = x.row(k).transpose().cast<float>();
      reweight(weight);
    }
  }

  std::vector<Eigen::Triplet<double>> smoothness() const {
    std::vector<Eigen::Triplet<double>> entries;
    const auto add = [&](std::uint32_t p, std::uint32_t q, double value) {
      entries.emplace_back(int(p), int(q), value);
    };
    for (const NodeGrid& grid : grids)
      for (int y = 0; y < grid.rows; ++y)
        for (int x = 0; x < grid.columns; ++x) {
          const auto at = [&](int u, int v) {
            return u < grid.columns && v < grid.rows
                       ? grid.node[std::size_t(v) * std::size_t(grid.columns) + std::size_t(u)]
                       : kInvalidIndex;
          };
          const std::uint32_t p = at(x, y);
          if (p == kInvalidIndex) continue;
          add(p, p, kOffsetPrior);
          for (const std::uint32_t q : {at(x + 1, y), at(x, y + 1)}) {
            if (q == kInvalidIndex) continue;
            add(p, p, kSmoothness);
            add(q, q, kSmoothness);
            add(p, q, -kSmoothness);
            add(q, p, -kSmoothness);
          }
        }
    return entries;
  }

  using Terms = std::array<std::pair<std::uint32_t, double>, 8>;

  /// offset(second side) − offset(first side).
  Terms terms_of(const SeamSample& sample) const {
    Terms terms;
    for (std::size_t side = 0; side < 2; ++side) {
      const auto nodes = nodes_at(sample.side[side]);
      for (std::size_t k = 0; k < 4; ++k)
        terms[4 * side + k] = {nodes[k].first, (side == 0 ? -1.0 : 1.0) * double(nodes[k].second)};
    }
    return terms;
  }

  /// So that samples with the same nodes follow each other, and go into the matrix as one.
  void sort_by_nodes() {
    const auto cell = [&](const Place& place) {
      const NodeGrid& grid = grids[place.part];
      const Cell c = cell_of(place.at, float(kNode_px), grid.columns, grid.rows);
      return std::array<std::uint32_t, 2>{place.part, std::uint32_t(c.y * grid.columns + c.x)};
    };
    std::vector<std::pair<std::array<std::uint32_t, 4>, std::uint32_t>> keys;
    for (std::uint32_t i = 0; i < samples.size(); ++i) {
      const auto a = cell(samples[i].side[0]), b = cell(samples[i].side[1]);
      keys.push_back({{a[0], a[1], b[0], b[1]}, i});
    }
    std::sort(keys.begin(), keys.end());
    std::vector<SeamSample> sorted;
    sorted.reserve(samples.size());
    for (const auto& [key, i] : keys) sorted.push_back(samples[i]);
    samples = std::move(sorted);
  }

  /// offset(second side) − offset(first side) should be −step.
  void add_samples(const std::vector<double>& weight, std::vector<Eigen::Triplet<double>>& entries,
                   Eigen::MatrixX3d& right) const {
    Eigen::Matrix<double, 8, 8> sum;
    for (std::size_t begin = 0, end = 0; begin < samples.size(); begin = end) {
      const Terms first = terms_of(samples[begin]);
      sum.setZero();
      for (end = begin; end < samples.size(); ++end) {
        const Terms terms = terms_of(samples[end]);
        Eigen::Matrix<double, 8, 1> x;
        bool is_same = true;
        for (std::size_t k = 0; k < 8; ++k) {
          x[Eigen::Index(k)] = terms[k].second;
          is_same = is_same && terms[k].first == first[k].first;
        }
        if (!is_same) break;
        sum += weight[end] * x * x.transpose();
        for (std::size_t k = 0; k < 8; ++k)
          if (terms[k].first != kInvalidIndex)
            right.row(Eigen::Index(terms[k].first)) -=
                weight[end] * terms[k].second * samples[end].step.cast<double>().transpose();
      }
      for (std::size_t p = 0; p < 8; ++p)
        for (std::size_t q = 0; q < 8; ++q)
          if (first[p].first != kInvalidIndex && first[q].first != kInvalidIndex)
            entries.emplace_back(int(first[p].first), int(first[q].first), sum(Eigen::Index(p), Eigen::Index(q)));
    }
  }

  /// Cauchy weights; the scale is that of the middle step that is left.
  void reweight(std::vector<double>& weight) const {
    std::vector<double> rest(samples.size());
    for (std::size_t i = 0; i < samples.size(); ++i) rest[i] = double(rest_of(samples[i]).norm()) / std::sqrt(3.0);
    std::vector<double> sorted = rest;
    const auto middle = sorted.begin() + std::ptrdiff_t(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const double scale = std::max(*middle, kUsualStep);
    for (std::size_t i = 0; i < samples.size(); ++i) weight[i] = 1 / (1 + rest[i] * rest[i] / (scale * scale));
  }

  Eigen::Vector3f rest_of(const SeamSample& sample) const {
    return sample.step + offset_at(sample.side[1]) - offset_at(sample.side[0]);
  }

  // ---- the rest, at the borders

  std::uint64_t key(std::uint32_t chart, int x, int y) const {
    const auto width = std::uint64_t(charts.charts[chart].shape.width * kBlock_px);
    return std::uint64_t(chart) << 32 | (std::uint64_t(y) * width + std::uint64_t(x));
  }

  void spread_rest(Context& context) {
    std::vector<std::array<std::uint64_t, 8>> keys(samples.size());
    parallel_for(context, samples.size(), 4096, [&](std::size_t i) {
      for (std::size_t side = 0; side < 2; ++side) {
        const Place& place = samples[i].side[side];
        const Chart& chart = charts.charts[place.chart];
        const Cell c = cell_of(place.at, 1, chart.shape.width * kBlock_px, chart.shape.height * kBlock_px);
        samples[i].pixels[side].weight = weights_of(samples[i], side, c);
        for (std::size_t k = 0; k < 4; ++k)
          keys[i][4 * side + k] = key(place.chart, c.x + int(k % 2), c.y + int(k / 2));
      }
    });
    for (std::size_t i = 0; i < samples.size(); ++i)
      for (std::size_t k = 0; k < 8; ++k)
        if (samples[i].pixels[k / 4].weight[k % 4] > 0) slot_pixel.push_back(keys[i][k]);
    parallel_sort(context, slot_pixel.begin(), slot_pixel.end(), std::less<>());
    slot_pixel.erase(std::unique(slot_pixel.begin(), slot_pixel.end()), slot_pixel.end());
    parallel_for(context, samples.size(), 4096, [&](std::size_t i) {
      for (std::size_t k = 0; k < 8; ++k) {
        Footprint& pixels = samples[i].pixels[k / 4];
        pixels.slot[k % 4] = 0;
        if (pixels.weight[k % 4] > 0)
          pixels.slot[k % 4] =
              std::uint32_t(std::lower_bound(slot_pixel.begin(), slot_pixel.end(), keys[i][k]) - slot_pixel.begin());
      }
    });
    slot_value.assign(std::max<std::size_t>(1, slot_pixel.size()), Eigen::Vector3f::Zero());
    iterate_rest(context);
  }

  /// Of the four pixels around a place. Within a chart only those of its own side: all zero where there are none.
  std::array<float, 4> weights_of(const SeamSample& sample, std::size_t side, const Cell& c) const {
    std::array<float, 4> weights = bilinear(c);
    if (!sample.is_inner()) return weights;
    const Place& place = sample.side[side];
    float sum = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const std::uint16_t mark = mark_at(charts.charts[place.chart], c.x + int(k % 2), c.y + int(k / 2));
      if (mark == 0 || first_part[place.chart] + part_of(mark) != place.part) weights[k] = 0;
      sum += weights[k];
    }
    if (sum > 0)
      for (float& weight : weights) weight /= sum;
    return weights;
  }

  /// Kaczmarz in blocks: every round, what is left at the samples goes to their pixels, averaged where samples share
  /// some.
  void iterate_rest(Context& context) {
    std::vector<Eigen::Vector3f> rest(samples.size()), sum(slot_value.size());
    std::vector<float> weights(slot_value.size());
    std::vector<Eigen::Vector3f> start(samples.size());
    parallel_for(context, samples.size(), 4096, [&](std::size_t i) { start[i] = rest_of(samples[i]); });
    for (int round = 0; round < kLocalRounds; ++round) {
      parallel_for(context, samples.size(), 4096, [&](std::size_t i) {
        rest[i] = start[i] + local_at(samples[i].pixels[1]) - local_at(samples[i].pixels[0]);
      });
      std::fill(sum.begin(), sum.end(), Eigen::Vector3f::Zero());
      std::fill(weights.begin(), weights.end(), 0.0f);
      for (std::size_t i = 0; i < samples.size(); ++i)
        for (std::size_t k = 0; k < 8; ++k) {
          const Footprint& pixels = samples[i].pixels[k / 4];
          sum[pixels.slot[k % 4]] += (k < 4 ? 0.5f : -0.5f) * pixels.weight[k % 4] * rest[i];
          weights[pixels.slot[k % 4]] += pixels.weight[k % 4];
        }
      for (std::size_t s = 0; s < slot_value.size(); ++s)
        if (weights[s] > 0) slot_value[s] += sum[s] / weights[s];
    }
  }

  Eigen::Vector3f local_at(const Footprint& pixels) const {
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    for (std::size_t k = 0; k < 4; ++k) sum += pixels.weight[k] * slot_value[pixels.slot[k]];
    return sum;
  }

  Correction correction_of(std::uint32_t c) const {
    const Chart& chart = charts.charts[c];
    const int width = chart.shape.width * kBlock_px, height = chart.shape.height * kBlock_px;
    Correction out(width, height, Eigen::Vector3f::Zero());
    Image<std::uint8_t> steps(width, height, 255);
    std::vector<std::uint32_t> front, next;
    const auto first = std::lower_bound(slot_pixel.begin(), slot_pixel.end(), std::uint64_t(c) << 32);
    const auto last = std::lower_bound(first, slot_pixel.end(), std::uint64_t(c + 1) << 32);
    for (auto s = first; s != last; ++s) {
      front.push_back(std::uint32_t(*s));
      out.pixels[front.back()] = slot_value[std::size_t(s - slot_pixel.begin())];
      steps.pixels[front.back()] = 0;
    }
    for (int step = 1; step < kFalloff_px; ++step, std::swap(front, next)) grow(chart, step, front, next, steps, out);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        if (!chart.owns(x, y) || mark_at(chart, x, y) == 0) continue;
        Eigen::Vector3f& value = out.at(x, y);
        const float share = float(steps.at(x, y)) / float(kFalloff_px);
        value *= share < 1 ? 1 - share * share * (3 - 2 * share) : 0;
        const auto part = std::uint32_t(part_of(mark_at(chart, x, y)));
        value += offset_at({c, first_part[c] + part, {float(x), float(y)}});
      }
    return out;
  }

  /// Pixels one step farther take the mean of their part's neighbours that are there already.
  void grow(const Chart& chart, int step, const std::vector<std::uint32_t>& front, std::vector<std::uint32_t>& next,
            Image<std::uint8_t>& steps, Correction& values) const {
    next.clear();
    const auto for_around = [&](std::uint32_t pixel, const auto& visit) {
      const int x = int(pixel) % steps.width, y = int(pixel) / steps.width;
      for (int v = std::max(y - 1, 0); v <= std::min(y + 1, steps.height - 1); ++v)
        for (int u = std::max(x - 1, 0); u <= std::min(x + 1, steps.width - 1); ++u)
          if (chart.owns(u, v) && part_of(mark_at(chart, u, v)) == part_of(mark_at(chart, x, y)))
            visit(std::uint32_t(steps.index(u, v)));
    };
    for (const std::uint32_t pixel : front)
      for_around(pixel, [&](std::uint32_t other) {
        if (steps.pixels[other] != 255) return;
        steps.pixels[other] = std::uint8_t(step);
        next.push_back(other);
      });
    for (const std::uint32_t pixel : next) {
      Eigen::Vector3f sum = Eigen::Vector3f::Zero();
      float count = 0;
      for_around(pixel, [&](std::uint32_t other) {
        if (int(steps.pixels[other]) < step) sum += values.pixels[other], ++count;
      });
      values.pixels[pixel] = sum / count;
    }
  }
};

Levelling::Levelling(const Mesh& mesh, const Charts& charts, const std::vector<SharedEdge>& edges)
    : impl_(std::make_unique<Impl>(mesh, charts, edges)) {}
Levelling::~Levelling() = default;

void Levelling::look(std::uint32_t view, const Photograph& photograph) { impl_->look(view, photograph); }

void Levelling::solve(const std::vector<ColorImage>& pages, const std::vector<PartMap>& map, Context& context) {
  impl_->pages = &pages;
  impl_->map = &map;
  impl_->solve(context);
}

Correction Levelling::correction_of(std::uint32_t chart) const { return impl_->correction_of(chart); }

Levelling::Steps Levelling::steps_before() const { return impl_->before; }
Levelling::Steps Levelling::steps_after() const { return impl_->after; }
Levelling::Steps Levelling::inner_steps_before() const { return impl_->inner_before; }
Levelling::Steps Levelling::inner_steps_after() const { return impl_->inner_after; }

}  // namespace lapseam
