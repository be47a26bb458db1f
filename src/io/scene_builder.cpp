#include <algorithm>

#include "io/codecs.h"
#include "io/colmap.h"
#include "io/e57/e57.h"
#include "io/exr.h"
#include "io/grid_scan.h"
#include "io/npy.h"
#include "io/range_grid.h"
#include "io/scene_formats.h"
#include "lapseam/context.h"

namespace lapseam {
namespace {

void check_exists(const Source& source, const std::string& field) {
  std::error_code ignored;
  if (!std::filesystem::exists(source.file, ignored)) source.refuse(field, "no such file");
  if (!std::filesystem::is_regular_file(source.file, ignored)) source.refuse(field, "this is no regular file");
}

void check_sensor_size(const Source& source, const Sensor& sensor, ImageSize size) {
  const ImageSize sensor_size{width(sensor), height(sensor)};
  if (sensor_size != size)
    source.refuse("size", "the range image is " + to_string(size) + ", its sensor " + to_string(sensor_size));
}

void complete_from_png(const Source& source, ViewDraft& draft) {
  const PngProbe probe = probe_png(source);
  if (!probe.is_gray16) source.refuse("range", "a PNG range image must be 16-bit greyscale");
  if (!draft.has_scale) source.refuse("range.scale_m", "missing; a PNG range image needs it (metres per stored unit)");
  if (!draft.view.sensor) source.refuse("sensor", "missing; a PNG range image needs a sensor");
  check_sensor_size(source, *draft.view.sensor, probe.size);
}

void complete_from_exr(const Source& source, ViewDraft& draft) {
  ViewSource& view = draft.view;
  const ExrHeader header = read_exr_header(source);
  choose_range_channel(source, header.channels, view.range.channel);
  if (!view.sensor) view.sensor = header.sensor;
  if (!view.sensor && !header.is_measured_grid)
    source.refuse("sensor", "missing, and the EXR file has no sensor attributes");
  if (view.sensor) check_sensor_size(source, *view.sensor, header.size);
  if (!draft.has_pose && header.T_world_view) {
    view.T_world_view = *header.T_world_view;
    draft.has_pose = true;
  }
  if (!draft.has_quantity && header.quantity) view.range.quantity = *header.quantity;
  if (!header.has_rgb || view.color) return;
  // The colours of a measured grid need its camera before the view is loaded.
  if (!view.sensor) view.sensor = read_exr_measured_grid(source);
  view.color.emplace();
  view.color->file = view.range.file;
  view.color->camera = *view.sensor;
}

void complete_from_grid(const Source& source, const ViewDraft& draft) {
  probe_range_grid(source);
  if (draft.view.sensor) source.refuse("sensor", "a range grid is its own sensor; its model must be in_file");
}

void complete_from_sens(const Source& source, const ViewDraft& draft) {
  if (!draft.has_scale) source.refuse("range.scale_m", "missing; a .sens frame needs it (metres per stored unit)");
  if (!draft.view.sensor) source.refuse("sensor", "missing; a .sens frame needs a sensor");
}

void complete_from_scans(const Source& source, RangeFormat format, ViewDraft& draft, Context& context) {
  RangeSource& range = draft.view.range;
  range.format = format;
  if (draft.has_scale && range.scale_m != 1) source.refuse("range.scale_m", "points are in metres, as they are");
  const std::unique_ptr<GridScan> scan = open_scan(source, format, range.index, range.offset, std::nullopt, &context);
  if (format == RangeFormat::kE57 && !draft.view.color) {
    const Eigen::Isometry3d T_world_scan = scan->T_world_scan().value_or(Eigen::Isometry3d::Identity());
    std::vector<ColorSource> images = find_e57_images(source, range.index, T_world_scan);
    // A pinhole image shows a part of a scan only: the scan's own colours come first then.
    const bool is_panorama = !images.empty() && std::holds_alternative<SphericalSensor>(images[0].camera);
    if (is_panorama || (!images.empty() && !scan->has_color())) {
      draft.view.color = std::move(images[0]);
      images.erase(images.begin());
    }
    draft.view.more_colors = std::move(images);
  }
  complete_from_scan(source, *scan, draft, context);
}

void complete_range(ViewDraft& draft, Context& context) {
  RangeSource& range = draft.view.range;
  const Source source{range.file, draft.view.name};
  check_exists(source, "range.file");
  if (!range.intensity_file.empty()) check_exists({range.intensity_file, draft.view.name}, "range.intensity");
  switch (const FileKind kind = recognise_file(range.file)) {
    case FileKind::kPng:
      range.format = RangeFormat::kPng16;
      complete_from_png(source, draft);
      break;
    case FileKind::kExr:
      range.format = RangeFormat::kExr;
      complete_from_exr(source, draft);
      break;
    case FileKind::kPly:
      range.format = RangeFormat::kStanfordGrid;
      complete_from_grid(source, draft);
      break;
    case FileKind::kE57:
      complete_from_scans(source, RangeFormat::kE57, draft, context);
      break;
    case FileKind::kPtx:
      complete_from_scans(source, RangeFormat::kPtx, draft, context);
      break;
    case FileKind::kPcd:
      complete_from_scans(source, RangeFormat::kPcd, draft, context);
      break;
    case FileKind::kSens:
      range.format = RangeFormat::kSens;
      complete_from_sens(source, draft);
      break;
    case FileKind::kColmapDepth:
      range.format = RangeFormat::kColmapDepth;
      if (!draft.view.sensor) source.refuse("sensor", "missing; a COLMAP depth map needs a sensor");
      check_sensor_size(source, *draft.view.sensor, probe_colmap_depth(source));
      break;
    case FileKind::kNpy:
      range.format = RangeFormat::kNpy;
      if (!draft.view.sensor) source.refuse("sensor", "missing; a .npy range image needs a sensor");
      check_sensor_size(source, *draft.view.sensor, probe_npy(source));
      break;
    default:
      source.refuse("range.file",
                    "a range image is a 16-bit PNG, an EXR, a .npy array, a range-grid PLY, or a scan of an E57, PTX "
                    "or PCD file; this is " +
                        std::string(describe(kind)));
  }
  if (range.format != RangeFormat::kExr && !range.channel.empty())
    source.refuse("range.channel", "only EXR files have channels");
  if (!draft.has_pose) source.refuse("T_world_view", "missing, and the range file holds no pose");
}

void check_color(const ViewSource& view, const ColorSource& color) {
  const Source source{color.file, view.name};
  check_exists(source, "color.file");
  const bool is_own = holds_scans(view.range.format) && color.file == view.range.file && color.index < kImageOfFile;
  if (is_own) return;  // its camera is the scan's sensor
  if (view.range.format == RangeFormat::kSens && color.file == view.range.file) return;  // so says its header
  const ImageSize size = probe_color_size(source, color.index);
  const ImageSize camera_size{width(color.camera), height(color.camera)};
  if (size != camera_size)
    source.refuse("color", "the image is " + to_string(size) + ", its camera " + to_string(camera_size));
}

}  // namespace

SceneBuilder::SceneBuilder(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context)
    : options_(options), context_(context) {
  scene_.file = file;
}

void SceneBuilder::check_name(const ViewSource& view) const {
  for (const ViewSource& other : scene_.views)
    if (other.name == view.name) throw InvalidInput(scene_.file, view.name, "name", "another view has this name");
}

void SceneBuilder::add(const std::function<ViewDraft()>& make) {
  context_.throw_if_cancelled();
  try {
    ViewDraft draft = make();
    check_name(draft.view);
    complete_range(draft, context_);
    if (draft.view.color) check_color(draft.view, *draft.view.color);
    for (const ColorSource& color : draft.view.more_colors) check_color(draft.view, color);
    scene_.views.push_back(std::move(draft.view));
  } catch (const Cancelled&) {
    throw;
  } catch (const Error& error) {
    if (!options_.skip_bad_views) throw;
    if (first_problem_.empty()) first_problem_ = error.what();
    context_.warn(std::string("view left out: ") + error.what());
  }
}

namespace {

/// Whether two views are taken to be of one sensor, and so to have one noise. What is found in points differs in the
/// last digits from scan to scan, and real scanners never start at the same angle.
bool is_one_sensor(const ViewSource& a, const ViewSource& b) {
  if (!a.sensor || !b.sensor) return !a.sensor && !b.sensor;
  if (holds_scans(a.range.format) && holds_scans(b.range.format))
    return a.sensor->index() == b.sensor->index() && width(*a.sensor) == width(*b.sensor) &&
           height(*a.sensor) == height(*b.sensor);
  return is_same_sensor(*a.sensor, *b.sensor);
}

}  // namespace

void SceneBuilder::assign_sensor_ids() {
  const auto is_taken = [&](const std::string& id) {
    return std::any_of(scene_.views.begin(), scene_.views.end(),
                       [&](const auto& view) { return view.sensor_id == id; });
  };
  std::vector<const ViewSource*> named;  // one view for each id given here
  for (ViewSource& view : scene_.views) {
    if (!view.sensor_id.empty()) continue;
    const auto same =
        std::find_if(named.begin(), named.end(), [&](const ViewSource* other) { return is_one_sensor(view, *other); });
    if (same != named.end()) {
      view.sensor_id = (*same)->sensor_id;
      continue;
    }
    const std::string stem = view.sensor ? std::string(kind_name(*view.sensor)) : kRangeGridSensorId;
    std::string id = stem;
    for (int i = 2; is_taken(id); ++i) id = stem + "-" + std::to_string(i);
    view.sensor_id = id;
    named.push_back(&view);
  }
}

Scene SceneBuilder::finish() {
  if (scene_.views.empty()) {
    const std::string detail = first_problem_.empty() ? "" : "; the first problem: " + first_problem_;
    throw InvalidInput(scene_.file, {}, "views", "there is no usable view" + detail);
  }
  assign_sensor_ids();
  return std::move(scene_);
}

}  // namespace lapseam
