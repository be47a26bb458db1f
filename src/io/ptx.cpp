// A scan is ten lines (columns, rows, the scanner's place and its three axes, a 4 × 4 matrix for row vectors), then a
// line `x y z intensity [red green blue]` per pixel, column by column, each from its lowest row up.

#include "io/ptx.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "io/line_reader.h"
#include "io/rigid.h"
#include "io/text_scan.h"

namespace lapseam {
namespace {

/// All numbers of a line; nothing when there are not exactly `count`, or a word is no number.
template <std::size_t kCount>
bool parse_line(std::string_view line, std::array<double, kCount>& numbers) {
  for (double& number : numbers) {
    const auto value = parse_number<double>(take_word(line));
    if (!value) return false;
    number = *value;
  }
  return take_word(line).empty();
}

struct Header {
  ImageSize size;
  Eigen::Isometry3d T_world_scan;
};

std::string place_of(const LineReader& lines) { return "line " + std::to_string(lines.line_number()) + " of the scan"; }

int read_count(const Source& source, LineReader& lines, const char* name) {
  std::string_view line;
  if (!lines.next(line)) source.refuse(name, "the file is truncated");
  std::string_view words = line;
  const auto count = parse_number<std::int64_t>(take_word(words));
  if (!count || *count < 1 || *count > 1 << 30 || !take_word(words).empty())
    source.refuse(name, "'" + std::string(line.substr(0, 40)) + "' is no number of " + name);
  return int(*count);
}

Header read_header(const Source& source, LineReader& lines) {
  Header header;
  header.size.width = read_count(source, lines, "columns");
  header.size.height = read_count(source, lines, "rows");
  // A line of the shortest sample has eight bytes.
  check_image_size(source, std::uint64_t(header.size.width), std::uint64_t(header.size.height),
                   file_size_bytes(source.file), 1);
  std::string_view line;
  std::array<double, 3> vector;
  for (int i = 0; i < 4; ++i)
    if (!lines.next(line) || !parse_line(line, vector))
      source.refuse(place_of(lines), "expected three numbers: the scanner's place or an axis");
  Eigen::Matrix4d matrix;
  for (int column = 0; column < 4; ++column) {
    std::array<double, 4> numbers;
    if (!lines.next(line) || !parse_line(line, numbers))
      source.refuse(place_of(lines), "expected four numbers: a row of the matrix");
    matrix.col(column) = Eigen::Map<const Eigen::Vector4d>(numbers.data());
  }
  // Six digits a number: rotations are off by up to 1e-6.
  header.T_world_scan = to_rigid(matrix, source, "matrix");
  return header;
}

std::uint8_t to_shade(double value) { return std::uint8_t(std::lround(std::clamp(value, 0.0, 255.0))); }

class PtxScan : public GridScan {
 public:
  PtxScan(const Source& source, std::uint64_t offset) : source_(source) {
    LineReader lines(source_, offset);
    header_ = read_header(source_, lines);
    body_offset_ = lines.offset();
  }

  std::optional<ImageSize> size() const override { return header_.size; }
  std::optional<Eigen::Isometry3d> T_world_scan() const override { return header_.T_world_scan; }
  bool has_color() const override { return true; }  // the intensity is one
  bool has_intensity() const override { return true; }
  std::uint64_t body_offset() const { return body_offset_; }

  MissingSamples visit(ScanChannel channel, const Visit& visit) const override {
    LineReader lines(source_, body_offset_);
    MissingSamples missing;
    GridSample sample;
    for (sample.u = 0; sample.u < header_.size.width; ++sample.u) {
      for (sample.v = header_.size.height - 1; sample.v >= 0; --sample.v) {
        const Rgb8 color = read_sample(lines, channel, sample.stored);
        if (!sample.stored.allFinite())
          ++missing.not_finite;
        else if (sample.stored.isZero(0))
          ++missing.zero;
        else
          visit(sample, color);
      }
    }
    return missing;
  }

 private:
  Rgb8 read_sample(LineReader& lines, ScanChannel channel, Eigen::Vector3d& point_m) const {
    std::string_view line;
    if (!lines.next(line)) source_.refuse("points", "the file is truncated");
    std::array<double, 7> numbers;
    std::size_t count = 0;
    for (std::string_view word = take_word(line); !word.empty(); word = take_word(line)) {
      const auto number = parse_number<double>(word);
      if (!number || count == numbers.size()) refuse_sample(lines);
      numbers[count++] = *number;
    }
    if (count != 4 && count != 7) refuse_sample(lines);
    point_m = {numbers[0], numbers[1], numbers[2]};
    if (count == 7 && channel != ScanChannel::kIntensity)
      return {to_shade(numbers[4]), to_shade(numbers[5]), to_shade(numbers[6])};
    const std::uint8_t gray = to_shade(numbers[3] * 255);
    return {gray, gray, gray};
  }

  [[noreturn]] void refuse_sample(const LineReader& lines) const {
    source_.refuse("sample " + std::to_string(lines.line_number()),
                   "expected x y z intensity, with or without red green blue");
  }

  Source source_;
  Header header_;
  std::uint64_t body_offset_ = 0;
};

/// Where the next scan begins: blank lines may lie between. False at the end of the file.
bool find_scan(LineReader& lines, std::uint64_t& offset) {
  std::string_view line;
  do {
    offset = lines.offset();
    if (!lines.next(line)) return false;
  } while (trim(line).empty());
  return true;
}

std::uint64_t sample_count(const ImageSize& size) { return std::uint64_t(size.width) * std::uint64_t(size.height); }

}  // namespace

bool looks_like_ptx(std::string_view start) {
  const auto is_count = [&] {
    std::string_view line = take_line(start);
    const auto count = parse_number<std::int64_t>(take_word(line));
    return count && *count > 0 && take_word(line).empty();
  };
  if (!is_count() || !is_count()) return false;
  std::array<double, 3> vector;
  for (int i = 0; i < 4; ++i)
    if (!parse_line(take_line(start), vector)) return false;
  return true;
}

Scene read_ptx(const std::filesystem::path& path, const ReadSceneOptions& options, Context& context) {
  SceneBuilder builder(path, options, context);
  builder.set_name(path.stem().string());
  std::uint64_t offset = 0;
  LineReader first(Source{path, {}}, 0);
  bool has_more = find_scan(first, offset);
  for (std::uint32_t index = 0; has_more; ++index) {
    const Source source{path, "scan " + std::to_string(index + 1)};
    builder.add([&] {
      ViewDraft draft;
      draft.view.name = source.view;
      draft.view.range.file = path;
      draft.view.range.format = RangeFormat::kPtx;
      draft.view.range.index = index;
      draft.view.range.offset = offset;
      return draft;
    });
    // The header again, for the next scan's place; without one that can be read, nobody knows where that is.
    LineReader lines(source, offset);
    ImageSize size{read_count(source, lines, "columns"), read_count(source, lines, "rows")};
    has_more = lines.skip(8 + sample_count(size)) && find_scan(lines, offset);
  }
  return builder.finish();
}

std::unique_ptr<GridScan> open_ptx_scan(const Source& source, std::uint32_t index, std::uint64_t offset) {
  if (offset == 0 && index > 0) {
    LineReader lines(source, 0);
    bool has_scan = find_scan(lines, offset);
    for (std::uint32_t i = 0; i < index && has_scan; ++i) {
      const PtxScan scan(source, offset);
      LineReader body(source, scan.body_offset());
      has_scan = body.skip(sample_count(*scan.size())) && find_scan(body, offset);
    }
    if (!has_scan) source.refuse("range.index", "there is no scan " + std::to_string(index));
  }
  return std::make_unique<PtxScan>(source, offset);
}

}  // namespace lapseam
