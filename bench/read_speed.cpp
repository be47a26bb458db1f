// read_speed SCENE [THREADS]: how fast a scene opens (sensors are found in scans) and loads (ranges are read), from the
// page cache. Wall clock, and time of all cores together, which other programs on the machine disturb less.

#include <fmt/format.h>

#include <chrono>
#include <cstdlib>
#include <ctime>
#include <set>

#include "core/parallel.h"
#include "lapseam/context.h"
#include "lapseam/io.h"

namespace {

double seconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

}  // namespace

int main(int count, char** arguments) {
  if (count < 2) {
    fmt::print(stderr, "read_speed SCENE [THREADS]\n");
    return 2;
  }
  try {
    lapseam::Context context(count > 2 ? std::atoi(arguments[2]) : 1);
    const std::clock_t open_begin = std::clock();
    const auto begin = std::chrono::steady_clock::now();
    const lapseam::Scene scene = lapseam::read_scene(arguments[1], {}, context);
    const double open_s = seconds_since(begin);
    const double open_core_s = double(std::clock() - open_begin) / CLOCKS_PER_SEC;
    std::vector<std::uint64_t> samples(scene.views.size());
    const std::clock_t load_begin = std::clock();
    const auto loading = std::chrono::steady_clock::now();
    lapseam::parallel_for(context, scene.views.size(), 1, [&](std::size_t i) {
      for (const float r : lapseam::load_view(scene.views[i]).range.pixels) samples[i] += r > 0;
    });
    const double load_s = seconds_since(loading);
    const double load_core_s = double(std::clock() - load_begin) / CLOCKS_PER_SEC;
    std::uint64_t sum = 0;
    for (const std::uint64_t n : samples) sum += n;
    std::set<std::filesystem::path> files;
    for (const lapseam::ViewSource& view : scene.views) files.insert(view.range.file);
    double megabytes = 0;
    for (const std::filesystem::path& file : files) megabytes += double(std::filesystem::file_size(file)) / 1e6;
    fmt::print("{} views, {:.2f} M points, {:.0f} MB\n", scene.views.size(), double(sum) / 1e6, megabytes);
    const auto print = [&](const char* what, double wall_s, double core_s) {
      fmt::print("{}: {:.2f} s ({:.0f} MB/s, {:.2f} M points/s); per core {:.0f} MB/s, {:.2f} M points/s\n", what,
                 wall_s, megabytes / wall_s, double(sum) / 1e6 / wall_s, megabytes / core_s,
                 double(sum) / 1e6 / core_s);
    };
    print("open", open_s, open_core_s);
    print("load", load_s, load_core_s);
  } catch (const std::exception& error) {
    fmt::print(stderr, "read_speed: {}\n", error.what());
    return 1;
  }
  return 0;
}
