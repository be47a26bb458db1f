#pragma once

// One writer per format of scenes, behind convert_scene of lapseam/convert.h. Views come one by one, in order.

#include <memory>
#include <optional>

#include "lapseam/context.h"
#include "lapseam/image.h"
#include "lapseam/view.h"

namespace lapseam {

struct LoadedView {
  ViewSource source;
  View view;
  std::optional<ColorImage> color;
  std::string file_stem;  ///< a name for files, different for every view
};

class SceneWriter {
 public:
  virtual ~SceneWriter() = default;
  /// Called for several views at a time: what needs no order (encoding images into files of their own).
  virtual void write_files(const LoadedView&) {}
  /// Called in the order of the views.
  virtual void add(const LoadedView& loaded) = 0;
  /// The result is complete under its name.
  virtual void finish() = 0;
};

// Files.
std::unique_ptr<SceneWriter> make_e57_writer(const std::filesystem::path& file);
std::unique_ptr<SceneWriter> make_ptx_writer(const std::filesystem::path& file);
// Folders. They are written where the caller says, and moved into place by it.
std::unique_ptr<SceneWriter> make_manifest_writer(const std::filesystem::path& folder);
std::unique_ptr<SceneWriter> make_tum_writer(const std::filesystem::path& folder, Context& context);
std::unique_ptr<SceneWriter> make_redwood_writer(const std::filesystem::path& folder, Context& context);
std::unique_ptr<SceneWriter> make_nerfstudio_writer(const std::filesystem::path& folder, Context& context);
std::unique_ptr<SceneWriter> make_pcd_writer(const std::filesystem::path& folder);

/// True where a view's colour image is pixel by pixel that of its range image.
bool has_registered_color(const LoadedView& loaded);

}  // namespace lapseam
