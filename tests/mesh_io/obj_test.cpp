#include "sample_meshes.h"

namespace lapseam {
namespace {

class Obj : public test::MeshFileTest {};

TEST_F(Obj, RoundTripWithTextureAndColors) {
  Mesh mesh = test::grid_mesh(12, 10);
  test::add_colors(mesh);
  test::add_texture(mesh);
  write_mesh(mesh, path("room scan.obj"));
  EXPECT_EQ(file_count(), 4u) << "obj, mtl and two pages";
  const Mesh back = read_mesh(path("room scan.obj"));
  EXPECT_EQ(back.positions_m, mesh.positions_m);
  EXPECT_EQ(back.colors, mesh.colors);
  EXPECT_EQ(back.triangles, mesh.triangles);
  test::expect_same_corners(mesh, back, test::identity_order(mesh), 0);
  EXPECT_EQ(back.pages.front().pixels, mesh.pages.front().pixels);
  write_mesh(mesh, path("jpeg.obj"), {.texture_format = TextureFormat::kJpeg});
  test::expect_similar_pages(mesh, read_mesh(path("jpeg.obj")));
}

TEST_F(Obj, PlainMeshNeedsNoMaterial) {
  const Mesh mesh = test::grid_mesh(4, 4);
  write_mesh(mesh, path("a.obj"));
  EXPECT_EQ(file_count(), 1u);
  const Mesh back = read_mesh(path("a.obj"));
  EXPECT_EQ(back.positions_m, mesh.positions_m);
  EXPECT_EQ(back.triangles, mesh.triangles);
  EXPECT_TRUE(back.colors.empty() && back.pages.empty() && back.texcoords.empty());
}

TEST_F(Obj, FarOriginKeepsItsDigits) {
  Mesh mesh = test::grid_mesh(4, 4);
  mesh.origin_m = {500000.25, 4000000.125, -20};
  write_mesh(mesh, path("a.obj"));
  const Mesh back = read_mesh(path("a.obj"));
  // Doubles at 4,000 km have steps of half a nanometre, the floats of the local frame of 60 nm at 1 m.
  test::expect_same_corners(mesh, back, test::identity_order(mesh), 2e-7);
}

TEST_F(Obj, PolygonsNegativeIndicesNormalsAndJoinedLines) {
  const Mesh mesh = read_mesh(write("a.obj",
                                    "# a comment\no thing\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nvt 0.5\n"
                                    "s off\nf 1//1 2//1 \\\n 3//1 4//1 # a square\nf -4 -3/-1/1 -2\nl 1 2\n"));
  EXPECT_EQ(mesh.triangles, (std::vector<Triangle>{{0, 1, 2}, {0, 2, 3}, {0, 1, 2}}));
  EXPECT_TRUE(mesh.colors.empty());
}

TEST_F(Obj, PlainMaterialColorBecomesAPageOfOnePixel) {
  write("m.mtl", "newmtl red\nKa 0 0 0\nKd 1 0 0.2\nnewmtl none\n");
  const Mesh mesh = read_mesh(write("a.obj",
                                    "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl red\nf 1 2 3\nf 3 2 1\n"
                                    "usemtl none\nf 1 3 2\nusemtl unheard_of\nf 2 1 3\n"));
  ASSERT_EQ(mesh.pages.size(), 1u);
  EXPECT_EQ(mesh.pages[0].pixels, (Pixels<Rgb8>{{255, 0, 51}}));
  EXPECT_EQ(mesh.triangle_page, (std::vector<std::uint32_t>{0, 0, kInvalidIndex, kInvalidIndex}));
}

TEST_F(Obj, MissingMaterialsAreNamed) {
  const auto file = write("a.obj", "mtllib gone.mtl\nv 0 0 0\n");
  try {
    read_mesh(file);
    FAIL();
  } catch (const IoError& error) {
    EXPECT_NE(std::string(error.what()).find("gone.mtl"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace lapseam
