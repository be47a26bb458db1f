// From a scene to a scene whose poses agree: sees the stages that takes.

#include "lapseam/register_scene.h"

#include <algorithm>
#include <filesystem>

#include "core/parallel.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "lapseam/smooth.h"
#include "load_views.h"
#include "range_files.h"
#include "register/rounding.h"

namespace lapseam {
std::vector<std::uint32_t> places_of(const std::vector<std::uint32_t>& fixed, const LoadedViews& loaded,
                                     const Scene& scene) {
  std::vector<std::uint32_t> out;
  for (const std::uint32_t view : fixed) {
    const auto found = std::find(loaded.source_index.begin(), loaded.source_index.end(), view);
    if (found == loaded.source_index.end())
      throw InvalidInput(scene.file, view < scene.views.size() ? scene.views[view].name : std::string(), "fixed",
                         "is no view that can be used");
    out.push_back(std::uint32_t(found - loaded.source_index.begin()));
  }
  return out;
}

PictureOf pictures_of(const Scene& scene, const LoadedViews& loaded) {
  return [&scene, &loaded](std::size_t i) -> std::optional<ViewPicture> {
    const ViewSource& source = scene.views[loaded.source_index[i]];
    if (!source.color) return std::nullopt;
    return ViewPicture{load_color(source), source.color->camera, source.color->T_view_color};
  };
}

namespace {

// Steps of disparity are wide where surfaces face the sensor.
constexpr int kReach_px = 32;

// Smooths ranges of depth cameras that give whole disparities, within what those were rounded by. Returns the sensors.
std::vector<std::string> undo_rounding(const ViewNoise& noise, std::vector<View>& views, Context& context) {
  StageScope stage(context, "rounding");
  std::vector<std::string> out;
  for (const auto& [id, sensor] : noise.sensors) {
    // Steps are larger than the noise: neighbours share their error.
    if (sensor.members.empty() || !(sensor.measured.model.correlation > 1)) continue;
    if (!std::holds_alternative<PinholeSensor>(views[sensor.members.front()].sensor)) continue;
    std::vector<const View*> of_sensor;
    for (const std::size_t i : sensor.members) of_sensor.push_back(&views[i]);
    const std::vector<float> values = range_values(of_sensor, context);
    for (const std::size_t i : sensor.members) {
      const SmoothResult smoothed = smooth(views[i], sensor.measured.model, {.reach_px = kReach_px}, context);
      views[i].range = within_rounding(views[i].range, smoothed.range, values);
    }
    out.push_back(id);
  }
  return out;
}

// Takes out of the views what their sensors are off by, and writes what is left beside the manifest.
void write_corrected(const RegisterResult& placed, const std::vector<std::string>& unrounded, const ViewNoise& noise,
                     const std::filesystem::path& folder, LoadedViews& loaded, Scene& scene, Context& context) {
  const std::vector<std::string> names = range_file_names(scene.views);
  std::error_code failure;
  std::filesystem::create_directories(folder, failure);
  if (failure) throw IoError(folder, "cannot make this folder: " + failure.message());
  StageScope stage(context, "write range images");
  parallel_for(context, loaded.views.size(), 1, [&](std::size_t i) {
    View& view = loaded.views[i];
    const auto found = placed.corrections.find(view.sensor_id);
    const std::vector<double>& lines = placed.views[i].line_offset_rad;
    const bool is_unrounded = std::find(unrounded.begin(), unrounded.end(), view.sensor_id) != unrounded.end();
    if (found == placed.corrections.end() && lines.empty() && !is_unrounded) return;
    ViewSource& source = scene.views[loaded.source_index[i]];
    source.range = written_range(source.range, folder / names[loaded.source_index[i]], view.sensor);
    // Steps of whole disparities are no longer told from surfaces when the noise is estimated anew.
    source.noise = noise.of_view[i];
    if (lines.empty()) {
      if (found != placed.corrections.end()) view.range = corrected(view.range, found->second);
    } else {
      view.sensor = corrected(std::get<SphericalSensor>(view.sensor), lines);
      source.sensor = view.sensor;
      source.sensor_id = view.name;
    }
    write_range_exr(source.range.file, view.range, view.sensor, view.T_world_view);
  });
}

}  // namespace

RegisterSceneResult register_scene(const Scene& scene, const RegisterSceneOptions& options, Context& context) {
  LoadedViews loaded = load_views(scene, {.skip_bad_views = options.skip_bad_views}, context);
  ViewNoise noise;
  RegisterSceneResult out;
  RegisterSceneReport& report = out.report;
  {
    StageScope stage(context, "noise");
    noise = estimate_view_noise(scene, loaded, context);
    report.disagreement_before = survey_disagreement(loaded.views, noise.of_view, context);
  }
  if (options.registration.calibrate) report.unrounded = undo_rounding(noise, loaded.views, context);
  RegisterOptions registration = options.registration;
  registration.fixed = places_of(options.registration.fixed, loaded, scene);
  RegisterResult placed =
      register_views(loaded.views, noise.of_view, pictures_of(scene, loaded), registration, context);
  out.scene = scene;
  for (std::size_t i = 0; i < loaded.views.size(); ++i) {
    ViewSource& view = out.scene.views[loaded.source_index[i]];
    report.names.push_back(view.name);
    loaded.views[i].T_world_view = view.T_world_view = placed.views[i].T_world_view;
    view.pose_covariance = placed.views[i].covariance;
    if (!placed.views[i].problem.empty()) context.warn(warning_about(view.name, placed.views[i]));
  }
  const bool has_lines = std::any_of(placed.views.begin(), placed.views.end(),
                                     [](const PlacedView& view) { return !view.line_offset_rad.empty(); });
  if (has_lines || !placed.corrections.empty() || !report.unrounded.empty())
    write_corrected(placed, report.unrounded, noise, options.corrected_ranges, loaded, out.scene, context);
  report.corrections = std::move(placed.corrections);
  StageScope stage(context, "disagreement");
  report.disagreement_after = survey_disagreement(loaded.views, noise.of_view, context);
  report.views_left_out = std::move(loaded.left_out);
  report.views = std::move(placed.views);
  report.registration = std::move(placed.report);
  return out;
}

}  // namespace lapseam
