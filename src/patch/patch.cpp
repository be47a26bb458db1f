#include "lapseam/patch.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "patch/by_view.h"

namespace lapseam {
namespace {

constexpr float kStepsPerOctave = 15, kLowest_per_m = 0.1f;
constexpr float kLowestCosine = 0.05f;  // 87°
constexpr std::size_t kRayRows = 16;

}  // namespace

std::uint8_t confidence_code(float per_m) {
  const float steps = kStepsPerOctave * std::log2(per_m / kLowest_per_m);
  return std::uint8_t(std::clamp(std::lround(steps), 1l, 255l));
}

float confidence_per_m(std::uint8_t code) {
  return code == 0 ? 0.0f : kLowest_per_m * std::exp2(float(code) / kStepsPerOctave);
}

std::shared_ptr<RayTable> make_ray_table(const Sensor& sensor, Context& context) {
  auto table = std::make_shared<RayTable>();
  table->width = width(sensor);
  table->height = height(sensor);
  const std::size_t n = std::size_t(table->width) * std::size_t(table->height);
  table->directions.resize(n);
  const bool has_one_origin = is_central(sensor);
  if (!has_one_origin) table->origins.resize(n);
  std::visit(
      [&](const auto& s) {
        parallel_for(context, std::size_t(table->height), kRayRows, [&](std::size_t v) {
          std::size_t i = v * std::size_t(table->width);
          for (int u = 0; u < table->width; ++u, ++i) {
            const Eigen::Vector3d at_one = s.unproject(u, double(v), 1.0);
            if (has_one_origin) {
              table->directions[i] = at_one.cast<float>();
            } else {
              const Eigen::Vector3d slope = s.unproject(u, double(v), 2.0) - at_one;
              table->directions[i] = slope.cast<float>();
              table->origins[i] = (at_one - slope).cast<float>();
            }
          }
        });
      },
      sensor);
  return table;
}

std::array<std::uint32_t, 3> PatchGrid::corners(std::size_t cell, int slot) const {
  const auto p00 = std::uint32_t(cell);
  const std::uint32_t u = p00 % std::uint32_t(width);
  const std::uint32_t p10 = u + 1 < std::uint32_t(width) ? p00 + 1 : p00 - u;
  const std::uint32_t p01 = p00 + std::uint32_t(width), p11 = p10 + std::uint32_t(width);
  std::array<std::uint32_t, 3> c;
  if (cells[cell] & kAntiDiagonal)
    c = slot == 0 ? std::array{p00, p01, p10} : std::array{p10, p01, p11};
  else
    c = slot == 0 ? std::array{p00, p01, p11} : std::array{p00, p11, p10};
  if (is_mirrored) std::swap(c[1], c[2]);
  return c;
}

std::size_t PatchGrid::triangle_count() const {
  std::size_t count = 0;
  for (const std::uint8_t cell : cells) count += std::size_t((cell >> 1) & 1) + std::size_t((cell >> 2) & 1);
  return count;
}

float expected_error_m(const Patch& patch, std::size_t pixel) {
  const float cosine = std::max(kLowestCosine, float(patch.incidence.pixels[pixel]) / 255);
  return patch.sigma_across(pixel, cosine);
}

std::vector<float> expected_errors(const Mesh& mesh, std::span<const Patch> patches) {
  std::vector<float> errors(mesh.vertex_count());
  const VerticesByView vertices(mesh, patches.size());
  for (std::size_t i = 0; i < patches.size(); ++i) {
    for (const std::uint32_t v : vertices.of(i)) errors[v] = expected_error_m(patches[i], mesh.vertex_pixel[v]);
    relieve(patches[i]);
  }
  return errors;
}

}  // namespace lapseam
