// floors SCENE [REPEAT]: what no integration of a scene can be faster than on this machine: decoding its range images,
// and one pass over the samples at memory speed (each read once and written once). Best of REPEAT (3), from the page
// cache, on one thread and on all. One JSON object on standard output.

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <ctime>

#include "core/parallel.h"
#include "lapseam/context.h"
#include "lapseam/io.h"

namespace {

using lapseam::RangeImage;

constexpr std::size_t kGrain = std::size_t(1) << 16;

struct Cost {
  double wall_s = 1e300;
  double processor_s = 1e300;  ///< of all threads; what other programs disturb less
};

template <typename F>
Cost best_of(int repeat, const F& f) {
  Cost best;
  for (int i = 0; i < repeat; ++i) {
    const std::clock_t processor = std::clock();
    const auto begin = std::chrono::steady_clock::now();
    f();
    const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    best.wall_s = std::min(best.wall_s, wall_s);
    best.processor_s = std::min(best.processor_s, double(std::clock() - processor) / CLOCKS_PER_SEC);
  }
  return best;
}

std::vector<RangeImage> decode(const lapseam::Scene& scene, lapseam::Context& context) {
  std::vector<RangeImage> images(scene.views.size());
  lapseam::parallel_for(context, images.size(), 1,
                        [&](std::size_t i) { images[i] = lapseam::load_view(scene.views[i]).range; });
  return images;
}

void pass_over(const std::vector<float>& from, std::vector<float>& to, lapseam::Context& context) {
  lapseam::parallel_blocks(context, from.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i != end; ++i) to[i] = from[i] * 1.5f;
  });
}

}  // namespace

int main(int count, char** arguments) {
  if (count < 2) {
    fmt::print(stderr, "floors SCENE [REPEAT]\n");
    return 2;
  }
  try {
    const int repeat = count > 2 ? std::max(1, std::atoi(arguments[2])) : 3;
    lapseam::Context one(1), all(0);
    const lapseam::Scene scene = lapseam::read_scene(arguments[1], {}, all);
    const Cost decode_1 = best_of(repeat, [&] { decode(scene, one); });
    const Cost decode_all = best_of(repeat, [&] { decode(scene, all); });
    std::vector<float> from, to;
    for (const RangeImage& image : decode(scene, all))
      from.insert(from.end(), image.pixels.begin(), image.pixels.end());
    to.resize(from.size());
    const Cost pass_1 = best_of(repeat, [&] { pass_over(from, to, one); });
    const Cost pass_all = best_of(repeat, [&] { pass_over(from, to, all); });
    fmt::print(
        "{{\"views\": {}, \"pixels\": {}, \"threads\": {}, \"decode_1_s\": {:.6f}, \"decode_s\": {:.6f}, "
        "\"decode_cpu_s\": {:.6f}, \"pass_1_s\": {:.6f}, \"pass_s\": {:.6f}, \"pass_cpu_s\": {:.6f}}}\n",
        scene.views.size(), from.size(), all.threads(), decode_1.wall_s, decode_all.wall_s, decode_1.processor_s,
        pass_1.wall_s, pass_all.wall_s, pass_1.processor_s);
  } catch (const std::exception& error) {
    fmt::print(stderr, "floors: {}\n", error.what());
    return 1;
  }
  return 0;
}
