// lapseam smooth: the range images of a scene, smoothed within their noise, as a scene again.

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <vector>

#include "command.h"
#include "lapseam/io.h"
#include "lapseam/smooth_scene.h"

namespace lapseam::tool {
namespace {

struct SmoothArguments {
  CommonOptions common;
  std::string scene, output;
  bool skip_bad_views = false;
};

template <typename Value>
double median_over(const std::vector<SmoothedView>& views, Value&& value_of) {
  std::vector<double> values;
  for (const SmoothedView& view : views) values.push_back(value_of(view));
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

void run(const SmoothArguments& arguments) {
  const std::unique_ptr<Context> context = make_context(arguments.common);
  const Scene scene = read_scene(arguments.scene, {.skip_bad_views = arguments.skip_bad_views}, *context);
  const SmoothSceneReport report =
      smooth_scene(scene, arguments.output, {.skip_bad_views = arguments.skip_bad_views}, *context);
  std::uint64_t samples = 0;
  for (const SmoothedView& view : report.views) samples += view.samples;
  fmt::print("{}: {} views, {} samples, moved by {:.2f} sigma (median); {:.0f} % of the noise is left\n",
             (std::filesystem::path(arguments.output) / "scene.json").string(), report.views.size(), samples,
             median_over(report.views, [](const SmoothedView& v) { return v.median_abs_shift_sigmas; }),
             100 * median_over(report.views, [](const SmoothedView& v) { return v.remaining_sigma_factor; }));
}

}  // namespace

void add_smooth_command(CLI::App& app) {
  auto arguments = std::make_shared<SmoothArguments>();
  CLI::App* command = app.add_subcommand("smooth", "Smooth range images within their noise; steps and creases stay");
  command->add_option("scene", arguments->scene, "scene.json, a Stanford .conf, or a folder that is recognised")
      ->required();
  command->add_option("-o,--output", arguments->output, "Folder to write: scene.json and range/*.exr")->required();
  command->add_flag("--skip-bad-views", arguments->skip_bad_views, "Leave out unusable views with a warning");
  command->footer(
      "Poses and sensors stay as they are, colour images stay where they are, and pixels without a sample stay "
      "without.\n"
      "scene.json states for each view what is left of its noise. 'lapseam integrate' smooths by itself.");
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
