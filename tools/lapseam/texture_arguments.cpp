#include "texture_arguments.h"

namespace lapseam::tool {

void add_texture_options(CLI::App& command, TextureArguments& arguments) {
  const char* group = "Texture";
  command.add_option("--page-size", arguments.page_size, "Largest texture page, pixels")
      ->check(CLI::Range(64, 16384))
      ->capture_default_str()
      ->group(group);
  command
      .add_option("--texture-memory", arguments.memory_mb,
                  "Most that all pages may take uncompressed, megabytes; images are made smaller for it")
      ->check(CLI::PositiveNumber)
      ->group(group);
  command.add_option("--texel", arguments.texel_mm, "Texture pixels no smaller than this on the surface, millimetres")
      ->check(CLI::PositiveNumber)
      ->group(group);
  command
      .add_flag("--no-equalize", arguments.no_equalize, "Leave exposure and white balance of the images as they are")
      ->group(group);
  command.add_flag("--no-level", arguments.no_level, "Leave the colour steps between images as they are")->group(group);
}

TextureOptions texture_options(const TextureArguments& arguments) {
  TextureOptions options;
  options.page_size = arguments.page_size;
  options.memory_bytes = std::uint64_t(1e6 * arguments.memory_mb);
  options.texel_m = 1e-3 * arguments.texel_mm;
  options.equalize = !arguments.no_equalize;
  options.level = !arguments.no_level;
  return options;
}

}  // namespace lapseam::tool
