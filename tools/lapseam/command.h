#pragma once

// What the subcommands share. Each subcommand is one file, command_NAME.cpp, with one function that adds it to the app.

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "lapseam/context.h"

namespace lapseam::tool {

/// Options that every subcommand has.
struct CommonOptions {
  int threads = 0;                ///< 0: all cores
  std::string progress = "auto";  ///< auto, bar, plain, json, none
};

/// Adds --threads and --progress to a subcommand.
void add_common_options(CLI::App& command, CommonOptions& options);

/// A context with progress on stderr, warnings on stderr, and cancel on SIGINT and SIGTERM.
std::unique_ptr<Context> make_context(const CommonOptions& options);

// Each adds its subcommand; the subcommand's callback does the work and throws lapseam::Error on failure (exit code 1).
// A wrong value found after parsing is CLI::ValidationError (exit code 2).
void add_register_command(CLI::App& app);
void add_integrate_command(CLI::App& app);
void add_info_command(CLI::App& app);
void add_simulate_command(CLI::App& app);
void add_texture_command(CLI::App& app);
void add_sew_command(CLI::App& app);
void add_evaluate_command(CLI::App& app);
void add_reduce_command(CLI::App& app);
void add_smooth_command(CLI::App& app);
void add_render_command(CLI::App& app);
void add_manifest_command(CLI::App& app);
void add_convert_command(CLI::App& app);
void add_tiles_command(CLI::App& app);
void add_compare_poses_command(CLI::App& app);

}  // namespace lapseam::tool
