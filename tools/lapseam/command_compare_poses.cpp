// lapseam compare-poses: how far the poses of one scene are from those of another.

#include <fmt/format.h>

#include <map>
#include <nlohmann/json.hpp>
#include <numbers>

#include "command.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "pose_lists.h"

namespace lapseam::tool {
namespace {

constexpr double kDegPerRad = 180.0 / std::numbers::pi;

struct ComparePosesArguments {
  CommonOptions common;
  std::string scene, truth;
  bool as_they_stand = false, json = false;
};

void print_table(const PosePairs& pairs, const PoseErrors& errors) {
  fmt::print("{} views: median {:.3f} mm, {:.4f} deg; 90 % {:.3f} mm, {:.4f} deg; most {:.3f} mm, {:.4f} deg\n",
             pairs.names.size(), 1000 * errors.median_translation_m, kDegPerRad * errors.median_rotation_rad,
             1000 * errors.p90_translation_m, kDegPerRad * errors.p90_rotation_rad, 1000 * errors.max_translation_m,
             kDegPerRad * errors.max_rotation_rad);
}

void print_json(const PosePairs& pairs, const PoseErrors& errors) {
  nlohmann::ordered_json out = {{"views", pairs.names.size()},
                                {"median_translation_m", errors.median_translation_m},
                                {"p90_translation_m", errors.p90_translation_m},
                                {"max_translation_m", errors.max_translation_m},
                                {"median_rotation_rad", errors.median_rotation_rad},
                                {"p90_rotation_rad", errors.p90_rotation_rad},
                                {"max_rotation_rad", errors.max_rotation_rad}};
  for (std::size_t i = 0; i < pairs.names.size(); ++i)
    out["poses"].push_back({{"name", pairs.names[i]},
                            {"translation_m", errors.translation_m[i]},
                            {"rotation_rad", errors.rotation_rad[i]}});
  fmt::print("{}\n", out.dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
}

void run(const ComparePosesArguments& arguments) {
  const std::unique_ptr<Context> context = make_context(arguments.common);
  const Scene scene = read_scene(arguments.scene, {}, *context), truth = read_scene(arguments.truth, {}, *context);
  PosePairs pairs = match_poses(scene, truth);
  if (!arguments.as_they_stand) {
    const Eigen::Isometry3d T = align_poses(pairs.poses, pairs.truth);
    for (Eigen::Isometry3d& pose : pairs.poses) pose = T * pose;
  }
  const PoseErrors errors = compare_poses(pairs.poses, pairs.truth);
  arguments.json ? print_json(pairs, errors) : print_table(pairs, errors);
}

}  // namespace

PosePairs match_poses(const Scene& scene, const Scene& truth) {
  std::map<std::string, const ViewSource*> by_name;
  for (const ViewSource& view : truth.views) by_name[view.name] = &view;
  PosePairs pairs;
  for (const ViewSource& view : scene.views) {
    const auto found = by_name.find(view.name);
    if (found == by_name.end()) continue;
    pairs.names.push_back(view.name);
    pairs.poses.push_back(view.T_world_view);
    pairs.truth.push_back(found->second->T_world_view);
  }
  if (pairs.names.empty()) throw InvalidInput(truth.file, {}, "views", "has no view of " + scene.file.string());
  return pairs;
}

void add_compare_poses_command(CLI::App& app) {
  auto arguments = std::make_shared<ComparePosesArguments>();
  CLI::App* command = app.add_subcommand("compare-poses", "How far the poses of a scene are from those of another");
  command->add_option("scene", arguments->scene, "The scene whose poses are judged")->required();
  command->add_option("truth", arguments->truth, "A scene with the same views, by name, at their true poses")
      ->required();
  command->add_flag("--as-they-stand", arguments->as_they_stand,
                    "Compare poses in the world's frame, instead of after the one rigid motion that fits them best");
  command->add_flag("--json", arguments->json, "Everything as one JSON object, each view included");
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
