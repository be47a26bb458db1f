#include <algorithm>
#include <system_error>

#include "io/e57/e57.h"
#include "io/pcd.h"
#include "io/ptx.h"
#include "io/scene_formats.h"
#include "io/sens.h"

namespace lapseam {
namespace {

constexpr const char* kRecognised =
    "a scene is a manifest (scene.json), an E57, PTX or PCD file, a Stanford .conf file, EXR files with sensor and "
    "pose, a range-grid PLY, a "
    ".sens file, nerfstudio's transforms.json, or a folder as of 7-Scenes, TUM, Redwood or COLMAP, or with scene.json, "
    "such EXR files or PCD files";

Scene read_folder(const std::filesystem::path& folder, const ReadSceneOptions& options, Context& context) {
  if (std::filesystem::exists(folder / "scene.json")) return read_manifest(folder / "scene.json", options, context);
  if (is_seven_scenes_folder(folder)) return read_seven_scenes(folder, options, context);
  if (is_tum_folder(folder)) return read_tum(folder, options, context);
  if (is_redwood_folder(folder)) return read_redwood(folder, options, context);
  if (is_colmap_folder(folder)) return read_colmap(folder, options, context);
  if (std::filesystem::exists(folder / "transforms.json"))
    return read_nerfstudio(folder / "transforms.json", options, context);
  const std::vector<std::string> clouds = list_files(folder, ".pcd");
  if (!clouds.empty()) return read_pcd_files(folder, clouds, options, context);
  const std::vector<std::string> confs = list_files(folder, ".conf");
  if (confs.size() == 1 && recognise_file(folder / confs.front()) == FileKind::kStanfordConf)
    return read_stanford_conf(folder / confs.front(), options, context);
  const std::vector<std::string> names = list_files(folder, ".exr");
  if (!names.empty()) {
    std::vector<std::filesystem::path> files;
    for (const std::string& name : names) files.push_back(folder / name);
    return read_exr_files(folder, files, options, context);
  }
  throw InvalidInput(folder, {}, {}, std::string("nothing in this folder is recognised; ") + kRecognised);
}

}  // namespace

std::vector<std::string> list_files(const std::filesystem::path& folder, const std::string& ending) {
  std::vector<std::string> names;
  std::error_code error;
  const std::filesystem::directory_iterator end;
  for (std::filesystem::directory_iterator it(folder, error); !error && it != end; it.increment(error)) {
    std::string name = it->path().filename().string();
    std::error_code ignored;
    if (name.ends_with(ending) && !name.starts_with('.') && it->is_regular_file(ignored))
      names.push_back(std::move(name));
  }
  if (error) throw IoError(folder, "cannot read: " + error.message());
  std::sort(names.begin(), names.end());
  return names;
}

std::filesystem::path resolved_path(const std::filesystem::path& path) {
  std::error_code error;
  const std::filesystem::path resolved = std::filesystem::weakly_canonical(path, error);
  return error ? path : resolved;
}

Scene read_exr_files(const std::filesystem::path& path, const std::vector<std::filesystem::path>& files,
                     const ReadSceneOptions& options, Context& context) {
  SceneBuilder builder(path, options, context);
  builder.set_name(resolved_path(path).stem().string());
  for (const std::filesystem::path& file : files) {
    builder.add([&] {
      ViewDraft draft;
      draft.view.name = file.stem().string();
      draft.view.range.file = file;
      return draft;
    });
  }
  return builder.finish();
}

namespace {

Scene read_any_scene(const std::filesystem::path& path, const ReadSceneOptions& options, Context& context) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) throw IoError(path, "no such file or folder");
  if (std::filesystem::is_directory(status)) return read_folder(path, options, context);
  switch (const FileKind kind = recognise_file(path)) {
    case FileKind::kJson:
      if (is_nerfstudio(path)) return read_nerfstudio(path, options, context);
      return read_manifest(path, options, context);
    case FileKind::kStanfordConf:
      return read_stanford_conf(path, options, context);
    case FileKind::kExr:
      return read_exr_files(path, {path}, options, context);
    case FileKind::kPly:
      return read_single_range_grid(path, options, context);
    case FileKind::kE57:
      return read_e57(path, options, context);
    case FileKind::kPtx:
      return read_ptx(path, options, context);
    case FileKind::kPcd:
      return read_pcd_files(path.parent_path(), {path.filename().string()}, options, context);
    case FileKind::kSens:
      return read_sens(path, options, context);
    default:
      throw InvalidInput(path, {}, {}, "this is " + std::string(describe(kind)) + "; " + kRecognised);
  }
}

}  // namespace

Scene read_scene(const std::filesystem::path& path, const ReadSceneOptions& options, Context& context) {
  try {
    return read_any_scene(path, options, context);
  } catch (const std::filesystem::filesystem_error& error) {
    // A name in the scene that the system cannot even look for.
    throw IoError(path, "cannot read: " + error.code().message());
  }
}

}  // namespace lapseam
