// A scan of an E57 file: records to samples.

#include <algorithm>
#include <cmath>

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

class E57GridScan : public GridScan {
 public:
  E57GridScan(const Source& source, PagedFile file, E57Scan scan)
      : source_(source), file_(std::move(file)), scan_(std::move(scan)) {
    if (scan_.record_count == 0) source_.refuse("points", "the scan has no points");
    choose_coordinates();
    choose_colors();
    row_ = scan_.find("rowIndex");
    column_ = scan_.find("columnIndex");
    if (row_ >= 0 && column_ >= 0) find_size();
  }

  std::optional<ImageSize> size() const override { return size_; }
  std::optional<Eigen::Isometry3d> T_world_scan() const override { return scan_.T_world_scan; }
  bool has_color() const override { return color_count_ > 0; }

  MissingSamples visit(const Visit& visit) const override {
    std::vector<int> wanted = coordinates_;
    const auto want = [&](int field) {
      if (field < 0) return -1;
      wanted.push_back(field);
      return int(wanted.size()) - 1;
    };
    const int state = want(state_), row = size_ ? want(row_) : -1, column = size_ ? want(column_) : -1;
    std::array<int, 3> colors{-1, -1, -1};
    for (std::size_t k = 0; k < color_count_; ++k) colors[k] = want(colors_[k]);
    const int color_state = want(color_count_ > 0 ? color_state_ : -1);

    PagedFile file(source_);
    E57Records records(file, scan_, wanted);
    MissingSamples missing;
    std::vector<bool> seen(size_ ? std::size_t(size_->width) * std::size_t(size_->height) : 0);
    GridSample sample;
    sample.is_polar = is_polar_;
    while (const std::size_t count = records.next()) {
      for (std::size_t i = 0; i < count; ++i) {
        sample.u = sample.v = -1;
        if (size_) {
          sample.u = int(records.column(std::size_t(column))[i] - first_column_);
          sample.v = int(records.column(std::size_t(row))[i] - first_row_);
        }
        for (int axis = 0; axis < 3; ++axis) sample.stored[axis] = records.column(std::size_t(axis))[i];
        if (state >= 0 && records.column(std::size_t(state))[i] != 0) {
          ++missing.flagged;
        } else if (!sample.stored.allFinite()) {
          ++missing.not_finite;
        } else if (is_polar_ ? sample.stored.z() == 0 : sample.stored.isZero(0)) {
          ++missing.zero;
        } else if (is_polar_ && sample.stored.z() < 0) {
          ++missing.negative;
        } else if (size_ && is_seen(seen, sample)) {
          ++missing.surplus;
        } else {
          const bool is_colored = color_state < 0 || records.column(std::size_t(color_state))[i] == 0;
          visit(sample, is_colored ? to_color(records, colors, i) : Rgb8{});
        }
      }
    }
    return missing;
  }

 private:
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

  void add_shade(int field, const std::optional<E57Limits>& limits) {
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
    colors_[color_count_] = field;
    shades_[color_count_++] = {range.minimum,
                               range.maximum > range.minimum ? 255 / (range.maximum - range.minimum) : 0};
  }

  /// Red, green and blue; or the intensity, as grey.
  void choose_colors() {
    const std::array<int, 3> rgb{scan_.find("colorRed"), scan_.find("colorGreen"), scan_.find("colorBlue")};
    if (rgb[0] >= 0 && rgb[1] >= 0 && rgb[2] >= 0) {
      for (std::size_t k = 0; k < 3; ++k) add_shade(rgb[k], scan_.color[k]);
      color_state_ = scan_.find("isColorInvalid");
    } else if (const int intensity = scan_.find("intensity"); intensity >= 0) {
      add_shade(intensity, scan_.intensity);
      color_state_ = scan_.find("isIntensityInvalid");
    }
  }

  Rgb8 to_color(const E57Records& records, const std::array<int, 3>& columns, std::size_t i) const {
    if (color_count_ == 0) return {};
    std::array<std::uint8_t, 3> c{};
    for (std::size_t k = 0; k < color_count_; ++k) c[k] = shades_[k](records.column(std::size_t(columns[k]))[i]);
    return color_count_ == 3 ? Rgb8{c[0], c[1], c[2]} : Rgb8{c[0], c[0], c[0]};
  }

  /// The grid spans what indexBounds declares and what the records have; without bounds it begins at 0.
  void find_size() {
    first_row_ = scan_.rows ? scan_.rows->minimum : 0;
    first_column_ = scan_.columns ? scan_.columns->minimum : 0;
    double last_row = scan_.rows ? scan_.rows->maximum : 0, last_column = scan_.columns ? scan_.columns->maximum : 0;
    E57Records records(file_, scan_, {row_, column_});
    while (const std::size_t count = records.next()) {
      for (std::size_t i = 0; i < count; ++i) {
        const double row = records.column(0)[i], column = records.column(1)[i];
        if (!(row >= first_row_) || !(column >= first_column_))
          source_.refuse("points", "a rowIndex or columnIndex lies before the first one");
        last_row = std::max(last_row, row);
        last_column = std::max(last_column, column);
      }
    }
    const double width = last_column - first_column_ + 1, height = last_row - first_row_ + 1;
    const double most = std::min(kCellsPerRecord * double(scan_.record_count) + kAlwaysFineCells, double(kMaxPixels));
    if (!(width >= 1 && height >= 1 && width * height <= most))
      source_.refuse("indexBounds", "rows and columns make a grid of " + std::to_string(std::int64_t(width)) + " x " +
                                        std::to_string(std::int64_t(height)) + " for " +
                                        std::to_string(scan_.record_count) + " points");
    size_ = ImageSize{int(width), int(height)};
  }

  /// Several returns may share a pixel; the first in the file stands for it.
  bool is_seen(std::vector<bool>& seen, const GridSample& sample) const {
    const std::size_t i = std::size_t(sample.v) * std::size_t(size_->width) + std::size_t(sample.u);
    const bool was = seen[i];
    seen[i] = true;
    return was;
  }

  Source source_;
  PagedFile file_;
  E57Scan scan_;
  std::vector<int> coordinates_;
  bool is_polar_ = false;
  int state_ = -1, row_ = -1, column_ = -1, color_state_ = -1;
  std::array<int, 3> colors_{-1, -1, -1};
  std::array<Shade, 3> shades_;
  std::size_t color_count_ = 0;
  double first_row_ = 0, first_column_ = 0;
  std::optional<ImageSize> size_;
};

std::string view_name(const E57Scan& scan, std::size_t index) {
  return scan.name.empty() ? "scan " + std::to_string(index + 1) : scan.name;
}

}  // namespace

std::unique_ptr<GridScan> open_e57_scan(const Source& source, std::uint32_t index) {
  PagedFile file(source);
  E57Document document = read_e57_document(file);
  if (index >= document.scans.size())
    source.refuse("range.index", "there is no scan " + std::to_string(index) + "; the file has " +
                                     std::to_string(document.scans.size()));
  return std::make_unique<E57GridScan>(source, std::move(file), std::move(document.scans[index]));
}

Scene read_e57(const std::filesystem::path& path, const ReadSceneOptions& options, Context& context) {
  const Source source{path, {}};
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
