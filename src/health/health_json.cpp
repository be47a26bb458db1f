#include <nlohmann/json.hpp>

#include "lapseam/health.h"

namespace lapseam {

std::string to_json(const MeshHealth& health) {
  nlohmann::ordered_json json = {
      {"vertices", health.vertices},
      {"triangles", health.triangles},
      {"area_m2", health.area_m2},
      {"components", health.components},
      {"components_100_triangles", health.components_100_triangles},
      {"largest_component_percent", 100 * health.largest_component_share},
      {"smallest_component_triangles", health.smallest_component_triangles},
      {"components_99_percent_area", health.components_99_percent_area},
      {"edges", health.edges},
      {"boundary_edges", health.boundary_edges},
      {"boundary_length_m", health.boundary_length_m},
      {"boundary_loops", health.boundary_loops},
      {"nonmanifold_edges", health.nonmanifold_edges},
      {"misoriented_edges", health.misoriented_edges},
      {"pinched_vertices", health.pinched_vertices},
      {"duplicate_triangles", health.duplicate_triangles},
      {"degenerate_triangles", health.degenerate_triangles},
      {"unused_vertices", health.unused_vertices},
      {"min_angle_p1_deg", health.min_angle_percentiles_deg[0]},
      {"min_angle_p5_deg", health.min_angle_percentiles_deg[1]},
      {"min_angle_p25_deg", health.min_angle_percentiles_deg[2]},
      {"min_angle_p50_deg", health.min_angle_percentiles_deg[3]},
      {"min_angle_below_10_deg_percent", 100 * health.min_angle_below_10_deg_share},
      {"edge_length_median_mm", 1e3 * health.edge_length_median_m},
  };
  // null: not checked
  json["self_intersecting_triangles"] = nullptr;
  json["self_intersecting_pairs"] = nullptr;
  if (health.self_intersections_checked) {
    json["self_intersecting_triangles"] = health.self_intersecting_triangles;
    json["self_intersecting_pairs"] = health.self_intersecting_pairs;
  }
  // null: the mesh does not say which of its triangles are seams
  json["seams"] = health.seams ? nlohmann::ordered_json::parse(to_json(*health.seams)) : nullptr;
  return json.dump();
}

}  // namespace lapseam
