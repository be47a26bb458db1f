// Files that are broken or made to do harm: each is refused with one line that names the file, and never costs more
// memory than its size justifies.

#include <sys/stat.h>

#include <nlohmann/json.hpp>
#include <random>

#include "core/memory.h"
#include "glb_bytes.h"
#include "sample_meshes.h"

namespace lapseam {
namespace {

using nlohmann::json;
using test::GlbBuilder;

class HostileMesh : public test::MeshFileTest {
 protected:
  /// The refusal has to come before memory is taken for what the file only claims.
  std::string cheap_refusal(const std::filesystem::path& file) {
    constexpr std::uint64_t kSlack_bytes = 64u << 20;
    const std::uint64_t before = peak_rss_bytes();
    const std::string text = refusal(file);
    EXPECT_LE(peak_rss_bytes(), before + kSlack_bytes);
    return text;
  }
  std::string refuse_ply(const std::string& text) { return cheap_refusal(write("a.ply", text)); }
  std::string refuse_obj(const std::string& text) { return cheap_refusal(write("a.obj", text)); }
  std::string refuse_glb(GlbBuilder glb) { return cheap_refusal(write("a.glb", glb.bytes())); }
};

constexpr const char* kXyz = "property float x\nproperty float y\nproperty float z\n";
constexpr const char* kAscii = "ply\nformat ascii 1.0\n";
constexpr const char* kBinary = "ply\nformat binary_little_endian 1.0\n";

TEST_F(HostileMesh, NotAMeshAtAll) {
  cheap_refusal(write("a.bin", ""));
  cheap_refusal(write("a.bin", std::string(1000, '\0')));
  cheap_refusal(write("a.ply", "hello world\n"));
  EXPECT_THROW(read_mesh(path("gone.ply")), IoError);
  EXPECT_THROW(read_mesh(path("")), IoError) << "a folder";
}

TEST_F(HostileMesh, PlyHeaders) {
  refuse_ply("ply\n");
  refuse_ply("ply\nformat ascii 1.0\nelement vertex 3\n");
  refuse_ply("ply\nformat morse 1.0\nend_header\n");
  refuse_ply("ply\nelement vertex 0\nend_header\n");
  refuse_ply(std::string(kAscii) + "property float x\nend_header\n");
  refuse_ply(std::string(kAscii) + "element vertex -3\n" + kXyz + "end_header\n");
  refuse_ply(std::string(kAscii) + "element vertex 99999999999999999999999\n" + kXyz + "end_header\n");
  refuse_ply(std::string(kAscii) + "element vertex 1\nproperty quaternion x\nend_header\n");
  refuse_ply(std::string(kAscii) + "element vertex 1\nproperty list float int x\nend_header\n");
  refuse_ply(std::string(kAscii) + "element vertex 1\nproperty float x\nproperty float y\nend_header\n0 0\n");
  refuse_ply(std::string(kAscii) + "gibberish\nend_header\n");
  refuse_ply(std::string(kAscii) + "obj_info origin_m 1 nan 2\nelement vertex 0\n" + kXyz + "end_header\n");
}

TEST_F(HostileMesh, PlyCountsBeyondTheFile) {
  for (const char* format : {kAscii, kBinary}) {
    for (const char* count : {"4000000000", "1000000000000000000", "18446744073709551615"}) {
      refuse_ply(std::string(format) + "element vertex " + count + "\n" + kXyz + "end_header\n0 0 0\n");
      refuse_ply(std::string(format) + "element vertex 0\n" + kXyz + "element face " + count +
                 "\nproperty list uchar int vertex_indices\nend_header\n3 0 1 2\n");
      refuse_ply(std::string(format) + "element other " + count + "\nproperty list uint double v\nelement vertex 0\n" +
                 kXyz + "end_header\n3 0 1 2\n");
    }
  }
}

TEST_F(HostileMesh, PlyLists) {
  const std::string header =
      "element vertex 3\n" + std::string(kXyz) + "element face 1\nproperty list uint int vertex_indices\nend_header\n";
  const std::string ascii = kAscii + header + "0 0 0\n1 0 0\n0 1 0\n";
  EXPECT_NE(refuse_ply(ascii + "4000000000 0 1 2\n").find("face 0"), std::string::npos);
  refuse_ply(ascii + "-3 0 1 2\n");
  refuse_ply(ascii + "nan 0 1 2\n");
  refuse_ply(ascii + "3 0 1\n");
  refuse_ply(ascii + "3 0 1 x\n");
  refuse_ply(ascii + "3 0 1 -1\n");
  refuse_ply(ascii + "3 0 1 nan\n");
  refuse_ply(ascii + "3 0 1 1e300\n");
  EXPECT_NE(refuse_ply(ascii + "3 0 1 3\n").find("vertex 3 of 3"), std::string::npos);
  const std::string binary = kBinary + header + std::string(36, '\0');
  refuse_ply(binary + std::string("\xFF\xFF\xFF\xFF", 4) + std::string(12, '\0'));
  refuse_ply(binary + std::string("\x03\0\0\0", 4) + std::string(11, '\0'));
}

TEST_F(HostileMesh, PlyPositionsThatAreNotFinite) {
  const std::string header = kAscii + std::string("element vertex 1\n") + kXyz + "end_header\n";
  for (const char* position : {"0 nan 0", "inf 0 0", "0 0 -inf", "0 1e300 0"})
    EXPECT_NE(refuse_ply(header + position + "\n").find("vertex 0"), std::string::npos);
}

TEST_F(HostileMesh, PlyUnknownTag) {
  refuse_ply(std::string(kAscii) + "element vertex 3\n" + kXyz +
             "element face 1\nproperty list uchar int vertex_indices\nproperty uchar tag\nend_header\n"
             "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 9\n");
}

TEST_F(HostileMesh, ObjLines) {
  for (const char* line : {"v 1 2", "v 1 2 nan", "v 1 inf 3", "v a b c", "f 1 2 4", "f 0 1 2", "f -4 1 2", "f 1 2 3/1",
                           "f 1 2 99999999999999999999", "vt nan 0", "vt inf", "f 1/x 2/1 3/1"}) {
    const std::string text = refuse_obj("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + std::string(line) + "\n");
    EXPECT_NE(text.find("line 4"), std::string::npos) << text;
  }
}

TEST_F(HostileMesh, ObjTextureThatIsNoImage) {
  write("m.mtl", "newmtl a\nmap_Kd m.mtl\n");
  const auto file = write("a.obj", "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n");
  try {
    read_mesh(file);
    FAIL();
  } catch (const InvalidInput& error) {
    EXPECT_NE(std::string(error.what()).find("m.mtl"), std::string::npos) << error.what();
  }
}

TEST_F(HostileMesh, ObjThatNamesAPipeOrADevice) {
  // Found by the fuzzer: without a writer the pipe, and the device without an end, would be read for ever.
  ASSERT_EQ(mkfifo(path("pipe").c_str(), 0600), 0);
  for (const std::string& library : {path("pipe").string(), std::string("/dev/zero")})
    EXPECT_THROW(read_mesh(write("a.obj", "mtllib " + library + "\nv 0 0 0\n")), IoError) << library;
  write("m.mtl", "newmtl a\nmap_Kd /dev/zero\n");
  EXPECT_THROW(read_mesh(write("a.obj", "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n")),
               IoError);
}

TEST_F(HostileMesh, GlbContainers) {
  const std::string good = GlbBuilder::triangle().bytes();
  ASSERT_EQ(read_mesh(write("good.glb", good)).triangle_count(), 1u);
  cheap_refusal(write("a.glb", "glTF"));
  std::string wrong = good;
  wrong[4] = 1;
  cheap_refusal(write("a.glb", wrong));
  wrong = good;
  wrong[15] = char(0x7F);  // length of the JSON chunk
  cheap_refusal(write("a.glb", wrong));
  const GlbBuilder empty;
  cheap_refusal(write("a.glb", empty.bytes_of("{\"asset\": ")));
  cheap_refusal(write("a.glb", empty.bytes_of("[]")));
  cheap_refusal(write("a.glb", empty.bytes_of(std::string(100000, '['))));
  cheap_refusal(write("a.glb", empty.bytes_of("{\"scenes\": 3, \"nodes\": \"x\"}")));
}

TEST_F(HostileMesh, GlbNumbersBeyondTheFile) {
  const std::vector<std::pair<std::string, json>> changes{
      {"/accessors/0/count", 4},
      {"/accessors/0/count", 4294967295u},
      {"/accessors/0/count", std::numeric_limits<std::uint64_t>::max()},
      {"/accessors/0/count", -1},
      {"/accessors/0/count", 2.5},
      {"/accessors/0/byteOffset", 4},
      {"/accessors/0/byteOffset", std::numeric_limits<std::uint64_t>::max() - 3},
      {"/accessors/0/bufferView", 7},
      {"/accessors/0/componentType", 5130},
      {"/accessors/0/componentType", 4294967296u + 5126u},
      {"/accessors/0/type", "MAT4"},
      {"/accessors/0/type", "VEC2"},
      {"/accessors/0/sparse", json::object()},
      {"/accessors/1/componentType", 5126},
      {"/bufferViews/0/byteLength", 1000000},
      {"/bufferViews/0/byteOffset", std::numeric_limits<std::uint64_t>::max()},
      {"/bufferViews/0/byteStride", 2},
      {"/bufferViews/0/byteStride", std::numeric_limits<std::uint64_t>::max()},
      {"/bufferViews/0/buffer", 1},
      {"/meshes/0/primitives/0/attributes/POSITION", 9},
      {"/meshes/0/primitives/0/attributes", 9},
      {"/meshes/0/primitives/0/material", 0},
      {"/meshes/0/primitives", 3},
      {"/nodes/0/mesh", 1},
      {"/nodes/0/children", json::array({0})},
      {"/nodes/0/children", json::array({5})},
      {"/nodes/0/translation", json::array({1, 2})},
      {"/nodes/0/scale", json::array({1, 1e300, 1e300})},
      {"/nodes/0/matrix", "unit"},
      {"/scenes/0/nodes", json::array({0, 0})},
      {"/scenes/0/nodes", json::array({-1})},
      {"/scene", 3},
      {"/extensionsRequired", json::array({"KHR_draco_mesh_compression"})},
  };
  for (const auto& [where, value] : changes) {
    SCOPED_TRACE(where + " = " + value.dump());
    GlbBuilder glb = GlbBuilder::triangle();
    glb.document[json::json_pointer(where)] = value;
    refuse_glb(glb);
  }
}

TEST_F(HostileMesh, GlbContents) {
  GlbBuilder glb = GlbBuilder::triangle();
  glb.binary[36] = 3;  // first index
  EXPECT_NE(refuse_glb(glb).find("vertex 3 of 3"), std::string::npos);
  glb = GlbBuilder::triangle();
  glb.binary[3] = char(0x7F), glb.binary[2] = char(0xC0);  // x of the first vertex: NaN
  refuse_glb(glb);
  glb = GlbBuilder::triangle();
  glb.document["images"][0]["bufferView"] = 0;
  glb.document["textures"][0]["source"] = 0;
  glb.document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = 0;
  glb.document["meshes"][0]["primitives"][0]["material"] = 0;
  EXPECT_NE(refuse_glb(glb).find("JPEG"), std::string::npos);
}

TEST_F(HostileMesh, GlbThatRepeatsAMeshWithoutEnd) {
  GlbBuilder glb;
  glb.add_accessor(std::vector<float>(3 * 30000, 0.5f), 5126, "VEC3", 30000);
  glb.document["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 0;
  for (int i = 0; i < 20000; ++i) {
    glb.document["nodes"].push_back({{"mesh", 0}});
    glb.document["scenes"][0]["nodes"].push_back(i);
  }
  refusal(write("a.glb", glb.bytes()));  // 600 million vertices from a file of a megabyte
}

/// Cut anywhere, or with any byte changed, a file gives a mesh or a refusal: nothing else, and always a valid mesh.
void expect_mesh_or_refusal(const std::filesystem::path& file) {
  Mesh mesh;
  try {
    mesh = read_mesh(file);
  } catch (const Error&) {
    return;  // refused
  }
  EXPECT_NO_THROW(check_mesh(mesh));
  for (const std::uint32_t page : mesh.triangle_page) EXPECT_TRUE(page == kInvalidIndex || page < mesh.pages.size());
}

TEST_F(HostileMesh, DamagedAtRandom) {
  Mesh mesh = test::grid_mesh(5, 4);
  test::add_colors(mesh);
  test::add_provenance(mesh);
  test::add_texture(mesh);
  std::mt19937 random(20240607);
  for (const char* name : {"a.ply", "a.obj", "a.glb"}) {
    write_mesh(mesh, path(name));
    const std::string good = read(name);
    for (std::size_t cut = 0; cut < good.size(); cut += 1 + good.size() / 200) {
      write(name, good.substr(0, cut));
      expect_mesh_or_refusal(path(name));
    }
    for (int round = 0; round < 400; ++round) {
      std::string bad = good;
      // Mostly in the front, where headers are.
      const std::size_t reach = round % 2 ? bad.size() : std::min<std::size_t>(bad.size(), 600);
      for (int k = 0; k < 3; ++k) bad[random() % reach] = char(random());
      write(name, bad);
      expect_mesh_or_refusal(path(name));
    }
  }
}

TEST_F(HostileMesh, TruncatedOwnFilesAreRefused) {
  const Mesh mesh = test::grid_mesh(9, 9);
  for (const char* name : {"a.ply", "a.glb"}) {
    write_mesh(mesh, path(name));
    const std::string good = read(name);
    for (const std::size_t cut : {good.size() - 1, good.size() / 2, std::size_t(40)}) {
      write(name, good.substr(0, cut));
      cheap_refusal(path(name));
    }
  }
}

TEST_F(HostileMesh, WritersRefuseBrokenMeshes) {
  const auto expect_refused = [&](const Mesh& mesh) {
    for (const char* name : {"a.ply", "a.obj", "a.glb"}) EXPECT_THROW(write_mesh(mesh, path(name)), InvalidInput);
    EXPECT_EQ(file_count(), 0u);
  };
  Mesh mesh = test::grid_mesh(3, 3);
  mesh.triangles[0][0] = 9;
  expect_refused(mesh);
  mesh = test::grid_mesh(3, 3);
  mesh.positions_m[4].y() = std::numeric_limits<float>::quiet_NaN();
  expect_refused(mesh);
  mesh = test::grid_mesh(3, 3);
  test::add_texture(mesh);
  mesh.triangle_page[0] = 2;
  expect_refused(mesh);
  mesh.triangle_page[0] = 0;
  mesh.texcoords[0][1].x() = std::numeric_limits<float>::infinity();
  expect_refused(mesh);
  mesh.texcoords.clear();
  expect_refused(mesh);
  EXPECT_THROW(write_mesh(test::grid_mesh(3, 3), path("a.3ds")), InvalidInput);
}

}  // namespace
}  // namespace lapseam
