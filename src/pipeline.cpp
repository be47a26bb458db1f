// The only file that sees every stage.

#include <algorithm>
#include <optional>

#include "core/memory.h"
#include "core/parallel.h"
#include "core/spill_file.h"

#include "io/scene_formats.h"
#include "lapseam/close_cracks.h"
#include "lapseam/error.h"
#include "lapseam/integrate.h"
#include "lapseam/io.h"
#include "lapseam/survey.h"
#include "lapseam/triangulate.h"
#include "load_views.h"
#include "mend/extend_outlines.h"
#include "mend/untangle.h"

namespace lapseam {
namespace {

// While the model grows it is thinned now and then, to this share of what the result may lose: more would show in what
// later views are compared with.
constexpr double kEarlyShare = 0.4;
// Closing cracks adds triangles to a count that is asked for.
constexpr double kShareBeforeClosing = 0.97;
constexpr std::size_t kTrianglesBetweenThinnings = 200'000;
// Of the border, for views to come back to it, and to be where something ends: slits are closed afterwards, in space.
constexpr std::uint32_t kShortestOutline = 12;
// The same on every machine, for the mesh depends on it.
constexpr std::size_t kMostTurnsAtOnce = 8;

// Bytes for a pixel of a view: range, cells, confidence, incidence, claim.
constexpr std::uint64_t kViewBytes = 8;
// While a view is smoothed and triangulated.
constexpr std::uint64_t kWorkBytes = 24;
// A sample's ray.
constexpr std::uint64_t kRayBytes = 12;
// The model at its largest and what thins it, for a pixel of all views: four to six were seen (docs/benchmarks.md).
constexpr std::uint64_t kModelBytes = 5, kLeastModelBytes = 3;
// A hundred views of VGA size just fit into it. With much less than half over the least, images come and go all the
// time.
constexpr std::uint64_t kUsualBytes = 400'000'000;
// Scenes that take less than that, but more than a small one, get this share of what they would take: the allocator
// keeps memory for later, and not all images are looked at all the time.
constexpr std::uint64_t kSmallBytes = 200'000'000;
constexpr double kUsualShare = 0.8;

std::string in_megabytes(std::uint64_t bytes) { return std::to_string((bytes + 999'999) / 1'000'000) + " MB"; }

class Integration {
 public:
  Integration(const Scene& scene, const IntegrateOptions& options, Context& context)
      : scene_(scene), options_(options), context_(context) {}

  IntegrateResult run() {
    check_budget();
    load();
    smooth_views();
    measure_disagreement();
    prepare_patches();
    zip();
    clean();
    finish();
    color();
    {
      StageScope stage(context_, "health");
      result_.report.health =
          check_health(result_.mesh, {.self_intersections = options_.check_self_intersections}, context_);
    }
    report_memory();
    return std::move(result_);
  }

 private:
  void check_budget() const {
    const std::uint64_t budget = context_.memory_use().budget_bytes;
    if (budget == 0) return;
    const MemoryEstimate needed = estimate_memory(scene_, options_, context_.threads());
    if (budget < needed.least_bytes)
      throw InvalidInput(scene_.file, {}, "memory",
                         in_megabytes(budget) + " will not do; about " + in_megabytes(needed.least_bytes) + " would");
  }

  void report_memory() {
    result_.report.memory = context_.memory_use();
    const std::uint64_t budget = result_.report.memory.budget_bytes, peak = peak_rss_bytes();
    if (budget > 0 && peak > budget)
      context_.warn("memory went " + in_megabytes(peak - budget) + " over the budget of " + in_megabytes(budget) +
                    ": the model itself stays in memory");
  }

  void load() {
    LoadedViews loaded =
        load_views(scene_, {.hold_out = options_.hold_out, .skip_bad_views = options_.skip_bad_views}, context_);
    ViewNoise noise;
    {
      StageScope stage(context_, "noise");
      noise = estimate_view_noise(scene_, loaded, context_);
    }
    noise_ = noise.of_view;
    if (options_.registration) place(loaded);
    views_ = std::move(loaded.views);
    drop_unused_intensities(noise_, views_);
    source_index_ = std::move(loaded.source_index);
    result_.report.views_left_out = std::move(loaded.left_out);
    for (const auto& [id, sensor] : noise.sensors) {
      SensorReport& report = result_.report.sensors[id];
      report.views = sensor.members.size();
      report.noise = sensor.noise;
      report.is_noise_given = sensor.is_given;
      report.measured = sensor.measured;
    }
  }

  // Textures are projected from the scene's poses, so those move too.
  void place(LoadedViews& loaded) {
    RegisterOptions registration = *options_.registration;
    registration.fixed = places_of(registration.fixed, loaded, scene_);
    RegisterResult placed = register_views(loaded.views, noise_, pictures_of(scene_, loaded), registration, context_);
    for (std::size_t i = 0; i < loaded.views.size(); ++i) {
      ViewSource& source = scene_.views[loaded.source_index[i]];
      loaded.views[i].T_world_view = source.T_world_view = placed.views[i].T_world_view;
      if (!placed.views[i].problem.empty()) context_.warn(warning_about(source.name, placed.views[i]));
    }
    result_.report.placed_views = std::move(placed.views);
    result_.report.registration = std::move(placed.report);
  }

  void smooth_views() {
    StageScope stage(context_, "smooth", views_.size());
    result_.report.views.resize(views_.size());
    parallel_for(context_, views_.size(), 1, [&](std::size_t i) {
      ViewReport& report = result_.report.views[i];
      report.name = views_[i].name;
      for (const float r : views_[i].range.pixels) report.samples += r > 0;
      SmoothResult smoothed = smooth(views_[i], noise_[i], options_.smooth, context_);
      views_[i].range = std::move(smoothed.range);
      report.smoothing_sigma_factor = smoothed.remaining_sigma_factor;
      stage.advance();
    });
    report_thresholds();
  }

  // Of smoothed views: what poses are off by by less than the noise of a sample would hide in it.
  void measure_disagreement() {
    StageScope stage(context_, "disagreement");
    std::vector<NoiseModel> left = noise_;
    for (std::size_t i = 0; i < left.size(); ++i)
      left[i] = left[i].scaled(result_.report.views[i].smoothing_sigma_factor);
    result_.report.disagreement = survey_disagreement(views_, left, context_);
    overlap_ = options_.overlap;
    if (!(overlap_.registration_error_m > 0))
      overlap_.registration_error_m = result_.report.disagreement.error.median_m;
    result_.report.registration_error_m = overlap_.registration_error_m;
  }

  // Steps are told in smoothed range images.
  StepThreshold step_threshold_of(std::size_t i) const {
    const NoiseModel left = noise_at_steps(noise_[i], result_.report.views[i].smoothing_sigma_factor);
    return make_step_threshold(views_[i].sensor, left);
  }

  // At the nearest, middle and farthest sample of each sensor's first view; loading has seen to it that there are some.
  void report_thresholds() {
    for (auto& entry : result_.report.sensors) {
      SensorReport& sensor = entry.second;
      const auto first =
          std::find_if(views_.begin(), views_.end(), [&](const View& v) { return v.sensor_id == entry.first; });
      std::vector<float> ranges;
      for (const float r : first->range.pixels)
        if (r > 0) ranges.push_back(r);
      std::sort(ranges.begin(), ranges.end());
      const StepThreshold threshold = step_threshold_of(std::size_t(first - views_.begin()));
      const std::size_t at[3] = {0, ranges.size() / 2, ranges.size() - 1};
      for (std::size_t k = 0; k < 3; ++k) {
        sensor.range_m[k] = double(ranges[at[k]]);
        sensor.sigma_m[k] = sensor.noise.sigma(sensor.range_m[k]);
        sensor.spacing_m[k] = threshold.spacing(sensor.range_m[k]);
        sensor.step_m[k] = threshold.isolated(sensor.range_m[k]);
      }
    }
  }

  // Rays depend on the sensor alone; views that share a sensor id and a model share the table.
  void make_rays() {
    std::map<std::string, std::size_t> first_of_sensor;
    std::vector<std::size_t> owner(views_.size());
    for (std::size_t i = 0; i < views_.size(); ++i) {
      const std::size_t first = first_of_sensor.try_emplace(views_[i].sensor_id, i).first->second;
      // Scanners of one id may have tables of their own.
      owner[i] = is_same_sensor(views_[first].sensor, views_[i].sensor) ? first : i;
    }
    rays_.resize(views_.size());
    parallel_for(context_, views_.size(), 1, [&](std::size_t i) {
      if (owner[i] != i) return;
      const std::shared_ptr<RayTable> rays = make_ray_table(views_[i].sensor, context_);
      for (auto* plane : {&rays->directions, &rays->origins}) {
        spill(*plane, context_);
        seal(*plane, context_);
      }
      rays_[i] = rays;
    });
    for (std::size_t i = 0; i < views_.size(); ++i) rays_[i] = rays_[owner[i]];
  }

  void prepare_patches() {
    make_rays();
    StageScope stage(context_, "triangulate", views_.size());
    patches_.resize(views_.size());
    parallel_for(context_, views_.size(), 1, [&](std::size_t i) {
      const StepThreshold threshold = step_threshold_of(i);
      Patch& patch = patches_[i];
      patch.view = std::move(views_[i]);
      patch.noise = noise_[i];
      patch.rays = rays_[i];
      patch.grid = triangulate(patch.view, *patch.rays, threshold, context_);
      measure_confidence(patch, threshold, context_);
      for_each_plane(patch, [&](auto& pixels) { spill(pixels, context_); });
      result_.report.views[i].triangles = patch.grid.triangle_count();
      stage.advance();
    });
  }

  static Image<std::uint8_t> wanted_of(const Image<std::uint8_t>& claims, Claim least) {
    Image<std::uint8_t> wanted = claims;
    for (std::uint8_t& c : wanted.pixels) c = c == std::uint8_t(Claim::kBest) || c == std::uint8_t(least);
    return wanted;
  }

  // What is known of each pixel of a view.
  template <typename P, typename F>
  static void for_each_plane(P& patch, const F& f) {
    f(patch.view.range.pixels);
    f(patch.grid.cells);
    f(patch.confidence.pixels);
    f(patch.incidence.pixels);
  }

  // What a memory budget keeps in a file must come back as it went.
  void seal_view(const Patch& patch, const Image<std::uint8_t>& claims) const {
    for_each_plane(patch, [&](const auto& pixels) { seal(pixels, context_); });
    seal(claims.pixels, context_);
  }
  void check_views(const std::vector<std::uint32_t>& views, const std::vector<Image<std::uint8_t>>& claims) const {
    if (!spill_file_of(context_)) return;
    std::map<const void*, std::uint32_t> view_of;  // rays are shared
    for (const std::uint32_t i : views) {
      view_of.emplace(claims[i].pixels.data(), i);
      view_of.emplace(rays_[i]->directions.data(), i);
      view_of.emplace(rays_[i]->origins.data(), i);
      for_each_plane(patches_[i], [&](const auto& pixels) { view_of.emplace(pixels.data(), i); });
    }
    const std::vector<std::pair<const void*, std::uint32_t>> planes(view_of.begin(), view_of.end());
    parallel_for(context_, planes.size(), 1, [&](std::size_t k) {
      const auto& [data, view] = planes[k];
      if (spill_file_of(context_)->is_whole(data)) return;
      throw IoError(spill_file_of(context_)->folder(), "the temporary file lost what was written for view '" +
                                                           patches_[view].view.name + "': its checksum differs");
    });
  }

  // Every spot belongs to the view that measured it best; what is left open is filled in a second round by whichever
  // view saw it. In between the model loses vertices that noise alone would ask for: every view is shown all of it.
  void zip() {
    std::vector<Image<std::uint8_t>> claims;
    {
      StageScope stage(context_, "overlap");
      std::vector<ClaimCounts> counts(patches_.size());
      claims = claim_samples(patches_, overlap_, counts, context_);
      for (std::size_t i = 0; i < patches_.size(); ++i) result_.report.views[i].claims = counts[i];
    }
    for (std::size_t i = 0; i < patches_.size(); ++i) seal_view(patches_[i], claims[i]);
    StageScope stage(context_, "sew", 2 * patches_.size());
    const std::vector<std::vector<std::uint32_t>> groups = group_views();
    Zipper zipper(patches_, overlap_);
    const auto turns_of = [&](const std::vector<std::uint32_t>& group, Claim least) {
      check_views(group, claims);
      std::vector<ZipperTurn> turns;
      for (const std::uint32_t i : group) turns.push_back({i, wanted_of(claims[i], least)});
      return turns;
    };
    std::size_t most_triangles = kTrianglesBetweenThinnings;
    for (const auto& group : groups) {
      zipper.add(turns_of(group, Claim::kBest), context_);
      stage.advance(group.size());
      if (zipper.mesh().triangle_count() < most_triangles && &group != &groups.back()) continue;
      thin(zipper);
      most_triangles = zipper.mesh().triangle_count() * 5 / 4 + kTrianglesBetweenThinnings;
    }
    for (const auto& group : groups) {
      zipper.revisit(turns_of(group, Claim::kYields), context_, kShortestOutline);
      stage.advance(group.size());
    }
    result_.report.zipper = zipper.report();
    result_.mesh = zipper.take();
  }

  // Views that see nothing in common take their turns at the same time.
  std::vector<std::vector<std::uint32_t>> group_views() const {
    std::vector<std::array<std::uint32_t, 2>> overlapping;
    for (const PairSurvey& pair : result_.report.disagreement.pairs) overlapping.push_back({pair.a, pair.b});
    return group_turns(std::uint32_t(patches_.size()), overlapping, kMostTurnsAtOnce);
  }

  void thin(Zipper& zipper) {
    if (!(options_.reduce_sigma > 0)) return;
    // All that is known of the border is made anew afterwards, and need not be kept meanwhile.
    const Mesh mesh = zipper.take();
    const ReduceOptions limits{.max_error_sigma = kEarlyShare * options_.reduce_sigma, .max_rounds = 1};
    zipper.replace_mesh(reduce(mesh, expected_errors(mesh, patches_), limits, context_).mesh, context_);
  }

  void clean() {
    Mesh& mesh = result_.mesh;
    StageScope stage(context_, "clean");
    // Where samples of a scanner's row share a vertex, towards its poles, an edge may have come twice.
    result_.report.nonmanifold_triangles_removed = remove_nonmanifold(mesh);
    result_.report.triangles_in_small_components = remove_small_components(mesh, options_.smallest_component);
    result_.report.outline_vertices_moved = extend_outlines(mesh, patches_, overlap_, kShortestOutline, context_);
    thin();
    result_.report.self_intersecting_triangles_removed =
        remove_self_intersections(mesh, expected_errors(mesh, patches_), context_);
    result_.report.cracks = close_cracks(mesh, patches_, overlap_, context_);
    result_.report.triangles_in_small_components += remove_small_components(mesh, options_.smallest_component);
    result_.report.pinched_vertices_split = split_pinched_vertices(mesh);
    for (ViewReport& view : result_.report.views) view.triangles_in_model = 0;
    for (std::uint32_t& view : mesh.triangle_view) {
      ++result_.report.views[view].triangles_in_model;
      view = source_index_[view];
    }
    for (std::uint32_t& view : mesh.vertex_view) view = source_index_[view];
    patches_.clear();
    patches_.shrink_to_fit();
  }

  // What is less than the noise needs no vertices; nor does what the user can do without. Before cracks are closed, for
  // reduction may make triangles cut through each other.
  void thin() {
    Mesh& mesh = result_.mesh;
    result_.report.triangles_before_reduction = mesh.triangle_count();
    if (options_.reduce_sigma > 0)
      mesh = reduce(mesh, expected_errors(mesh, patches_), {.max_error_sigma = options_.reduce_sigma}, context_).mesh;
    ReduceOptions limits = options_.reduce;
    limits.max_triangles = std::uint64_t(double(limits.max_triangles) * kShareBeforeClosing);
    if (limits.max_error_m > 0 || limits.max_triangles > 0) mesh = reduce(mesh, {}, limits, context_).mesh;
  }

  void finish() {
    Mesh& mesh = result_.mesh;
    if (options_.fill_holes.largest_m > 0) {
      StageScope stage(context_, "fill holes");
      result_.report.fill_holes = fill_holes(mesh, options_.fill_holes, context_);
    }
    if (const std::uint64_t most = options_.reduce.max_triangles; most > 0 && mesh.triangle_count() > most)
      mesh = reduce(mesh, {}, {.max_triangles = most}, context_).mesh;
  }

  void color() {
    // An image of a view that was left out is no part of the model.
    std::vector<ViewSource> sources = scene_.views;
    for (std::size_t i = 0; i < sources.size(); ++i)
      if (!std::binary_search(source_index_.begin(), source_index_.end(), std::uint32_t(i))) sources[i].color.reset();
    const bool has_color =
        std::any_of(sources.begin(), sources.end(), [](const ViewSource& view) { return view.color.has_value(); });
    if (!has_color || options_.color == ColorOutput::kNone) return;
    TextureOptions limits = options_.texture;
    limits.registration_error_m = result_.report.registration_error_m;
    Mesh& mesh = result_.mesh;
    result_.report.texture = texture(mesh, sources, limits, context_);
    if (options_.color != ColorOutput::kVertices) return;
    color_vertices(mesh, context_);
    drop_texture(mesh);
  }

  Scene scene_;  // as given, or with the poses that registration found
  const IntegrateOptions& options_;
  Context& context_;
  IntegrateResult result_;
  std::vector<View> views_;
  std::vector<std::uint32_t> source_index_;  // of each used view, its index in the scene
  std::vector<NoiseModel> noise_;
  std::vector<std::shared_ptr<const RayTable>> rays_;
  std::vector<Patch> patches_;
  OverlapOptions overlap_;
};

}  // namespace

MemoryEstimate estimate_memory(const Scene& scene, const IntegrateOptions& options, int threads) {
  std::uint64_t all = 0, largest = 0, rays = 0;
  std::map<std::string, std::uint64_t> of_sensor;
  for (std::size_t i = 0; i < scene.views.size(); ++i) {
    if (options.hold_out > 0 && i % std::size_t(options.hold_out) == 0) continue;
    const ViewSource& view = scene.views[i];
    if (!view.sensor) continue;  // its file knows its size
    const std::uint64_t pixels = std::uint64_t(width(*view.sensor)) * std::uint64_t(height(*view.sensor));
    all += pixels;
    largest = std::max(largest, pixels);
    std::uint64_t& largest_of_sensor = of_sensor[view.sensor_id];
    rays += pixels > largest_of_sensor ? pixels - largest_of_sensor : 0;
    largest_of_sensor = std::max(largest_of_sensor, pixels);
  }
  const std::uint64_t fixed = rss_bytes() + kRayBytes * rays + kWorkBytes * largest * std::uint64_t(threads);
  MemoryEstimate estimate{.all_bytes = fixed + (kViewBytes + kModelBytes) * all,
                          .least_bytes = fixed + kLeastModelBytes * all};
  if (estimate.all_bytes > kUsualBytes)
    estimate.usual_bytes = std::max(kUsualBytes, estimate.least_bytes * 3 / 2);
  else if (estimate.all_bytes > kSmallBytes)
    estimate.usual_bytes = std::max(std::uint64_t(kUsualShare * double(estimate.all_bytes)), estimate.least_bytes);
  return estimate;
}

IntegrateResult integrate(const Scene& scene, const IntegrateOptions& options, Context& context) {
  return Integration(scene, options, context).run();
}

}  // namespace lapseam
