#include "texture_arguments.h"

#include <filesystem>
#include <map>

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
  WriteMeshOptions& writing = arguments.writing;
  static const std::map<std::string, TextureFormat> kFormats = {
      {"jpeg", TextureFormat::kJpeg}, {"png", TextureFormat::kPng}, {"webp", TextureFormat::kWebp}};
  command
      .add_option_function<std::string>(
          "--texture-format", [&writing](const std::string& name) { writing.texture_format = kFormats.at(name); },
          "Images in .glb and beside .obj: png (lossless), jpeg or webp (.glb alone)")
      ->check(CLI::IsMember({"png", "jpeg", "webp"}))
      ->default_str("png")
      ->group(group);
  command.add_option("--texture-quality", writing.texture_quality, "Of jpeg and webp")
      ->check(CLI::Range(1, 100))
      ->each([&arguments](const std::string&) { arguments.has_quality = true; })
      ->capture_default_str()
      ->group(group);
  command
      .add_option_function<std::string>(
          "--material", [&writing](const std::string& name) { writing.is_lit = name == "matte"; },
          "In .glb: unlit shows the photographs as they are, matte is lit by the viewer")
      ->check(CLI::IsMember({"unlit", "matte"}))
      ->default_str("unlit")
      ->group(group);
  command.add_flag("--quantize", writing.quantize, "16-bit geometry in .glb (KHR_mesh_quantization)")->group(group);
  command
      .add_flag("--meshopt", writing.compress, "Geometry in .glb compressed (EXT_meshopt_compression), a third or less")
      ->group(group);
}

void check_texture_output(const TextureArguments& arguments, const std::string& output) {
  const bool is_glb = std::filesystem::path(output).extension() == ".glb";
  if (arguments.writing.texture_format == TextureFormat::kWebp && !is_glb)
    throw CLI::ValidationError("--texture-format", "webp is for .glb: " + output);
  if (arguments.has_quality && arguments.writing.texture_format == TextureFormat::kPng)
    throw CLI::ValidationError("--texture-quality", "png is lossless; --texture-format jpeg or webp has a quality");
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
