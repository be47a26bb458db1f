// A simulated scan as a folder: what a user would have, and under truth/ what no user has.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <fstream>
#include <iomanip>
#include <limits>
#include <sstream>

#include "core/parallel.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "lapseam/simulate.h"

namespace lapseam {
namespace {

namespace fs = std::filesystem;

constexpr std::uint16_t kLargestStored = 65534;  // 65535 means "no sample" to some readers

/// Metres per stored unit: the finest of 1, 2, 5 × 10ⁿ that holds every range.
double png_scale(double largest_range_m) {
  for (double decade = 1e-6; decade < 1e6; decade *= 10)
    for (const double step : {1.0, 2.0, 5.0})
      if (step * decade * kLargestStored >= largest_range_m) return step * decade;
  return 1e6;
}

/// No range of any view is longer.
double largest_range(const SimulatedScene& scene, const std::vector<ViewSource>& planned,
                     const SensorEffects& effects) {
  Eigen::AlignedBox3d box;
  for (const auto& p : scene.mesh.positions_m) box.extend(scene.mesh.origin_m + p.cast<double>());
  for (const auto& view : planned) box.extend(view.T_world_view.translation());
  return std::min(effects.max_range_m, 1.05 * box.diagonal().norm());
}

Image<std::uint16_t> to_png16(const RangeImage& range, double scale_m) {
  Image<std::uint16_t> out(range.width, range.height);
  for (std::size_t i = 0; i < range.size(); ++i) {
    const double stored = std::round(double(range.pixels[i]) / scale_m);
    out.pixels[i] = stored <= kLargestStored ? std::uint16_t(stored) : std::uint16_t(0);
  }
  return out;
}

void make_folder(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error) throw IoError(path, "cannot be made: " + error.message());
}

struct ViewRecord {
  std::size_t samples = 0;
  double gain = 1;
};

class FolderWriter {
 public:
  FolderWriter(const SimulatedScene& scene, const std::vector<ViewSource>& planned, const SensorEffects& effects,
               const fs::path& folder, const FolderOptions& options)
      : effects_(effects),
        folder_(folder),
        options_(options),
        measured_(planned),
        truth_(planned),
        records_(planned.size()),
        scale_m_(png_scale(largest_range(scene, planned, effects))) {
    if (options.range_format != RangeFormat::kExr && options.range_format != RangeFormat::kPng16)
      throw InvalidInput(folder, {}, "range format", "must be EXR or 16-bit PNG");
    for (const char* part : {"range", "truth/range"}) make_folder(folder / part);
    if (options.has_color) make_folder(folder / "color");
    for (ViewSource& view : measured_)
      if (!options.has_color) view.color.reset();
  }

  const std::vector<ViewSource>& planned() const { return measured_; }

  void write_view(std::size_t i, const SimulatedView& simulated) {
    records_[i] = {std::size_t(std::count_if(simulated.view.range.pixels.begin(), simulated.view.range.pixels.end(),
                                             [](float r) { return r > 0; })),
                   simulated.exposure_gain};
    if (records_[i].samples == 0) return;
    ViewSource& view = measured_[i];
    view.T_world_view = simulated.view.T_world_view;
    // A model without noise would be no model; then the reader estimates what quantisation leaves.
    if (options_.declares_noise && effects_.noise.sigma(1.0) > 0) view.noise = effects_.noise;
    const bool is_png = options_.range_format == RangeFormat::kPng16;
    view.range = range_source(folder_ / "range" / (view.name + (is_png ? ".png" : ".exr")), *view.sensor);
    if (is_png) {
      view.range.format = RangeFormat::kPng16;
      view.range.scale_m = scale_m_;
      write_png16(view.range.file, to_png16(simulated.view.range, scale_m_));
    } else {
      write_range_exr(view.range.file, simulated.view.range, *view.sensor, view.T_world_view);
    }
    if (const Image<std::uint8_t>& intensity = simulated.view.intensity; !intensity.pixels.empty()) {
      view.range.intensity_file = folder_ / "range" / (view.name + "-intensity.png");
      write_png8(view.range.intensity_file, intensity);
    }
    if (view.color) {
      view.color->file = folder_ / "color" / (view.name + ".png");
      write_png(view.color->file, simulated.color);
    }
    ViewSource& truth = truth_[i];
    truth.color.reset();
    truth.range = range_source(folder_ / "truth" / "range" / (view.name + ".exr"), *view.sensor);
    write_range_exr(truth.range.file, simulated.true_range, *view.sensor, truth.T_world_view);
  }

  FolderReport finish(const SimulatedScene& scene, Context& context) {
    FolderReport report;
    Scene measured{scene.name, folder_ / "scene.json", {}},
        truth{scene.name + " truth", folder_ / "truth" / "scene.json", {}};
    std::ostringstream table;
    table << "name,exposure_gain,samples\n" << std::setprecision(std::numeric_limits<double>::max_digits10);
    for (std::size_t i = 0; i < records_.size(); ++i) {
      table << measured_[i].name << ',' << records_[i].gain << ',' << records_[i].samples << '\n';
      if (records_[i].samples == 0) {
        ++report.empty_views;
        continue;
      }
      report.samples += records_[i].samples;
      ++report.views;
      measured.views.push_back(std::move(measured_[i]));
      truth.views.push_back(std::move(truth_[i]));
    }
    if (report.views == 0) throw InvalidInput(folder_, {}, "views", "none of them measured anything");
    for (std::size_t i = 0; i < records_.size(); ++i)
      if (records_[i].samples == 0) context.warn("view " + measured_[i].name + " measured nothing and is left out");
    const fs::path table_file = folder_ / "truth" / "views.csv";
    std::ofstream out(table_file, std::ios::binary);
    out << table.str();
    if (!out.flush()) throw IoError(table_file, "cannot be written");
    write_scene(truth, truth.file);
    write_scene(measured, measured.file);
    return report;
  }

 private:
  static RangeSource range_source(fs::path file, const Sensor& sensor) {
    RangeSource range;
    range.format = RangeFormat::kExr;
    range.file = std::move(file);
    range.quantity = std::holds_alternative<SphericalSensor>(sensor) ? RangeQuantity::kDistance : RangeQuantity::kZ;
    return range;
  }

  const SensorEffects& effects_;
  fs::path folder_;
  const FolderOptions& options_;
  std::vector<ViewSource> measured_, truth_;
  std::vector<ViewRecord> records_;
  double scale_m_;
};

}  // namespace

FolderReport simulate_to_folder(const SimulatedScene& scene, const std::vector<ViewSource>& planned,
                                const SensorEffects& effects, const std::filesystem::path& folder,
                                const FolderOptions& options, Context& context) {
  if (planned.empty()) throw InvalidInput(folder, {}, "views", "there are none");
  const Simulator simulator(scene, options.seed, context, options.has_color);
  FolderWriter writer(scene, planned, effects, folder, options);
  {
    StageScope stage(context, "simulate", planned.size());
    // Small views side by side, so that encoding files keeps all threads busy; large ones one by one, to save memory.
    constexpr std::size_t kLargeView_px = 4'000'000;
    const Sensor& first = planned.front().sensor.value();
    const bool is_large = std::size_t(width(first)) * std::size_t(height(first)) > kLargeView_px;
    if (is_large || planned.size() < std::size_t(context.threads())) {
      for (std::size_t i = 0; i < planned.size(); ++i) {
        writer.write_view(i, simulator.simulate(writer.planned()[i], std::uint32_t(i), effects, context));
        stage.advance();
      }
    } else {
      parallel_for(context, planned.size(), 1, [&](std::size_t i) {
        writer.write_view(i, simulator.simulate_serially(writer.planned()[i], std::uint32_t(i), effects));
        stage.advance();
      });
    }
  }
  StageScope stage(context, "write truth");
  write_mesh(scene.mesh, folder / "truth" / "mesh.ply");
  return writer.finish(scene, context);
}

}  // namespace lapseam
