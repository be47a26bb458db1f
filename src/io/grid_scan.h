#pragma once

// A scan of a file that holds points rather than ranges (E57, PTX, PCD): what its reader offers, and how a view comes
// of it. Scans are streamed; what is kept are ranges.

#include <memory>
#include <optional>

#include "io/grid_sensor.h"
#include "io/scene_formats.h"

namespace lapseam {

/// What is to be read along with the places of the samples; it may cost time.
enum class ScanChannel { kNone, kColor, kIntensity };

class GridScan {
 public:
  /// A valid sample (u = −1 without a grid) and its colour, or its intensity as grey; black where the scan has none.
  using Visit = std::function<void(const GridSample&, Rgb8)>;

  virtual ~GridScan() = default;
  /// Nothing where points have no rows and columns.
  virtual std::optional<ImageSize> size() const = 0;
  virtual std::optional<Eigen::Isometry3d> T_world_scan() const = 0;
  virtual bool has_color() const = 0;
  virtual bool has_intensity() const { return false; }
  /// The valid samples in the file's order, the first of each pixel. Counts the others; `absent` is left to the caller.
  virtual MissingSamples visit(ScanChannel channel, const Visit& visit) const = 0;
  /// How many pieces there are that may be visited side by side; together they are all valid samples.
  virtual std::size_t pieces() const { return 1; }
  virtual void visit_piece(std::size_t piece, const VisitSample& visit) const;
};

/// The format's own scan, by RangeSource::format, index and offset. Opening may pass over all points to find the grid's
/// size, in parallel where there is a context; not where the size is known from before.
std::unique_ptr<GridScan> open_scan(const Source& source, RangeFormat format, std::uint32_t index, std::uint64_t offset,
                                    std::optional<ImageSize> known_size, Context* context);
bool holds_scans(RangeFormat format);

/// Finds sensor and pose of the draft's scan, and its colours where there is no other colour image.
void complete_from_scan(const Source& source, const GridScan& scan, ViewDraft& draft, Context& context);
/// Range image, intensities and counts; view.sensor is the one that complete_from_scan has found, or is found now.
void load_scan(const Source& source, const GridScan& scan, const std::optional<Sensor>& sensor, View& view);
/// The scan's own colours, in its grid.
ColorImage load_scan_color(const Source& source, const GridScan& scan, const Sensor& camera);

}  // namespace lapseam
