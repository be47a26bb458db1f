// Based on: G. Turk, M. Levoy, Zippered Polygon Meshes from Range Images, 1994, §4; and Y. Sun, C. Dumont, M. Abidi,
// Mesh-based Integration of Range and Color Images, 2000, §2.2 (overlap in the new view's image) and §2.3 (gaps).

#include "sew/view_turn.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <unordered_map>

#include "core/parallel.h"
#include "sensor/crowding.h"
#include "triangulate/adaptive_triangles.h"

namespace lapseam {
namespace {

constexpr float kNearWall_px = 0.3f;   // samples nearer to the model's border than this would make slivers
constexpr float kWallStep_px = 0.25f;  // sampling of borders
constexpr float kFocusMargin_px = 6;   // around borders
constexpr std::array<float, 2> kBeyondWall_px = {0.6f, 1.2f};
// A sample may be left out when it is this close to the surface without it, in standard deviations of its range.
constexpr float kFlatness = 0.3f;

constexpr std::size_t kRows = 16;  // of the image, per task
constexpr int kLeastRun = 8;       // of samples that share a vertex

bool has_area(const Triangle& t) { return t[0] != t[1] && t[1] != t[2] && t[2] != t[0]; }

}  // namespace

ViewTurn::ViewTurn(const GrownModel& model, std::uint32_t index, const Image<std::uint8_t>& wanted, int shift,
                   Where where, Context& context)
    : model_(model),
      index_(index),
      where_(where),
      context_(context),
      in_(model, index, wanted, shift, where == Where::kBorder),
      covering_(in_),
      gaps_(in_, covering_) {
  addition_.view = index;
  addition_.first_vertex = std::uint32_t(model.mesh.vertex_count());
}

ModelAddition ViewTurn::run() {
  if (where_ == Where::kWanted && !in_.focus_on_wanted()) return {};
  find_walls();
  if (where_ == Where::kBorder && !focus_on_border()) return {};
  block_out_of_focus();
  mark_walls();
  covering_.mark(context_);
  emit_grid();
  triangulate_gaps();
  report_border();
  addition_.finish(model_, context_);
  return std::move(addition_);
}

void ViewTurn::find_walls() {
  constexpr std::size_t kBlock = 4096;
  const std::size_t blocks = (model_.open.size() + kBlock - 1) / kBlock;
  std::vector<std::vector<Wall>> walls(blocks), blocked(blocks);
  parallel_for(context_, blocks, 1, [&](std::size_t block) {
    for (std::size_t i = block * kBlock; i < std::min(model_.open.size(), (block + 1) * kBlock); ++i) {
      Wall wall{std::uint32_t(i), {}, {}};
      const WallKind found = classify(model_.open[i], wall.a, wall.b);
      if (found == WallKind::kWall) walls[block].push_back(wall);
      if (found == WallKind::kBlocked) blocked[block].push_back(wall);
    }
  });
  for (std::size_t block = 0; block < blocks; ++block) {
    walls_.insert(walls_.end(), walls[block].begin(), walls[block].end());
    blocked_.insert(blocked_.end(), blocked[block].begin(), blocked[block].end());
  }
}

ViewTurn::WallKind ViewTurn::classify(const OpenEdge& edge, CanvasPoint& a, CanvasPoint& b) const {
  a = in_.canvas.project(model_.mesh.positions_m[edge.a]);
  b = in_.canvas.project(model_.mesh.positions_m[edge.b]);
  if (!a.is_in && !b.is_in) return WallKind::kElsewhere;
  if (!in_.is_in_focus(std::min(a.u, b.u), std::max(a.u, b.u), std::min(a.v, b.v), std::max(a.v, b.v)))
    return WallKind::kElsewhere;
  const Agreement at_a = in_.canvas.compare(a, model_.error_m[edge.a]),
                  at_b = in_.canvas.compare(b, model_.error_m[edge.b]);
  const bool a_agrees = at_a == Agreement::kAgrees, b_agrees = at_b == Agreement::kAgrees;
  if (!a_agrees && !b_agrees) return WallKind::kElsewhere;
  const bool a_front = in_.is_front(model_.mesh.positions_m[edge.a], model_.normal[edge.a]);
  const bool b_front = in_.is_front(model_.mesh.positions_m[edge.b], model_.normal[edge.b]);
  if (!a_front && !b_front) return WallKind::kElsewhere;  // the other side of a sheet
  if (in_.patch.grid.wraps && std::abs(a.u - b.u) > 0.5f * float(in_.width)) return WallKind::kElsewhere;
  if (!a_agrees || !b_agrees) return WallKind::kBlocked;
  std::uint32_t c = 0;
  for (const std::uint32_t v : model_.mesh.triangles[edge.triangle])
    if (v != edge.a && v != edge.b) c = v;
  const CanvasPoint third = in_.canvas.project(model_.mesh.positions_m[c]);
  if (!(third.r > 0) || !(in_.turn(a, b, third) > 0)) return WallKind::kBlocked;
  return WallKind::kWall;
}

bool ViewTurn::focus_on_border() {
  in_.focus_on_nothing();
  bool any = false;
  for (const Wall& wall : walls_) {
    if (model_.outline_size[wall.open] < model_.shortest_outline || !ends_in_surface(wall)) continue;
    any = true;
    for (const CanvasPoint& end : {wall.a, wall.b}) in_.focus_around(end.u, end.v, kFocusMargin_px);
  }
  return any;
}

// Whether the view measured surface beyond the border: most of it is where things end, and stays.
bool ViewTurn::ends_in_surface(const Wall& wall) const {
  const Eigen::Vector2f a(wall.a.u, wall.a.v), along = Eigen::Vector2f(wall.b.u, wall.b.v) - a;
  const float length = along.norm();
  if (!(length > 0)) return true;
  const Eigen::Vector2f out = Eigen::Vector2f(-along.y(), along.x()) / (in_.patch.grid.is_mirrored ? -length : length);
  const OpenEdge& edge = model_.open[wall.open];
  const float error = std::max(model_.error_m[edge.a], model_.error_m[edge.b]);
  const int steps = std::max(1, int(std::ceil(length)));
  for (int i = 0; i < steps; ++i) {
    const float t = (float(i) + 0.5f) / float(steps);
    for (const float beyond : kBeyondWall_px) {
      const Eigen::Vector2f at = a + t * along + beyond * out;
      if (in_.is_surface(at.x(), at.y(), wall.a.r + t * (wall.b.r - wall.a.r), error)) return true;
    }
  }
  return false;
}

void ViewTurn::block_out_of_focus() {
  for (int v = 0; v < in_.height; ++v)
    for (int u = 0; u < in_.width; ++u)
      if (!in_.is_focused(u, v)) in_.cell.at(u, v) = ModelInView::kBlocked;
}

template <typename Visit>
void ViewTurn::walk(const CanvasPoint& a, const CanvasPoint& b, const Visit& visit) const {
  const float length = std::hypot(b.u - a.u, b.v - a.v);
  const int steps = std::max(1, int(std::ceil(length / kWallStep_px)));
  for (int i = 0; i <= steps; ++i) {
    const float t = float(i) / float(steps);
    const int u = int(std::floor(a.u + t * (b.u - a.u))), v = int(std::floor(a.v + t * (b.v - a.v)));
    if (u >= 0 && v >= 0 && u < in_.width && v < in_.height) visit(u, v);
  }
}

void ViewTurn::mark_near(const CanvasPoint& a, const CanvasPoint& b) {
  const int u0 = std::max(0, int(std::ceil(std::min(a.u, b.u) - kNearWall_px)));
  const int u1 = std::min(in_.width - 1, int(std::floor(std::max(a.u, b.u) + kNearWall_px)));
  const int v0 = std::max(0, int(std::ceil(std::min(a.v, b.v) - kNearWall_px)));
  const int v1 = std::min(in_.height - 1, int(std::floor(std::max(a.v, b.v) + kNearWall_px)));
  const Eigen::Vector2f p(a.u, a.v), d(b.u - a.u, b.v - a.v);
  const float squared = d.squaredNorm();
  for (int v = v0; v <= v1; ++v)
    for (int u = u0; u <= u1; ++u) {
      const Eigen::Vector2f q(float(u) - p.x(), float(v) - p.y());
      const float t = squared > 0 ? std::clamp(q.dot(d) / squared, 0.0f, 1.0f) : 0.0f;
      if ((q - t * d).squaredNorm() < kNearWall_px * kNearWall_px) in_.sample.at(u, v) |= ModelInView::kNear;
    }
}

void ViewTurn::mark_walls() {
  for (const Wall& wall : walls_) {
    walk(wall.a, wall.b, [&](int u, int v) { in_.cell.at(u, v) |= ModelInView::kWall; });
    mark_near(wall.a, wall.b);
  }
  for (const Wall& wall : blocked_) block(wall.a, wall.b);
}

void ViewTurn::block(const CanvasPoint& a, const CanvasPoint& b) {
  walk(a, b, [&](int u, int v) { in_.cell.at(u, v) |= ModelInView::kBlocked; });
  mark_near(a, b);
}

void ViewTurn::emit_grid() {
  vertex_of_sample_ = Image<std::uint32_t>(in_.width, in_.height, kInvalidIndex);
  emitted_ = Image<std::uint8_t>(in_.width, in_.height, 0);
  find_anchors();
  Image<std::uint8_t> is_full(in_.width, in_.height, 0);
  parallel_blocks(context_, std::size_t(in_.height), kRows, [&](std::size_t begin, std::size_t end) {
    in_.for_each_in_focus(int(begin), int(end), [&](int u, int v) {
      if (!in_.is_cell_in(u, v) || in_.cell.at(u, v)) return;
      for (int slot = 0; slot < 2; ++slot) {
        if (!in_.exists(u, v, slot)) continue;
        const auto corners = in_.corners_of(u, v, slot);
        if (std::all_of(corners.begin(), corners.end(), [&](const auto& c) { return in_.is_usable(c.x(), c.y()); }))
          emitted_.at(u, v) |= std::uint8_t(1 << slot);
      }
      // Where samples share vertices, each cell is for itself: what shares one is joined by edges of the row.
      const bool is_crowded = !anchors_[std::size_t(v)].empty() && !anchors_[std::size_t(v) + 1].empty();
      is_full.at(u, v) = emitted_.at(u, v) == 3 && !is_crowded;
    });
  });
  mark_emitted();
  const auto deviation = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t m) {
    return deviation_from_plane(a, b, c, m);
  };
  for (const SampleTriangle& t : adaptive_triangles(is_full, deviation, context_)) {
    Triangle corners;
    for (std::size_t k = 0; k < 3; ++k) corners[k] = vertex_of(t[k]);
    if (in_.patch.grid.is_mirrored) std::swap(corners[1], corners[2]);
    if (has_area(corners)) addition_.add_triangle(corners, TriangleTag::kMeasured);
  }
  in_.for_each_in_focus([&](int u, int v) {
    if (is_full.at(u, v)) return;
    for (int slot = 0; slot < 2; ++slot) {
      if (!is_emitted(u, v, slot)) continue;
      const auto corners = in_.corners_of(u, v, slot);
      const Triangle t = {vertex_of(corners[0].x(), corners[0].y()), vertex_of(corners[1].x(), corners[1].y()),
                          vertex_of(corners[2].x(), corners[2].y())};
      if (has_area(t)) addition_.add_triangle(t, TriangleTag::kMeasured);
    }
  });
}

// A row of cells marks two rows of samples: every other block of rows at a time.
void ViewTurn::mark_emitted() {
  const std::size_t blocks = (std::size_t(in_.height) + kRows - 1) / kRows;
  for (std::size_t first = 0; first < 2; ++first)
    parallel_for(context_, (blocks + 1 - first) / 2, 1, [&](std::size_t i) {
      const int begin = int(kRows * (2 * i + first));
      in_.for_each_in_focus(begin, std::min(begin + int(kRows), in_.height), [&](int u, int v) {
        for (int slot = 0; slot < 2; ++slot)
          if (is_emitted(u, v, slot))
            for (const auto& c : in_.corners_of(u, v, slot)) in_.sample.at(c.x(), c.y()) |= ModelInView::kEmitted;
      });
    });
}

// Samples of a row that lie closer together than a row and the next, as towards a scanner's poles, would make slivers:
// as many as fit into that distance share the vertex of the first, as long as surface joins them.
void ViewTurn::find_anchors() {
  anchors_.assign(std::size_t(in_.height), {});
  for (int v = 0; v < in_.height; ++v) {
    // A power of two, so that runs of neighbouring rows begin together.
    const int run = int(std::bit_floor(unsigned(samples_per_row_step(in_.patch.view.sensor, v))));
    if (run < kLeastRun) continue;
    std::vector<int>& anchors = anchors_[std::size_t(v)];
    anchors.resize(std::size_t(in_.width));
    const int cell_row = std::min(v, in_.height - 2);
    for (int u = 0; u < in_.width; ++u) {
      const bool is_joined = u > 0 && int(in_.canvas.pixel(u, v) % std::size_t(in_.width)) % run != 0 &&
                             in_.exists(u - 1, cell_row, 0) && in_.exists(u - 1, cell_row, 1) &&
                             in_.is_usable(u - 1, v) && in_.is_usable(u, v);
      anchors[std::size_t(u)] = is_joined ? anchors[std::size_t(u) - 1] : u;
    }
  }
}

int ViewTurn::anchor_of(int u, int v) const {
  const std::vector<int>& anchors = anchors_[std::size_t(v)];
  return anchors.empty() ? u : anchors[std::size_t(u)];
}

std::uint32_t ViewTurn::vertex_of(int u, int v) {
  u = anchor_of(u, v);
  std::uint32_t& id = vertex_of_sample_.at(u, v);
  if (id == kInvalidIndex) {
    const std::size_t pixel = in_.canvas.pixel(u, v);
    id = addition_.add_vertex(pixel, in_.canvas.position(pixel));
  }
  return id;
}

std::uint32_t ViewTurn::vertex_of(std::uint32_t sample) {
  return vertex_of(int(sample % std::uint32_t(in_.width)), int(sample / std::uint32_t(in_.width)));
}

// Of sample m from the plane through three others, along its ray, in units of what noise explains.
float ViewTurn::deviation_from_plane(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t m) const {
  const auto pixel = [&](std::uint32_t i) {
    return in_.canvas.pixel(int(i % std::uint32_t(in_.width)), int(i / std::uint32_t(in_.width)));
  };
  const std::size_t pm = pixel(m);
  const Eigen::Vector3f pa = in_.patch.point_in_view(pixel(a));
  const Eigen::Vector3f normal = (in_.patch.point_in_view(pixel(b)) - pa).cross(in_.patch.point_in_view(pixel(c)) - pa);
  const Eigen::Vector3f origin =
      in_.patch.rays->origins.empty() ? Eigen::Vector3f(Eigen::Vector3f::Zero()) : in_.patch.rays->origins[pm];
  const float along = normal.dot(in_.patch.rays->directions[pm]), r = in_.patch.view.range.pixels[pm];
  if (along == 0) return 2;
  const float off = std::abs(normal.dot(pa - origin) / along - r);
  return off / (kFlatness * float(in_.patch.noise.sigma(double(r))));
}

bool ViewTurn::is_emitted(int u, int v, int slot) const {
  return in_.is_cell_in(u, v) && (emitted_.at(u, v) >> slot & 1);
}

// Whether the triangle across the edge p–q of an emitted triangle was emitted too.
bool ViewTurn::is_neighbor_emitted(int u, int v, int slot, const Eigen::Vector2i& p, const Eigen::Vector2i& q) const {
  const Eigen::Vector2i low = p.cwiseMin(q), d = (p - q).cwiseAbs();
  const auto is_anti = [&](int x, int y) { return (in_.grid_cell(x, y) & PatchGrid::kAntiDiagonal) != 0; };
  if (d.x() == 1 && d.y() == 1) return is_emitted(u, v, 1 - slot);
  if (d.x() == 0) return low.x() == u ? is_emitted(u - 1, v, 1) : is_emitted(u + 1, v, 0);
  if (low.y() == v) return v > 0 && is_emitted(u, v - 1, is_anti(u, v - 1) ? 1 : 0);
  return in_.is_cell_in(u, v + 1) && is_emitted(u, v + 1, is_anti(u, v + 1) ? 0 : 1);
}

std::uint32_t ViewTurn::gap_point_of_wall(std::uint32_t vertex, const CanvasPoint& at) {
  const auto [place, is_new] = gap_point_of_vertex_.try_emplace(vertex, std::uint32_t(gaps_.points().size()));
  if (is_new) gaps_.add_point({vertex, kInvalidIndex, at.r, model_.error_m[vertex]}, at.u, at.v);
  return place->second;
}

std::uint32_t ViewTurn::gap_point_of(int u, int v) {
  std::uint32_t& point = gap_point_of_sample_.at(u, v);
  if (point == kInvalidIndex)
    point = gaps_.add_point({vertex_of_sample_.at(anchor_of(u, v), v), std::uint32_t(in_.sample.index(u, v)),
                             in_.patch.view.range.pixels[in_.canvas.pixel(u, v)], 0},
                            float(u), float(v));
  return point;
}

// What collect(u, v, found) appends to `found` for every place in focus, row by row.
template <typename T, typename Collect>
std::vector<T> ViewTurn::collect_in_focus(const Collect& collect) {
  const std::size_t blocks = (std::size_t(in_.height) + kRows - 1) / kRows;
  return parallel_collect<T>(context_, blocks, 1, [&](std::size_t i, std::vector<T>& found) {
    const int begin = int(kRows * i);
    in_.for_each_in_focus(begin, std::min(begin + int(kRows), in_.height), [&](int u, int v) { collect(u, v, found); });
  });
}

void ViewTurn::triangulate_gaps() {
  gap_point_of_sample_ = Image<std::uint32_t>(in_.width, in_.height, kInvalidIndex);
  for (const Wall& wall : walls_) {
    const OpenEdge& edge = model_.open[wall.open];
    const std::uint32_t b = gap_point_of_wall(edge.b, wall.b), a = gap_point_of_wall(edge.a, wall.a);
    gaps_.add_fence(b, a);
  }
  using Sample = Eigen::Vector2i;
  const auto sides = collect_in_focus<std::array<Sample, 2>>([&](int u, int v, auto& found) {
    for (int slot = 0; slot < 2; ++slot) {
      if (!is_emitted(u, v, slot)) continue;
      const auto c = in_.corners_of(u, v, slot);
      for (std::size_t k = 0; k < 3; ++k)
        if (!is_neighbor_emitted(u, v, slot, c[k], c[(k + 1) % 3])) found.push_back({c[k], c[(k + 1) % 3]});
    }
  });
  for (const auto& [p, q] : sides) {
    const std::uint32_t a = gap_point_of(p.x(), p.y()), b = gap_point_of(q.x(), q.y());
    gaps_.add_fence(b, a);
    const std::uint32_t from = gaps_.points()[a].vertex, to = gaps_.points()[b].vertex;
    if (from != to) new_border_.push_back({from, to, kInvalidIndex});
  }
  find_border_triangles();
  const auto in_gaps = collect_in_focus<Sample>([&](int u, int v, auto& found) {
    if (!(in_.sample.at(u, v) & ModelInView::kEmitted) && in_.is_usable(u, v) && touches_gap(u, v))
      found.push_back({u, v});
  });
  for (const Sample& s : in_gaps) gap_point_of(s.x(), s.y());
  const auto block_lost = [&](std::size_t fence) {
    const auto [a, b] = fence < walls_.size() ? std::array{walls_[fence].a, walls_[fence].b} : gaps_.ends_of(fence);
    block(a, b);
  };
  for (const auto& face : gaps_.fill(block_lost, context_)) add_face(face);
}

void ViewTurn::find_border_triangles() {
  const auto key = [](std::uint32_t a, std::uint32_t b) { return std::uint64_t(a) << 32 | b; };
  std::unordered_map<std::uint64_t, std::size_t> at;
  at.reserve(new_border_.size());
  on_border_.assign(addition_.pixels.size(), 0);
  for (std::size_t i = 0; i < new_border_.size(); ++i) {
    at.emplace(key(new_border_[i].a, new_border_[i].b), i);
    on_border_[new_border_[i].a - addition_.first_vertex] = 1;
  }
  for (std::size_t t = 0; t < addition_.triangles.size(); ++t)
    for (std::size_t k = 0; k < 3; ++k) {
      const Triangle& corners = addition_.triangles[t];
      if (!is_on_border(corners, k)) continue;
      const auto found = at.find(key(corners[k], corners[(k + 1) % 3]));
      if (found != at.end()) new_border_[found->second].triangle = std::uint32_t(t);
    }
  // Of triangles that came to nothing, because samples share vertices.
  std::erase_if(new_border_, [](const OpenEdge& edge) { return edge.triangle == kInvalidIndex; });
}

// Both ends of the edge from corner k.
bool ViewTurn::is_on_border(const Triangle& t, std::size_t k) const {
  const auto is_end = [&](std::uint32_t v) {
    const std::size_t own = v - addition_.first_vertex;
    return addition_.is_own(v) && own < on_border_.size() && on_border_[own];
  };
  return is_end(t[k]) && is_end(t[(k + 1) % 3]);
}

// A sample that could not be part of a grid triangle, because of the model's border or of samples not wanted.
bool ViewTurn::touches_gap(int u, int v) const {
  for (int y = v - 1; y <= v; ++y)
    for (int x = u - 1; x <= u; ++x)
      if (in_.is_cell_in(x, y) && (in_.grid_cell(x, y) & (PatchGrid::kExists | PatchGrid::kExists << 1))) return true;
  return false;
}

void ViewTurn::add_face(const std::array<std::uint32_t, 3>& corners) {
  Triangle t;
  bool is_own = true;
  for (std::size_t k = 0; k < 3; ++k) {
    const GapFaces::Point& point = gaps_.points()[corners[k]];
    t[k] = point.vertex != kInvalidIndex ? point.vertex : vertex_of(point.sample);
    is_own &= addition_.is_own(t[k]) || model_.mesh.vertex_view[t[k]] == index_;
  }
  if (!has_area(t)) return;
  const std::uint32_t id = addition_.add_triangle(t, is_own ? TriangleTag::kMeasured : TriangleTag::kSeam);
  for (std::size_t k = 0; k < 3; ++k) addition_.sides.push_back({t[k], t[(k + 1) % 3], id});
}

void ViewTurn::report_border() {
  for (const Wall& wall : walls_) addition_.closed.push_back(wall.open);
  addition_.sides.insert(addition_.sides.end(), new_border_.begin(), new_border_.end());
  for (const Triangle& t : addition_.triangles)
    for (std::size_t k = 0; k < 3; ++k)
      if (is_on_border(t, k)) addition_.chords.push_back(undirected(t[k], t[(k + 1) % 3]));
}

}  // namespace lapseam
