// After A. Teichman, S. Miller, S. Thrun, Unsupervised intrinsic calibration of depth sensors via SLAM, 2013, and
// Q.-Y. Zhou, V. Koltun, Simultaneous localization and calibration, 2014; here as an offset of inverse range
// (disparity, of structured light) that is bilinear over the image.

#include "register/range_offsets.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

#include "core/parallel.h"

namespace lapseam {
namespace {

// Nodes over the longer and the shorter side of an image: a depth camera's stripes and rings are wider than a tenth.
constexpr int kNodes = 13;
constexpr std::size_t kFewestViews = 8;
// Nodes are held to their neighbours as firmly as this share of what is known of a node on average.
constexpr double kSmooth = 0.01;
// Of the misfit of the other half of the pairs: what is predicted less well is chance, since halves share their views.
constexpr double kLeastGain = 0.01;
// Sums are made in this many runs of pairs, added up in order.
constexpr std::size_t kRuns = 16;

int nodes_along(int pixels, int longer) {
  return std::max(2, 1 + int(std::lround(double(kNodes - 1) * pixels / longer)));
}

struct Node {
  Eigen::Index index;
  double weight;
};

struct Lattice {
  Eigen::Index first = 0;  // of its nodes among those of all sensors
  int width = 0, height = 0, columns = 0, rows = 0;
  double scale_u() const { return double(columns - 1) / (width - 1); }
  double scale_v() const { return double(rows - 1) / (height - 1); }

  std::array<Node, 4> at(double u, double v) const {
    const double x = std::clamp(u * scale_u(), 0.0, double(columns - 1));
    const double y = std::clamp(v * scale_v(), 0.0, double(rows - 1));
    const int i = std::min(int(x), columns - 2), j = std::min(int(y), rows - 2);
    const double s = x - i, t = y - j;
    const Eigen::Index k = first + j * columns + i;
    return {Node{k, (1 - s) * (1 - t)}, Node{k + 1, s * (1 - t)}, Node{k + columns, (1 - s) * t},
            Node{k + columns + 1, s * t}};
  }
};

// Normal equations of half the pairs; c is the weighted sum of squares.
struct Half {
  Eigen::MatrixXd H;
  Eigen::VectorXd g;
  double c = 0;
  explicit Half(Eigen::Index n = 0) : H(Eigen::MatrixXd::Zero(n, n)), g(Eigen::VectorXd::Zero(n)) {}
  void add(const Half& other) {
    H += other.H;
    g += other.g;
    c += other.c;
  }
};

class Offsets {
 public:
  Offsets(std::span<const View> views, std::span<const Posed> posed) : views_(views), posed_(posed) {
    std::map<std::string, std::size_t> count;
    for (const View& view : views)
      if (std::holds_alternative<PinholeSensor>(view.sensor)) ++count[view.sensor_id];
    for (const View& view : views) {
      if (!std::holds_alternative<PinholeSensor>(view.sensor) || count[view.sensor_id] < kFewestViews) continue;
      const int w = view.range.width, h = view.range.height, longer = std::max(w, h);
      if (w < 2 || h < 2) continue;
      const auto [at, is_new] = lattices_.try_emplace(view.sensor_id);
      if (!is_new) continue;
      at->second = {size_, w, h, nodes_along(w, longer), nodes_along(h, longer)};
      size_ += at->second.columns * at->second.rows;
    }
    for (const View& view : views) {
      const auto found = lattices_.find(view.sensor_id);
      const bool is_same_size = found != lattices_.end() && found->second.width == view.range.width &&
                                found->second.height == view.range.height;
      lattice_of_.push_back(is_same_size ? &found->second : nullptr);
    }
  }

  bool empty() const { return size_ == 0; }

  std::array<Half, 2> sum(std::span<const GatedPair> pairs, std::size_t surfels, Context& context) const {
    std::vector<std::array<Half, 2>> runs(kRuns, {Half(size_), Half(size_)});
    parallel_for(context, kRuns, 1, [&](std::size_t run) {
      for (std::size_t k = run * pairs.size() / kRuns; k < (run + 1) * pairs.size() / kRuns; ++k) {
        const GatedPair& pair = pairs[k];
        if (!lattice_of_[pair.a] && !lattice_of_[pair.b]) continue;
        add(pair.a, pair.b, pair.gate, surfels, runs[run][k % 2]);
        add(pair.b, pair.a, pair.gate, surfels, runs[run][k % 2]);
      }
    });
    for (std::size_t run = 1; run < kRuns; ++run)
      for (const std::size_t half : {0, 1}) runs[0][half].add(runs[run][half]);
    return std::move(runs[0]);
  }

  // Each sensor's part of the solution, or nothing where halves of the pairs do not predict each other.
  Eigen::VectorXd solve(const std::array<Half, 2>& halves, std::vector<std::string>& changed) const {
    Eigen::VectorXd out = Eigen::VectorXd::Zero(size_);
    Half all = halves[0];
    all.add(halves[1]);
    const Eigen::VectorXd x = solve(all), x0 = solve(halves[0]), x1 = solve(halves[1]);
    for (const auto& [id, lattice] : lattices_) {
      const Eigen::Index n = lattice.columns * lattice.rows;
      const double gain0 = gain(halves[0], x1, lattice.first, n), gain1 = gain(halves[1], x0, lattice.first, n);
      if (!(gain0 >= kLeastGain) || !(gain1 >= kLeastGain)) continue;
      out.segment(lattice.first, n) = x.segment(lattice.first, n);
      changed.push_back(id);
    }
    return out;
  }

  const Lattice& lattice_of(const std::string& id) const { return lattices_.at(id); }

 private:
  void add(std::uint32_t from, std::uint32_t to, const Gate& gate, std::size_t surfels, Half& out) const {
    const Posed &a = posed_[from], &b = posed_[to];
    const Eigen::Isometry3d T_b_a = b.T_world_view.inverse(Eigen::Isometry) * a.T_world_view;
    const std::size_t stride = thinning(*a.image, surfels);
    for (const Match& match : find_matches(a, b, gate, stride)) {
      const double r = double(match.residual_m), t = r / gate.at(match), fit = std::max(0.0, 1 - t * t);
      const double w = fit * fit / gate.variance(match);
      if (!(w > 0)) continue;
      const Eigen::Vector3d n = match.normal_in_b.cast<double>();
      const Eigen::Vector3d p = T_b_a.linear() * a.image->surfels[match.a].point.cast<double>();
      const Eigen::Vector3d q = b.image->surfels[match.b].point.cast<double>();
      // 1/z grows by the offset: a point moves by −z · offset times itself.
      const double by_a = -n.dot(p) * double(a.image->surfels[match.a].point.z()), by_b = n.dot(q) * q.z();
      std::array<Node, 8> nodes;
      std::size_t count = 0;
      collect(lattice_of_[from], *a.image, match.a, by_a, nodes, count);
      collect(lattice_of_[to], *b.image, match.b, by_b, nodes, count);
      out.c += w * r * r;
      for (std::size_t i = 0; i < count; ++i) {
        out.g[nodes[i].index] += w * nodes[i].weight * r;
        for (std::size_t j = 0; j < count; ++j)
          out.H(nodes[j].index, nodes[i].index) += w * nodes[i].weight * nodes[j].weight;
      }
    }
  }

  static void collect(const Lattice* lattice, const SurfelImage& image, std::uint32_t surfel, double factor,
                      std::array<Node, 8>& nodes, std::size_t& count) {
    if (!lattice) return;
    const double u = image.factor * (int(surfel) % image.width + 0.5) - 0.5;
    const double v = image.factor * (int(surfel) / image.width + 0.5) - 0.5;
    for (const Node& node : lattice->at(u, v)) nodes[count++] = {node.index, node.weight * factor};
  }

  // With neighbours held to each other, so that what no match sees follows from what is next to it.
  Eigen::VectorXd solve(const Half& half) const {
    const double held = kSmooth * half.H.trace() / double(size_);
    if (!(held > 0)) return Eigen::VectorXd::Zero(size_);
    Eigen::MatrixXd H = half.H;
    const auto hold = [&](Eigen::Index i, Eigen::Index j) {
      H(i, i) += held;
      H(j, j) += held;
      H(i, j) -= held;
      H(j, i) -= held;
    };
    for (const auto& [id, lattice] : lattices_)
      for (int row = 0; row < lattice.rows; ++row)
        for (int column = 0; column < lattice.columns; ++column) {
          const Eigen::Index i = lattice.first + row * lattice.columns + column;
          H(i, i) += 0.01 * held;  // an offset that is the same everywhere and that nothing shows is none
          if (column + 1 < lattice.columns) hold(i, i + 1);
          if (row + 1 < lattice.rows) hold(i, i + lattice.columns);
        }
    return H.ldlt().solve(-half.g);
  }

  // Share of the misfit that the offsets of one sensor take away.
  static double gain(const Half& half, const Eigen::VectorXd& x, Eigen::Index first, Eigen::Index n) {
    const Eigen::VectorXd part = x.segment(first, n);
    return -(2 * half.g.segment(first, n).dot(part) + part.dot(half.H.block(first, first, n, n) * part)) / half.c;
  }

  std::span<const View> views_;
  std::span<const Posed> posed_;
  std::map<std::string, Lattice> lattices_;
  std::vector<const Lattice*> lattice_of_;
  Eigen::Index size_ = 0;
};

}  // namespace

bool add_range_offsets(std::span<const View> views, std::span<const Posed> posed, std::span<const GatedPair> pairs,
                       std::size_t surfels, std::map<std::string, RangeCorrection>& corrections, Context& context) {
  const Offsets offsets(views, posed);
  if (offsets.empty() || pairs.empty()) return false;
  std::vector<std::string> changed;
  const Eigen::VectorXd x = offsets.solve(offsets.sum(pairs, surfels, context), changed);
  for (const std::string& id : changed) {
    const Lattice& lattice = offsets.lattice_of(id);
    RangeCorrection& correction = corrections[id];
    correction.columns = lattice.columns;
    correction.rows = lattice.rows;
    correction.offset_per_m.resize(std::size_t(lattice.columns) * std::size_t(lattice.rows));
    for (std::size_t k = 0; k < correction.offset_per_m.size(); ++k)
      correction.offset_per_m[k] += x[lattice.first + Eigen::Index(k)];
  }
  return !changed.empty();
}

RangeImage corrected(const RangeImage& range, const RangeCorrection& correction) {
  RangeImage out = range;
  const Lattice lattice{0, range.width, range.height, correction.columns, correction.rows};
  if (range.width < 2 || range.height < 2 || lattice.columns < 2 || lattice.rows < 2) return out;
  for (int v = 0; v < range.height; ++v)
    for (int u = 0; u < range.width; ++u) {
      float& r = out.at(u, v);
      if (!(r > 0)) continue;
      double offset = 0;
      for (const Node& node : lattice.at(u, v))
        offset += node.weight * correction.offset_per_m[std::size_t(node.index)];
      const double inverse = 1 / double(r) + offset;
      r = inverse > 0 ? float(1 / inverse) : 0;
    }
  return out;
}

}  // namespace lapseam
