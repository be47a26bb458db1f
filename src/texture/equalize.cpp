// Based on: D. B. Goldman, Vignette and Exposure Calibration and Compensation, 2010; the logarithms make the problem
// linear, as in M. Brown, D. Lowe, Automatic Panoramic Image Stitching using Invariant Features, 2007, §6.

#include "texture/equalize.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "core/disjoint_sets.h"
#include "core/parallel.h"
#include "lapseam/io.h"
#include "texture/candidates.h"
#include "texture/spots.h"

namespace lapseam {
namespace {

constexpr std::size_t kSpots = 30'000;
constexpr int kRounds = 10;
constexpr int kWindow = 2;  // pixels to each side of a spot
// Values near the ends of the scale are cut off, or drowned in rounding.
constexpr float kDarkest = 12, kBrightest = 245;
// Share of a spot's mean by which the colour may vary around it: where it varies more, a small shift changes it.
constexpr float kMostVariation = 0.25f;
// How sure it is beforehand that gains and falloffs are none, in observations of unit weight.
constexpr double kGainPrior = 0.01, kFalloffPrior = 30;
constexpr std::size_t kFalloffs = 2;

struct Observation {
  std::uint32_t spot, view;
  float squared_radius;
  Eigen::Vector3f log_color;
  float log_detail;   // of gradients over their size, see below; NaN where there are too few
  float log_density;  // pixels per metre
};

/// Mean colour of a window, and how sharp it is; nothing where it is cut off, varies too much, or leaves the image.
std::optional<Observation> observe(const ColorImage& image, const Eigen::Vector2f& pixel) {
  const int u = int(std::lround(pixel.x())), v = int(std::lround(pixel.y()));
  if (u < kWindow + 1 || v < kWindow + 1 || u + kWindow + 1 >= image.width || v + kWindow + 1 >= image.height)
    return {};
  Eigen::Vector3f sum = Eigen::Vector3f::Zero(), squares = Eigen::Vector3f::Zero();
  float fine = 0, coarse = 0;
  const auto at = [&](int x, int y) {
    const Rgb8 c = image.at(x, y);
    return Eigen::Vector3f(float(c.r), float(c.g), float(c.b));
  };
  for (int y = v - kWindow; y <= v + kWindow; ++y)
    for (int x = u - kWindow; x <= u + kWindow; ++x) {
      const Eigen::Vector3f c = at(x, y);
      if (c.minCoeff() < kDarkest || c.maxCoeff() > kBrightest) return {};
      sum += c;
      squares += c.cwiseProduct(c);
      const float g = c.y(), right = at(x + 1, y).y(), left = at(x - 1, y).y(), up = at(x, y - 1).y(),
                  down = at(x, y + 1).y();
      fine += (right - g) * (right - g) + (down - g) * (down - g);
      coarse += 0.25f * ((right - left) * (right - left) + (down - up) * (down - up));
    }
  constexpr float kCount = (2 * kWindow + 1) * (2 * kWindow + 1);
  const Eigen::Vector3f mean = sum / kCount;
  const Eigen::Vector3f deviation = (squares / kCount - mean.cwiseProduct(mean)).cwiseMax(0.0f).cwiseSqrt();
  if ((deviation.array() > kMostVariation * mean.array()).any()) return {};
  Observation out{};
  out.log_color = mean.array().log();
  // Differences of neighbours against those over two pixels: an edge spread over many pixels has equal ones. Little
  // contrast shows the noise of the image only.
  constexpr float kLeastContrast = 9 * kCount;
  out.log_detail = coarse > kLeastContrast ? std::log(fine / coarse) : std::nanf("");
  return out;
}

std::vector<Observation> observe_all(const Mesh& mesh, std::span<const ViewSource> sources, const ColorCameras& cameras,
                                     std::span<const DepthImage> depths, Context& context) {
  const std::vector<Spot> spots = choose_spots(mesh, kSpots);
  std::vector<std::vector<Observation>> by_view(sources.size());
  StageScope stage(context, "texture: equalize", sources.size());
  parallel_for(context, sources.size(), 1, [&](std::size_t view) {
    if (cameras[view]) {
      std::optional<ColorImage> image;
      TriangleSight sight;
      Eigen::Vector2f pixel;
      for (std::uint32_t s = 0; s < spots.size(); ++s) {
        // The middle of a triangle stands for it.
        const Triangle& t = mesh.triangles[spots[s].triangle];
        const std::array<Eigen::Vector3f, 3> c = {mesh.positions_m[t[0]], mesh.positions_m[t[1]],
                                                  mesh.positions_m[t[2]]};
        const Eigen::Vector3f middle = (c[0] + c[1] + c[2]) / 3;
        if (!cameras[view]->may_see(middle, 0) || !cameras[view]->project(middle, pixel)) continue;
        if (!look_at_triangle(c, *cameras[view], depths[view], sight) || sight.fringe > 0) continue;
        if (!image) image = load_color(sources[view]);
        std::optional<Observation> seen = observe(*image, pixel);
        if (!seen) continue;
        seen->spot = s;
        seen->view = std::uint32_t(view);
        seen->squared_radius = cameras[view]->squared_radius(pixel);
        seen->log_density = std::log(sight.density_px);
        by_view[view].push_back(*seen);
      }
    }
    stage.advance();
  });
  std::vector<Observation> all;
  for (const auto& some : by_view) all.insert(all.end(), some.begin(), some.end());
  std::sort(all.begin(), all.end(), [](const Observation& a, const Observation& b) {
    return a.spot != b.spot ? a.spot < b.spot : a.view < b.view;
  });
  return all;
}

/// One row of a linear model y = spot + offset[view] + Σ slope[group][k] · x[k].
struct Row {
  std::uint32_t spot, view, group;
  double y;
  std::array<double, kFalloffs> x;
};

struct Fit {
  Eigen::VectorXd offset;  // of each view
  Eigen::VectorXd slope;   // kFalloffs of each group
  double median_residual = 0;
};

/// Iteratively reweighted least squares; spots are eliminated.
class AdditiveModel {
 public:
  AdditiveModel(std::vector<Row> rows, std::size_t views, std::size_t groups, double slope_prior)
      : rows_(std::move(rows)), views_(views), unknowns_(views + kFalloffs * groups), slope_prior_(slope_prior) {}

  Fit solve(int rounds) {
    weights_.assign(rows_.size(), 1);
    Eigen::VectorXd x = Eigen::VectorXd::Zero(Eigen::Index(unknowns_));
    double median = reweight(x);
    for (int round = 0; round < rounds; ++round) {
      x = solve_weighted();
      median = reweight(x);
    }
    return {x.head(Eigen::Index(views_)), x.tail(Eigen::Index(unknowns_ - views_)), median};
  }

  double initial_median() {
    weights_.assign(rows_.size(), 1);
    return reweight(Eigen::VectorXd::Zero(Eigen::Index(unknowns_)));
  }

 private:
  template <typename Visit>
  void for_spots(const Visit& visit) const {
    for (std::size_t begin = 0, end = 0; begin < rows_.size(); begin = end) {
      for (end = begin; end < rows_.size() && rows_[end].spot == rows_[begin].spot;) ++end;
      if (end - begin > 1) visit(begin, end);
    }
  }

  std::size_t slope_index(const Row& row, std::size_t k) const { return views_ + kFalloffs * row.group + k; }

  double predicted(const Row& row, const Eigen::VectorXd& x) const {
    double sum = x[Eigen::Index(row.view)];
    for (std::size_t k = 0; k < kFalloffs; ++k) sum += row.x[k] * x[Eigen::Index(slope_index(row, k))];
    return sum;
  }

  /// Cauchy weights of the residuals; returns their median.
  double reweight(const Eigen::VectorXd& x) {
    std::vector<double> residual(rows_.size(), 0), sorted;
    for_spots([&](std::size_t begin, std::size_t end) {
      double mean = 0, sum = 0;
      for (std::size_t i = begin; i < end; ++i) {
        mean += weights_[i] * (rows_[i].y - predicted(rows_[i], x));
        sum += weights_[i];
      }
      for (std::size_t i = begin; i < end; ++i) {
        residual[i] = std::abs(rows_[i].y - predicted(rows_[i], x) - mean / sum);
        sorted.push_back(residual[i]);
      }
    });
    if (sorted.empty()) return 0;
    const auto middle = sorted.begin() + std::ptrdiff_t(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    // 95 % efficiency for normal residuals, whose median is 0.6745 of their deviation.
    const double scale = std::max(2.385 * *middle / 0.6745, 1e-6);
    for (std::size_t i = 0; i < rows_.size(); ++i) weights_[i] = 1 / (1 + residual[i] * residual[i] / (scale * scale));
    return *middle;
  }

  Eigen::VectorXd solve_weighted() const {
    const auto n = Eigen::Index(unknowns_);
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
    for (Eigen::Index v = 0; v < n; ++v) normal(v, v) = std::size_t(v) < views_ ? kGainPrior : slope_prior_;
    std::vector<Term> mean;
    for_spots([&](std::size_t begin, std::size_t end) { add_spot(begin, end, mean, normal, right); });
    return normal.ldlt().solve(right);
  }

  struct Term {
    Eigen::Index unknown;
    double factor;
  };
  using Terms = std::array<Term, 1 + kFalloffs>;

  Terms terms_of(const Row& row) const {
    Terms terms;
    terms[0] = {Eigen::Index(row.view), 1.0};
    for (std::size_t k = 0; k < kFalloffs; ++k) terms[k + 1] = {Eigen::Index(slope_index(row, k)), row.x[k]};
    return terms;
  }

  /// What is left of a spot's rows when its own value is the one that fits best. mean: scratch.
  void add_spot(std::size_t begin, std::size_t end, std::vector<Term>& mean, Eigen::MatrixXd& normal,
                Eigen::VectorXd& right) const {
    double mean_y = 0, sum = 0;
    mean.clear();
    for (std::size_t i = begin; i < end; ++i) {
      const double w = weights_[i];
      for (const Term& p : terms_of(rows_[i])) {
        right[p.unknown] += w * p.factor * rows_[i].y;
        for (const Term& q : terms_of(rows_[i])) normal(p.unknown, q.unknown) += w * p.factor * q.factor;
        const auto known =
            std::find_if(mean.begin(), mean.end(), [&](const Term& m) { return m.unknown == p.unknown; });
        if (known == mean.end())
          mean.push_back({p.unknown, w * p.factor});
        else
          known->factor += w * p.factor;
      }
      mean_y += w * rows_[i].y;
      sum += w;
    }
    for (const Term& p : mean) {
      right[p.unknown] -= p.factor * mean_y / sum;
      for (const Term& q : mean) normal(p.unknown, q.unknown) -= p.factor * q.factor / sum;
    }
  }

  std::vector<Row> rows_;
  std::vector<double> weights_;
  std::size_t views_, unknowns_;
  double slope_prior_;
};

/// Subtracts the median from the values of each set of connected views; views without observations are 0.
void center(Eigen::VectorXd& values, DisjointSets& connected, const std::vector<std::uint8_t>& is_observed) {
  std::map<std::uint32_t, std::vector<double>> members;
  for (std::uint32_t v = 0; v < is_observed.size(); ++v)
    if (is_observed[v]) members[connected.find(v)].push_back(values[v]);
  std::map<std::uint32_t, double> median;
  for (auto& [root, some] : members) {
    std::sort(some.begin(), some.end());
    median[root] = 0.5 * (some[some.size() / 2] + some[(some.size() - 1) / 2]);
  }
  for (std::uint32_t v = 0; v < is_observed.size(); ++v)
    values[v] = is_observed[v] ? values[v] - median[connected.find(v)] : 0;
}

std::vector<std::uint32_t> groups_of(std::span<const ViewSource> sources) {
  std::map<std::string, std::uint32_t> numbers;
  std::vector<std::uint32_t> group;
  for (const ViewSource& source : sources)
    group.push_back(numbers.try_emplace(source.sensor_id, std::uint32_t(numbers.size())).first->second);
  return group;
}

}  // namespace

Equalization equalize(const Mesh& mesh, std::span<const ViewSource> sources, const ColorCameras& cameras,
                      std::span<const DepthImage> depths, Context& context) {
  Equalization out;
  out.of_view.resize(sources.size());
  out.blur.assign(sources.size(), 0);
  const std::vector<Observation> seen = observe_all(mesh, sources, cameras, depths, context);
  const std::vector<std::uint32_t> group = groups_of(sources);
  const std::size_t groups = group.empty() ? 0 : 1 + *std::max_element(group.begin(), group.end());
  DisjointSets connected(sources.size());
  std::vector<std::uint8_t> is_observed(sources.size(), 0);
  for (std::size_t i = 1; i < seen.size(); ++i)
    if (seen[i].spot == seen[i - 1].spot) {
      connected.unite(seen[i].view, seen[i - 1].view);
      is_observed[seen[i].view] = is_observed[seen[i - 1].view] = 1;
    }
  out.observations = seen.size();
  std::array<Fit, 4> fits;
  std::array<double, 3> before{};
  parallel_for(context, fits.size(), 1, [&](std::size_t c) {
    std::vector<Row> rows;
    for (const Observation& o : seen) {
      const double r2 = double(o.squared_radius);
      if (c < 3)
        rows.push_back({o.spot, o.view, group[o.view], double(o.log_color[Eigen::Index(c)]), {r2, r2 * r2}});
      else if (!std::isnan(o.log_detail))
        rows.push_back({o.spot, o.view, 0, double(o.log_detail), {double(o.log_density), 0}});
    }
    AdditiveModel model(std::move(rows), sources.size(), c < 3 ? groups : 1, kFalloffPrior);
    if (c < 3) before[c] = model.initial_median();
    fits[c] = model.solve(kRounds);
    center(fits[c].offset, connected, is_observed);
  });
  for (std::size_t v = 0; v < sources.size(); ++v) {
    for (std::size_t c = 0; c < 3; ++c) {
      out.of_view[v].gain[Eigen::Index(c)] = float(-fits[c].offset[Eigen::Index(v)]);
      for (std::size_t k = 0; k < kFalloffs; ++k)
        out.of_view[v].falloff[k][Eigen::Index(c)] = float(-fits[c].slope[Eigen::Index(kFalloffs * group[v] + k)]);
    }
    out.blur[v] = float(std::max(0.0, -fits[3].offset[Eigen::Index(v)]));
  }
  for (std::size_t c = 0; c < 3; ++c) {
    out.residual_before += before[c] / 3;
    out.residual_after += fits[c].median_residual / 3;
  }
  return out;
}

}  // namespace lapseam
