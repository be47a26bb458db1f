#include "health/seams.h"

#include <algorithm>
#include <functional>
#include <nlohmann/json.hpp>
#include <vector>

#include "core/disjoint_sets.h"
#include "core/parallel.h"
#include "health/percentile.h"
#include "health/self_intersection.h"
#include "health/shape.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

class SeamSurveyor {
 public:
  SeamSurveyor(const TaggedSurface& surface, const Incidence& incidence) : surface_(surface), incidence_(incidence) {}

  SeamHealth run(std::uint64_t island_triangles, Context& context) {
    measure_triangles(context);
    join_patches(context);
    count_patches(island_triangles);
    return seams_;
  }

 private:
  bool is_measured(std::size_t t) const { return surface_.tag[t] == TriangleTag::kMeasured; }
  bool is_proper(std::size_t t) const { return !has_repeated_vertex(surface_.triangles[t]); }

  void measure_triangles(Context& context) {
    std::vector<float> angles;
    double area = 0;
    for (std::size_t i = 0; i < surface_.triangles.size(); ++i) {
      if (i % kCancelEvery == 0) context.throw_if_cancelled();
      const Triangle& t = surface_.triangles[i];
      if (!is_proper(i)) continue;
      seams_.measured_triangles += is_measured(i);
      seams_.seam_triangles += surface_.tag[i] == TriangleTag::kSeam;
      seams_.filled_triangles += surface_.tag[i] == TriangleTag::kFilled;
      const TriangleShape shape =
          shape_of(surface_.positions_m[t[0]], surface_.positions_m[t[1]], surface_.positions_m[t[2]]);
      area += shape.area_m2;
      if (surface_.tag[i] != TriangleTag::kSeam) continue;
      seams_.seam_area_m2 += shape.area_m2;
      angles.push_back(shape.min_angle_deg);
      if (!surface_.is_meeting.empty()) seams_.self_intersecting_seam_triangles += surface_.is_meeting[i];
    }
    seams_.self_intersections_checked = !surface_.is_meeting.empty();
    area_m2_ = area;
    if (area > 0) seams_.seam_area_share = seams_.seam_area_m2 / area;
    if (angles.empty()) return;
    parallel_sort(context, angles.begin(), angles.end(), std::less<>());
    constexpr std::array<double, 3> kPercents = {1, 5, 25};
    for (std::size_t k = 0; k < kPercents.size(); ++k)
      seams_.seam_min_angle_percentiles_deg[k] = percentile(angles, kPercents[k]);
  }

  // Each pair of triangles with a common edge once, from the smaller index.
  void join_patches(Context& context) {
    patches_.reset(surface_.triangles.size());
    for (std::size_t i = 0; i < surface_.triangles.size(); ++i) {
      if (i % kCancelEvery == 0) context.throw_if_cancelled();
      if (!is_proper(i)) continue;
      const Triangle& t = surface_.triangles[i];
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = t[k], b = t[(k + 1) % 3];
        for (const std::uint32_t other : incidence_.around(a)) {
          const Triangle& o = surface_.triangles[other];
          if (other > i && (o[0] == b || o[1] == b || o[2] == b)) join(i, other, a, b);
        }
      }
    }
    if (area_m2_ > 0) seams_.seam_length_per_area_per_m = seams_.seam_length_m / area_m2_;
  }

  void join(std::size_t i, std::uint32_t other, std::uint32_t a, std::uint32_t b) {
    const bool is_first = is_measured(i), is_second = is_measured(other);
    if (!is_first && !is_second) return;
    if (is_first && is_second && surface_.view[i] == surface_.view[other]) {
      patches_.unite(std::uint32_t(i), other);
      return;
    }
    const double length = (surface_.positions_m[a].cast<double>() - surface_.positions_m[b].cast<double>()).norm();
    seams_.seam_length_m += is_first && is_second ? length : length / 2;
  }

  void count_patches(std::uint64_t island_triangles) {
    std::vector<std::uint32_t> size(surface_.triangles.size(), 0);
    for (std::size_t i = 0; i < size.size(); ++i)
      if (is_proper(i) && is_measured(i)) ++size[patches_.find(std::uint32_t(i))];
    for (const std::uint32_t s : size) {
      if (s == 0) continue;
      ++seams_.patches;
      if (s >= island_triangles) continue;
      ++seams_.islands;
      seams_.triangles_in_islands += s;
    }
  }

  static constexpr std::size_t kCancelEvery = 1 << 16;

  const TaggedSurface& surface_;
  const Incidence& incidence_;
  DisjointSets patches_;
  double area_m2_ = 0;
  SeamHealth seams_;
};

}  // namespace

SeamHealth measure_seams(const TaggedSurface& surface, const Incidence& incidence, std::uint64_t island_triangles,
                         Context& context) {
  return SeamSurveyor(surface, incidence).run(island_triangles, context);
}

SeamHealth check_seams(const Mesh& mesh, const SeamOptions& options, Context& context) {
  check_mesh(mesh);
  if (mesh.triangle_count() > 0 && mesh.triangle_tag.empty())
    throw InvalidInput({}, {}, "triangle_tag", "seams are known by their tags, and the mesh has none");
  if (mesh.triangle_count() > 0 && mesh.triangle_view.empty())
    throw InvalidInput({}, {}, "triangle_view", "patches are known by their views, and the mesh names none");
  SelfIntersections found;
  if (options.self_intersections) found = find_self_intersections(mesh.positions_m, mesh.triangles, context);
  const Incidence incidence = build_incidence(mesh.vertex_count(), mesh.triangles);
  SeamHealth seams =
      measure_seams({mesh.positions_m, mesh.triangles, mesh.triangle_tag, mesh.triangle_view, found.is_meeting},
                    incidence, options.island_triangles, context);
  seams.self_intersections_checked = options.self_intersections;
  return seams;
}

std::string to_json(const SeamHealth& seams) {
  nlohmann::ordered_json json = {
      {"measured_triangles", seams.measured_triangles},
      {"seam_triangles", seams.seam_triangles},
      {"filled_triangles", seams.filled_triangles},
      {"seam_area_m2", seams.seam_area_m2},
      {"seam_area_percent", 100 * seams.seam_area_share},
      {"seam_length_m", seams.seam_length_m},
      {"seam_length_per_area_per_m", seams.seam_length_per_area_per_m},
      {"patches", seams.patches},
      {"islands", seams.islands},
      {"triangles_in_islands", seams.triangles_in_islands},
      {"seam_min_angle_p1_deg", nullptr},
      {"seam_min_angle_p5_deg", nullptr},
      {"seam_min_angle_p25_deg", nullptr},
      {"self_intersecting_seam_triangles", nullptr},  // null: not checked
  };
  if (seams.seam_triangles > 0) {
    json["seam_min_angle_p1_deg"] = seams.seam_min_angle_percentiles_deg[0];
    json["seam_min_angle_p5_deg"] = seams.seam_min_angle_percentiles_deg[1];
    json["seam_min_angle_p25_deg"] = seams.seam_min_angle_percentiles_deg[2];
  }
  if (seams.self_intersections_checked)
    json["self_intersecting_seam_triangles"] = seams.self_intersecting_seam_triangles;
  return json.dump();
}

}  // namespace lapseam
