// lapseam convert: any scene that can be read, as a folder with manifest and EXR images, or in another format.

#include <fmt/format.h>

#include "command.h"
#include "lapseam/convert.h"
#include "lapseam/io.h"

namespace lapseam::tool {
namespace {

struct ConvertArguments {
  CommonOptions common;
  std::string scene, output, format;
  bool no_color = false, skip_bad_views = false;
};

void run(const ConvertArguments& arguments) {
  const std::unique_ptr<Context> context = make_context(arguments.common);
  ConvertOptions options;
  options.format = arguments.format.empty() ? scene_format_of(arguments.output) : scene_format_named(arguments.format);
  options.with_color = !arguments.no_color;
  options.skip_bad_views = arguments.skip_bad_views;
  const Scene scene = read_scene(arguments.scene, {.skip_bad_views = arguments.skip_bad_views}, *context);
  const ConvertReport report = convert_scene(scene, arguments.output, options, *context);
  fmt::print("{}: {} views, {} with colour, {} samples\n", arguments.output, report.views, report.with_color,
             report.samples);
}

}  // namespace

void add_convert_command(CLI::App& app) {
  auto arguments = std::make_shared<ConvertArguments>();
  CLI::App* command = app.add_subcommand("convert", "Write a scene in another format: manifest and EXR, E57, PTX, ...");
  command->add_option("scene", arguments->scene, "Any scene that can be read: a file, or a folder")->required();
  command
      ->add_option("-o,--output", arguments->output,
                   "A folder for manifest and EXR images; or a name that ends in .e57 or .ptx")
      ->required();
  command
      ->add_option("--format", arguments->format,
                   "Instead of by the name: " + fmt::format("{}", fmt::join(scene_format_names(), ", ")))
      ->check(CLI::IsMember([] {
        std::vector<std::string> names;
        for (const std::string_view name : scene_format_names()) names.emplace_back(name);
        return names;
      }()));
  command->add_flag("--no-color", arguments->no_color, "Ranges only");
  command->add_flag("--skip-bad-views", arguments->skip_bad_views, "Leave out unusable views with a warning");
  command->footer(
      "Examples:\n"
      "  lapseam convert site.e57 -o site            a folder with scene.json and EXR images\n"
      "  lapseam convert room/scene.json -o room.e57\n"
      "  lapseam convert room/scene.json -o room_tum --format tum");
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
