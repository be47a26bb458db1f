#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <numeric>

#include "sample_meshes.h"

namespace lapseam {
namespace {

class Ply : public test::MeshFileTest {};

template <typename T>
void append(std::string& bytes, T value, bool is_big_endian) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if (is_big_endian) std::reverse(raw, raw + sizeof(T));
  bytes.append(raw, sizeof(T));
}

TEST_F(Ply, RoundTripKeepsEverything) {
  Mesh mesh = test::grid_mesh(9, 7);
  test::add_colors(mesh);
  test::add_provenance(mesh);
  mesh.origin_m = {500000.1, -4000000.7, 123.456};
  write_mesh(mesh, path("a.ply"));
  const Mesh back = read_mesh(path("a.ply"));
  EXPECT_EQ(back.origin_m, mesh.origin_m);
  EXPECT_EQ(back.positions_m, mesh.positions_m);
  EXPECT_EQ(back.triangles, mesh.triangles);
  EXPECT_EQ(back.colors, mesh.colors);
  EXPECT_EQ(back.vertex_view, mesh.vertex_view);
  EXPECT_EQ(back.vertex_pixel, mesh.vertex_pixel);
  EXPECT_EQ(back.triangle_view, mesh.triangle_view);
  EXPECT_EQ(back.triangle_tag, mesh.triangle_tag);
  EXPECT_EQ(file_count(), 1u) << "a temporary file was left behind";
}

TEST_F(Ply, WithoutProvenanceHasNone) {
  Mesh mesh = test::grid_mesh(3, 3);
  test::add_provenance(mesh);
  write_mesh(mesh, path("a.ply"), {.with_provenance = false});
  const Mesh back = read_mesh(path("a.ply"));
  EXPECT_EQ(back.triangles, mesh.triangles);
  EXPECT_TRUE(back.vertex_view.empty() && back.vertex_pixel.empty());
  EXPECT_TRUE(back.triangle_view.empty() && back.triangle_tag.empty());
}

TEST_F(Ply, EmptyMesh) {
  write_mesh(Mesh{}, path("a.ply"));
  const Mesh back = read_mesh(path("a.ply"));
  EXPECT_EQ(back.vertex_count(), 0u);
  EXPECT_EQ(back.triangle_count(), 0u);
}

TEST_F(Ply, SameBytesTwice) {
  Mesh mesh = test::grid_mesh(20, 20);
  test::add_provenance(mesh);
  write_mesh(mesh, path("a.ply"));
  write_mesh(mesh, path("b.ply"));
  EXPECT_EQ(read("a.ply"), read("b.ply"));
}

// A body with everything a reader must step over: unknown elements before and between, lists in vertices, unusual types
// and orders, polygons.
std::string unusual_body(bool is_big_endian) {
  std::string bytes;
  append(bytes, std::uint16_t(3), is_big_endian);  // camera: a list of 3 doubles, then a float
  for (int i = 0; i < 3; ++i) append(bytes, double(i), is_big_endian);
  append(bytes, 1.5f, is_big_endian);
  for (int i = 0; i < 5; ++i) {  // vertex: z, list of shorts, quality, x, blue, y, red, green
    append(bytes, float(i), is_big_endian);
    append(bytes, std::uint32_t(i), is_big_endian);
    for (int j = 0; j < i; ++j) append(bytes, std::int16_t(-j), is_big_endian);
    append(bytes, double(i), is_big_endian);
    append(bytes, double(10 + i), is_big_endian);
    append(bytes, std::uint16_t(65535), is_big_endian);
    append(bytes, std::int8_t(-i), is_big_endian);
    append(bytes, std::uint16_t(257 * i), is_big_endian);
    append(bytes, std::uint16_t(0), is_big_endian);
  }
  append(bytes, std::uint8_t(7), is_big_endian);  // face: flags, then the polygon
  append(bytes, std::int32_t(5), is_big_endian);
  for (int i = 0; i < 5; ++i) append(bytes, std::int16_t(i), is_big_endian);
  append(bytes, std::uint8_t(7), is_big_endian);  // a polygon of two corners is no surface
  append(bytes, std::int32_t(2), is_big_endian);
  append(bytes, std::int16_t(0), is_big_endian);
  append(bytes, std::int16_t(1), is_big_endian);
  return bytes;
}

constexpr const char* kUnusualElements =
    "element camera 1\nproperty list ushort double matrix\nproperty float32 f\n"
    "element vertex 5\nproperty float z\nproperty list uint int16 neighbours\nproperty double quality\n"
    "property float64 x\nproperty ushort blue\nproperty char y\nproperty ushort red\nproperty ushort green\n"
    "element face 2\nproperty uint8 flags\nproperty list int short vertex_index\nend_header\n";

void expect_unusual(const Mesh& mesh) {
  ASSERT_EQ(mesh.vertex_count(), 5u);
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(mesh.positions_m[std::size_t(i)], Eigen::Vector3f(float(10 + i), float(-i), float(i)));
    EXPECT_EQ(mesh.colors[std::size_t(i)], (Rgb8{std::uint8_t(i), 0, 255}));
  }
  const std::vector<Triangle> fan{{0, 1, 2}, {0, 2, 3}, {0, 3, 4}};
  EXPECT_EQ(mesh.triangles, fan);
}

TEST_F(Ply, UnusualLittleEndian) {
  expect_unusual(read_mesh(write("a.ply", std::string("ply\nformat binary_little_endian 1.0\ncomment hello\n") +
                                              kUnusualElements + unusual_body(false))));
}

TEST_F(Ply, UnusualBigEndian) {
  expect_unusual(read_mesh(
      write("a.ply", std::string("ply\nformat binary_big_endian 1.0\n") + kUnusualElements + unusual_body(true))));
}

TEST_F(Ply, UnusualAsciiWithWindowsLines) {
  std::string text = std::string("ply\nformat ascii 1.0\n") + kUnusualElements + "3 0 1 2 1.5\n";
  for (int i = 0; i < 5; ++i) {
    text += std::to_string(i) + " " + std::to_string(i) + " ";
    for (int j = 0; j < i; ++j) text += std::to_string(-j) + " ";
    text += "0.5 +1" + std::to_string(i) + ".0e0 65535 " + std::to_string(-i) + " " + std::to_string(257 * i) + " 0\n";
  }
  text += "7 5 0 1 2 3 4\n7 2 0 1";
  std::string windows;
  for (const char c : text) windows += c == '\n' ? std::string("\r\n") : std::string(1, c);
  expect_unusual(read_mesh(write("a.ply", text)));
  expect_unusual(read_mesh(write("b.ply", windows)));
}

TEST_F(Ply, FloatColorsAndForeignViewProperty) {
  // "view" as a float is somebody else's: not an index.
  const Mesh mesh = read_mesh(write("a.ply",
                                    "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
                                    "property float z\nproperty float red\nproperty float green\nproperty float blue\n"
                                    "property float view\nend_header\n0 0 0 1 0.5 -3 9\n0 0 1 nan 2 0 9\n"));
  EXPECT_EQ(mesh.colors[0], (Rgb8{255, 128, 0}));
  EXPECT_EQ(mesh.colors[1], (Rgb8{0, 255, 0}));
  EXPECT_TRUE(mesh.vertex_view.empty());
}

TEST_F(Ply, FarDoublesKeepTheirDigits) {
  const Mesh mesh =
      read_mesh(write("a.ply",
                      "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\n"
                      "property double z\nend_header\n4500000.0123 612345.5 10\n4500000.0133 612345.5 10\n"));
  const Eigen::Vector3f step = mesh.positions_m[1] - mesh.positions_m[0];
  EXPECT_NEAR(double(step.x()), 0.001, 1e-8);  // a float at 4,500 km has steps of 0.5 m
  EXPECT_NEAR(mesh.origin_m.x() + double(mesh.positions_m[0].x()), 4500000.0123, 1e-8);
}

TEST_F(Ply, FacesBeforeVertices) {
  const Mesh mesh =
      read_mesh(write("a.ply",
                      "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\n"
                      "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
                      "3 0 1 2\n0 0 0\n1 0 0\n0 1 0\n"));
  EXPECT_EQ(mesh.triangles, (std::vector<Triangle>{{0, 1, 2}}));
}

TEST_F(Ply, StanfordModels) {
  const char* data = std::getenv("LAPSEAM_DATA");
  if (!data || !std::filesystem::exists(std::filesystem::path(data) / "bunny/bun_zipper.ply"))
    GTEST_SKIP() << "set LAPSEAM_DATA to the folder with the Stanford scans";
  const std::filesystem::path folder = data;
  const Mesh bunny = read_mesh(folder / "bunny/bun_zipper.ply");
  EXPECT_EQ(bunny.vertex_count(), 35947u);
  EXPECT_EQ(bunny.triangle_count(), 69451u);
  EXPECT_EQ(bunny.positions_m[0], Eigen::Vector3f(-0.0378297f, 0.12794f, 0.00447467f));
  const Mesh dragon = read_mesh(folder / "dragon/dragon_vrip.ply");
  EXPECT_EQ(dragon.triangle_count(), 871414u);
  const Mesh scan = read_mesh(folder / "bunny/bun000.ply");
  EXPECT_EQ(scan.vertex_count(), 40256u);
  EXPECT_EQ(scan.triangle_count(), 0u);
}

}  // namespace
}  // namespace lapseam
