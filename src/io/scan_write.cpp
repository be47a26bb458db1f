// PTX and PCD, writing: files of points.

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <utility>

#include "io/output_file.h"
#include "io/scene_writer.h"

namespace lapseam {
namespace {

/// Appends numbers to a line of text.
class Text {
 public:
  Text& fixed(double value, int digits) {
    char buffer[400];  // the largest double has 309 digits before the point
    const auto end = std::to_chars(buffer, buffer + sizeof buffer, value, std::chars_format::fixed, digits).ptr;
    return word({buffer, std::size_t(end - buffer)});
  }
  template <typename Number>
  Text& shortest(Number value) {
    char buffer[32];
    return word({buffer, std::size_t(std::to_chars(buffer, buffer + sizeof buffer, value).ptr - buffer)});
  }
  Text& word(std::string_view text) {
    if (!text_.empty() && text_.back() != '\n') text_ += ' ';
    text_ += text;
    return *this;
  }
  Text& end() {
    text_ += '\n';
    return *this;
  }
  std::string take() { return std::exchange(text_, {}); }

 private:
  std::string text_;
};

class PtxWriter : public SceneWriter {
 public:
  explicit PtxWriter(const std::filesystem::path& file) : out_(file) {}

  void add(const LoadedView& loaded) override {
    const View& view = loaded.view;
    const ColorImage* color = has_registered_color(loaded) ? &*loaded.color : nullptr;
    write_header(view);
    for (int u = 0; u < view.range.width; ++u) {
      for (int v = view.range.height - 1; v >= 0; --v) {
        const float r = view.range.at(u, v);
        if (r > 0) {
          const Eigen::Vector3d p = unproject(view.sensor, u, v, double(r));
          for (int axis = 0; axis < 3; ++axis) text_.fixed(p[axis], kDigits);
        } else {
          text_.word("0 0 0");
        }
        text_.word("0.5");
        if (color) {
          const Rgb8 c = r > 0 ? color->at(u, v) : Rgb8{};
          text_.shortest(int(c.r)).shortest(int(c.g)).shortest(int(c.b));
        }
        text_.end();
      }
      out_.write(text_.take());
    }
  }

  void finish() override { out_.commit(); }

 private:
  void write_header(const View& view) {
    text_.shortest(view.range.width).end().shortest(view.range.height).end();
    const Eigen::Matrix4d M = view.T_world_view.matrix();
    for (int axis = 0; axis < 3; ++axis) text_.shortest(M(axis, 3));
    text_.end();
    for (int column = 0; column < 3; ++column) {
      for (int axis = 0; axis < 3; ++axis) text_.shortest(M(axis, column));
      text_.end();
    }
    // Row vectors: the matrix is transposed, and all its digits are written, which readers take as well.
    for (int column = 0; column < 4; ++column) {
      for (int row = 0; row < 4; ++row) text_.shortest(M(row, column));
      text_.end();
    }
    out_.write(text_.take());
  }

  static constexpr int kDigits = 6;  // a micrometre, as everybody writes it
  OutputFile out_;
  Text text_;
};

// Farther from the world's origin than this, single precision is off by more than 0.1 mm.
constexpr double kFar_m = 1000;

/// Organised clouds, one file a view, binary, in the world; the viewpoint is the pose. Coordinates are floats, as all
/// programs read them, and doubles only far from the origin, where floats would say nothing.
class PcdWriter : public SceneWriter {
 public:
  explicit PcdWriter(const std::filesystem::path& folder) : folder_(folder) {}

  void write_files(const LoadedView& loaded) override {
    const View& view = loaded.view;
    const ColorImage* color = has_registered_color(loaded) ? &*loaded.color : nullptr;
    OutputFile out(folder_ / (loaded.file_stem + ".pcd"));
    const bool is_far = view.T_world_view.translation().cwiseAbs().maxCoeff() > kFar_m;
    out.write(header(view, color != nullptr, is_far));
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    for (int v = 0; v < view.range.height; ++v) {
      for (int u = 0; u < view.range.width; ++u) {
        const float r = view.range.at(u, v);
        const Eigen::Vector3d p = r > 0 ? Eigen::Vector3d(view.T_world_view * unproject(view.sensor, u, v, double(r)))
                                        : Eigen::Vector3d(kNan, kNan, kNan);
        const Eigen::Vector3f single = p.cast<float>();
        is_far ? out.write(p.data(), 3 * sizeof(double)) : out.write(single.data(), 3 * sizeof(float));
        if (!color) continue;
        const Rgb8 c = color->at(u, v);
        out.put(std::uint32_t(c.r) << 16 | std::uint32_t(c.g) << 8 | std::uint32_t(c.b));
      }
    }
    out.commit();
  }
  void add(const LoadedView&) override {}
  void finish() override {}

 private:
  static std::string header(const View& view, bool has_color, bool is_far) {
    const Eigen::Quaterniond q(view.T_world_view.linear());
    const Eigen::Vector3d t = view.T_world_view.translation();
    Text text;
    text.word("# .PCD v0.7 - Point Cloud Data file format").end().word("VERSION 0.7").end();
    const char* sizes = is_far ? "SIZE 8 8 8" : "SIZE 4 4 4";
    if (has_color)
      text.word("FIELDS x y z rgb").end().word(sizes).word("4").end().word("TYPE F F F U").end().word("COUNT 1 1 1 1");
    else
      text.word("FIELDS x y z").end().word(sizes).end().word("TYPE F F F").end().word("COUNT 1 1 1");
    text.end().word("WIDTH").shortest(view.range.width).end().word("HEIGHT").shortest(view.range.height).end();
    text.word("VIEWPOINT");
    for (const double value : {t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z()}) text.shortest(value);
    text.end().word("POINTS").shortest(view.range.size()).end().word("DATA binary").end();
    return text.take();
  }

  std::filesystem::path folder_;
};

}  // namespace

std::unique_ptr<SceneWriter> make_ptx_writer(const std::filesystem::path& file) {
  return std::make_unique<PtxWriter>(file);
}
std::unique_ptr<SceneWriter> make_pcd_writer(const std::filesystem::path& folder) {
  return std::make_unique<PcdWriter>(folder);
}

}  // namespace lapseam
