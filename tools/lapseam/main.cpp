// The command line: parses, calls, and turns what was thrown into one line and an exit code.
// 0: done. 1: the work failed. 2: the command line is wrong. 130: interrupted.

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <new>
#include <numeric>

#include "allocator.h"
#include "command.h"
#include "help_formatter.h"
#include "lapseam/error.h"
#include "lapseam/version.h"

namespace lapseam::tool {
namespace {

enum ExitCode { kOk = 0, kFailed = 1, kUsage = 2, kInterrupted = 130 };

constexpr const char* kDescription =
    "lapseam turns registered range images and colour images into one textured triangle mesh.";

constexpr const char* kFooter = R"(
Examples, in the order of the work:
  lapseam simulate room -o room                        a made-up scene with its truth, to try things on
  lapseam manifest frames/ -o scene.json               writes any readable scene as a manifest, to be edited
  lapseam info room/scene.json                         what is there, and is it usable?
  lapseam smooth room/scene.json -o smoothed           its range images, smoothed within their noise
  lapseam register room/scene.json -o placed           all poses refined at once, as a new scene
  lapseam integrate room/scene.json -o room.glb        all views into one mesh (.ply, .glb or .obj)
  lapseam texture room.ply room/scene.json -o room.glb colour alone, for a mesh that integrate has made
  lapseam sew a.ply b.ply c.ply -o joined.ply          overlapping meshes into one, without range images
  lapseam reduce room.ply -o small.ply                 fewer triangles, within the noise
  lapseam render room.glb -o room.png --orbit 30,40    a picture of it
  lapseam evaluate room.ply room/truth/mesh.ply --views room/truth/scene.json

SCENE is a manifest (scene.json), a Stanford .conf file, or a folder that is recognised: see docs/formats.md.
'lapseam COMMAND --help' explains a command. Results go to stdout, talk to stderr. Exit codes: 0 done, 1 failed,
2 wrong command line, 130 interrupted.)";

int report_error(std::string message, int exit_code) {
  // One line, whatever a library put into its message.
  std::replace(message.begin(), message.end(), '\n', ' ');
  fmt::print(stderr, "lapseam: error: {}\n", message);
  return exit_code;
}

/// Optimal string alignment distance: insertions, deletions, changes, and swaps of neighbours (Damerau 1964).
std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> before_last(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
  std::iota(last.begin(), last.end(), std::size_t(0));
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1)});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) row[j] = std::min(row[j], before_last[j - 2] + 1);
    }
    std::swap(before_last, last);
    std::swap(last, row);
  }
  return last[b.size()];
}

/// "; did you mean X?", or nothing when no name is near.
std::string suggest(const std::string& word, const std::vector<std::string>& names) {
  std::size_t best = std::max<std::size_t>(2, word.size() / 3) + 1;
  std::string nearest;
  for (const std::string& name : names) {
    // What was typed may be the beginning of a longer name.
    const bool is_prefix = word.size() >= 3 && name.starts_with(word);
    const std::size_t distance = is_prefix ? 1 : edit_distance(word, name);
    if (distance < best) {
      best = distance;
      nearest = name;
    }
  }
  return nearest.empty() ? "" : "; did you mean " + nearest + "?";
}

std::vector<std::string> command_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    names.push_back(command->get_name());
  }
  return names;
}

std::vector<std::string> option_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    for (const std::string& name : option->get_snames()) names.push_back("-" + name);
  }
  return names;
}

/// Words that the parsed command did not know. An unknown option explains more than the complaints that follow from it
/// (a missing value, a missing argument), so it is told first.
std::string describe_unknown(const CLI::App& command) {
  const std::vector<std::string> words = command.remaining();
  for (const std::string& word : words) {
    if (word.size() < 2 || word[0] != '-') continue;
    const std::string name = word.substr(0, word.find('='));
    return fmt::format("unknown option {}{}", name, suggest(name, option_names(command)));
  }
  return words.empty() ? "" : "unexpected argument '" + words.front() + "'";
}

int report_usage(const CLI::App& app, const CLI::ParseError& error) {
  const std::vector<CLI::App*> parsed = app.get_subcommands();
  const CLI::App& command = parsed.empty() ? app : *parsed.front();
  const std::string name = parsed.empty() ? "lapseam" : "lapseam " + command.get_name();

  std::string message = describe_unknown(command);
  const std::vector<std::string> commands = command_names(app);
  if (parsed.empty()) {
    const std::vector<std::string> words = app.remaining();
    if (words.empty()) {
      message = fmt::format("no command given; there are {}", fmt::join(commands, ", "));
    } else if (words.front()[0] != '-') {
      message = fmt::format("unknown command '{}'{}", words.front(), suggest(words.front(), commands));
    }
  }
  if (message.empty()) message = error.what();
  if (!parsed.empty()) message = command.get_name() + ": " + message;
  return report_error(message + " (see " + name + " --help)", kUsage);
}

int run(int argc, char** argv) {
  CLI::App app(kDescription, "lapseam");
  app.set_version_flag("--version", std::string("lapseam ") + kVersion, "Print the version and stop");
  app.set_help_flag("-h,--help", "Print this text and stop");
  app.require_subcommand(1);
  app.formatter(std::make_shared<HelpFormatter>());
  // In the order of the pipeline, which is the order of the help text.
  add_simulate_command(app);
  add_manifest_command(app);
  add_convert_command(app);
  add_info_command(app);
  add_smooth_command(app);
  add_register_command(app);
  add_integrate_command(app);
  add_texture_command(app);
  add_sew_command(app);
  add_reduce_command(app);
  add_tiles_command(app);
  add_render_command(app);
  add_evaluate_command(app);
  add_compare_poses_command(app);
  app.footer(kFooter);  // last, since commands inherit it

  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& request) {  // --help, --version
    return app.exit(request, std::cout, std::cerr);
  } catch (const CLI::RuntimeError& error) {  // a command that has said all there is to say
    return error.get_exit_code();
  } catch (const CLI::ParseError& error) {
    return report_usage(app, error);
  }
  return kOk;
}

int run_and_report(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const Cancelled&) {
    return report_error("interrupted", kInterrupted);
  } catch (const Error& error) {
    return report_error(error.what(), kFailed);
  } catch (const std::bad_alloc&) {
    return report_error("out of memory", kFailed);
  } catch (const std::exception& error) {
    return report_error(fmt::format("unexpected: {}", error.what()), kFailed);
  }
}

}  // namespace
}  // namespace lapseam::tool

int main(int argc, char** argv) {
  lapseam::tool::set_up_allocator();
  const int exit_code = lapseam::tool::run_and_report(argc, argv);
  std::cout.flush();
  if (std::fflush(stdout) != 0 || !std::cout) {
    return lapseam::tool::report_error("cannot write to standard output", lapseam::tool::kFailed);
  }
  return exit_code;
}
