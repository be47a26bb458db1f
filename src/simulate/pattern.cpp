#include "simulate/pattern.h"

#include <algorithm>
#include <cmath>

#include "simulate/counter_rng.h"

namespace lapseam::simulation {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

/// In [0, 1), from a lattice cell.
float cell_value(int x, int y, int z, std::uint32_t seed) {
  std::uint32_t h = std::uint32_t(x) * 0x8DA6B343u ^ std::uint32_t(y) * 0xD8163841u ^ std::uint32_t(z) * 0xCB1AB31Fu ^
                    seed * 0x165667B1u;
  h = (h ^ (h >> 15)) * 0x2C1B3C6Du;
  h = (h ^ (h >> 12)) * 0x297A2D39u;
  return float((h ^ (h >> 15)) >> 8) * 0x1p-24f;
}

float smooth(float t) { return t * t * (3 - 2 * t); }
float mix(float a, float b, float t) { return a + (b - a) * t; }
Vector3f mix(const Vector3f& a, const Vector3f& b, float t) { return a + (b - a) * t; }
int floor_int(float x) { return int(std::floor(x)); }
float fraction(float x) { return x - std::floor(x); }

/// Value noise in [0, 1), one feature per unit.
float noise(const Vector3f& p, std::uint32_t seed) {
  const int x = floor_int(p.x()), y = floor_int(p.y()), z = floor_int(p.z());
  const float fx = smooth(p.x() - float(x)), fy = smooth(p.y() - float(y)), fz = smooth(p.z() - float(z));
  const auto row = [&](int j, int k) { return mix(cell_value(x, j, k, seed), cell_value(x + 1, j, k, seed), fx); };
  return mix(mix(row(y, z), row(y + 1, z), fy), mix(row(y, z + 1), row(y + 1, z + 1), fy), fz);
}

float cloud(Vector3f p, std::uint32_t seed, int octaves) {
  float sum = 0, weight = 0.5f;
  for (int i = 0; i < octaves; ++i, weight *= 0.5f, p *= 2.03f) sum += weight * noise(p, seed + std::uint32_t(i));
  return sum / (1 - 2 * weight + weight);
}

/// The two coordinates of the pattern frame that span the face: z stays upright where it can.
Vector2f flat_coordinates(const Vector3f& p, const Vector3f& n) {
  const Vector3f a = n.cwiseAbs();
  if (a.z() >= a.x() && a.z() >= a.y()) return {p.x(), p.y()};
  return a.x() >= a.y() ? Vector2f(p.y(), p.z()) : Vector2f(p.x(), p.z());
}

Vector3f plain(const Material& m, const Vector3f& p) {
  // Paint is never flat: two scales of mottling, 6 %.
  return m.color_a * (0.94f + 0.08f * noise(p * 9.0f, m.seed) + 0.04f * noise(p * 70.0f, m.seed + 1));
}

Vector3f checker(const Material& m, const Vector2f& q) {
  const int i = floor_int(q.x() / m.scale_m), j = floor_int(q.y() / m.scale_m);
  return ((i + j) & 1 ? m.color_a : m.color_b) * (0.9f + 0.2f * cell_value(i, j, 0, m.seed));
}

Vector3f tiles(const Material& m, const Vector2f& q) {
  const float s = q.x() / m.scale_m, t = q.y() / m.scale_m;
  const bool is_grout = std::min({fraction(s), 1 - fraction(s), fraction(t), 1 - fraction(t)}) < 0.02f;
  if (is_grout) return m.color_b;
  const float tone = cell_value(floor_int(s), floor_int(t), 1, m.seed);
  return m.color_a * (0.8f + 0.3f * tone + 0.12f * noise({q.x() * 40, q.y() * 40, tone * 50}, m.seed));
}

float grain(const Vector3f& p, std::uint32_t seed) {
  return 0.65f * noise({p.x() * 3, p.y() * 90, p.z() * 90}, seed) +
         0.35f * noise({p.x() * 12, p.y() * 300, p.z() * 300}, seed);
}

Vector3f planks(const Material& m, const Vector2f& q) {
  const int row = floor_int(q.y() / m.scale_m);
  const float length = 9 * m.scale_m;
  const float along = q.x() + length * cell_value(row, 7, 0, m.seed);
  const int plank = floor_int(along / length);
  const float edge = std::min(fraction(q.y() / m.scale_m), 1 - fraction(q.y() / m.scale_m)) * m.scale_m;
  const float end = std::min(fraction(along / length), 1 - fraction(along / length)) * length;
  const float tone = cell_value(row, plank, 3, m.seed);
  const Vector3f wood = mix(m.color_a, m.color_b, 0.6f * tone + 0.5f * grain({along, q.y(), tone * 9}, m.seed) - 0.05f);
  return std::min(edge, end) < 0.0018f ? Vector3f(wood * 0.35f) : wood;
}

Vector3f wood(const Material& m, const Vector3f& p) {
  // Rings around an axis outside the piece, bent by noise.
  const float bend = 0.35f * m.scale_m * noise(Vector3f(p.x() * 2, p.y() * 6, p.z() * 6), m.seed);
  const float ring = fraction((std::hypot(p.y() + 0.31f, p.z() - 0.47f) + bend) / (0.22f * m.scale_m));
  return mix(m.color_a, m.color_b, 0.55f * ring * ring + 0.35f * grain(p, m.seed));
}

Vector3f stripes(const Material& m, const Vector2f& q) {
  const float s = fraction(q.x() / m.scale_m);
  const int i = floor_int(q.x() / m.scale_m);
  if (s > 0.46f && s < 0.5f) return 0.5f * (m.color_a + m.color_b);
  return (s < 0.5f ? m.color_a : m.color_b) * (0.88f + 0.18f * cell_value(i, 0, s < 0.5f, m.seed)) *
         (0.96f + 0.06f * noise({q.x() * 50, q.y() * 14, 0}, m.seed));
}

Vector3f marble(const Material& m, const Vector3f& p) {
  const float warp = cloud(p / m.scale_m, m.seed, 4);
  const float vein = std::abs(std::sin((p.x() + p.y() + p.z()) / m.scale_m * 2.0f + 9.0f * warp));
  return mix(m.color_b, m.color_a, std::min(1.0f, 0.25f + vein)) * (0.85f + 0.25f * warp);
}

/// A page: lines of words of random 3 × 5 glyphs, a heading now and then, and a margin of empty paper.
Vector3f text(const Material& m, const Vector2f& q) {
  const int line = floor_int(q.y() / m.scale_m);
  const bool is_heading = cell_value(line, 1, 2, m.seed) < 0.12f;
  const float width = m.scale_m * (is_heading ? 0.8f : 0.5f);
  const int letter = floor_int(q.x() / width);
  const float gx = fraction(q.x() / width) * 4, gy = fraction(q.y() / m.scale_m) * (is_heading ? 6.0f : 8.0f);
  const bool is_gap = cell_value(letter / 2, line, 5, m.seed) < 0.14f || cell_value(line, 9, 9, m.seed) < 0.1f;
  if (is_gap || gx >= 3 || gy >= 5) return m.color_a;
  const std::uint32_t glyph = std::uint32_t(cell_value(letter, line, 6, m.seed) * 24);
  const bool is_ink = cell_value(int(gx), int(gy), int(glyph), 77) < 0.55f;
  return is_ink ? Vector3f(is_heading ? 0.5f * (m.color_b + Vector3f(0.5f, 0.03f, 0.03f)) : m.color_b) : m.color_a;
}

/// A landscape, one repeat wide and centred on the frame's origin: sky with sun and clouds, three ranges of hills.
Vector3f picture(const Material& m, const Vector2f& q) {
  const float x = q.x() / m.scale_m, y = q.y() / m.scale_m;
  Vector3f color = mix(Vector3f(0.75f, 0.6f, 0.45f), Vector3f(0.12f, 0.3f, 0.62f), std::clamp(y + 0.45f, 0.0f, 1.0f));
  const float cloudy = cloud({x * 3, y * 7, 0.5f}, m.seed, 4);
  color = mix(color, Vector3f::Constant(0.85f), std::clamp(3 * cloudy - 1.5f, 0.0f, 1.0f));
  const Vector2f sun(0.5f * cell_value(1, 0, 0, m.seed) - 0.25f, 0.18f);
  if ((Vector2f(x, y) - sun).norm() < 0.07f) color = {0.95f, 0.75f, 0.25f};
  for (int hill = 0; hill < 3; ++hill) {
    const float ridge =
        0.08f - 0.13f * float(hill) + 0.24f * (cloud({x * float(2 + 2 * hill), float(hill), 3}, m.seed + 9, 3) - 0.5f);
    const float shade = 0.7f + 0.6f * noise({x * 60, y * 60, float(hill)}, m.seed);
    if (y < ridge) color = mix(m.color_a, m.color_b, float(hill) / 2) * shade;
  }
  return color;
}

Vector3f weave(const Material& m, const Vector2f& q) {
  const float s = q.x() / m.scale_m, t = q.y() / m.scale_m;
  const bool is_warp = ((floor_int(s) + floor_int(t)) & 1) != 0;
  const float thread = is_warp ? std::abs(fraction(s) - 0.5f) : std::abs(fraction(t) - 0.5f);
  const float mottle = 0.85f + 0.3f * noise({q.x() * 25, q.y() * 25, 0}, m.seed);
  return (is_warp ? m.color_a : m.color_b) * (1.05f - 0.6f * thread) * mottle;
}

Vector3f dots(const Material& m, const Vector2f& q) {
  const int row = floor_int(q.y() / m.scale_m);
  const float s = q.x() / m.scale_m + 0.5f * float(row & 1);
  const Vector2f d(fraction(s) - 0.5f, fraction(q.y() / m.scale_m) - 0.5f);
  const float radius = 0.2f + 0.12f * cell_value(floor_int(s), row, 0, m.seed);
  const bool is_ring = d.norm() > radius && d.norm() < radius + 0.06f;
  if (d.norm() <= radius) return m.color_b * (0.9f + 0.2f * cell_value(floor_int(s), row, 1, m.seed));
  return (is_ring ? Vector3f(0.5f * (m.color_a + m.color_b)) : m.color_a) *
         (0.94f + 0.08f * noise({q.x() * 9, q.y() * 9, 0}, m.seed));
}

/// A book that stands along z, scale_m high: bands, and a title across the spine.
Vector3f spine(const Material& m, const Vector2f& q) {
  const float t = q.y() / m.scale_m;
  const float band = 0.06f + 0.08f * cell_value(0, 0, 1, m.seed);
  if (std::abs(t - band) < 0.012f || std::abs(1 - t - band) < 0.012f) return m.color_b;
  const bool is_title =
      t > 0.35f && t < 0.75f && cell_value(floor_int(q.y() / 0.006f), floor_int(q.x() / 0.004f), 2, m.seed) < 0.3f;
  if (is_title) return m.color_b;
  return m.color_a * (0.85f + 0.25f * noise({q.x() * 200, q.y() * 60, 0}, m.seed));
}

}  // namespace

Vector3f albedo(const Material& material, const Vector3f& point, const Vector3f& normal) {
  const Vector3f p = material.T_pattern_world * point;
  const Vector2f q = flat_coordinates(p, material.T_pattern_world.linear() * normal);
  switch (material.pattern) {
    case Pattern::kPlain:
      return plain(material, p);
    case Pattern::kChecker:
      return checker(material, q);
    case Pattern::kTiles:
      return tiles(material, q);
    case Pattern::kPlanks:
      return planks(material, q);
    case Pattern::kWood:
      return wood(material, p);
    case Pattern::kStripes:
      return stripes(material, q);
    case Pattern::kMarble:
      return marble(material, p);
    case Pattern::kText:
      return text(material, q);
    case Pattern::kPicture:
      return picture(material, q);
    case Pattern::kWeave:
      return weave(material, q);
    case Pattern::kDots:
      return dots(material, q);
    case Pattern::kSpine:
      return spine(material, q);
  }
  return material.color_a;
}

}  // namespace lapseam::simulation
