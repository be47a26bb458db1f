#include "lapseam/smooth_scene.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>

#include "core/parallel.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "range_files.h"

namespace lapseam {
namespace {

namespace fs = std::filesystem;

// Views of one sensor that its noise is estimated from, spread over the scene; as in the pipeline.
constexpr std::size_t kNoiseViews = 8;

bool is_same_file(const fs::path& a, const fs::path& b) {
  std::error_code ignored;  // what does not exist is nobody's
  return fs::equivalent(a, b, ignored);
}

class SceneSmoother {
 public:
  SceneSmoother(const Scene& scene, const fs::path& folder, const SmoothSceneOptions& options, Context& context)
      : scene_(scene), folder_(folder), options_(options), context_(context), written_(scene.views) {
    const std::vector<std::string> names = range_file_names(scene.views);
    for (const std::string& name : names) files_.push_back(folder / "range" / name);
  }

  SmoothSceneReport run() {
    check_folder();
    estimate_noise_of_sensors();
    smooth_views();
    return finish();
  }

 private:
  void check_folder() const {
    const auto refuse = [&](const fs::path& input) {
      throw InvalidInput(folder_, {}, "output", "would overwrite " + input.string() + "; choose another folder");
    };
    if (is_same_file(folder_ / "scene.json", scene_.file)) refuse(scene_.file);
    std::set<fs::path> outputs;
    for (const fs::path& file : files_) outputs.insert(fs::weakly_canonical(file));
    for (const ViewSource& view : scene_.views) {
      if (outputs.contains(fs::weakly_canonical(view.range.file))) refuse(view.range.file);
      if (view.color && outputs.contains(fs::weakly_canonical(view.color->file))) refuse(view.color->file);
    }
    std::error_code error;
    fs::create_directories(folder_ / "range", error);
    if (error) throw IoError(folder_ / "range", "cannot be made: " + error.message());
  }

  /// Nothing, and why, when the view cannot be read.
  std::optional<View> load(std::size_t i, std::string& problem) const {
    try {
      return load_view(scene_.views[i]);
    } catch (const Cancelled&) {
      throw;
    } catch (const Error& error) {
      if (!options_.skip_bad_views) throw;
      problem = error.what();
      return std::nullopt;
    }
  }

  void estimate_noise_of_sensors() {
    std::map<std::string, std::vector<std::size_t>> views_of_sensor;
    for (std::size_t i = 0; i < scene_.views.size(); ++i)
      if (!scene_.views[i].noise) views_of_sensor[scene_.views[i].sensor_id].push_back(i);
    StageScope stage(context_, "noise", views_of_sensor.size());
    for (const auto& [id, members] : views_of_sensor) {
      const std::vector<View> views = sample_views(members);
      std::vector<const View*> pointers;
      for (const View& view : views) pointers.push_back(&view);
      if (!views.empty()) noise_of_sensor_[id] = estimate_noise(pointers, context_);
      stage.advance();
    }
  }

  /// Up to kNoiseViews of a sensor's views that can be read, at least one where there is one.
  std::vector<View> sample_views(const std::vector<std::size_t>& members) const {
    const std::size_t count = std::min(kNoiseViews, members.size());
    std::vector<std::optional<View>> loaded(count);
    parallel_for(context_, count, 1, [&](std::size_t k) {
      std::string told_later;
      loaded[k] = load(members[k * members.size() / count], told_later);
    });
    std::vector<View> views;
    for (auto& view : loaded)
      if (view) views.push_back(std::move(*view));
    for (std::size_t k = 0; views.empty() && k < members.size(); ++k) {
      std::string told_later;
      if (auto view = load(members[k], told_later)) views.push_back(std::move(*view));
    }
    return views;
  }

  void smooth_views() {
    StageScope stage(context_, "smooth", scene_.views.size());
    smoothed_.resize(scene_.views.size());
    problems_.resize(scene_.views.size());
    parallel_for(context_, scene_.views.size(), 1, [&](std::size_t i) {
      if (std::optional<View> view = load(i, problems_[i])) smoothed_[i] = smooth_view(i, *view);
      stage.advance();
    });
  }

  SmoothedView smooth_view(std::size_t i, const View& view) {
    ViewSource& written = written_[i];
    const NoiseModel noise = written.noise ? *written.noise : noise_of_sensor_.at(written.sensor_id);
    const SmoothResult result = smooth(view, noise, options_.smooth, context_);
    SmoothedView out{view.name, 0, result.remaining_sigma_factor, 0};
    std::vector<double> shifts;
    for (std::size_t k = 0; k < view.range.size(); ++k) {
      const double before = double(view.range.pixels[k]);
      if (before > 0) shifts.push_back(std::abs(double(result.range.pixels[k]) - before) / noise.sigma(before));
    }
    out.samples = shifts.size();
    const auto middle = shifts.begin() + std::ptrdiff_t(shifts.size() / 2);
    std::nth_element(shifts.begin(), middle, shifts.end());
    out.median_abs_shift_sigmas = *middle;  // a loaded view has a sample

    write_range_exr(files_[i], result.range, view.sensor, view.T_world_view);
    written.sensor = view.sensor;
    written.noise = noise.scaled(result.remaining_sigma_factor);
    written.range = written_range(written.range, files_[i], view.sensor);
    return out;
  }

  SmoothSceneReport finish() {
    SmoothSceneReport report;
    Scene out{scene_.name, folder_ / "scene.json", {}};
    for (std::size_t i = 0; i < written_.size(); ++i) {
      if (smoothed_[i]) {
        report.views.push_back(std::move(*smoothed_[i]));
        out.views.push_back(std::move(written_[i]));
      } else {
        context_.warn("view left out: " + problems_[i]);
        report.views_left_out.push_back(scene_.views[i].name);
      }
    }
    if (out.views.empty()) throw InvalidInput(scene_.file, {}, "views", "no view can be used");
    write_scene(out, out.file);
    return report;
  }

  const Scene& scene_;
  fs::path folder_;
  const SmoothSceneOptions& options_;
  Context& context_;
  std::vector<ViewSource> written_;
  std::vector<fs::path> files_;
  std::map<std::string, NoiseModel> noise_of_sensor_;
  std::vector<std::optional<SmoothedView>> smoothed_;
  std::vector<std::string> problems_;
};

}  // namespace

SmoothSceneReport smooth_scene(const Scene& scene, const fs::path& folder, const SmoothSceneOptions& options,
                               Context& context) {
  return SceneSmoother(scene, folder, options, context).run();
}

}  // namespace lapseam
