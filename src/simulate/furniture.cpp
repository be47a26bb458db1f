#include "simulate/furniture.h"

#include <array>
#include <cmath>
#include <numbers>

namespace lapseam::simulation {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kPi = std::numbers::pi;

constexpr std::array<std::uint32_t, 12> kCloth = {0xB03A2E, 0x1F618D, 0x117864, 0xB9770E, 0x6C3483, 0x2E4053,
                                                  0xCA6F1E, 0x148F77, 0xA93226, 0x2874A6, 0xD4AC0D, 0x7B241C};

std::uint32_t pick_cloth(Dice& dice) { return kCloth[std::size_t(dice.index(int(kCloth.size())))]; }

Material oak(Dice& dice) { return make_material(Pattern::kWood, 0xD2A679, 0x8E5A2B, 0.12, dice); }
Material walnut(Dice& dice) { return make_material(Pattern::kWood, 0x8A5A3C, 0x4A2C1A, 0.10, dice); }
Material steel(Dice& dice) {
  Material m = make_material(Pattern::kPlain, 0xA9B0B6, 0xA9B0B6, 0.1, dice);
  m.is_specular = true;
  return m;
}
Material paint(std::uint32_t srgb, Dice& dice) { return make_material(Pattern::kPlain, srgb, srgb, 0.1, dice); }

/// The profile of a thin vessel: up along the outside, over the rim, down along the inside.
std::vector<Vector2d> vessel(const std::vector<Vector2d>& outside, double wall_m) {
  std::vector<Vector2d> profile{{0, outside.front().y()}};
  profile.insert(profile.end(), outside.begin(), outside.end());
  for (std::size_t i = outside.size(); i-- > 0;)
    profile.emplace_back(std::max(outside[i].x() - wall_m, 0.0),
                         std::max(outside[i].y(), outside.front().y() + wall_m));
  profile.emplace_back(0, outside.front().y() + wall_m);
  return profile;
}

void add_mug(MeshBuilder& builder, const Frame& frame, Dice& dice) {
  builder.set_frame(frame);
  builder.use(make_material(Pattern::kStripes, pick_cloth(dice), 0xEDE6D6, 0.03, dice));
  builder.add_revolution(vessel({{0.036, 0}, {0.04, 0.01}, {0.04, 0.095}}, 0.004), 40);
  builder.set_frame(frame *
                    Frame(Eigen::Translation3d(0.045, 0, 0.05) * Eigen::AngleAxisd(kPi / 2, Vector3d::UnitX())));
  builder.add_torus(Vector3d::Zero(), 0.024, 0.005, 28, 10);
}

void add_book(MeshBuilder& builder, const Frame& frame, double thickness_m, double depth_m, double height_m,
              Dice& dice) {
  builder.set_frame(frame);
  builder.use(make_material(Pattern::kSpine, pick_cloth(dice), 0xE8D9A8, height_m, dice));
  // Two covers and a back around a block of paper that is a little smaller.
  constexpr double kCover = 0.0025;
  builder.add_box({0, 0, 0}, {kCover, depth_m, height_m});
  builder.add_box({thickness_m - kCover, 0, 0}, {thickness_m, depth_m, height_m});
  builder.add_box({kCover, depth_m - kCover, 0}, {thickness_m - kCover, depth_m, height_m});
  builder.use(make_material(Pattern::kStripes, 0xF2EBDC, 0xD8CDB8, 0.0015, dice));
  builder.add_box({kCover, 0.006, 0.004}, {thickness_m - kCover, depth_m - kCover, height_m - 0.004});
}

void add_book_row(MeshBuilder& builder, const Frame& shelf, double length_m, double depth_m, double clear_m,
                  Dice& dice) {
  double x = 0.01;
  while (true) {
    const double thickness = dice.between(0.014, 0.05), height = clear_m * dice.between(0.6, 0.92);
    const double depth = depth_m * dice.between(0.6, 0.9),
                 lean = dice.between(0, 1) < 0.12 ? dice.between(0.08, 0.2) : 0.0;
    const double foot = thickness * std::cos(lean) + height * std::sin(lean);
    if (x + foot > length_m - 0.01) return;
    // A leaning book stands on its lower right edge; the frame lifts its left bottom corner accordingly.
    const Frame book = shelf * Frame(Eigen::Translation3d(x, 0.02, 0.001 + thickness * std::sin(lean)) *
                                     Eigen::AngleAxisd(lean, Vector3d::UnitY()));
    add_book(builder, book, thickness, depth, height, dice);
    x += foot + dice.between(0.0008, 0.003) + (dice.between(0, 1) < 0.07 ? dice.between(0.04, 0.12) : 0.0);
  }
}

void add_things_on_table(MeshBuilder& builder, const Frame& top, Dice& dice) {
  // Each thing has its own part of the table top.
  // Each number is drawn by a statement of its own: compilers evaluate arguments in different orders.
  const double vase_y = dice.between(0.1, 0.2), vase_x = dice.between(-0.05, 0.1);
  add_vase(builder, top * standing_at(vase_x, vase_y), 0.26, dice);
  for (const double side : {-1.0, 1.0}) {
    const double x = side * dice.between(0.55, 0.62), y = side * dice.between(0.12, 0.26);
    add_mug(builder, top * standing_at(x, y, dice.between(0, 6)), dice);
  }
  double z = 0.001;
  const double pile_yaw = dice.between(-0.3, 0.3), pile_y = dice.between(-0.28, -0.2), pile_x = dice.between(0.2, 0.3);
  const Frame pile = top * standing_at(pile_x, pile_y, pile_yaw);
  for (int i = 0; i < 3; ++i) {
    const double thickness = dice.between(0.018, 0.035);
    // Lying: the book's x (thickness) points up.
    const Frame lying = pile * Frame(Eigen::Translation3d(0, 0, z + thickness) *
                                     Eigen::AngleAxisd(dice.between(-0.25, 0.25), Vector3d::UnitZ()) *
                                     Eigen::AngleAxisd(kPi / 2, Vector3d::UnitY()));
    add_book(builder, lying, thickness, 0.15 - 0.012 * i, 0.22 - 0.02 * i, dice);
    z += thickness + 0.001;
  }
  // A bowl with fruit, and a sheet of paper.
  const double bowl_y = dice.between(0.15, 0.22), bowl_x = dice.between(-0.48, -0.36);
  const Frame bowl = top * standing_at(bowl_x, bowl_y);
  builder.set_frame(bowl);
  builder.use(make_material(Pattern::kMarble, 0xE8ECEF, 0x5D8AA8, 0.06, dice));
  builder.add_revolution(vessel({{0.05, 0}, {0.09, 0.02}, {0.12, 0.05}, {0.135, 0.085}}, 0.005), 56);
  for (int i = 0; i < 3; ++i) {
    const double angle = 2.1 * i;
    builder.use(paint(i == 0 ? 0xD35400 : i == 1 ? 0x7DA453 : 0xC0392B, dice));
    builder.add_superellipsoid({0.047 * std::cos(angle), 0.047 * std::sin(angle), 0.062}, {0.039, 0.039, 0.036}, 1, 1,
                               32);
  }
  const double sheet_yaw = dice.between(-0.12, 0.12), sheet_x = dice.between(-0.3, -0.1);
  builder.set_frame(top * standing_at(sheet_x, -0.22, sheet_yaw));
  builder.use(make_material(Pattern::kText, 0xF4F4F0, 0x202225, 0.012, dice));
  builder.add_box({-0.105, -0.1485, 0.0005}, {0.105, 0.1485, 0.003});
}

}  // namespace

Material make_material(Pattern pattern, std::uint32_t srgb_a, std::uint32_t srgb_b, double scale_m, Dice& dice) {
  Material m;
  m.pattern = pattern;
  m.color_a = linear_color(srgb_a);
  m.color_b = linear_color(srgb_b);
  m.scale_m = float(scale_m);
  m.seed = dice.seed();
  return m;
}

Frame standing_at(double x, double y, double yaw_rad, double z) {
  return Frame(Eigen::Translation3d(x, y, z) * Eigen::AngleAxisd(yaw_rad, Vector3d::UnitZ()));
}

void add_table_group(MeshBuilder& builder, const Frame& frame, Dice& dice) {
  builder.set_frame(frame);
  builder.use(oak(dice));
  builder.add_box({-0.75, -0.42, 0.72}, {0.75, 0.42, 0.75});
  builder.add_box({-0.66, -0.35, 0.64}, {0.66, -0.33, 0.72});
  builder.add_box({-0.66, 0.33, 0.64}, {0.66, 0.35, 0.72});
  for (const double x : {-0.7, 0.66})
    for (const double y : {-0.37, 0.33}) builder.add_box({x, y, 0}, {x + 0.04, y + 0.04, 0.72});
  for (int i = 0; i < 4; ++i) {
    const double x = i % 2 ? 0.36 : -0.36, side = i / 2 ? 1 : -1;
    const double yaw = (side > 0 ? kPi : 0) + dice.between(-0.3, 0.3);
    const double y = side * dice.between(0.5, 0.68), off = dice.between(-0.05, 0.05);
    add_chair(builder, frame * standing_at(x + off, y, yaw), dice);
  }
  add_things_on_table(builder, frame * standing_at(0, 0, 0, 0.75), dice);
}

void add_chair(MeshBuilder& builder, const Frame& frame, Dice& dice) {
  builder.set_frame(frame);
  builder.use(walnut(dice));
  for (const double x : {-0.18, 0.18}) {
    // The feet start as far up as their slanting ends reach down.
    builder.add_rod({1.08 * x, 0.2, 0.001}, {x, 0.17, 0.44}, 0.024, 14);
    // Back legs run on into the back.
    const std::array<Vector3d, 3> back{Vector3d(1.08 * x, -0.22, 0.0013), Vector3d(x, -0.18, 0.45),
                                       Vector3d(x, -0.24, 0.92)};
    builder.add_tube(back, 0.024, 14);
    builder.add_rod({1.04 * x, 0.185, 0.22}, {1.04 * x, -0.2, 0.22}, 0.014);
  }
  builder.add_box({-0.19, -0.245, 0.85}, {0.19, -0.222, 0.92});
  for (int i = 0; i < 4; ++i) {
    const double x = -0.12 + 0.08 * i;
    builder.add_rod({x, -0.185, 0.45}, {x, -0.233, 0.86}, 0.012);
  }
  builder.add_box({-0.21, -0.2, 0.44}, {0.21, 0.21, 0.46});
  builder.use(make_material(Pattern::kWeave, pick_cloth(dice), 0xD7CCB8, 0.012, dice));
  builder.add_superellipsoid({0, 0.005, 0.478}, {0.195, 0.19, 0.022}, 0.7, 0.35, 48);
}

void add_bookshelf(MeshBuilder& builder, const Frame& frame, double width_m, double height_m, Dice& dice) {
  constexpr double kBoard = 0.02, kDepth = 0.3;
  const double half = 0.5 * width_m;
  builder.set_frame(frame);
  builder.use(walnut(dice));
  builder.add_box({-half, -0.5 * kDepth, 0}, {-half + kBoard, 0.5 * kDepth, height_m});
  builder.add_box({half - kBoard, -0.5 * kDepth, 0}, {half, 0.5 * kDepth, height_m});
  builder.add_box({-half + kBoard, -0.5 * kDepth, 0}, {half - kBoard, -0.5 * kDepth + 0.008, height_m});
  const int shelves = std::max(3, int(height_m / 0.36));
  const double pitch = (height_m - 0.06 - kBoard) / shelves;
  for (int i = 0; i <= shelves; ++i) {
    const double z = 0.06 + pitch * i;
    builder.set_frame(frame);
    builder.use(walnut(dice));
    builder.add_box({-half + kBoard, -0.5 * kDepth + 0.008, z}, {half - kBoard, 0.5 * kDepth, z + kBoard});
    if (i == shelves) break;
    const double length = width_m - 2 * kBoard, clear = pitch - kBoard;
    const Frame shelf = frame * standing_at(-half + kBoard, -0.5 * kDepth + 0.008, 0, z + kBoard);
    const double filled = dice.between(0.45, 0.95) * length;
    add_book_row(builder, shelf, filled, kDepth - 0.03, clear, dice);
    if (length - filled > 0.25)
      add_vase(builder, frame * standing_at(half - 0.15, 0.02, 0, z + kBoard), clear * dice.between(0.6, 0.9), dice);
  }
}

void add_sofa(MeshBuilder& builder, const Frame& frame, Dice& dice) {
  const std::uint32_t cloth = pick_cloth(dice);
  const auto fabric = [&] { return make_material(Pattern::kWeave, cloth, 0x8C8C86, 0.01, dice); };
  builder.set_frame(frame);
  builder.use(fabric());
  builder.add_box({-0.98, -0.42, 0.12}, {0.98, 0.4, 0.3});
  builder.add_superellipsoid({0, -0.36, 0.5}, {1.0, 0.1, 0.36}, 0.3, 0.3, 64);
  for (const double x : {-0.93, 0.93}) builder.add_superellipsoid({x, 0.0, 0.36}, {0.1, 0.44, 0.26}, 0.35, 0.35, 56);
  for (const double x : {-0.41, 0.41}) builder.add_superellipsoid({x, 0.08, 0.38}, {0.405, 0.36, 0.1}, 0.4, 0.25, 64);
  for (const double x : {-0.9, 0.86})
    for (const double y : {-0.38, 0.34}) builder.add_box({x, y, 0}, {x + 0.04, y + 0.04, 0.12});
  constexpr std::array<Pattern, 3> kCushions = {Pattern::kDots, Pattern::kStripes, Pattern::kChecker};
  for (int i = 0; i < 3; ++i) {
    const double x = -0.62 + 0.6 * i + dice.between(-0.06, 0.06);
    builder.set_frame(
        frame * standing_at(x, -0.14, dice.between(-0.25, 0.25), 0.66) *
        Frame(Eigen::AngleAxisd(-0.28, Vector3d::UnitX()) * Eigen::AngleAxisd(kPi / 2, Vector3d::UnitX())));
    builder.use(make_material(kCushions[std::size_t(i)], pick_cloth(dice), 0xE6DCC6, 0.07, dice));
    builder.add_superellipsoid({0, 0, 0}, {0.22, 0.21, 0.075}, 1.0, 0.5, 64);
  }
}

void add_sideboard(MeshBuilder& builder, const Frame& frame, Dice& dice) {
  builder.set_frame(frame);
  builder.use(oak(dice));
  builder.add_box({-0.7, -0.2, 0.1}, {0.7, 0.2, 0.72});
  for (const double x : {-0.66, 0.62})
    for (const double y : {-0.17, 0.13}) builder.add_box({x, y, 0}, {x + 0.04, y + 0.04, 0.1});
  for (int i = 0; i < 3; ++i) {
    const double x = -0.69 + 0.465 * i;
    builder.use(oak(dice));
    builder.add_box({x, 0.2, 0.115}, {x + 0.45, 0.218, 0.705});
    builder.use(steel(dice));
    builder.add_superellipsoid({x + (i == 2 ? 0.05 : 0.4), 0.236, 0.46}, {0.014, 0.018, 0.014}, 1, 1, 24);
  }
  const Frame top = frame * standing_at(0, 0, 0, 0.72);
  // A globe on a foot with a 10 mm axis; a ring; a vase; a dish with a lid.
  builder.set_frame(top * standing_at(-0.45, 0));
  builder.use(walnut(dice));
  builder.add_revolution(std::array<Vector2d, 4>{{{0, 0}, {0.07, 0}, {0.06, 0.02}, {0, 0.025}}}, 40);
  builder.add_rod({0, 0, 0.02}, {0, 0, 0.08}, 0.010);
  builder.use(make_material(Pattern::kMarble, 0x2E86C1, 0xD5C9A1, 0.09, dice));
  builder.add_superellipsoid({0, 0, 0.19}, {0.12, 0.12, 0.12}, 1, 1, 72);
  builder.set_frame(top * standing_at(-0.02, 0.02, 0.4, 0.13) * Frame(Eigen::AngleAxisd(kPi / 2, Vector3d::UnitX())));
  builder.use(make_material(Pattern::kChecker, 0xC0392B, 0xF4ECD8, 0.025, dice));
  builder.add_torus(Vector3d::Zero(), 0.095, 0.034, 64, 28);
  add_vase(builder, top * standing_at(0.32, -0.02), 0.34, dice);
  add_mug(builder, top * standing_at(0.54, 0.05, dice.between(0, 6)), dice);
}

void add_partition(MeshBuilder& builder, const Frame& frame, double length_m, double height_m, double thickness_m,
                   Dice& dice) {
  builder.set_frame(frame);
  const double half = 0.5 * length_m, t = 0.5 * thickness_m;
  const auto corner = [&](double x, double y, double z) { return Vector3d(x, y, z); };
  constexpr double kFoot = 0.04;
  builder.use(make_material(Pattern::kDots, 0xF1E3C6, 0xC0562B, 0.16, dice));
  builder.add_quad(corner(half, t, kFoot), corner(-half, t, kFoot), corner(-half, t, height_m),
                   corner(half, t, height_m));
  builder.use(make_material(Pattern::kTiles, 0x6FA8A0, 0x2D3E40, 0.2, dice));
  builder.add_quad(corner(-half, -t, kFoot), corner(half, -t, kFoot), corner(half, -t, height_m),
                   corner(-half, -t, height_m));
  builder.use(oak(dice));
  for (const double s : {-1.0, 1.0}) {
    builder.add_quad(corner(s * half, -s * t, kFoot), corner(s * half, s * t, kFoot), corner(s * half, s * t, height_m),
                     corner(s * half, -s * t, height_m));
    builder.add_box({s * (half - 0.2) - 0.03, -0.2, 0}, {s * (half - 0.2) + 0.03, 0.2, kFoot});
  }
  builder.add_quad(corner(-half, -t, height_m), corner(half, -t, height_m), corner(half, t, height_m),
                   corner(-half, t, height_m));
  builder.add_quad(corner(-half, t, kFoot), corner(half, t, kFoot), corner(half, -t, kFoot), corner(-half, -t, kFoot));
}

}  // namespace lapseam::simulation
