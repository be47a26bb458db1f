// All readers behind one libFuzzer entry, a target each. The environment variable LAPSEAM_FUZZ_TARGET says which one is
// fed (see kTargets); whatever it is fed, it may only return or throw lapseam::Error, in less than a second.

#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "io/colmap.h"
#include "core/crc32c.h"
#include "io/e57/paged_file.h"
#include "io/output_file.h"
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

/// LAPSEAM_FUZZ_FOLDERS has a folder for each kind of scene that is one. The fuzzed bytes replace one of the files that
/// are given, FOLDER/NAME, in copies of their own; the first byte says which.
class FolderFiles {
 public:
  explicit FolderFiles(const std::vector<std::string>& files) {
    const char* folders = std::getenv("LAPSEAM_FUZZ_FOLDERS");
    if (!folders) {
      std::fprintf(stderr, "LAPSEAM_FUZZ_FOLDERS is not set; tools/fuzz does that\n");
      std::exit(2);
    }
    std::string pattern = "/dev/shm/lapseam_fuzz_XXXXXX";
    place_ = mkdtemp(pattern.data());
    for (const std::string& file : files) {
      const std::string folder = file.substr(0, file.find('/'));
      if (!fs::exists(place_ / folder))
        fs::copy(fs::path(folders) / folder, place_ / folder, fs::copy_options::recursive);
      const std::vector<char> bytes = read_file_bytes(place_ / file);
      files_.push_back({place_ / folder, place_ / file, {bytes.begin(), bytes.end()}});
    }
  }
  ~FolderFiles() {
    std::error_code ignored;
    fs::remove_all(place_, ignored);
  }
  void fill(std::string_view bytes) {
    const std::size_t chosen = bytes.empty() ? 0 : std::uint8_t(bytes[0]) % files_.size();
    if (chosen != last_) write(files_[last_].path, files_[last_].original);
    last_ = chosen;
    write(files_[chosen].path, bytes.empty() ? bytes : bytes.substr(1));
  }
  const fs::path& folder() const { return files_[last_].folder; }

 private:
  struct File {
    fs::path folder, path;
    std::string original;
  };
  static void write(const fs::path& path, std::string_view bytes) {
    std::FILE* out = std::fopen(path.c_str(), "wb");
    if (!out || std::fwrite(bytes.data(), 1, bytes.size(), out) != bytes.size() || std::fclose(out) != 0) std::abort();
  }

  fs::path place_;
  std::vector<File> files_;
  std::size_t last_ = 0;
};

void load_all(const fs::path& path) {
  Context context(1);
  const Scene scene = read_scene(path, {}, context);
  for (const ViewSource& view : scene.views) {
    load_view(view);
    if (view.color) load_color(view);
  }
}

using Feed = std::function<void(std::string_view)>;

Feed scene_file() {
  return [file = MemoryFile()](std::string_view bytes) {
    file.fill(bytes);
    load_all(file.path());
  };
}

/// A fuzzer hardly ever guesses a checksum; what lies behind it is to be reached all the same. The last page of a file
/// that ends within one stays wrong.
Feed e57_file() {
  return [file = MemoryFile()](std::string_view bytes) {
    std::string mended(bytes);
    for (std::size_t page = 0; page + kE57PageBytes <= mended.size(); page += kE57PageBytes) {
      const std::uint32_t sum = __builtin_bswap32(crc32c(mended.data() + page, kE57PayloadBytes));
      std::memcpy(mended.data() + page + kE57PayloadBytes, &sum, sizeof sum);
    }
    file.fill(mended);
    load_all(file.path());
  };
}

Feed scene_folder(const std::vector<std::string>& files) {
  return [place = std::make_shared<FolderFiles>(files)](std::string_view bytes) {
    place->fill(bytes);
    load_all(place->folder());
  };
}

Feed bare_file(void (*read)(const fs::path&)) {
  return [file = MemoryFile(), read](std::string_view bytes) {
    file.fill(bytes);
    read(file.path());
  };
}

/// Calls both, whatever the first one throws.
template <typename First, typename Second>
void read_twice(const First& first, const Second& second) {
  try {
    first();
  } catch (const Error&) {
    second();
    throw;
  }
  second();
}

// One target for each reader. What takes more than one file gets each of them fuzzed; a file that two readers take
// (meshes and range grids are both PLY, ranges and colours both PNG) is given to both.
const std::map<std::string_view, std::function<Feed()>> kTargets{
    {"e57", e57_file},
    {"ptx", scene_file},
    {"pcd", scene_file},
    {"sens", scene_file},
    {"exr", scene_file},
    {"png",
     [] {
       return bare_file(
           [](const fs::path& file) { read_twice([&] { read_png16(file); }, [&] { read_color_image(file); }); });
     }},
    {"jpeg", [] { return bare_file([](const fs::path& file) { read_color_image(file); }); }},
    {"ply",
     [] {
       return bare_file([](const fs::path& file) { read_twice([&] { read_mesh(file); }, [&] { load_all(file); }); });
     }},
    {"obj", [] { return bare_file([](const fs::path& file) { read_mesh(file); }); }},
    {"glb", [] { return bare_file([](const fs::path& file) { read_mesh(file); }); }},
    {"manifest", [] { return scene_folder({"scene/scene.json"}); }},
    {"conf", [] { return scene_folder({"conf/scene.conf"}); }},
    {"seven_scenes",
     [] {
       return scene_folder({"seven/frame-000000.pose.txt", "seven/camera-intrinsics.txt"});
     }},
    {"tum",
     [] {
       return scene_folder({"tum/groundtruth.txt", "tum/depth.txt", "tum/calibration.txt"});
     }},
    {"redwood",
     [] {
       return scene_folder({"redwood/trajectory.log", "redwood/camera_intrinsic.json"});
     }},
    {"nerfstudio",
     [] {
       return scene_folder({"nerfstudio/transforms.json", "nerfstudio_npy/depth.npy"});
     }},
    {"colmap",
     [] {
       return scene_folder({"colmap_text/sparse/images.txt", "colmap_text/sparse/cameras.txt",
                            "colmap_binary/sparse/images.bin", "colmap_binary/sparse/cameras.bin",
                            "colmap_binary/stereo/depth_maps/a.jpg.geometric.bin"});
     }},
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
  // Time of this process, not of the clock on the wall: other programs may have the processor meanwhile.
  const std::clock_t begin = std::clock();
  try {
    feed({reinterpret_cast<const char*>(data), size});
  } catch (const lapseam::Error& error) {
    // The promise to the user: one line.
    if (std::string_view(error.what()).find('\n') != std::string_view::npos) std::abort();
  }
  if (std::clock() - begin > CLOCKS_PER_SEC) {
    std::fprintf(stderr, "more than a second for one file\n");
    std::abort();
  }
  return 0;
}
