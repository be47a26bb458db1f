#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "glb_bytes.h"
#include "sample_meshes.h"

namespace lapseam {
namespace {

using nlohmann::json;

class Glb : public test::MeshFileTest {};

json document_of(const std::string& bytes) {
  std::uint32_t length = 0;
  std::memcpy(&length, bytes.data() + 12, 4);
  return json::parse(bytes.substr(20, length));
}

TEST_F(Glb, RoundTripTextured) {
  Mesh mesh = test::grid_mesh(12, 10);
  test::add_texture(mesh);
  mesh.origin_m = {500000.123, -7, 0.5};
  write_mesh(mesh, path("a.glb"));
  const Mesh back = read_mesh(path("a.glb"));
  EXPECT_EQ(back.origin_m, mesh.origin_m);
  EXPECT_EQ(back.vertex_count(), mesh.vertex_count()) << "vertices split at chart borders must be joined again";
  test::expect_same_corners(mesh, back, test::identity_order(mesh), 0);
  test::expect_similar_pages(mesh, back);
  EXPECT_TRUE(back.colors.empty());
}

TEST_F(Glb, RoundTripKeepsEveryShadeOfColors) {
  Mesh mesh = test::grid_mesh(16, 16);
  test::add_colors(mesh);
  write_mesh(mesh, path("a.glb"));
  const Mesh back = read_mesh(path("a.glb"));
  ASSERT_EQ(back.triangle_count(), mesh.triangle_count());
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i)
    for (std::size_t k = 0; k < 3; ++k) ASSERT_EQ(back.colors[back.triangles[i][k]], mesh.colors[mesh.triangles[i][k]]);
}

TEST_F(Glb, TexturedAndColoredTrianglesShareVertices) {
  Mesh mesh = test::grid_mesh(6, 6);
  test::add_texture(mesh);
  test::add_colors(mesh);
  write_mesh(mesh, path("a.glb"));
  const Mesh back = read_mesh(path("a.glb"));
  EXPECT_EQ(back.vertex_count(), mesh.vertex_count());
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    if (mesh.triangle_page[i] != kInvalidIndex) continue;
    for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(back.colors[back.triangles[i][k]], mesh.colors[mesh.triangles[i][k]]);
  }
}

TEST_F(Glb, WhatNoImageShowsCanBeToldByItsMaterial) {
  Mesh mesh = test::grid_mesh(6, 6);
  test::add_texture(mesh);
  test::add_colors(mesh);
  std::vector<std::size_t> plain;
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i)
    if (mesh.triangle_page[i] == kInvalidIndex) plain.push_back(i);
  ASSERT_GE(plain.size(), 2u);
  const auto text_of = [&](const std::string& name) {
    std::ifstream file(path(name), std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  mesh.is_unseen.assign(mesh.triangle_count(), 0);
  write_mesh(mesh, path("seen.glb"));
  mesh.is_unseen[plain[0]] = 1;
  for (const std::string name : {"both.glb", "both.obj", "both.ply"}) write_mesh(mesh, path(name));
  EXPECT_EQ(text_of("seen.glb").find("\"unseen\""), std::string::npos);
  EXPECT_NE(text_of("seen.glb").find("\"vertex_colors\""), std::string::npos);
  EXPECT_NE(text_of("both.glb").find("\"unseen\""), std::string::npos);
  EXPECT_NE(text_of("both.glb").find("\"vertex_colors\""), std::string::npos);
  EXPECT_NE(text_of("both.obj").find("usemtl unseen"), std::string::npos);
  EXPECT_NE(text_of("both.ply").find("property uchar unseen"), std::string::npos);
  for (const std::string name : {"both.glb", "both.obj", "both.ply"})
    EXPECT_EQ(read_mesh(path(name)).triangle_count(), mesh.triangle_count()) << name;
}

// Corners of each triangle in the world, from its first in lexical order, and the triangles sorted: what stays the same
// when vertices and triangles are put in another order.
std::vector<std::array<Eigen::Vector3d, 3>> sorted_corners(const Mesh& mesh) {
  const auto is_before = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
  };
  std::vector<std::array<Eigen::Vector3d, 3>> out;
  for (const Triangle& t : mesh.triangles) {
    std::array<Eigen::Vector3d, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) {
      // Rounded to the grid of the sample mesh, so that quantized positions sort alike.
      const Eigen::Vector3d p = mesh.origin_m + mesh.positions_m[t[k]].cast<double>();
      corners[k] = (p.array() * 1000).round() / 1000;
    }
    std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end(), is_before), corners.end());
    out.push_back(corners);
  }
  std::sort(out.begin(), out.end(), [&](const auto& a, const auto& b) {
    return std::lexicographical_compare(a.begin(), a.end(), b.begin(), b.end(), is_before);
  });
  return out;
}

TEST_F(Glb, CompressedAndQuantizedHoldTheSameTriangles) {
  Mesh mesh = test::grid_mesh(12, 10);
  test::add_texture(mesh);
  test::add_colors(mesh);
  for (const bool quantize : {false, true})
    for (const bool compress : {false, true}) {
      write_mesh(mesh, path("a.glb"), {.quantize = quantize, .compress = compress});
      const Mesh back = read_mesh(path("a.glb"));
      EXPECT_EQ(sorted_corners(back), sorted_corners(mesh)) << quantize << compress;
      ASSERT_EQ(back.pages.size(), mesh.pages.size());
      const json document = document_of(read("a.glb"));
      const auto requires_extension = [&](const char* name) {
        const json names = document.value("extensionsRequired", json::array());
        return std::find(names.begin(), names.end(), name) != names.end();
      };
      EXPECT_EQ(requires_extension("KHR_mesh_quantization"), quantize);
      EXPECT_EQ(requires_extension("EXT_meshopt_compression"), compress);
    }
}

TEST_F(Glb, EveryTextureFormatIsReadAgain) {
  Mesh mesh = test::grid_mesh(12, 10);
  test::add_texture(mesh);
  write_mesh(mesh, path("png.glb"), {.texture_format = TextureFormat::kPng});
  EXPECT_EQ(read_mesh(path("png.glb")).pages.front().pixels, mesh.pages.front().pixels) << "PNG loses nothing";
  write_mesh(mesh, path("jpeg.glb"), {.texture_format = TextureFormat::kJpeg});
  test::expect_similar_pages(mesh, read_mesh(path("jpeg.glb")));
  write_mesh(mesh, path("webp.glb"), {.texture_format = TextureFormat::kWebp});
  test::expect_similar_pages(mesh, read_mesh(path("webp.glb")));
  EXPECT_THROW(write_mesh(mesh, path("a.obj"), {.texture_format = TextureFormat::kWebp}), InvalidInput);
}

TEST_F(Glb, LitMaterialIsAnOption) {
  Mesh mesh = test::grid_mesh(6, 6);
  test::add_texture(mesh);
  for (const bool is_lit : {false, true}) {
    write_mesh(mesh, path("a.glb"), {.is_lit = is_lit});
    EXPECT_EQ(read("a.glb").find("KHR_materials_unlit") == std::string::npos, is_lit);
  }
}

TEST_F(Glb, DescribesWhatItHolds) {
  Mesh mesh = test::grid_mesh(12, 10);
  test::add_texture(mesh);
  mesh.origin_m = {500000.123, -7, 0.5};
  write_mesh(mesh, path("a.glb"));
  const std::string bytes = read("a.glb");
  EXPECT_EQ(bytes.size() % 4, 0u);
  const json document = document_of(bytes);
  const json& primitives = document.at("meshes").at(0).at("primitives");
  ASSERT_EQ(primitives.size(), 3u) << "two pages and the rest";
  EXPECT_EQ(document.at("nodes").at(0).at("translation"), json({500000.123, -7.0, 0.5}));
  for (const json& primitive : primitives) {
    const json& accessor = document.at("accessors").at(primitive.at("attributes").at("POSITION").get<std::size_t>());
    EXPECT_TRUE(accessor.contains("min") && accessor.contains("max"));
    EXPECT_LT(accessor.at("count").get<std::size_t>(), 3 * mesh.triangle_count() / 2) << "corners were not welded";
  }
  EXPECT_TRUE(document.at("materials").at(0).at("extensions").contains("KHR_materials_unlit"));
  EXPECT_FALSE(document.at("materials").at(2).contains("extensions")) << "nothing is known about its colour";
}

TEST_F(Glb, EmptyMesh) {
  write_mesh(Mesh{}, path("a.glb"));
  EXPECT_EQ(read_mesh(path("a.glb")).triangle_count(), 0u);
}

TEST_F(Glb, NodesTurnScaleAndMirror) {
  // A parent turns by 90° about z and moves; one child mirrors x. Strip, fan, bytes as indices, quantised positions.
  test::GlbBuilder glb;
  const std::size_t positions =
      glb.add_accessor(std::vector<std::int16_t>{0, 0, 0, 0, 32767, 0, 0, 0, 0, 32767, 0, 0, 32767, 32767, 0, 0}, 5122,
                       "VEC3", 4, {{"normalized", true}}, 8);
  const std::size_t indices = glb.add_accessor(std::vector<std::uint8_t>{0, 1, 2, 3}, 5121, "SCALAR", 4);
  glb.document["extensionsRequired"] = {"KHR_mesh_quantization"};
  glb.document["meshes"] =
      json::array({{{"primitives", {{{"attributes", {{"POSITION", positions}}}, {"indices", indices}, {"mode", 5}}}}},
                   {{"primitives", {{{"attributes", {{"POSITION", positions}}}, {"mode", 6}}}}}});
  const double h = std::sqrt(0.5);
  glb.document["nodes"] = json::array({{{"children", {1, 2}}, {"rotation", {0, 0, h, h}}, {"translation", {10, 0, 0}}},
                                       {{"mesh", 0}, {"scale", {2, 2, 2}}},
                                       {{"mesh", 1}, {"matrix", {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}}});
  glb.document["scenes"] = json::array({{{"nodes", {0}}}});
  const Mesh mesh = read_mesh(write("a.glb", glb.bytes()));

  const auto corner = [&](std::size_t t, std::size_t k) {
    return Eigen::Vector3d(mesh.origin_m + mesh.positions_m[mesh.triangles[t][k]].cast<double>());
  };
  const auto near = [](const Eigen::Vector3d& a, double x, double y) {
    return (a - Eigen::Vector3d(x, y, 0)).norm() < 1e-5;
  };
  ASSERT_EQ(mesh.triangle_count(), 4u);
  EXPECT_TRUE(near(corner(0, 0), 10, 0) && near(corner(0, 1), 10, 2) && near(corner(0, 2), 8, 0));
  EXPECT_TRUE(near(corner(3, 0), 10, 0));
  // However they were stored, all four face +z except the fan's, whose corners 0, 1, 2 turn left and then right.
  const auto facing = [&](std::size_t t) {
    return (corner(t, 1) - corner(t, 0)).cross(corner(t, 2) - corner(t, 0)).z() > 0;
  };
  EXPECT_TRUE(facing(0) && facing(1)) << "a strip winds every other triangle the other way";
  EXPECT_TRUE(facing(2)) << "mirrored: the winding must be turned back";
  EXPECT_FALSE(facing(3));
}

}  // namespace
}  // namespace lapseam
