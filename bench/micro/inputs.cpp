#include "inputs.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>

#include "lapseam/context.h"
#include "lapseam/io.h"
#include "lapseam/sew.h"
#include "lapseam/simulate.h"
#include "lapseam/smooth.h"

namespace lapseam::bench {
namespace {

namespace fs = std::filesystem;

struct Simulated {
  std::vector<View> views;
  std::vector<ViewSource> planned;
};

const Simulated& simulated() {
  static const Simulated made = [] {
    Context context;
    const SimulatedScene room = make_room();
    SensorRig rig = make_rgbd_rig();
    rig.color.reset();
    Simulated out;
    // The beginning of a walk of a hundred views: neighbours overlap as they do there.
    out.planned = make_trajectory(room, rig, {.kind = Trajectory::kWalk, .views = 100}, context);
    out.planned.resize(kViews);
    const Simulator simulator(room, 1, context, false);
    for (std::uint32_t i = 0; i < kViews; ++i)
      out.views.push_back(simulator.simulate(out.planned[i], i, rig.effects, context).view);
    return out;
  }();
  return made;
}

struct Folder {
  fs::path path = fs::temp_directory_path() / ("lapseam_micro_" + std::to_string(getpid()));
  Folder() { fs::create_directories(path); }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
};
const fs::path& folder() {
  static const Folder made;
  return made.path;
}

ViewSource source_of(RangeFormat format, const std::string& name) {
  ViewSource source = simulated().planned.front();
  source.range = {};
  source.range.format = format;
  source.range.file = folder() / name;
  return source;
}

}  // namespace

const std::vector<View>& views() { return simulated().views; }

NoiseModel noise() { return make_rgbd_rig().effects.noise; }

const StepThreshold& step_threshold() {
  static const StepThreshold made = [] {
    Context context;
    const View& view = views().front();
    const double left = smooth(view, noise(), {}, context).remaining_sigma_factor;
    return make_step_threshold(view.sensor, noise_at_steps(noise(), left));
  }();
  return made;
}

const std::vector<Patch>& patches() {
  static const std::vector<Patch> made = [] {
    Context context;
    const auto rays = make_ray_table(views().front().sensor, context);
    std::vector<Patch> out(kViews);
    for (std::size_t i = 0; i < out.size(); ++i) {
      Patch& patch = out[i];
      patch.view = views()[i];
      patch.noise = noise();
      patch.rays = rays;
      patch.view.range = smooth(patch.view, patch.noise, {}, context).range;
      patch.grid = triangulate(patch.view, *rays, step_threshold(), context);
      measure_confidence(patch, step_threshold(), context);
    }
    return out;
  }();
  return made;
}

const std::vector<Image<std::uint8_t>>& claims() {
  static const std::vector<Image<std::uint8_t>> made = [] {
    Context context;
    std::vector<Patch> copy = patches();
    return claim_samples(copy, {}, {}, context);
  }();
  return made;
}

Mesh sewn(Context& context) {
  Zipper zipper(patches(), {});
  for (const Claim least : {Claim::kBest, Claim::kYields})
    for (std::uint32_t i = 0; i < kViews; ++i) {
      Image<std::uint8_t> wanted = claims()[i];
      for (std::uint8_t& c : wanted.pixels) c = c == std::uint8_t(Claim::kBest) || c == std::uint8_t(least);
      zipper.add({i, wanted}, context);
    }
  return zipper.take();
}

const Mesh& mesh() {
  static const Mesh made = [] {
    Context context;
    return sewn(context);
  }();
  return made;
}

std::size_t sample_count(const View& view) {
  return std::size_t(std::count_if(view.range.pixels.begin(), view.range.pixels.end(), [](float r) { return r > 0; }));
}

std::size_t sample_count() {
  std::size_t sum = 0;
  for (const View& view : views()) sum += sample_count(view);
  return sum;
}

const ViewSource& exr_file() {
  static const ViewSource made = [] {
    const View& view = views().front();
    ViewSource source = source_of(RangeFormat::kExr, "range.exr");
    write_range_exr(source.range.file, view.range, view.sensor, view.T_world_view);
    return source;
  }();
  return made;
}

const ViewSource& png_file() {
  static const ViewSource made = [] {
    const View& view = views().front();
    ViewSource source = source_of(RangeFormat::kPng16, "range.png");
    source.range.scale_m = 1e-4;
    Image<std::uint16_t> stored(view.range.width, view.range.height);
    for (std::size_t i = 0; i < stored.size(); ++i)
      stored.pixels[i] = std::uint16_t(std::lround(double(view.range.pixels[i]) / source.range.scale_m));
    write_png16(source.range.file, stored);
    return source;
  }();
  return made;
}

}  // namespace lapseam::bench
