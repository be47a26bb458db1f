// Google benchmarks of the kernels, one by one, on neighbouring views of a simulated room. items: samples, except for
// reduction and what comes after it, where they are triangles. The argument is the number of threads.
//
//   build/release/micro [--benchmark_filter=Smooth] [--benchmark_format=json] …

#include <benchmark/benchmark.h>

#include <filesystem>

#include "core/parallel.h"
#include "health/self_intersection.h"
#include "inputs.h"
#include "lapseam/close_cracks.h"
#include "lapseam/context.h"
#include "lapseam/io.h"
#include "lapseam/noise.h"
#include "lapseam/reduce.h"
#include "lapseam/sensor.h"
#include "lapseam/sew.h"
#include "lapseam/smooth.h"

namespace lapseam::bench {
namespace {

using benchmark::State;

std::int64_t times(const State& state, std::size_t n) { return std::int64_t(state.iterations()) * std::int64_t(n); }

// ---- floors: reading files, and memory

void decode(State& state, const ViewSource& source) {
  for (auto _ : state) benchmark::DoNotOptimize(load_view(source));
  state.SetItemsProcessed(times(state, views().front().range.size()));
  state.SetBytesProcessed(times(state, std::filesystem::file_size(source.range.file)));
}
void DecodeExr(State& state) { decode(state, exr_file()); }
void DecodePng(State& state) { decode(state, png_file()); }

void PassOverSamples(State& state) {
  Context context(int(state.range(0)));
  // Larger than caches are.
  std::vector<float> from, to;
  while (from.size() < std::size_t(1) << 25)
    for (const View& view : views()) from.insert(from.end(), view.range.pixels.begin(), view.range.pixels.end());
  to.resize(from.size());
  for (auto _ : state) {
    parallel_blocks(context, from.size(), std::size_t(1) << 16, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i != end; ++i) to[i] = from[i] * 1.5f;
    });
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(times(state, from.size()));
  state.SetBytesProcessed(times(state, 2 * sizeof(float) * from.size()));
}

// ---- one view

void Unproject(State& state) {
  const Patch& patch = patches().front();
  const Pixels<float>& range = patch.view.range.pixels;
  std::vector<Eigen::Vector3f> points(range.size());
  for (auto _ : state) {
    for (std::size_t i = 0; i < range.size(); ++i) points[i] = patch.rays->point(i, range[i]);
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(times(state, range.size()));
  state.SetBytesProcessed(times(state, range.size() * (sizeof(float) + 2 * sizeof(Eigen::Vector3f))));
}

void Project(State& state) {
  const Patch& from = patches()[0];
  const View& to = patches()[1].view;
  const Eigen::Isometry3d T_to_from = to.T_world_view.inverse() * from.view.T_world_view;
  const auto& sensor = std::get<PinholeSensor>(to.sensor);
  const Pixels<float>& range = from.view.range.pixels;
  for (auto _ : state) {
    double sum = 0;
    PixelRange pixel;
    for (std::size_t i = 0; i < range.size(); ++i)
      if (range[i] > 0 && sensor.project(T_to_from * from.point_in_view(i).cast<double>(), pixel)) sum += pixel.u;
    benchmark::DoNotOptimize(sum);
  }
  state.SetItemsProcessed(times(state, sample_count(from.view)));
}

void EstimateNoise(State& state) {
  Context context(int(state.range(0)));
  std::vector<const View*> all;
  for (const View& view : views()) all.push_back(&view);
  for (auto _ : state) benchmark::DoNotOptimize(estimate_noise(all, context));
  state.SetItemsProcessed(times(state, sample_count()));
}

void Smooth(State& state) {
  Context context(int(state.range(0)));
  const View& view = views().front();
  for (auto _ : state) benchmark::DoNotOptimize(smooth(view, noise(), {}, context));
  state.SetItemsProcessed(times(state, sample_count(view)));
}

void Triangulate(State& state) {
  Context context(int(state.range(0)));
  const Patch& patch = patches().front();
  for (auto _ : state) benchmark::DoNotOptimize(triangulate(patch.view, *patch.rays, step_threshold(), context));
  state.SetItemsProcessed(times(state, sample_count(patch.view)));
}

void MeasureConfidence(State& state) {
  Context context(int(state.range(0)));
  Patch patch = patches().front();
  for (auto _ : state) measure_confidence(patch, step_threshold(), context);
  state.SetItemsProcessed(times(state, sample_count(patch.view)));
}

// ---- several views

void claim(State& state, bool consensus) {
  Context context(int(state.range(0)));
  const OverlapOptions options{.consensus = consensus};
  for (auto _ : state) {
    state.PauseTiming();
    std::vector<Patch> copy = patches();  // consensus moves their ranges
    state.ResumeTiming();
    benchmark::DoNotOptimize(claim_samples(copy, options, {}, context));
  }
  state.SetItemsProcessed(times(state, sample_count()));
}
/// Every sample projected into every view that can see it, and compared.
void Overlap(State& state) { claim(state, false); }
/// The same, and the mean of all that agree: consensus alone is the difference.
void OverlapAndConsensus(State& state) { claim(state, true); }

void Sew(State& state) {
  Context context(int(state.range(0)));
  claims();
  for (auto _ : state) benchmark::DoNotOptimize(sewn(context));
  state.SetItemsProcessed(times(state, sample_count()));
}

// ---- the mesh

void CloseCracks(State& state) {
  Context context(int(state.range(0)));
  for (auto _ : state) {
    state.PauseTiming();
    Mesh copy = mesh();
    state.ResumeTiming();
    benchmark::DoNotOptimize(close_cracks(copy, patches(), {}, context));
  }
  state.SetItemsProcessed(times(state, mesh().triangle_count()));
}

void FindSelfIntersections(State& state) {
  Context context(int(state.range(0)));
  for (auto _ : state) benchmark::DoNotOptimize(find_self_intersections(mesh().positions_m, mesh().triangles, context));
  state.SetItemsProcessed(times(state, mesh().triangle_count()));
}

/// To a quarter of its triangles.
void Reduce(State& state) {
  Context context(int(state.range(0)));
  const ReduceOptions options{.max_triangles = mesh().triangle_count() / 4};
  for (auto _ : state) benchmark::DoNotOptimize(reduce(mesh(), {}, options, context));
  state.SetItemsProcessed(times(state, mesh().triangle_count()));
}

void WritePly(State& state) {
  const std::filesystem::path file = exr_file().range.file.parent_path() / "mesh.ply";
  for (auto _ : state) write_mesh(mesh(), file);
  state.SetItemsProcessed(times(state, mesh().triangle_count()));
  state.SetBytesProcessed(times(state, std::filesystem::file_size(file)));
}

void alone(benchmark::internal::Benchmark* b) { b->Unit(benchmark::kMillisecond); }
void on_threads(benchmark::internal::Benchmark* b) {
  b->ArgName("threads")->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime()->MeasureProcessCPUTime();
}

BENCHMARK(DecodeExr)->Apply(alone);
BENCHMARK(DecodePng)->Apply(alone);
BENCHMARK(PassOverSamples)->Apply(on_threads);
BENCHMARK(Unproject)->Apply(alone);
BENCHMARK(Project)->Apply(alone);
BENCHMARK(EstimateNoise)->Apply(on_threads);
BENCHMARK(Smooth)->Apply(on_threads);
BENCHMARK(Triangulate)->Apply(on_threads);
BENCHMARK(MeasureConfidence)->Apply(on_threads);
BENCHMARK(Overlap)->Apply(on_threads);
BENCHMARK(OverlapAndConsensus)->Apply(on_threads);
BENCHMARK(Sew)->Apply(on_threads);
BENCHMARK(CloseCracks)->Apply(on_threads);
BENCHMARK(FindSelfIntersections)->Apply(on_threads);
BENCHMARK(Reduce)->Apply(on_threads);
BENCHMARK(WritePly)->Apply(alone);

}  // namespace
}  // namespace lapseam::bench

BENCHMARK_MAIN();
