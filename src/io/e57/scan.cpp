// A scan of an E57 file: records to samples.

#include <algorithm>
#include <atomic>
#include <cmath>

#include "core/parallel.h"
#include "io/e57/compressed_vector.h"
#include "io/e57/e57.h"

namespace lapseam {
namespace {

// Empty cells beyond this many a record are no scan; small grids are let through.
constexpr double kCellsPerRecord = 64, kAlwaysFineCells = 65536;

/// A stored colour or intensity to 8 bits, between the limits that the file gives it.
struct Shade {
  double minimum = 0, scale = 0;

  std::uint8_t operator()(double value) const {
    const double shade = (value - minimum) * scale;
    return shade > 0 ? std::uint8_t(std::lround(std::min(shade, 255.0))) : std::uint8_t(0);
  }
};

/// The fields that make a colour, or the one of the intensity, and the field that says which are invalid.
struct Shades {
  std::array<int, 3> field{-1, -1, -1};
  std::array<Shade, 3> shade;
  std::size_t count = 0;
  int state = -1;
};

// Scans are visited in pieces of at least so many records, and in no more pieces than that: each costs the fitting a
// table.
constexpr std::uint64_t kPieceRecords = 1 << 18, kMostPieces = 64;

/// A set of pixels, filled from several threads.
class PixelSet {
 public:
  explicit PixelSet(std::size_t pixels) : words_(pixels / 64 + 1) {}

  /// True if it was there already.
  bool add(std::size_t pixel) {
    const std::uint64_t bit = std::uint64_t(1) << pixel % 64;
    return words_[pixel / 64].fetch_or(bit, std::memory_order_relaxed) & bit;
  }

 private:
  std::vector<std::atomic<std::uint64_t>> words_;
};

class E57GridScan : public GridScan {
 public:
  E57GridScan(const Source& source, E57Scan scan, std::optional<ImageSize> known_size, Context* context)
      : source_(source), scan_(std::move(scan)) {
    if (scan_.record_count == 0) source_.refuse("points", "the scan has no points");
    choose_coordinates();
    choose_colors();
    row_ = scan_.find("rowIndex");
    column_ = scan_.find("columnIndex");
    if (row_ < 0 || column_ < 0) return;
    first_row_ = scan_.rows ? scan_.rows->minimum : 0;
    first_column_ = scan_.columns ? scan_.columns->minimum : 0;
    size_ = known_size;
    if (size_) return;
    if (context) {
      find_size(*context);
    } else {
      Context alone(1);
      find_size(alone);
    }
  }

  std::optional<ImageSize> size() const override { return size_; }
  std::optional<Eigen::Isometry3d> T_world_scan() const override { return scan_.T_world_scan; }
  bool has_color() const override { return colors_.count > 0; }
  bool has_intensity() const override { return intensity_.count > 0; }

  MissingSamples visit(ScanChannel channel, const Visit& visit) const override {
    return visit_records(channel, {0, scan_.record_count}, true, visit);
  }

  std::size_t pieces() const override { return pieces_; }

  void visit_piece(std::size_t piece, const VisitSample& visit) const override {
    // Several pieces there are only where no pixel has two returns.
    visit_records(ScanChannel::kNone, piece_range(piece), pieces_ == 1,
                  [&](const GridSample& sample, Rgb8) { visit(sample); });
  }

 private:
  RecordRange piece_range(std::size_t piece) const {
    return {scan_.record_count * piece / pieces_, scan_.record_count * (piece + 1) / pieces_};
  }

  E57Records records_of(PagedFile& file, std::vector<int> wanted, RecordRange range) const {
    if (range.begin == 0 && range.end == scan_.record_count) return {file, scan_, std::move(wanted)};
    return {file, scan_, std::move(wanted), index_, range};
  }

  /// Samples of some records, in order; of several in one pixel the first, if that is asked for.
  template <typename VisitRecord>
  MissingSamples visit_records(ScanChannel channel, RecordRange range, bool is_first_only,
                               const VisitRecord& visit) const {
    std::vector<int> wanted = coordinates_;
    const auto want = [&](int field) {
      if (field < 0) return -1;
      wanted.push_back(field);
      return int(wanted.size()) - 1;
    };
    const Shades& shades = channel == ScanChannel::kIntensity ? intensity_ : colors_;
    const std::size_t color_count = channel == ScanChannel::kNone ? 0 : shades.count;
    const int state = want(state_), row = size_ ? want(row_) : -1, column = size_ ? want(column_) : -1;
    std::array<int, 3> colors{-1, -1, -1};
    for (std::size_t k = 0; k < color_count; ++k) colors[k] = want(shades.field[k]);
    const int color_state = want(color_count > 0 ? shades.state : -1);

    PagedFile file(source_);
    E57Records records = records_of(file, wanted, range);
    MissingSamples missing;
    std::vector<bool> seen(size_ && is_first_only ? std::size_t(size_->width) * std::size_t(size_->height) : 0);
    GridSample sample;
    sample.is_polar = is_polar_;
    while (const std::size_t count = records.next()) {
      const std::array<const double*, 3> stored{records.column(0).data(), records.column(1).data(),
                                                records.column(2).data()};
      const double* states = state >= 0 ? records.column(std::size_t(state)).data() : nullptr;
      const double* rows = size_ ? records.column(std::size_t(row)).data() : nullptr;
      const double* columns = size_ ? records.column(std::size_t(column)).data() : nullptr;
      for (std::size_t i = 0; i < count; ++i) {
        sample.u = sample.v = -1;
        if (size_) set_pixel(columns[i], rows[i], sample);
        sample.stored = {stored[0][i], stored[1][i], stored[2][i]};
        if (states && states[i] != 0) {
          ++missing.flagged;
        } else if (!sample.stored.allFinite()) {
          ++missing.not_finite;
        } else if (is_polar_ ? sample.stored.z() == 0 : sample.stored.isZero(0)) {
          ++missing.zero;
        } else if (is_polar_ && sample.stored.z() < 0) {
          ++missing.negative;
        } else if (!seen.empty() && is_seen(seen, sample)) {
          ++missing.surplus;
        } else {
          const bool is_colored = color_state < 0 || records.column(std::size_t(color_state))[i] == 0;
          visit(sample, is_colored && color_count > 0 ? to_color(shades, records, colors, i) : Rgb8{});
        }
      }
    }
    return missing;
  }

  void set_pixel(double column, double row, GridSample& sample) const {
    const double u = column - first_column_, v = row - first_row_;
    if (!(u >= 0 && v >= 0 && u < size_->width && v < size_->height))
      source_.refuse("points", "the file has changed while it was read");
    sample.u = int(u);
    sample.v = int(v);
  }

  void choose_coordinates() {
    const auto all = [&](std::initializer_list<const char*> names) {
      coordinates_.clear();
      for (const char* name : names) {
        const int field = scan_.find(name);
        if (field >= 0 && scan_.fields[std::size_t(field)].kind != E57Field::Kind::kString)
          coordinates_.push_back(field);
      }
      return coordinates_.size() == names.size();
    };
    if (all({"cartesianX", "cartesianY", "cartesianZ"})) {
      state_ = scan_.find("cartesianInvalidState");
    } else if (all({"sphericalAzimuth", "sphericalElevation", "sphericalRange"})) {
      is_polar_ = true;
      state_ = scan_.find("sphericalInvalidState");
    } else {
      source_.refuse("points.prototype", "has neither cartesianX, Y, Z nor sphericalRange, Azimuth, Elevation");
    }
  }

  void add_shade(Shades& shades, int field, const std::optional<E57Limits>& limits) const {
    const E57Field& packed = scan_.fields[std::size_t(field)];
    E57Limits range{0, 1};
    if (limits && limits->maximum > limits->minimum) {
      range = *limits;
    } else if (packed.kind == E57Field::Kind::kInteger) {
      range = {double(packed.minimum), double(packed.maximum)};
    } else if (packed.kind == E57Field::Kind::kScaledInteger) {
      range = {double(packed.minimum) * packed.scale + packed.offset,
               double(packed.maximum) * packed.scale + packed.offset};
    }
    shades.field[shades.count] = field;
    shades.shade[shades.count++] = {range.minimum,
                                    range.maximum > range.minimum ? 255 / (range.maximum - range.minimum) : 0};
  }

  /// Red, green and blue; or the intensity, as grey. And the intensity by itself.
  void choose_colors() {
    const std::array<int, 3> rgb{scan_.find("colorRed"), scan_.find("colorGreen"), scan_.find("colorBlue")};
    if (rgb[0] >= 0 && rgb[1] >= 0 && rgb[2] >= 0) {
      for (std::size_t k = 0; k < 3; ++k) add_shade(colors_, rgb[k], scan_.color[k]);
      colors_.state = scan_.find("isColorInvalid");
    }
    if (const int intensity = scan_.find("intensity"); intensity >= 0) {
      add_shade(intensity_, intensity, scan_.intensity);
      intensity_.state = scan_.find("isIntensityInvalid");
    }
    if (colors_.count == 0) colors_ = intensity_;
  }

  static Rgb8 to_color(const Shades& shades, const E57Records& records, const std::array<int, 3>& columns,
                       std::size_t i) {
    std::array<std::uint8_t, 3> c{};
    for (std::size_t k = 0; k < shades.count; ++k) c[k] = shades.shade[k](records.column(std::size_t(columns[k]))[i]);
    return shades.count == 3 ? Rgb8{c[0], c[1], c[2]} : Rgb8{c[0], c[0], c[0]};
  }

  struct Extent {
    double last_row = 0, last_column = 0;
    bool has_twice = false;  ///< a pixel has two records
  };

  /// What the records have, and what lies in `seen` twice, of a grid of this size.
  Extent find_extent(Extent extent, ImageSize size, PixelSet* seen, Context& context) const {
    std::vector<Extent> parts(pieces_, extent);
    parallel_for(context, pieces_, 1, [&](std::size_t piece) {
      PagedFile file(source_);
      E57Records records = records_of(file, {row_, column_}, piece_range(piece));
      Extent& part = parts[piece];
      while (const std::size_t count = records.next()) {
        const double *rows = records.column(0).data(), *columns = records.column(1).data();
        for (std::size_t i = 0; i < count; ++i) {
          const double v = rows[i] - first_row_, u = columns[i] - first_column_;
          if (!(v >= 0) || !(u >= 0)) source_.refuse("points", "a rowIndex or columnIndex lies before the first one");
          part.last_row = std::max(part.last_row, rows[i]);
          part.last_column = std::max(part.last_column, columns[i]);
          if (seen && u < size.width && v < size.height)
            part.has_twice |= seen->add(std::size_t(v) * std::size_t(size.width) + std::size_t(u));
        }
      }
    });
    for (const Extent& part : parts) {
      extent.last_row = std::max(extent.last_row, part.last_row);
      extent.last_column = std::max(extent.last_column, part.last_column);
      extent.has_twice |= part.has_twice;
    }
    return extent;
  }

  /// Nothing where it would be no scan's.
  std::optional<ImageSize> size_of(const Extent& extent) const {
    const double width = extent.last_column - first_column_ + 1, height = extent.last_row - first_row_ + 1;
    const double most = std::min(kCellsPerRecord * double(scan_.record_count) + kAlwaysFineCells, double(kMaxPixels));
    if (!(width >= 1 && height >= 1 && width * height <= most)) return std::nullopt;
    return ImageSize{int(width), int(height)};
  }

  /// The grid spans what indexBounds declares and what the records have; without bounds it begins at 0. Pieces may be
  /// visited side by side if no pixel has two records.
  void find_size(Context& context) {
    pieces_ = std::size_t(std::clamp<std::uint64_t>(scan_.record_count / kPieceRecords, 1, kMostPieces));
    if (pieces_ > 1) {
      constexpr std::uint64_t kBlockPages = 2;  // headers lie far apart
      PagedFile file(source_, kBlockPages);
      index_ = index_packets(file, scan_);
    }
    Extent extent{scan_.rows ? scan_.rows->maximum : 0, scan_.columns ? scan_.columns->maximum : 0};
    const std::optional<ImageSize> declared = size_of(extent);
    // Where the bounds tell the truth, one pass answers both questions.
    const auto pass = [&](std::optional<ImageSize> size) {
      std::optional<PixelSet> seen;
      if (pieces_ > 1 && size) seen.emplace(std::size_t(size->width) * std::size_t(size->height));
      extent = find_extent(extent, size.value_or(ImageSize{}), seen ? &*seen : nullptr, context);
    };
    pass(declared);
    size_ = size_of(extent);
    if (!size_) {
      const double width = extent.last_column - first_column_ + 1, height = extent.last_row - first_row_ + 1;
      const auto number = [](double value) { return std::to_string(std::int64_t(std::clamp(value, -1e18, 1e18))); };
      source_.refuse("indexBounds", "rows and columns make a grid of " + number(width) + " x " + number(height) +
                                        " for " + std::to_string(scan_.record_count) + " points");
    }
    if (pieces_ > 1 && size_ != declared) pass(size_);
    if (extent.has_twice) pieces_ = 1;
  }

  /// Several returns may share a pixel; the first in the file stands for it.
  bool is_seen(std::vector<bool>& seen, const GridSample& sample) const {
    const std::size_t i = std::size_t(sample.v) * std::size_t(size_->width) + std::size_t(sample.u);
    const bool was = seen[i];
    seen[i] = true;
    return was;
  }

  Source source_;
  E57Scan scan_;
  E57Index index_;  ///< where there are several pieces
  std::size_t pieces_ = 1;
  std::vector<int> coordinates_;
  bool is_polar_ = false;
  int state_ = -1, row_ = -1, column_ = -1;
  Shades colors_, intensity_;
  double first_row_ = 0, first_column_ = 0;
  std::optional<ImageSize> size_;
};

std::string view_name(const E57Scan& scan, std::size_t index) {
  return scan.name.empty() ? "scan " + std::to_string(index + 1) : scan.name;
}

}  // namespace

std::unique_ptr<GridScan> open_e57_scan(const Source& source, std::uint32_t index, std::optional<ImageSize> known_size,
                                        Context* context) {
  PagedFile file(source);
  E57Document document = read_e57_document(file);
  if (index >= document.scans.size())
    source.refuse("range.index", "there is no scan " + std::to_string(index) + "; the file has " +
                                     std::to_string(document.scans.size()));
  return std::make_unique<E57GridScan>(source, std::move(document.scans[index]), known_size, context);
}

Scene read_e57(const std::filesystem::path& path, const ReadSceneOptions& options, Context& context) {
  const Source source{path, {}};
  check_e57_pages(source, context);
  PagedFile file(source);
  const E57Document document = read_e57_document(file);
  if (document.scans.empty()) {
    const std::size_t images = document.images.size();
    source.refuse("data3D", images > 0 ? "the file holds " + std::to_string(images) + " images and no scan"
                                       : "the file is empty: it holds no scan");
  }
  SceneBuilder builder(path, options, context);
  builder.set_name(path.stem().string());
  std::vector<std::string> names;
  for (std::size_t i = 0; i < document.scans.size(); ++i) {
    std::string name = view_name(document.scans[i], i);
    // Names are free text in these files, and may be given twice.
    if (std::find(names.begin(), names.end(), name) != names.end()) name += " (" + std::to_string(i + 1) + ")";
    names.push_back(name);
    builder.add([&] {
      ViewDraft draft;
      draft.view.name = name;
      draft.view.range.file = path;
      draft.view.range.format = RangeFormat::kE57;
      draft.view.range.index = std::uint32_t(i);
      return draft;
    });
  }
  return builder.finish();
}

}  // namespace lapseam
