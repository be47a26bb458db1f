#include "lapseam/convert.h"

#include <algorithm>
#include <array>
#include <cstdio>

#include "core/parallel.h"
#include "io/output_folder.h"
#include "io/scene_formats.h"
#include "io/scene_writer.h"

namespace lapseam {
namespace {

constexpr std::array<std::pair<std::string_view, SceneFormat>, 7> kNames{{{"scene", SceneFormat::kManifest},
                                                                          {"e57", SceneFormat::kE57},
                                                                          {"ptx", SceneFormat::kPtx},
                                                                          {"tum", SceneFormat::kTum},
                                                                          {"redwood", SceneFormat::kRedwood},
                                                                          {"nerfstudio", SceneFormat::kNerfstudio},
                                                                          {"pcd", SceneFormat::kPcd}}};

bool is_file(SceneFormat format) { return format == SceneFormat::kE57 || format == SceneFormat::kPtx; }

std::unique_ptr<SceneWriter> make_writer(SceneFormat format, const std::filesystem::path& place, Context& context) {
  switch (format) {
    case SceneFormat::kE57:
      return make_e57_writer(place);
    case SceneFormat::kPtx:
      return make_ptx_writer(place);
    case SceneFormat::kTum:
      return make_tum_writer(place, context);
    case SceneFormat::kRedwood:
      return make_redwood_writer(place, context);
    case SceneFormat::kNerfstudio:
      return make_nerfstudio_writer(place, context);
    case SceneFormat::kPcd:
      return make_pcd_writer(place);
    case SceneFormat::kManifest:
      break;
  }
  return make_manifest_writer(place);
}

/// Names of files: the views' own where they are plain and sort as the views do, else numbers.
std::vector<std::string> choose_stems(const Scene& scene) {
  std::vector<std::string> stems;
  const auto is_plain = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  };
  bool is_usable = true;
  for (const ViewSource& view : scene.views) {
    is_usable &= !view.name.empty() && view.name.size() < 100 &&
                 std::all_of(view.name.begin(), view.name.end(), is_plain) &&
                 (stems.empty() || stems.back() < view.name);
    stems.push_back(view.name);
  }
  if (is_usable) return stems;
  for (std::size_t i = 0; i < stems.size(); ++i) {
    char text[24];
    std::snprintf(text, sizeof text, "%06zu", i);
    stems[i] = text;
  }
  return stems;
}

class Converter {
 public:
  Converter(const Scene& scene, SceneWriter& writer, const ConvertOptions& options, Context& context)
      : scene_(scene), writer_(writer), options_(options), context_(context), stems_(choose_stems(scene)) {}

  ConvertReport run() {
    StageScope stage(context_, "convert", scene_.views.size());
    const auto batch = std::size_t(context_.threads());
    for (std::size_t begin = 0; begin < scene_.views.size(); begin += batch) {
      const std::size_t end = std::min(begin + batch, scene_.views.size());
      std::vector<std::optional<LoadedView>> loaded(end - begin);
      std::vector<std::string> problems(end - begin);
      parallel_for(context_, end - begin, 1, [&](std::size_t k) {
        load(begin + k, loaded[k], problems[k]);
        stage.advance();
      });
      for (std::size_t k = 0; k < loaded.size(); ++k)
        loaded[k] ? add(*loaded[k]) : context_.warn("view left out: " + problems[k]);
    }
    if (report_.views == 0) throw InvalidInput(scene_.file, {}, "views", "there is no usable view");
    writer_.finish();
    return report_;
  }

 private:
  void load(std::size_t i, std::optional<LoadedView>& out, std::string& problem) {
    const ViewSource& source = scene_.views[i];
    try {
      LoadedView loaded{source, load_view(source), {}, stems_[i]};
      if (!options_.with_color) loaded.source.color.reset();
      if (loaded.source.color) loaded.color = load_color(source);
      writer_.write_files(loaded);
      out = std::move(loaded);
    } catch (const InvalidInput& error) {
      if (!options_.skip_bad_views) throw;
      problem = error.what();
    }
  }

  void add(const LoadedView& loaded) {
    const std::size_t further = loaded.color ? loaded.source.more_colors.size() : 0;
    if (further > 0)
      context_.warn(loaded.view.name + ": " + std::to_string(further) + " further images of the scan are left out");
    writer_.add(loaded);
    ++report_.views;
    report_.with_color += loaded.color.has_value();
    const Pixels<float>& pixels = loaded.view.range.pixels;
    report_.samples += std::uint64_t(std::count_if(pixels.begin(), pixels.end(), [](float r) { return r > 0; }));
  }

  const Scene& scene_;
  SceneWriter& writer_;
  const ConvertOptions& options_;
  Context& context_;
  std::vector<std::string> stems_;
  ConvertReport report_;
};

}  // namespace

bool has_registered_color(const LoadedView& loaded) {
  return loaded.color && loaded.source.color->T_view_color.matrix() == Eigen::Matrix4d::Identity() &&
         is_same_sensor(loaded.source.color->camera, loaded.view.sensor);
}

SceneFormat scene_format_named(std::string_view name) {
  for (const auto& [known, format] : kNames)
    if (known == name) return format;
  throw InvalidInput({}, {}, "format", "'" + std::string(name) + "' is no format of scenes that can be written");
}

std::vector<std::string_view> scene_format_names() {
  std::vector<std::string_view> names;
  for (const auto& [name, format] : kNames) names.push_back(name);
  return names;
}

SceneFormat scene_format_of(const std::filesystem::path& output) {
  std::string ending = output.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? char(c + 32) : c; });
  return ending == ".e57" ? SceneFormat::kE57 : ending == ".ptx" ? SceneFormat::kPtx : SceneFormat::kManifest;
}

ConvertReport convert_scene(const Scene& scene, const std::filesystem::path& output, const ConvertOptions& options,
                            Context& context) {
  if (is_file(options.format))
    return Converter(scene, *make_writer(options.format, output, context), options, context).run();
  OutputFolder folder(output);
  const ConvertReport report =
      Converter(scene, *make_writer(options.format, folder.path(), context), options, context).run();
  folder.commit();
  return report;
}

}  // namespace lapseam
