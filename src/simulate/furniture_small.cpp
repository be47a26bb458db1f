#include <array>
#include <cmath>
#include <numbers>

#include "simulate/furniture.h"

namespace lapseam::simulation {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kPi = std::numbers::pi;

Material metal(std::uint32_t srgb, Dice& dice) {
  Material m = make_material(Pattern::kPlain, srgb, srgb, 0.1, dice);
  m.is_specular = true;
  return m;
}

Material paint(std::uint32_t srgb, Dice& dice) { return make_material(Pattern::kPlain, srgb, srgb, 0.1, dice); }

}  // namespace

void add_drying_rack(MeshBuilder& builder, const Frame& frame, Dice& dice) {
  builder.set_frame(frame);
  builder.use(metal(0xB8BEC4, dice));
  for (const double x : {-0.4, 0.4}) {
    // The feet start as far up as their slanting ends reach down.
    builder.add_rod({x, -0.25, 0.0014}, {x, 0, 0.9}, 0.010, 16);
    builder.add_rod({x, 0.25, 0.0014}, {x, 0, 0.9}, 0.010, 16);
  }
  builder.use(paint(0xD9DDE0, dice));
  builder.add_rod({-0.4, 0, 0.9}, {0.4, 0, 0.9}, 0.010, 16);
  for (const double side : {-1.0, 1.0})
    for (int i = 1; i <= 3; ++i) {
      const double z = 0.9 - 0.2 * i, y = side * 0.25 * (0.9 - z) / 0.9;
      builder.add_rod({-0.4, y, z}, {0.4, y, z}, 0.005, 12);
    }
  // A towel over the top rod: a 4 mm cloth, bent over.
  std::vector<Vector2d> line;
  for (int i = 0; i <= 8; ++i) line.emplace_back(-0.014 - 0.016 * (8 - i) / 8.0, 0.55 + 0.345 * i / 8.0);
  for (int i = 1; i < 8; ++i) line.emplace_back(-0.014 * std::cos(kPi * i / 8), 0.895 + 0.014 * std::sin(kPi * i / 8));
  for (int i = 0; i <= 8; ++i) line.emplace_back(0.014 + 0.01 * i / 8.0, 0.895 - 0.24 * i / 8.0);
  // The line lies in (y, z); the curtain stands along what is then the rack's x.
  Eigen::Matrix3d R;
  R << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  Frame lying = Frame::Identity();
  lying.linear() = R;
  builder.set_frame(frame * lying);
  builder.use(make_material(Pattern::kStripes, 0x3D6FA3, 0xEFEFEA, 0.05, dice));
  builder.add_curtain(line, 0.004, -0.3, 0.05);
}

void add_floor_lamp(MeshBuilder& builder, const Frame& frame, Dice& dice) {
  builder.set_frame(frame);
  builder.use(metal(0x3A3D40, dice));
  builder.add_revolution(std::array<Vector2d, 4>{{{0, 0}, {0.14, 0}, {0.13, 0.02}, {0, 0.028}}}, 48);
  builder.add_rod({0, 0, 0.02}, {0, 0, 1.5}, 0.010, 16);
  builder.use(paint(0xE9D8B4, dice));
  builder.add_revolution(std::array<Vector2d, 5>{{{0.17, 1.3}, {0.12, 1.56}, {0.117, 1.56}, {0.167, 1.3}, {0.17, 1.3}}},
                         56);
  builder.use(make_material(Pattern::kPlain, 0xFFF2D8, 0xFFF2D8, 0.1, dice));
  builder.add_superellipsoid({0, 0, 1.42}, {0.04, 0.04, 0.05}, 1, 1, 32);
  // The mains cable: 5 mm, on the floor in a bow.
  std::vector<Vector3d> cable;
  for (int i = 0; i <= 24; ++i) {
    const double t = i / 24.0;
    cable.emplace_back(0.12 + 0.7 * t, 0.12 * std::sin(5.5 * t), 0.004 + 0.0005 * std::sin(20 * t));
  }
  builder.use(paint(0x1E1F22, dice));
  builder.add_tube(cable, 0.005, 10);
}

void add_plant(MeshBuilder& builder, const Frame& frame, Dice& dice) {
  builder.set_frame(frame);
  builder.use(make_material(Pattern::kTiles, 0xB5651D, 0x6B3A12, 0.06, dice));
  const std::array<Vector2d, 8> pot{
      {{0, 0}, {0.12, 0}, {0.16, 0.26}, {0.175, 0.27}, {0.175, 0.3}, {0.155, 0.3}, {0.15, 0.26}, {0, 0.26}}};
  builder.add_revolution(pot, 48);
  for (int i = 0; i < 9; ++i) {
    const double heading = 2 * kPi * i / 9 + dice.between(-0.25, 0.25), rise = dice.between(0.35, 0.9);
    const double reach = dice.between(0.08, 0.2);
    const Vector3d out(std::cos(heading), std::sin(heading), 0);
    std::vector<Vector3d> stem;
    for (int k = 0; k <= 8; ++k) {
      const double t = k / 8.0;
      stem.push_back(out * (0.03 + reach * t * t) + Vector3d(0, 0, 0.25 + rise * t));
    }
    builder.set_frame(frame);
    builder.use(paint(0x4F7942, dice));
    builder.add_tube(stem, 0.006, 10);
    // The leaf: a flat ellipsoid, 5 mm thick, whose long axis leads on from the stem.
    const double droop = dice.between(-0.5, 0.3), half_length = dice.between(0.07, 0.11);
    const Frame tip = Frame(Eigen::Translation3d(stem.back()) * Eigen::AngleAxisd(heading, Vector3d::UnitZ()) *
                            Eigen::AngleAxisd(-droop, Vector3d::UnitY()));
    builder.set_frame(frame * tip);
    builder.use(make_material(Pattern::kStripes, 0x2E8B57, 0x6BA34A, 0.03, dice));
    builder.add_superellipsoid({half_length - 0.01, 0, 0}, {half_length, 0.4 * half_length, 0.0025}, 1, 1, 36);
  }
}

void add_pouf(MeshBuilder& builder, const Frame& frame, Dice& dice) {
  builder.set_frame(frame);
  builder.use(make_material(Pattern::kWeave, 0xC98B3A, 0x7A4E1D, 0.014, dice));
  builder.add_superellipsoid({0, 0, 0.2}, {0.27, 0.27, 0.2}, 0.55, 1, 80);
}

void add_basket(MeshBuilder& builder, const Frame& frame, Dice& dice) {
  builder.set_frame(frame);
  builder.use(make_material(Pattern::kWeave, 0xA9855A, 0x6E5030, 0.02, dice));
  const std::array<Vector2d, 6> profile{{{0, 0}, {0.11, 0}, {0.15, 0.32}, {0.146, 0.32}, {0.107, 0.004}, {0, 0.004}}};
  builder.add_revolution(profile, 48);
}

void add_rug(MeshBuilder& builder, const Frame& frame, double length_m, double width_m, Dice& dice) {
  builder.set_frame(frame);
  builder.use(make_material(Pattern::kDots, 0x7B2D26, 0xE0C9A0, 0.18, dice));
  const double x = 0.5 * length_m, y = 0.5 * width_m;
  builder.add_box({-x + 0.12, -y + 0.12, 0}, {x - 0.12, y - 0.12, 0.008});
  builder.use(make_material(Pattern::kStripes, 0x243B53, 0xE0C9A0, 0.06, dice));
  for (const double s : {-1.0, 1.0}) {
    builder.add_box({s > 0 ? x - 0.12 : -x, -y, 0}, {s > 0 ? x : -x + 0.12, y, 0.008});
    builder.add_box({-x + 0.12, s > 0 ? y - 0.12 : -y, 0}, {x - 0.12, s > 0 ? y : -y + 0.12, 0.008});
  }
}

void add_picture(MeshBuilder& builder, const Frame& frame, double width_m, double height_m, Pattern pattern,
                 Dice& dice) {
  builder.set_frame(frame);
  const double x = 0.5 * width_m, z = 0.5 * height_m, bar = 0.03;
  const bool is_page = pattern == Pattern::kText;
  builder.use(is_page ? make_material(pattern, 0xF3EDDC, 0x1B1B1F, 0.03, dice)
                      : make_material(pattern, 0x6D8F5A, 0x23452C, std::max(width_m, height_m), dice));
  builder.add_quad({x, 0.012, -z}, {-x, 0.012, -z}, {-x, 0.012, z}, {x, 0.012, z});
  builder.use(make_material(Pattern::kWood, 0x6B4A2B, 0x33210F, 0.1, dice));
  for (const double s : {-1.0, 1.0}) {
    builder.add_box({s > 0 ? x : -x - bar, 0, -z - bar}, {s > 0 ? x + bar : -x, 0.028, z + bar});
    builder.add_box({-x, 0, s > 0 ? z : -z - bar}, {x, 0.028, s > 0 ? z + bar : -z});
  }
}

void add_pendant_lamp(MeshBuilder& builder, const Frame& frame, double ceiling_m, Dice& dice) {
  builder.set_frame(frame);
  const double z = ceiling_m - 0.85;
  builder.use(paint(0x17181A, dice));
  std::vector<Vector3d> cable;
  for (int i = 0; i <= 10; ++i) cable.emplace_back(0.004 * std::sin(0.7 * i), 0, z + 0.25 + 0.599 * i / 10.0);
  builder.add_tube(cable, 0.005, 12);
  builder.add_revolution(
      std::array<Vector2d, 3>{{{0.05, ceiling_m - 0.03}, {0.05, ceiling_m - 0.0005}, {0, ceiling_m - 0.0005}}}, 32);
  builder.add_revolution(std::array<Vector2d, 2>{{{0, ceiling_m - 0.03}, {0.05, ceiling_m - 0.03}}}, 32);
  builder.use(paint(0xC8553D, dice));
  std::vector<Vector2d> shade;
  for (int i = 0; i <= 12; ++i) {
    const double t = i / 12.0;
    shade.emplace_back(0.2 * std::cos(0.5 * kPi * t) + 0.02 * t, z + 0.25 * std::sin(0.5 * kPi * t));
  }
  for (int i = 12; i >= 0; --i) {
    const double t = i / 12.0;
    shade.emplace_back(0.196 * std::cos(0.5 * kPi * t), z + 0.246 * std::sin(0.5 * kPi * t));
  }
  shade.push_back(shade.front());
  shade.insert(shade.begin() + 13, Vector2d(0, z + 0.25));
  builder.add_revolution(shade, 64);
  Material bulb = make_material(Pattern::kPlain, 0xFFF4DC, 0xFFF4DC, 0.1, dice);
  bulb.glow = 0.8f;
  builder.use(bulb);
  builder.add_superellipsoid({0, 0, z + 0.12}, {0.045, 0.045, 0.06}, 1, 1, 32);
}

void add_vase(MeshBuilder& builder, const Frame& frame, double height_m, Dice& dice) {
  builder.set_frame(frame);
  constexpr std::array<std::uint32_t, 4> kGlaze = {0x2C6E7F, 0xA23B2A, 0xD9C7A0, 0x4B3B6B};
  const std::uint32_t color = kGlaze[std::size_t(dice.index(4))];
  Material glaze = make_material(dice.index(2) ? Pattern::kMarble : Pattern::kStripes, color, 0xE9E2D0, 0.05, dice);
  glaze.is_specular = true;
  builder.use(glaze);
  const double belly = dice.between(0.26, 0.4), neck = dice.between(0.1, 0.16), waist = dice.between(0.3, 0.5);
  std::vector<Vector2d> profile{{0, 0}};
  constexpr int kRows = 36;
  const auto radius = [&](double t) {
    const double body = std::exp(-8.0 * (t - waist) * (t - waist));
    return height_m * (neck + (belly - neck) * body * (1 - 0.3 * t) + (t > 0.85 ? 1.6 * (t - 0.85) * (t - 0.85) : 0.0));
  };
  for (int i = 0; i <= kRows; ++i) profile.emplace_back(radius(double(i) / kRows), height_m * i / kRows);
  const double wall = std::min(0.004, 0.02 * height_m);
  for (int i = kRows; i >= kRows / 2; --i) profile.emplace_back(radius(double(i) / kRows) - wall, height_m * i / kRows);
  profile.emplace_back(0, height_m * 0.5);
  builder.add_revolution(profile, 56);
}

void add_radiator(MeshBuilder& builder, const Frame& frame, double width_m, Dice& dice) {
  builder.set_frame(frame);
  builder.use(paint(0xECEBE6, dice));
  const double half = 0.5 * width_m;
  const int ribs = int(width_m / 0.07);
  for (int i = 0; i <= ribs; ++i) {
    const double x = -half + width_m * i / ribs;
    builder.add_rod({x, 0.07, 0.14}, {x, 0.07, 0.68}, 0.04, 16);
  }
  for (const double z : {0.16, 0.66}) builder.add_rod({-half - 0.03, 0.07, z}, {half + 0.03, 0.07, z}, 0.03, 16);
  builder.use(metal(0x9C8A6A, dice));
  for (const double x : {-half - 0.02, half + 0.02}) builder.add_rod({x, 0.07, 0.0}, {x, 0.07, 0.15}, 0.016);
}

void add_curtain_rail(MeshBuilder& builder, const Frame& frame, double opening_m, double height_m, Dice& dice) {
  builder.set_frame(frame);
  const double half = 0.5 * opening_m + 0.45;
  builder.use(metal(0x6E6259, dice));
  builder.add_rod({-half, 0.1, height_m}, {half, 0.1, height_m}, 0.010, 16);
  for (const double x : {-half, half}) {
    builder.add_superellipsoid({x, 0.1, height_m}, {0.022, 0.022, 0.022}, 1, 1, 28);
    builder.add_rod({0.97 * x, 0.0, height_m - 0.006}, {0.97 * x, 0.1, height_m - 0.006}, 0.010);
  }
  for (const double side : {-1.0, 1.0}) {
    std::vector<Vector2d> line;
    for (int i = 0; i <= 96; ++i) {
      const double t = i / 96.0, x = side * (0.5 * opening_m - 0.05 + 0.42 * t);
      line.emplace_back(x, 0.1 + (0.026 + 0.01 * std::sin(3 * t)) * std::sin(2 * kPi * 5 * t));
    }
    builder.use(make_material(Pattern::kStripes, 0x8FB8AE, 0xF0E9D2, 0.05, dice));
    builder.add_curtain(line, 0.004, 0.12, height_m - 0.01);
  }
}

}  // namespace lapseam::simulation
