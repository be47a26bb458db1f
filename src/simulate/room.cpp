// The furnished room. x runs along its width, y along its depth; the floor is z = 0.

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "lapseam/error.h"
#include "lapseam/simulate.h"
#include "simulate/furniture.h"

namespace lapseam {
namespace simulation {
namespace {

using Eigen::Vector3d;

constexpr double kPi = std::numbers::pi;

/// A rectangular niche in a wall. along and up measure on the wall, from its left lower corner seen from inside.
struct Niche {
  double along_low = 0, along_high = 0, up_low = 0, up_high = 0, depth = 0;
  Material side, back;
};

/// Frame of a wall: x along it to the right seen from inside, y into the room, z up.
Frame wall_frame(const Vector3d& left_corner, double yaw_rad) {
  return standing_at(left_corner.x(), left_corner.y(), yaw_rad, left_corner.z());
}

/// In the wall frame the room is at y > 0. From inside, with y towards the viewer and z up, x runs to the LEFT.
void add_wall(MeshBuilder& builder, const Frame& frame, double length, double height, const Material& material,
              const Niche* niche) {
  builder.set_frame(frame);
  builder.use(material);
  const auto front = [&](double x0, double x1, double z0, double z1, double y) {
    builder.add_quad({x1, y, z0}, {x0, y, z0}, {x0, y, z1}, {x1, y, z1});
  };
  if (!niche) return front(0, length, 0, height, 0);
  const std::array<double, 4> xs{0, niche->along_low, niche->along_high, length};
  const std::array<double, 4> zs{0, niche->up_low, niche->up_high, height};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k)
      if (i != 1 || k != 1) front(xs[i], xs[i + 1], zs[k], zs[k + 1], 0);
  const double x0 = xs[1], x1 = xs[2], z0 = zs[1], z1 = zs[2], y = -niche->depth;
  builder.use(niche->side);
  builder.add_quad({x0, y, z0}, {x0, 0, z0}, {x0, 0, z1}, {x0, y, z1});
  builder.add_quad({x1, 0, z0}, {x1, y, z0}, {x1, y, z1}, {x1, 0, z1});
  builder.add_quad({x0, y, z0}, {x1, y, z0}, {x1, 0, z0}, {x0, 0, z0});
  builder.add_quad({x0, y, z1}, {x0, 0, z1}, {x1, 0, z1}, {x1, y, z1});
  builder.set_frame(frame * standing_at(0.5 * (x0 + x1), 0, 0, 0.5 * (z0 + z1)));
  builder.use(niche->back);
  builder.set_frame(frame);
  front(x0, x1, z0, z1, y);
}

void add_skirting(MeshBuilder& builder, const Frame& frame, double from, double to, Dice& dice) {
  builder.set_frame(frame);
  builder.use(make_material(Pattern::kPlain, 0xF5F2EA, 0xF5F2EA, 0.1, dice));
  builder.add_box({from, 0, 0}, {to, 0.012, 0.08});
}

void add_window_bars(MeshBuilder& builder, const Frame& frame, const Niche& niche, Dice& dice) {
  builder.set_frame(frame);
  builder.use(make_material(Pattern::kPlain, 0xF7F7F5, 0xF7F7F5, 0.1, dice));
  const double y0 = -niche.depth, y1 = y0 + 0.05, w = 0.05;
  const double x0 = niche.along_low, x1 = niche.along_high, z0 = niche.up_low, z1 = niche.up_high;
  builder.add_box({x0, y0, z0}, {x0 + w, y1, z1});
  builder.add_box({x1 - w, y0, z0}, {x1, y1, z1});
  builder.add_box({x0 + w, y0, z0}, {x1 - w, y1, z0 + w});
  builder.add_box({x0 + w, y0, z1 - w}, {x1 - w, y1, z1});
  builder.add_box({0.5 * (x0 + x1 - w), y0, z0 + w}, {0.5 * (x0 + x1 + w), y1, z1 - w});
  // The sill stands out over the radiator.
  builder.add_box({x0 - 0.05, 0.0, z0 - 0.03}, {x1 + 0.05, 0.06, z0});
}

void add_door(MeshBuilder& builder, const Frame& frame, const Niche& niche, Dice& dice) {
  builder.set_frame(frame);
  builder.use(make_material(Pattern::kPlain, 0xE9E4D8, 0xE9E4D8, 0.1, dice));
  const double x0 = niche.along_low, x1 = niche.along_high, z1 = niche.up_high, w = 0.08;
  builder.add_box({x0 - w, 0, 0}, {x0, 0.025, z1 + w});
  builder.add_box({x1, 0, 0}, {x1 + w, 0.025, z1 + w});
  builder.add_box({x0, 0, z1}, {x1, 0.025, z1 + w});
  for (const double z : {0.18, 1.05})
    builder.add_box({x0 + 0.13, -niche.depth, z}, {x1 - 0.13, -niche.depth + 0.008, z + 0.75});
  Material brass = make_material(Pattern::kPlain, 0xB08D57, 0xB08D57, 0.1, dice);
  brass.is_specular = true;
  builder.use(brass);
  const double hx = x1 - 0.07, y = -niche.depth;
  const std::array<Vector3d, 4> handle{Vector3d(hx, y, 1.02), Vector3d(hx, y + 0.045, 1.02),
                                       Vector3d(hx - 0.03, y + 0.05, 1.02), Vector3d(hx - 0.12, y + 0.05, 1.02)};
  builder.add_tube(handle, 0.016, 14);
}

struct Walls {
  Frame south, east, north, west;
};

Walls add_shell(MeshBuilder& builder, double w, double d, double h, Dice& dice) {
  builder.set_frame(Frame::Identity());
  builder.use(make_material(Pattern::kPlanks, 0xC69C6D, 0x8B5E3C, 0.12, dice));
  builder.add_quad({0, 0, 0}, {w, 0, 0}, {w, d, 0}, {0, d, 0});
  builder.use(make_material(Pattern::kPlain, 0xF3F1EC, 0xF3F1EC, 0.1, dice));
  builder.add_quad({0, 0, h}, {0, d, h}, {w, d, h}, {w, 0, h});
  const Walls walls{wall_frame({0, 0, 0}, 0), wall_frame({w, 0, 0}, 0.5 * kPi), wall_frame({w, d, 0}, kPi),
                    wall_frame({0, d, 0}, 1.5 * kPi)};
  Niche window{0.5 * w - 0.9,
               0.5 * w + 0.9,
               0.92,
               std::min(2.15, h - 0.4),
               0.22,
               make_material(Pattern::kPlain, 0xF2EFE8, 0xF2EFE8, 0.1, dice),
               make_material(Pattern::kPicture, 0x6D8F5A, 0x23452C, 1.9, dice)};
  window.back.glow = 0.9f;
  const Niche door{d - 2.4,
                   d - 1.5,
                   0.0,
                   2.02,
                   0.06,
                   make_material(Pattern::kPlain, 0xE9E4D8, 0xE9E4D8, 0.1, dice),
                   make_material(Pattern::kWood, 0xC7A27A, 0x94683F, 0.2, dice)};
  add_wall(builder, walls.south, w, h, make_material(Pattern::kStripes, 0xD9CBB0, 0xCDBB97, 0.22, dice), nullptr);
  add_wall(builder, walls.east, d, h, make_material(Pattern::kPlain, 0xB9C4BC, 0xB9C4BC, 0.1, dice), nullptr);
  add_wall(builder, walls.north, w, h, make_material(Pattern::kPlain, 0xE6DFD2, 0xE6DFD2, 0.1, dice), &window);
  add_wall(builder, walls.west, d, h, make_material(Pattern::kDots, 0xA9B7C0, 0x8698A5, 0.3, dice), &door);
  add_skirting(builder, walls.south, 0.012, w - 0.012, dice);
  add_skirting(builder, walls.east, 0.012, d - 0.012, dice);
  add_skirting(builder, walls.north, 0.012, w - 0.012, dice);
  add_skirting(builder, walls.west, 0.012, door.along_low - 0.08, dice);
  add_skirting(builder, walls.west, door.along_high + 0.08, d - 0.012, dice);
  add_window_bars(builder, walls.north, window, dice);
  add_door(builder, walls.west, door, dice);
  return walls;
}

Frame on_wall(const Frame& wall, double along, double up, double off = 0.0005) {
  return wall * standing_at(along, off, 0, up);
}

/// The base arrangement: along the walls, with the table group in the north-west and a partition across the south.
void furnish(MeshBuilder& builder, const Walls& walls, double w, double d, double h, Dice& dice) {
  const double x_table = std::min(0.35 * w, 2.3), y_table = d - 1.65;
  add_rug(builder, standing_at(x_table, y_table - 0.1), 2.2, 1.6, dice);
  add_table_group(builder, standing_at(x_table, y_table, dice.between(-0.08, 0.08), 0.008), dice);
  add_pendant_lamp(builder, standing_at(x_table, y_table), h, dice);
  add_sofa(builder, standing_at(1.45, 0.5, dice.between(-0.02, 0.02)), dice);
  add_floor_lamp(builder, standing_at(2.75, 0.35, dice.between(0.2, 0.6)), dice);
  add_sideboard(builder, standing_at(w - 1.0, 0.24), dice);
  // Clear of the lamp's cable on one side and of the sideboard on the other.
  add_partition(builder, standing_at(std::max(0.6 * w, 3.0), 1.55, 0.5 * kPi + dice.between(-0.04, 0.04)), 1.5,
                std::min(1.75, h - 0.5), 0.015, dice);
  add_bookshelf(builder, standing_at(w - 0.165, d - 1.5, 0.5 * kPi), std::min(1.9, d - 2.4), std::min(2.05, h - 0.3),
                dice);
  add_drying_rack(builder, standing_at(w - 0.65, 1.7, 0.5 * kPi + dice.between(-0.2, 0.2)), dice);
  add_plant(builder, standing_at(0.5, d - 0.5), dice);
  add_pouf(builder, standing_at(1.9 + dice.between(-0.1, 0.1), 1.5), dice);
  add_basket(builder, standing_at(0.25, 1.35), dice);
  builder.set_frame(standing_at(w - 1.3, 2.45));
  builder.use(make_material(Pattern::kChecker, 0xD35400, 0xF4ECD8, 0.06, dice));
  builder.add_superellipsoid({0, 0, 0.11}, {0.11, 0.11, 0.11}, 1, 1, 64);

  add_picture(builder, on_wall(walls.south, 1.45, 1.6), 0.9, 0.6, Pattern::kPicture, dice);
  add_picture(builder, on_wall(walls.south, w - 1.0, 1.65), 0.5, 0.7, Pattern::kText, dice);
  add_picture(builder, on_wall(walls.east, 0.9, 1.6), 0.4, 0.5, Pattern::kPicture, dice);
  add_picture(builder, on_wall(walls.west, 1.0, 1.6), 0.7, 0.7, Pattern::kMarble, dice);
  add_radiator(builder, walls.north * standing_at(0.5 * w, 0), 1.3, dice);
  add_curtain_rail(builder, walls.north * standing_at(0.5 * w, 0), 1.8, std::min(2.3, h - 0.2), dice);
  // A 5 mm cable that droops along the west wall.
  std::vector<Vector3d> cable;
  for (int i = 0; i <= 40; ++i) cable.emplace_back(0.35 + 1.1 * i / 40.0, 0.02, 0.9 - 0.25 * std::sin(kPi * i / 40.0));
  builder.set_frame(walls.west);
  builder.use(make_material(Pattern::kPlain, 0x232428, 0x232428, 0.1, dice));
  builder.add_tube(cable, 0.005, 10);
}

/// A larger room gets islands of furniture where the base arrangement does not reach.
void add_islands(MeshBuilder& builder, double w, double d, double h, Dice& dice) {
  for (double x = 0; x + 2.2 < w; x += 3.4) {
    for (double y = 0; y + 2.2 < d; y += 3.2) {
      const double cx = x + 1.9, cy = y + 1.7;
      const bool is_west = cx<4.4, is_east = cx> w - 3.0, is_south = cy<3.4, is_north = cy> d - 3.2;
      if (((is_west || is_east) && (is_south || is_north)) || cx > w - 1.6 || cy > d - 1.6) continue;
      const double yaw = dice.between(-0.4, 0.4);
      const int kind = dice.index(4);
      if (kind == 0) {
        add_table_group(builder, standing_at(cx, cy, yaw), dice);
        add_pendant_lamp(builder, standing_at(cx, cy), h, dice);
      } else if (kind == 1) {
        add_bookshelf(builder, standing_at(cx, cy, yaw), 1.6, std::min(1.9, h - 0.4), dice);
        add_bookshelf(builder, standing_at(cx + 0.31 * std::sin(yaw), cy - 0.31 * std::cos(yaw), yaw + kPi), 1.6, 1.4,
                      dice);
      } else if (kind == 2) {
        add_partition(builder, standing_at(cx, cy, yaw), 1.6, std::min(1.75, h - 0.5), dice.between(0.01, 0.02), dice);
        add_pouf(builder, standing_at(cx + 0.7, cy + 0.8), dice);
        add_plant(builder, standing_at(cx - 0.7, cy - 0.6), dice);
      } else {
        add_sofa(builder, standing_at(cx, cy, yaw), dice);
        add_drying_rack(builder, standing_at(cx - 0.2, cy - 1.0, yaw), dice);
      }
    }
  }
}

}  // namespace
}  // namespace simulation

SimulatedScene make_room(const RoomOptions& options) {
  using namespace simulation;
  const double w = options.width_m, d = options.depth_m, h = options.height_m;
  if (!(w >= 4.5 && d >= 4.0 && h >= 2.4 && std::max({w, d, h}) <= 60.0))
    throw InvalidInput({}, {}, "room size", "must be at least 4.5 × 4 × 2.4 m and at most 60 m");
  Dice dice(options.seed, Stream::kRoom);
  MeshBuilder builder;
  const Walls walls = add_shell(builder, w, d, h, dice);
  furnish(builder, walls, w, d, h, dice);
  add_islands(builder, w, d, h, dice);
  SimulatedScene scene = builder.finish("room");
  scene.is_interior = true;
  // The window's daylight, and ceiling lamps every few metres.
  const float fw = float(w), fd = float(d), fh = float(h);
  scene.lights.push_back({{0.5f * fw, fd - 0.02f, 1.55f}, {0.85f, 0, 0}, {0, 0, 0.6f}, {1.0f, 1.05f, 1.15f}});
  for (float x = std::min(0.5f * fw, 3.0f); x < fw; x += 4.0f)
    for (float y = std::min(0.45f * fd, 2.2f); y < fd; y += 4.0f)
      scene.lights.push_back({{x, y, fh - 0.03f}, {0.5f, 0, 0}, {0, -0.5f, 0}, {1.6f, 1.45f, 1.2f}});
  return scene;
}

}  // namespace lapseam
