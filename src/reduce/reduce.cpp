// Rounds of pieces: each piece is reduced alone, with its border locked; the next round cuts elsewhere, so that what
// was a border is reduced as well.

#include "lapseam/reduce.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "core/parallel.h"

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "reduce/collapser.h"
#include "reduce/mesh_noise.h"
#include "reduce/partition.h"
#include "reduce/working_mesh.h"

namespace lapseam {
namespace {

constexpr int kMostRoundsForCount = 2;
constexpr float kShifts[] = {0, 0.62f, 0.31f, 0.87f, 0.48f};  ///< of the cuts, in each round
constexpr std::size_t kPieceTriangles = 12288;  ///< a piece at work takes about a megabyte: a core's cache
/// Bound over roughness, where none is given: comes out as about one sigma between result and mesh given, see
/// docs/reduction.md.
constexpr double kNoiseFactor = 6;
constexpr std::size_t kSamplePieces = 32, kErrorSteps = 40;  ///< of doubling squared error: a factor of a million
constexpr double kCountSlack = 1.5;                          ///< left for the last round, of the triangles wanted
constexpr double kWorthARound = 0.97;                        ///< a round that leaves more than this was the last

// What holds for all pieces of all rounds.
struct Settings {
  QuadricOptions quadrics;
  CollapseLimits limits;
  std::size_t max_triangles = 0;
};

void check(const Mesh& mesh, std::span<const float> vertex_sigma_m, const ReduceOptions& options) {
  check_mesh(mesh);
  const auto refuse = [](const char* field, const std::string& problem) { throw InvalidInput({}, {}, field, problem); };
  if (!(options.max_error_m >= 0 && std::isfinite(options.max_error_m)))
    refuse("max_error_m", "must be a length, not negative");
  if (!(options.max_error_sigma >= 0 && std::isfinite(options.max_error_sigma)))
    refuse("max_error_sigma", "must be finite and not negative");
  if (options.max_error_sigma > 0 && vertex_sigma_m.empty()) refuse("max_error_sigma", "needs a sigma for each vertex");
  if (options.max_error_sigma > 0 && options.max_error_m > 0)
    refuse("max_error_sigma", "and max_error_m exclude each other");
  if (options.max_rounds < 1) refuse("max_rounds", "must be at least 1");
  if (!vertex_sigma_m.empty() && vertex_sigma_m.size() != mesh.vertex_count())
    refuse("vertex_sigma_m",
           "has " + std::to_string(vertex_sigma_m.size()) + " entries, not " + std::to_string(mesh.vertex_count()));
  for (std::size_t i = 0; i < vertex_sigma_m.size(); ++i)
    if (!(vertex_sigma_m[i] > 0 && std::isfinite(vertex_sigma_m[i])))
      refuse("vertex_sigma_m", "vertex " + std::to_string(i) + " has none that is positive and finite");
}

// No piece goes below its share of a wanted count, so that no round does. The last collapses are chosen over the whole
// mesh.
std::size_t piece_limit(const Settings& settings, std::size_t piece_triangles, std::size_t all_triangles) {
  return std::size_t(std::ceil(double(settings.max_triangles) * double(piece_triangles) / double(all_triangles)));
}

WorkingMesh run_round(const Surface& surface, const Partition& parts, const Mesh& mesh, const Settings& settings,
                      Context& context) {
  StageScope stage(context, "reduce", surface.triangles.size());
  PieceResults results(parts);
  parallel_for(context, parts.parts, 1, [&](std::size_t part) {
    const std::size_t size = parts.triangles_of(part).size();
    LoadedPiece loaded = load_piece(surface, parts, part);
    Collapser collapser(loaded.piece, mesh.positions_m, context);
    if (!surface.has_quadrics()) collapser.start_quadrics(settings.quadrics, loaded.squared_sigma);
    CollapseLimits limits = settings.limits;
    limits.max_triangles =
        parts.parts == 1 ? settings.max_triangles : piece_limit(settings, size, surface.triangles.size());
    collapser.run(limits);
    results.store(part, std::move(loaded));
    stage.advance(size);
  });
  return results.join(context);
}

// What single precision alone makes.
double rounding_error(const Mesh& mesh) {
  float largest = 0;
  for (const Eigen::Vector3f& p : mesh.positions_m) largest = std::max(largest, p.cwiseAbs().maxCoeff());
  return 1e-6 * double(largest);
}

// Triangles and the area that they cover.
struct Density {
  double triangles = 0, area = 0;
};

// Of what no locked vertex takes part in: the border of a piece stays dense, which a later round mends.
Density inner_density(const Piece& piece) {
  Density out;
  for (const Triangle& t : piece.triangles) {
    if (t[0] == kInvalidIndex || piece.is_locked[t[0]] || piece.is_locked[t[1]] || piece.is_locked[t[2]]) continue;
    const Eigen::Vector3f& p = piece.vertices[t[0]].position_m;
    out.area += double((piece.vertices[t[1]].position_m - p).cross(piece.vertices[t[2]].position_m - p).norm());
    ++out.triangles;
  }
  return out;
}

// An error at which somewhat more triangles are left than are wanted, from pieces here and there that are reduced in
// steps of growing error. With it all pieces can be reduced alone, and the detail stays where it is.
float squared_error_for_count(const Surface& surface, const Partition& parts, const Mesh& mesh,
                              const Settings& settings, float smallest_error, Context& context) {
  const std::size_t pieces = std::min(kSamplePieces, parts.parts);
  const double wanted_share = kCountSlack * double(settings.max_triangles) / double(surface.triangles.size());
  // Triangles that would be left of each piece if all of it were like its inside.
  std::vector<std::array<double, kErrorSteps>> left(pieces);
  std::vector<double> given(pieces, 0);
  const auto squared_error = [&](std::size_t step) { return smallest_error * smallest_error * std::exp2(float(step)); };
  parallel_for(context, pieces, 1, [&](std::size_t i) {
    LoadedPiece loaded = load_piece(surface, parts, i * parts.parts / pieces);
    left[i].fill(0);
    const Density before = inner_density(loaded.piece);
    given[i] = before.triangles;
    Collapser collapser(loaded.piece, mesh.positions_m, context);
    collapser.start_quadrics(settings.quadrics, loaded.squared_sigma);
    for (std::size_t step = 0; step < kErrorSteps; ++step) {
      CollapseLimits limits = settings.limits;
      limits.max_squared_error = squared_error(step);
      collapser.run(limits);
      const Density now = inner_density(loaded.piece);
      if (now.area > 0) left[i][step] = now.triangles / now.area * before.area;
      if (left[i][step] < given[i] * wanted_share / 8) break;
    }
  });
  const double all = std::accumulate(given.begin(), given.end(), 0.0);
  std::size_t step = 0;
  for (; step + 1 < kErrorSteps; ++step) {
    double sum = 0;
    for (const auto& piece : left) sum += piece[step + 1];
    if (sum < wanted_share * all) break;
  }
  return squared_error(step);
}

}  // namespace

ReduceResult reduce(const Mesh& mesh, std::span<const float> vertex_sigma_m, const ReduceOptions& options,
                    Context& context) {
  check(mesh, vertex_sigma_m, options);
  ReduceResult out;
  if (!mesh.texcoords.empty()) context.warn("reduce: texture coordinates are dropped; texture the reduced mesh again");
  if (mesh.triangles.empty()) {
    out.mesh.origin_m = mesh.origin_m;
    return out;
  }
  Settings settings;
  settings.max_triangles = std::size_t(options.max_triangles);
  settings.limits.placement = options.placement;
  settings.quadrics.in_sigmas = options.max_error_sigma > 0;
  float largest = std::numeric_limits<float>::max();
  double bound = options.max_error_sigma > 0 ? options.max_error_sigma : options.max_error_m;
  const bool is_counted = options.max_triangles > 0;

  Surface surface = surface_of(mesh, vertex_sigma_m);
  WorkingMesh current;
  for (int round = 0; round < options.max_rounds; ++round) {
    const std::size_t before = surface.triangles.size();
    // A count is exact when the last collapses are chosen over the whole mesh: one piece, on one thread.
    const bool is_last = before <= kPieceTriangles ||
                         (is_counted && (double(before) <= 1.2 * kCountSlack * double(settings.max_triangles) ||
                                         round == kMostRoundsForCount));
    const Partition parts =
        partition(surface.positions_m, surface.triangles, is_last ? before + 1 : kPieceTriangles / 2,
                  kShifts[std::size_t(round) % std::size(kShifts)], context);
    if (round == 0) {
      if (bound == 0) out.report.noise_m = estimate_mesh_noise(surface, parts, context);
      if (bound == 0 && !is_counted) bound = std::max(kNoiseFactor * out.report.noise_m, rounding_error(mesh));
      largest = bound > 0 ? float(bound * bound) : largest;
      settings.limits.max_squared_error = largest;
      if (is_counted && !is_last) {
        const double smallest =
            settings.quadrics.in_sigmas ? 1e-3 : std::max(out.report.noise_m / 8, rounding_error(mesh));
        settings.limits.max_squared_error =
            std::min(largest, squared_error_for_count(surface, parts, mesh, settings, float(smallest), context));
      }
    }
    if (is_last) settings.limits.max_squared_error = largest;
    WorkingMesh next = run_round(surface, parts, mesh, settings, context);
    current = std::move(next);
    surface = surface_of(current);
    out.report.rounds = round + 1;
    if (is_last || (!is_counted && double(current.triangles.size()) > kWorthARound * double(before))) break;
  }
  out.report.max_error_m = options.max_error_sigma > 0 ? 0 : bound;
  out.mesh = to_mesh(current, mesh, context);
  return out;
}

}  // namespace lapseam
