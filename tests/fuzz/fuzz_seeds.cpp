// fuzz_seeds OUT: writes OUT/corpus/TARGET/… and OUT/folders/…, with lapseam's own writers where there are some.

#include <zlib.h>

#include <cstdio>
#include <string>

#include "formats/room_scene.h"
#include "io/page_codec.h"

namespace lapseam::test {
namespace {

namespace fs = std::filesystem;

template <typename T>
void append(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

Mesh small_mesh(bool is_textured) {
  Mesh mesh;
  mesh.positions_m = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0.5f}};
  mesh.triangles = {{0, 1, 2}, {2, 1, 3}};
  if (!is_textured) {
    mesh.colors = {{1, 2, 3}, {4, 5, 6}, {7, 8, 9}, {10, 11, 12}};
    mesh.triangle_view = {0, 1};
    mesh.triangle_tag = {TriangleTag::kMeasured, TriangleTag::kSeam};
    return mesh;
  }
  mesh.texcoords.assign(2, {Eigen::Vector2f(0, 0), Eigen::Vector2f(1, 0), Eigen::Vector2f(0, 1)});
  mesh.triangle_page = {0, 0};
  mesh.pages = {make_color(8, 8)};
  return mesh;
}

std::string range_grid(const std::string& format) {
  std::string text =
      "ply\nformat " + format +
      " 1.0\nobj_info num_cols 6\nobj_info num_rows 5\nelement vertex 30\nproperty float x\nproperty float "
      "y\nproperty float z\nelement range_grid 30\nproperty list uchar int vertex_indices\nend_header\n";
  const bool is_text = format == "ascii";
  char line[96];
  for (int i = 0; i < 30; ++i) {
    const float x = 0.01f * float(i % 6), y = 0.01f * float(i / 6), z = 0.02f * float((i * 7) % 5);
    std::snprintf(line, sizeof line, "%g %g %g\n", double(x), double(y), double(z));
    if (is_text) text += line;
    for (const float value : {x, y, z})
      if (!is_text) append(text, value);
  }
  for (std::int32_t i = 0; i < 30; ++i) {
    if (is_text) {
      text += "1 " + std::to_string(i) + "\n";
    } else {
      append(text, std::uint8_t(1));
      append(text, i);
    }
  }
  return text;
}

std::string sens() {
  std::string bytes;
  append(bytes, std::uint32_t(4));
  append(bytes, std::uint64_t(1));
  bytes += "S";
  const auto matrix = [&](float f, float c) {
    for (const float v : {f, 0.f, c, 0.f, 0.f, f, c, 0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 0.f, 1.f}) append(bytes, v);
  };
  matrix(10, 4), matrix(1, 0), matrix(10, 4), matrix(1, 0);
  append(bytes, std::int32_t(2));
  append(bytes, std::int32_t(1));
  for (int i = 0; i < 4; ++i) append(bytes, std::uint32_t(8));
  append(bytes, 1000.0f);
  append(bytes, std::uint64_t(1));
  const std::vector<char> jpeg = encode_jpeg(make_color(8, 8), 80);
  const std::vector<std::uint16_t> depth(64, 1500);
  std::vector<Bytef> packed(compressBound(128));
  uLongf size = packed.size();
  compress(packed.data(), &size, reinterpret_cast<const Bytef*>(depth.data()), 128);
  matrix(1, 0);
  append(bytes, std::uint64_t(0));
  append(bytes, std::uint64_t(0));
  append(bytes, std::uint64_t(jpeg.size()));
  append(bytes, std::uint64_t(size));
  bytes.append(jpeg.data(), jpeg.size());
  bytes.append(reinterpret_cast<const char*>(packed.data()), size);
  return bytes;
}

std::string colmap_depth() {
  std::string bytes = "8&6&1&";
  for (int i = 0; i < 48; ++i) append(bytes, 1.0f + float(i % 7));
  return bytes;
}

std::string colmap_images() {
  std::string bytes;
  append(bytes, std::uint64_t(1));
  append(bytes, std::uint32_t(1));
  for (const double value : {1.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0}) append(bytes, value);
  append(bytes, std::uint32_t(3));
  bytes += "a.jpg";
  bytes += '\0';
  append(bytes, std::uint64_t(0));
  return bytes;
}

std::string colmap_cameras() {
  std::string bytes;
  append(bytes, std::uint64_t(1));
  append(bytes, std::uint32_t(3));
  append(bytes, std::uint32_t(1));
  append(bytes, std::uint64_t(8));
  append(bytes, std::uint64_t(6));
  for (const double value : {10.0, 11.0, 4.5, 3.5}) append(bytes, value);
  return bytes;
}

/// A depth map of NumPy: 8 x 6 floats or 16-bit integers.
std::string npy(const std::string& type) {
  std::string header = "{'descr': '" + type + "', 'fortran_order': False, 'shape': (6, 8), }";
  header.resize(118, ' ');
  header.back() = '\n';
  std::string bytes = "\x93NUMPY\x01";
  bytes += '\0';
  append(bytes, std::uint16_t(header.size()));
  bytes += header;
  for (int i = 0; i < 48; ++i)
    type == "<f4" ? append(bytes, 1.0f + float(i % 7)) : append(bytes, std::uint16_t(1000 + i));
  return bytes;
}

void write_folders(const fs::path& out, Context& context) {
  const PinholeSensor camera{8, 6, 8, 8, 3.5, 2.5, {}};
  const Scene scene = room_scene(camera, 2);
  convert_scene(scene, out / "scene", {.format = SceneFormat::kManifest}, context);
  convert_scene(scene, out / "tum", {.format = SceneFormat::kTum}, context);
  convert_scene(scene, out / "redwood", {.format = SceneFormat::kRedwood}, context);
  convert_scene(scene, out / "nerfstudio", {.format = SceneFormat::kNerfstudio}, context);
  write_bytes(out / "conf/a.ply", range_grid("ascii"));
  write_bytes(out / "conf/scene.conf", "camera 0 0 0 0 0 0 1\nbmesh a.ply 1 2 3 0 0 0 1\n");
  fs::create_directories(out / "seven");
  fs::copy_file(out / "redwood/depth/view0.png", out / "seven/frame-000000.depth.png",
                fs::copy_options::overwrite_existing);
  write_bytes(out / "seven/frame-000000.pose.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
  write_bytes(out / "seven/camera-intrinsics.txt", "585 0 320\n0 585 240\n0 0 1\n");
  write_bytes(out / "nerfstudio_npy/transforms.json",
              R"({"fl_x": 8, "fl_y": 8, "cx": 4, "cy": 3, "w": 8, "h": 6, "frames": [{"file_path": "a",
 "depth_file_path": "depth.npy", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]})");
  write_bytes(out / "nerfstudio_npy/depth.npy", npy("<f4"));
  for (const char* name : {"colmap_text", "colmap_binary"})
    write_bytes(out / name / "stereo/depth_maps/a.jpg.geometric.bin", colmap_depth());
  write_bytes(out / "colmap_text/sparse/cameras.txt", "3 PINHOLE 8 6 10 11 4.5 3.5\n");
  write_bytes(out / "colmap_text/sparse/images.txt", "1 1 0 0 0 1 2 3 3 a.jpg\n\n");
  write_bytes(out / "colmap_binary/sparse/cameras.bin", colmap_cameras());
  write_bytes(out / "colmap_binary/sparse/images.bin", colmap_images());
}

void write_scans(const fs::path& out, Context& context) {
  const auto scanner = SphericalSensor::from_limits(12, 8, -1, 1, 0.6, -0.5);
  const PinholeSensor camera{8, 6, 8, 8, 3.5, 2.5, {}};
  int count = 0;
  for (const Scene& scene : {room_scene(scanner, 2), room_scene(camera, 1, false)}) {
    const std::string name = "seed" + std::to_string(count++);
    for (const char* kind : {"e57", "ptx", "pcd"}) fs::create_directories(out / kind);
    convert_scene(scene, out / "e57" / name, {.format = SceneFormat::kE57}, context);
    convert_scene(scene, out / "ptx" / name, {.format = SceneFormat::kPtx}, context);
    convert_scene(scene, out / ".pcd", {.format = SceneFormat::kPcd}, context);
    fs::copy_file(out / ".pcd/view0.pcd", out / "pcd" / name, fs::copy_options::overwrite_existing);
    fs::remove_all(out / ".pcd");
    const View view = load_view(scene.views[0]);
    const ColorImage color = make_color(view.range.width, view.range.height);
    fs::create_directories(out / "exr");
    write_range_exr(out / "exr" / name, view.range, view.sensor, view.T_world_view, count == 1 ? &color : nullptr);
  }
}

void write_images_and_meshes(const fs::path& out) {
  for (const char* kind : {"png", "jpeg", "ply", "obj", "glb"}) fs::create_directories(out / kind);
  write_png(out / "png/color", make_color(9, 7));
  write_png16(out / "png/range", Image<std::uint16_t>(9, 7, 1500));
  const std::vector<char> jpeg = encode_jpeg(make_color(17, 9), 80);
  write_bytes(out / "jpeg/seed", {jpeg.data(), jpeg.size()});
  for (const bool is_textured : {false, true}) {
    const std::string name = is_textured ? "textured" : "colored";
    for (const std::string kind : {"ply", "obj", "glb"}) {
      if (kind == "obj" && is_textured) continue;  // its other files are not there when it is read alone
      write_mesh(small_mesh(is_textured), out / kind / (name + "." + kind));
    }
  }
}

}  // namespace
}  // namespace lapseam::test

int main(int count, char** arguments) {
  using namespace lapseam::test;
  if (count != 2) return 2;
  const std::filesystem::path out = arguments[1];
  const auto corpus = out / "corpus", folders = out / "folders";
  std::filesystem::create_directories(corpus);
  std::filesystem::create_directories(folders);
  lapseam::Context context(1);
  write_scans(corpus, context);
  write_images_and_meshes(corpus);
  write_bytes(corpus / "ply/grid_text", range_grid("ascii"));
  write_bytes(corpus / "ply/grid_binary", range_grid("binary_little_endian"));
  write_bytes(corpus / "sens/seed", sens());
  write_folders(folders, context);
  // What each folder's fuzzed files are at first; the first byte says which of them it is (kTargets in
  // fuzz_readers.cpp).
  const std::pair<const char*, std::vector<const char*>> seeds[] = {
      {"manifest", {"scene/scene.json"}},
      {"conf", {"conf/scene.conf"}},
      {"seven_scenes", {"seven/frame-000000.pose.txt", "seven/camera-intrinsics.txt"}},
      {"tum", {"tum/groundtruth.txt", "tum/depth.txt", "tum/calibration.txt"}},
      {"redwood", {"redwood/trajectory.log", "redwood/camera_intrinsic.json"}},
      {"nerfstudio", {"nerfstudio/transforms.json", "nerfstudio_npy/depth.npy"}},
      {"colmap",
       {"colmap_text/sparse/images.txt", "colmap_text/sparse/cameras.txt", "colmap_binary/sparse/images.bin",
        "colmap_binary/sparse/cameras.bin", "colmap_binary/stereo/depth_maps/a.jpg.geometric.bin"}}};
  for (const auto& [target, files] : seeds)
    for (std::size_t i = 0; i < files.size(); ++i)
      write_bytes(corpus / target / ("seed" + std::to_string(i)), char(i) + read_bytes(folders / files[i]));
  write_bytes(corpus / "nerfstudio/integers", '\1' + npy("<u2"));
  return 0;
}
