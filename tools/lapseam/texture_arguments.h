#pragma once

// Options of texturing, for the commands that do it.

#include <CLI/CLI.hpp>

#include "lapseam/io.h"
#include "lapseam/texture.h"

namespace lapseam::tool {

struct TextureArguments {
  int page_size = TextureOptions{}.page_size;
  double memory_mb = 0, texel_mm = 0;
  bool no_equalize = false, no_level = false;
  WriteMeshOptions writing;
  bool has_quality = false;  // asked for, which only some formats have
};

void add_texture_options(CLI::App& command, TextureArguments& arguments);
TextureOptions texture_options(const TextureArguments& arguments);
/// Refuses a texture format that the output cannot have, before the work starts.
void check_texture_output(const TextureArguments& arguments, const std::string& output);

}  // namespace lapseam::tool
