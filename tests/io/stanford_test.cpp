#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "io/range_grid.h"
#include "io_support.h"
#include "lapseam/context.h"
#include "lapseam/io.h"
#include "spatial/kd_tree.h"

namespace lapseam::test {
namespace {

/// A grid over a gentle dome that a scanner at +z sees; every 7th pixel is empty. x runs along the columns, y up the
/// rows.
struct Dome {
  static constexpr int kColumns = 12, kRows = 9;
  static constexpr int kTotal = kColumns * kRows;

  static bool has_sample(int i) { return i % 7 != 3; }
  static Eigen::Vector3f point(int i) {
    const float x = float(i % kColumns) * 0.01f, y = float(i / kColumns) * 0.01f;
    return {x, y, 0.05f - (x - 0.05f) * (x - 0.05f) - y * y};
  }
  static int sample_count() {
    int count = 0;
    for (int i = 0; i < kTotal; ++i) count += has_sample(i);
    return count;
  }

  static std::string header(const std::string& format) {
    return "ply\nformat " + format + " 1.0\nobj_info num_cols 12\nobj_info num_rows 9\nelement vertex " +
           std::to_string(sample_count()) +
           "\nproperty float x\nproperty float y\nproperty float z\nelement range_grid 108\n"
           "property list uchar int vertex_indices\nend_header\n";
  }

  static std::string ascii() {
    std::string text = header("ascii");
    char line[96];
    for (int i = 0; i < kTotal; ++i) {
      if (!has_sample(i)) continue;
      const Eigen::Vector3f p = point(i);
      std::snprintf(line, sizeof line, "%.9g %.9g %.9g \n", double(p.x()), double(p.y()), double(p.z()));
      text += line;
    }
    int next = 0;
    for (int i = 0; i < kTotal; ++i) text += has_sample(i) ? "1 " + std::to_string(next++) + "\n" : "0\n";
    return text;
  }

  template <typename T>
  static void put(std::string& bytes, T value, bool is_big_endian) {
    char data[sizeof value];
    std::memcpy(data, &value, sizeof value);
    if (is_big_endian) std::reverse(std::begin(data), std::end(data));
    bytes.append(data, sizeof value);
  }

  static std::string binary(bool is_big_endian) {
    std::string bytes = header(is_big_endian ? "binary_big_endian" : "binary_little_endian");
    for (int i = 0; i < kTotal; ++i)
      for (int axis = 0; has_sample(i) && axis < 3; ++axis) put(bytes, point(i)[axis], is_big_endian);
    std::int32_t next = 0;
    for (int i = 0; i < kTotal; ++i) {
      put(bytes, std::uint8_t(has_sample(i)), is_big_endian);
      if (has_sample(i)) put(bytes, next++, is_big_endian);
    }
    return bytes;
  }
};

TEST(RangeGrid, RowsAreFlippedAndEmptyPixelsAreNaN) {
  const TempFolder folder;
  for (const std::string& bytes : {Dome::ascii(), Dome::binary(false), Dome::binary(true)}) {
    write_bytes(folder / "a.ply", bytes);
    EXPECT_EQ(probe_range_grid({folder / "a.ply", {}}), (ImageSize{12, 9}));
    const RangeGrid grid = read_range_grid({folder / "a.ply", {}}, 1.0);
    ASSERT_EQ(grid.points_m.size(), 108u);
    for (int i = 0; i < Dome::kTotal; ++i) {
      const int u = i % 12, v = 8 - i / 12;
      const Eigen::Vector3d& p = grid.points_m[std::size_t(v * 12 + u)];
      if (Dome::has_sample(i)) {
        EXPECT_EQ(p.cast<float>(), Dome::point(i));
      } else {
        EXPECT_TRUE(std::isnan(p.x()));
      }
    }
  }
}

TEST(RangeGrid, LoadsAsAViewThatLooksAlongMinusZ) {
  const TempFolder folder;
  Context context(1);
  write_bytes(folder / "a.ply", Dome::ascii());
  write_bytes(folder / "one.conf",
              "camera 0 0 0 0 0 0 1\n\nmesh old.ply 0 0 0 0 0 0 1\nbmesh a.ply 1 2 3 0 0 0.70710678 0.70710678\n");
  const Scene scene = read_scene(folder / "one.conf", {}, context);
  ASSERT_EQ(scene.views.size(), 1u);
  const ViewSource& source = scene.views[0];
  EXPECT_EQ(source.name, "a");
  // The conjugate of the usual reading: −90° about z.
  EXPECT_TRUE((source.T_world_view * Eigen::Vector3d(1, 0, 0)).isApprox(Eigen::Vector3d(1, 1, 3), 1e-7));

  const View view = load_view(source);
  EXPECT_EQ(handedness(view.sensor), 1);
  EXPECT_LT(ray_direction(view.sensor, 6, 4).z(), -0.9);
  for (int i = 0; i < Dome::kTotal; ++i) {
    const int u = i % 12, v = 8 - i / 12;
    const float r = view.range.at(u, v);
    EXPECT_EQ(r > 0, Dome::has_sample(i));
    if (!Dome::has_sample(i)) continue;
    EXPECT_LT((unproject(view.sensor, u, v, double(r)) - Dome::point(i).cast<double>()).norm(), 1e-6);
  }
}

TEST(RangeGrid, HostileFiles) {
  const TempFolder folder;
  const auto expect_bad = [&](std::string text, const std::string& from, const std::string& to,
                              const std::string& word) {
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    write_bytes(folder / "b.ply", text.replace(at, from.size(), to));
    expect_refused([&] { read_range_grid({folder / "b.ply", "v"}, 1.0); }, {"b.ply", word});
  };
  const std::string ascii = Dome::ascii(), binary = Dome::binary(false);
  expect_bad(ascii, "num_cols 12", "num_cols 1000000000", "size");
  expect_bad(ascii, "num_cols 12", "num_cols -12", "num_cols");
  expect_bad(ascii, "num_cols 12", "num_cols 13", "range_grid");
  expect_bad(ascii, "obj_info num_rows 9\n", "", "num_rows");
  expect_bad(ascii, "element range_grid 108", "element faces 108", "no range grid");
  expect_bad(ascii, "element vertex 9", "element vertex 99999999999", "vertex");
  expect_bad(ascii, "property float y", "property float w", "x, y and z");
  expect_bad(ascii, "\n1 91\n", "\n1 93\n", "93");
  expect_bad(ascii, "\n1 91\n", "\n1 -1\n", "-1");
  expect_bad(ascii, "\n1 91\n", "\n2 90 91\n", "2 samples");
  expect_bad(ascii, "\n1 91\n", "\n1 x\n", "'x'");
  // Cut one character off, and the last index is another number; so cut whole lines.
  for (const std::string& bytes : {ascii.substr(0, ascii.size() - 5), binary.substr(0, binary.size() - 3)}) {
    write_bytes(folder / "b.ply", bytes);
    expect_refused([&] { read_range_grid({folder / "b.ply", "v"}, 1.0); }, {"b.ply", "'v'", "truncated"});
  }
  for (const std::string& whole : {ascii, binary}) {
    for (std::size_t length = 0; length + 5 < whole.size(); length += 37) {
      write_bytes(folder / "b.ply", whole.substr(0, length));
      expect_refused([&] { read_range_grid({folder / "b.ply", "v"}, 1.0); }, {"b.ply"});
    }
  }
}

TEST(StanfordConf, MistakesHaveALine) {
  const TempFolder folder;
  Context context(1);
  write_bytes(folder / "a.ply", Dome::ascii());
  const auto expect_bad = [&](const std::string& text, std::initializer_list<std::string> words) {
    write_bytes(folder / "x.conf", text);
    expect_refused([&] { read_scene(folder / "x.conf", {}, context); }, words);
  };
  expect_bad("bmesh a.ply 0 0 0 0 0 0\n", {"x.conf", "'a'", "line 1", "7 numbers"});
  expect_bad("camera 1\nbmesh a.ply 0 nan 0 0 0 0 1\n", {"x.conf", "'a'", "line 2", "finite"});
  expect_bad("bmesh a.ply 0 0 0 0 0 0 2\n", {"x.conf", "'a'", "quaternion"});
  expect_bad("bmesh a.ply 0 0 0 0 0 0 1\nbmsh a.ply\n", {"x.conf", "line 2", "bmsh"});
  expect_bad("bmesh none.ply 0 0 0 0 0 0 1\n", {"none.ply", "'none'", "no such file"});
  expect_bad("camera 0 0 0\nmesh a.ply\n", {"x.conf", "bmesh"});
  expect_bad("bmesh a.ply 0 0 0 0 0 0 1\nbmesh a.ply 0 0 0 0 0 0 1\n", {"x.conf", "'a'", "name"});
}

TEST(StanfordConf, BunnyScansLieOnTheBunny) {
  const std::filesystem::path data = data_folder();
  if (data.empty()) GTEST_SKIP() << "no real scans: set LAPSEAM_DATA";
  Context context(2);
  const Mesh bunny = read_mesh(data / "bunny/bun_zipper.ply");
  const KdTree tree(bunny.positions_m);
  const Scene scene = read_scene(data / "bunny/bun.conf", {}, context);
  ASSERT_EQ(scene.views.size(), 10u);
  std::size_t samples = 0;
  for (const ViewSource& source : scene.views) {
    const View view = load_view(source);
    EXPECT_EQ(view.range.width, 512);
    std::vector<float> distances_m;
    std::vector<Neighbor> nearest;
    for (int v = 0; v < view.range.height; ++v) {
      for (int u = 0; u < view.range.width; ++u) {
        const float r = view.range.at(u, v);
        if (!(r > 0) || samples++ % 10) continue;
        const Eigen::Vector3d p = view.T_world_view * unproject(view.sensor, u, v, double(r));
        tree.find_nearest(p.cast<float>(), 1, nearest);
        distances_m.push_back(std::sqrt(nearest.at(0).squared_distance));
      }
    }
    std::nth_element(distances_m.begin(), distances_m.begin() + std::ptrdiff_t(distances_m.size() / 2),
                     distances_m.end());
    const float median_m = distances_m[distances_m.size() / 2];
    // Measured once with an independent program: 0.53 to 0.57 mm; the vertices of the reference are about 1 mm apart.
    EXPECT_GT(median_m, 0.0005f) << source.name;
    EXPECT_LT(median_m, 0.0006f) << source.name;
  }
  EXPECT_EQ(samples, 362272u);
}

}  // namespace
}  // namespace lapseam::test
