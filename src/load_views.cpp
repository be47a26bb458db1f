#include "load_views.h"

#include <algorithm>
#include <optional>

#include "core/parallel.h"
#include "core/spill_file.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "noise/noise_symmetry.h"

namespace lapseam {
namespace {

// Views of one sensor that its noise is estimated from, spread over the scene.
constexpr std::size_t kNoiseViews = 8;

// By all views of the sensor: those that its noise is estimated from may have too few samples.
void judge_symmetry(const std::vector<View>& views, const std::vector<std::size_t>& members,
                    std::vector<NoiseModel>& of_view, Context& context) {
  std::vector<const View*> of_sensor;
  std::vector<const NoiseModel*> noise;
  for (const std::size_t i : members) {
    of_sensor.push_back(&views[i]);
    noise.push_back(&of_view[i]);
  }
  const bool is_symmetric = is_symmetric_in_range(of_sensor, noise, context);
  for (const std::size_t i : members) of_view[i].is_symmetric_in_range = is_symmetric;
}

}  // namespace

LoadedViews load_views(const Scene& scene, const LoadOptions& options, Context& context) {
  StageScope stage(context, "load", scene.views.size());
  std::vector<std::optional<View>> loaded(scene.views.size());
  std::vector<std::string> problems(scene.views.size());
  parallel_for(context, scene.views.size(), 1, [&](std::size_t i) {
    if (options.hold_out > 0 && i % std::size_t(options.hold_out) == 0) return;
    try {
      loaded[i] = load_view(scene.views[i]);
      spill(loaded[i]->range.pixels, context);
    } catch (const Cancelled&) {
      throw;
    } catch (const Error& error) {
      problems[i] = error.what();
    }
    stage.advance();
  });
  LoadedViews out;
  for (std::size_t i = 0; i < loaded.size(); ++i) {
    if (!problems[i].empty()) {
      if (!options.skip_bad_views) throw Error(problems[i]);
      context.warn("view left out: " + problems[i]);
    }
    if (!loaded[i]) {
      out.left_out.push_back(scene.views[i].name);
      continue;
    }
    out.source_index.push_back(std::uint32_t(i));
    out.views.push_back(std::move(*loaded[i]));
  }
  if (out.views.empty()) throw InvalidInput(scene.file, {}, "views", "no view can be used");
  return out;
}

ViewNoise estimate_view_noise(const Scene& scene, const LoadedViews& loaded, Context& context) {
  ViewNoise out;
  out.of_view.resize(loaded.views.size());
  for (std::size_t i = 0; i < loaded.views.size(); ++i) out.sensors[loaded.views[i].sensor_id].members.push_back(i);
  const auto given_by = [&](std::size_t i) { return scene.views[loaded.source_index[i]].noise; };
  for (auto& [id, sensor] : out.sensors) {
    const std::vector<std::size_t>& members = sensor.members;
    const auto given = std::find_if(members.begin(), members.end(), [&](std::size_t i) { return given_by(i); });
    sensor.is_given = given != members.end();
    std::vector<const View*> sample;
    const std::size_t count = std::min(kNoiseViews, members.size());
    for (std::size_t k = 0; k < count; ++k) sample.push_back(&loaded.views[members[k * members.size() / count]]);
    sensor.measured = measure_noise(sample, context);
    sensor.noise = sensor.is_given ? *given_by(*given) : sensor.measured.model;
    for (const std::size_t i : members) out.of_view[i] = given_by(i).value_or(sensor.noise);
    judge_symmetry(loaded.views, members, out.of_view, context);
    sensor.noise.is_symmetric_in_range = out.of_view[members.front()].is_symmetric_in_range;
  }
  return out;
}

void drop_unused_intensities(const std::vector<NoiseModel>& noise, std::vector<View>& views) {
  for (std::size_t i = 0; i < views.size(); ++i)
    if (noise[i].intensity_power == 0) views[i].intensity = {};
}

}  // namespace lapseam
