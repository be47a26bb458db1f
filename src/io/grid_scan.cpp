#include "io/grid_scan.h"

#include <algorithm>

#include "io/e57/e57.h"
#include "io/pcd.h"
#include "io/ptx.h"

namespace lapseam {
namespace {

std::vector<GridSample> collect(const GridScan& scan, ScanChannel channel, std::vector<Rgb8>* colors,
                                MissingSamples* missing) {
  std::vector<GridSample> samples;
  const MissingSamples counted = scan.visit(channel, [&](const GridSample& sample, Rgb8 color) {
    samples.push_back(sample);
    if (colors) colors->push_back(color);
  });
  if (missing) *missing = counted;
  return samples;
}

/// The scan's samples with a pixel each, whether the file gives them one or not.
void visit_pixels(const Source& source, const GridScan& scan, ScanChannel channel, MissingSamples& missing,
                  const GridScan::Visit& visit) {
  if (scan.size()) {
    missing = scan.visit(channel, visit);
    return;
  }
  std::vector<Rgb8> colors;
  std::vector<GridSample> samples = collect(scan, channel, &colors, &missing);
  make_polar_grid(source, samples);
  for (std::size_t i = 0; i < samples.size(); ++i)
    samples[i].u >= 0 ? visit(samples[i], colors[i]) : void(++missing.surplus);
}

Sensor find_sensor(const Source& source, const GridScan& scan, Context& context) {
  if (const auto size = scan.size()) {
    const SamplePieces samples{scan.pieces(),
                               [&](std::size_t piece, const VisitSample& visit) { scan.visit_piece(piece, visit); }};
    return fit_grid_sensor(source, *size, samples, context);
  }
  // Without a place to look from, points have no directions.
  if (!scan.T_world_scan())
    source.refuse("points", "have neither rows and columns nor a pose: nothing says how they were scanned");
  std::vector<GridSample> samples = collect(scan, ScanChannel::kNone, nullptr, nullptr);
  return make_polar_grid(source, samples);
}

}  // namespace

void GridScan::visit_piece(std::size_t, const VisitSample& visit) const {
  this->visit(ScanChannel::kNone, [&](const GridSample& sample, Rgb8) { visit(sample); });
}

std::unique_ptr<GridScan> open_scan(const Source& source, RangeFormat format, std::uint32_t index, std::uint64_t offset,
                                    std::optional<ImageSize> known_size, Context* context) {
  switch (format) {
    case RangeFormat::kE57:
      return open_e57_scan(source, index, known_size, context);
    case RangeFormat::kPtx:
      return open_ptx_scan(source, index, offset);
    case RangeFormat::kPcd:
      return open_pcd(source);
    default:
      source.refuse("range", "holds no scans");
  }
}

bool holds_scans(RangeFormat format) {
  return format == RangeFormat::kE57 || format == RangeFormat::kPtx || format == RangeFormat::kPcd;
}

void complete_from_scan(const Source& source, const GridScan& scan, ViewDraft& draft, Context& context) {
  ViewSource& view = draft.view;
  if (view.sensor) source.refuse("sensor", "a scan is its own sensor; its model must be in_file");
  view.sensor = find_sensor(source, scan, context);
  if (!draft.has_pose) {
    // A grid alone, without a pose, is one view at the world's origin.
    view.T_world_view = scan.T_world_scan().value_or(Eigen::Isometry3d::Identity());
    draft.has_pose = true;
  }
  if (view.color || !scan.has_color()) return;
  view.color.emplace();
  view.color->file = view.range.file;
  view.color->index = view.range.index;
  view.color->offset = view.range.offset;
  view.color->camera = *view.sensor;
}

void load_scan(const Source& source, const GridScan& scan, const std::optional<Sensor>& sensor, View& view) {
  if (sensor) {
    view.sensor = *sensor;
  } else {
    Context context(1);
    view.sensor = find_sensor(source, scan, context);
  }
  view.range = RangeImage(width(view.sensor), height(view.sensor), kInvalidRange);
  if (scan.has_intensity()) view.intensity = Image<std::uint8_t>(view.range.width, view.range.height, 0);
  const ScanChannel channel = scan.has_intensity() ? ScanChannel::kIntensity : ScanChannel::kNone;
  std::uint64_t samples = 0;
  visit_pixels(source, scan, channel, view.missing, [&](const GridSample& sample, Rgb8 intensity) {
    if (sample.u >= view.range.width || sample.v >= view.range.height)
      source.refuse("points", "the file has changed while it was read");
    float& r = view.range.at(sample.u, sample.v);
    r = range_of(view.sensor, sample);
    if (!view.intensity.pixels.empty()) view.intensity.at(sample.u, sample.v) = intensity.r;
    r > 0 ? ++samples : ++view.missing.negative;
  });
  const MissingSamples& m = view.missing;
  const std::uint64_t told = samples + m.zero + m.negative + m.not_finite + m.named + m.flagged;
  view.missing.absent = view.range.size() - std::min<std::uint64_t>(told, view.range.size());
}

ColorImage load_scan_color(const Source& source, const GridScan& scan, const Sensor& camera) {
  if (!scan.has_color()) source.refuse("color", "the scan has no colours");
  ColorImage image(width(camera), height(camera));
  MissingSamples ignored;
  visit_pixels(source, scan, ScanChannel::kColor, ignored, [&](const GridSample& sample, Rgb8 color) {
    if (sample.u < image.width && sample.v < image.height) image.at(sample.u, sample.v) = color;
  });
  return image;
}

}  // namespace lapseam
