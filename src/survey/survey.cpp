#include "lapseam/survey.h"

#include <algorithm>
#include <exception>
#include <map>

#include "core/parallel.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "survey/compare_views.h"
#include "survey/registration_error.h"

namespace lapseam {
namespace {

std::uint64_t bytes_of(const View& view) {
  std::uint64_t bytes = view.range.size() * sizeof(float);
  if (const auto* grid = std::get_if<MeasuredGridSensor>(&view.sensor))
    bytes += grid->warp.size() * sizeof(grid->warp[0]);
  const auto* spherical = std::get_if<SphericalSensor>(&view.sensor);
  if (spherical && spherical->warp) bytes += spherical->warp->size() * sizeof(Eigen::Vector2f);
  return bytes;
}

void describe(const View& view, ViewSurvey& out) {
  out.sensor_kind = kind_name(view.sensor);
  out.width = view.range.width;
  out.height = view.range.height;
  std::vector<double> ranges;
  for (const float r : view.range.pixels)
    if (r > 0) ranges.push_back(double(r));
  out.samples = ranges.size();
  out.missing = view.missing;
  out.valid_share = double(ranges.size()) / double(std::max<std::size_t>(1, view.range.size()));
  if (ranges.empty()) {
    out.problem = "no valid sample";
    return;
  }
  const auto [low, high] = std::minmax_element(ranges.begin(), ranges.end());
  out.range_min_m = *low;
  out.range_max_m = *high;
  out.range_median_m = quantile(ranges, 0.5);
  out.spacing_m = spacing_line(view.sensor).at(out.range_median_m);
}

class Surveyor {
 public:
  Surveyor(const Scene& scene, const SurveyOptions& options, Context& context)
      : scene_(scene), options_(options), context_(context), kept_(scene.views.size()), noise_(scene.views.size()) {
    out_.views.resize(scene.views.size());
  }

  Survey run() {
    read_views();
    survey_sensors();
    if (options_.with_pairs) survey_pairs();
    return std::move(out_);
  }

 private:
  void read_views() {
    StageScope stage(context_, "survey views", scene_.views.size());
    // In batches, so that what does not fit is dropped before the next is read.
    const std::size_t batch = std::max<std::size_t>(8, std::size_t(context_.threads()) * 4);
    std::uint64_t bytes = 0;
    for (std::size_t begin = 0; begin < scene_.views.size(); begin += batch) {
      const std::size_t end = std::min(begin + batch, scene_.views.size());
      parallel_for(context_, end - begin, 1, [&](std::size_t k) {
        read_view(begin + k);
        stage.advance();
      });
      for (std::size_t i = begin; i < end; ++i) {
        if (!kept_[i]) continue;
        bytes += bytes_of(*kept_[i]);
        if (noise_views_[kept_[i]->sensor_id].size() < kNoiseViews)
          noise_views_[kept_[i]->sensor_id].push_back(i);
        else if (bytes > options_.keep_bytes)
          kept_[i].reset();
      }
    }
  }

  void read_view(std::size_t i) {
    const ViewSource& source = scene_.views[i];
    ViewSurvey& view = out_.views[i];
    view.name = source.name;
    view.sensor_id = source.sensor_id;
    if (source.sensor) view.sensor_kind = kind_name(*source.sensor);
    try {
      View loaded = load_view(source);
      describe(loaded, view);
      if (view.is_usable()) kept_[i] = std::move(loaded);
    } catch (const Cancelled&) {
      throw;
    } catch (const Error& error) {
      view.problem = error.what();
    }
  }

  void survey_sensors() {
    std::map<std::string, SensorSurvey> sensors;
    for (const auto& [id, members] : noise_views_) {
      std::vector<const View*> views;
      for (const std::size_t i : members) views.push_back(&*kept_[i]);
      sensors[id].sensor_id = id;
      NoiseMeasurement measured = measure_noise(views, context_);
      sensors[id].noise = measured.model;
      sensors[id].bins = std::move(measured.bins);
    }
    for (std::size_t i = 0; i < out_.views.size(); ++i) {
      if (!out_.views[i].is_usable()) continue;
      SensorSurvey& sensor = sensors[out_.views[i].sensor_id];
      ++sensor.views;
      const auto& given = scene_.views[i].noise;
      if (given && !sensor.given) sensor.given = given;
      noise_[i] = given ? *given : sensor.given ? *sensor.given : sensor.noise;
    }
    for (auto& [id, sensor] : sensors) out_.sensors.push_back(std::move(sensor));
  }

  // The view itself, or, if it was not kept, its file once more.
  template <typename Body>
  void with_view(std::size_t i, const Body& body) {
    if (kept_[i]) return body(*kept_[i]);
    const View view = load_view(scene_.views[i]);
    body(view);
  }

  void survey_pairs() {
    const std::size_t n = out_.views.size();
    StageScope stage(context_, "survey pairs", n);
    std::vector<ViewProbe> probes(n);
    parallel_for(context_, n, 1, [&](std::size_t i) {
      if (out_.views[i].is_usable())
        with_view(i, [&](const View& view) { probes[i] = make_probe(view, noise_[i], options_.samples_per_view); });
    });
    std::vector<std::vector<PairSurvey>> pairs(n);  // by b
    std::vector<std::vector<double>> errors(n), apart(n);
    parallel_for(context_, n, 1, [&](std::size_t b) {
      if (out_.views[b].is_usable())
        with_view(b, [&](const View& view) {
          for (std::size_t a = 0; a < n; ++a)
            if (a != b) compare(a, b, probes, view, pairs[b], errors[b], apart[b]);
        });
      stage.advance();
    });
    std::vector<double> told, all;
    for (std::size_t b = 0; b < n; ++b) {
      out_.pairs.insert(out_.pairs.end(), pairs[b].begin(), pairs[b].end());
      told.insert(told.end(), errors[b].begin(), errors[b].end());
      all.insert(all.end(), apart[b].begin(), apart[b].end());
    }
    out_.distance_m = quantile(all, 0.5);
    std::sort(out_.pairs.begin(), out_.pairs.end(),
              [](const PairSurvey& x, const PairSurvey& y) { return x.a != y.a ? x.a < y.a : x.b < y.b; });
    out_.registration = summarize_registration(std::move(told));
  }

  void compare(std::size_t a, std::size_t b, const std::vector<ViewProbe>& probes, const View& view_b,
               std::vector<PairSurvey>& pairs, std::vector<double>& errors, std::vector<double>& apart) const {
    if (probes[a].samples.empty()) return;
    const ViewComparison found = compare_views(probes[a], view_b, noise_[b], probes[b]);
    auto pair = describe_pair(found, probes[a].samples.size());
    if (!pair) return;
    pair->a = std::uint32_t(a);
    pair->b = std::uint32_t(b);
    pairs.push_back(*pair);
    const std::vector<double> found_apart = distances(found);
    apart.insert(apart.end(), found_apart.begin(), found_apart.end());
    if (const auto error = unexplained_error(found.disagreements)) errors.push_back(*error);
  }

  // Noise is estimated from the first so many views of a sensor, which are kept whatever their size.
  static constexpr std::size_t kNoiseViews = 16;

  const Scene& scene_;
  const SurveyOptions& options_;
  Context& context_;
  Survey out_;
  std::vector<std::optional<View>> kept_;
  std::map<std::string, std::vector<std::size_t>> noise_views_;
  std::vector<NoiseModel> noise_;
};

}  // namespace

std::uint64_t Survey::usable_views() const {
  return std::uint64_t(std::count_if(views.begin(), views.end(), [](const ViewSurvey& v) { return v.is_usable(); }));
}

Survey survey(const Scene& scene, const SurveyOptions& options, Context& context) {
  return Surveyor(scene, options, context).run();
}

}  // namespace lapseam
