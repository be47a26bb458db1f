// All readers behind one libFuzzer entry. The environment variable LAPSEAM_FUZZ_TARGET says which one is fed (see
// kTargets); whatever it is fed, it may only return or throw lapseam::Error.

#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "io/colmap.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

namespace fs = std::filesystem;

/// A file in memory with a name.
class MemoryFile {
 public:
  MemoryFile() : descriptor_(memfd_create("lapseam_fuzz", 0)) {
    if (descriptor_ < 0) std::abort();
    path_ = "/proc/self/fd/" + std::to_string(descriptor_);
  }
  void fill(std::string_view bytes) const {
    if (ftruncate(descriptor_, off_t(bytes.size())) != 0 ||
        pwrite(descriptor_, bytes.data(), bytes.size(), 0) != ssize_t(bytes.size()))
      std::abort();
  }
  const fs::path& path() const { return path_; }

 private:
  int descriptor_;
  fs::path path_;
};

/// The folder of seeds has one for each kind of folder: LAPSEAM_FUZZ_FOLDERS/tum and so on. The fuzzed file replaces
/// one of its files, in a copy of its own.
class FolderFile {
 public:
  FolderFile(const char* folder, const char* file) {
    const char* folders = std::getenv("LAPSEAM_FUZZ_FOLDERS");
    if (!folders) {
      std::fprintf(stderr, "LAPSEAM_FUZZ_FOLDERS is not set; tools/fuzz does that\n");
      std::exit(2);
    }
    std::string pattern = "/dev/shm/lapseam_fuzz_XXXXXX";
    folder_ = mkdtemp(pattern.data());
    fs::copy(fs::path(folders) / folder, folder_, fs::copy_options::recursive);
    file_ = folder_ / file;
  }
  ~FolderFile() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  void fill(std::string_view bytes) const {
    std::FILE* out = std::fopen(file_.c_str(), "wb");
    if (!out || std::fwrite(bytes.data(), 1, bytes.size(), out) != bytes.size() || std::fclose(out) != 0) std::abort();
  }
  const fs::path& folder() const { return folder_; }

 private:
  fs::path folder_, file_;
};

void load_all(const fs::path& path, Context& context) {
  const Scene scene = read_scene(path, {}, context);
  for (const ViewSource& view : scene.views) {
    load_view(view);
    if (view.color) load_color(view);
  }
}

using Feed = std::function<void(std::string_view)>;

Feed scene_file() {
  return [file = MemoryFile(), context = std::make_shared<Context>(1)](std::string_view bytes) {
    file.fill(bytes);
    load_all(file.path(), *context);
  };
}

Feed scene_folder(const char* folder, const char* name) {
  return [place = std::make_shared<FolderFile>(folder, name),
          context = std::make_shared<Context>(1)](std::string_view bytes) {
    place->fill(bytes);
    load_all(place->folder(), *context);
  };
}

Feed bare_file(void (*read)(const fs::path&)) {
  return [file = MemoryFile(), read](std::string_view bytes) {
    file.fill(bytes);
    read(file.path());
  };
}

const std::map<std::string_view, std::function<Feed()>> kTargets{
    {"e57", scene_file},
    {"ptx", scene_file},
    {"pcd", scene_file},
    {"sens", scene_file},
    {"exr", scene_file},
    {"range_grid", scene_file},
    {"png", [] { return bare_file([](const fs::path& file) { read_color_image(file); }); }},
    {"png16", [] { return bare_file([](const fs::path& file) { read_png16(file); }); }},
    {"jpeg", [] { return bare_file([](const fs::path& file) { read_color_image(file); }); }},
    {"colmap_depth", [] { return bare_file([](const fs::path& file) {
                            read_colmap_depth({file, {}});
                          }); }},
    {"ply", [] { return bare_file([](const fs::path& file) { read_mesh(file); }); }},
    {"obj", [] { return bare_file([](const fs::path& file) { read_mesh(file); }); }},
    {"glb", [] { return bare_file([](const fs::path& file) { read_mesh(file); }); }},
    {"manifest", [] { return scene_folder("scene", "scene.json"); }},
    {"conf", [] { return scene_folder("conf", "scene.conf"); }},
    {"seven_scenes", [] { return scene_folder("seven", "frame-000000.pose.txt"); }},
    {"tum", [] { return scene_folder("tum", "groundtruth.txt"); }},
    {"tum_list", [] { return scene_folder("tum", "depth.txt"); }},
    {"redwood", [] { return scene_folder("redwood", "trajectory.log"); }},
    {"redwood_json", [] { return scene_folder("redwood", "camera_intrinsic.json"); }},
    {"nerfstudio", [] { return scene_folder("nerfstudio", "transforms.json"); }},
    {"colmap_text", [] { return scene_folder("colmap_text", "sparse/images.txt"); }},
    {"colmap_cameras", [] { return scene_folder("colmap_text", "sparse/cameras.txt"); }},
    {"colmap_binary", [] { return scene_folder("colmap_binary", "sparse/images.bin"); }},
};

Feed chosen_target() {
  const char* name = std::getenv("LAPSEAM_FUZZ_TARGET");
  const auto found = kTargets.find(name ? name : "");
  if (found == kTargets.end()) {
    std::fprintf(stderr, "LAPSEAM_FUZZ_TARGET must be one of:");
    for (const auto& [known, make] : kTargets) std::fprintf(stderr, " %s", std::string(known).c_str());
    std::fprintf(stderr, "\n");
    std::exit(2);
  }
  return found->second();
}

}  // namespace
}  // namespace lapseam

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const lapseam::Feed feed = lapseam::chosen_target();
  try {
    feed({reinterpret_cast<const char*>(data), size});
  } catch (const lapseam::Error& error) {
    // The promise to the user: one line.
    if (std::string_view(error.what()).find('\n') != std::string_view::npos) std::abort();
  }
  return 0;
}
