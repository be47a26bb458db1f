#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "lapseam/io.h"
#include "lapseam/texture.h"
#include "texture/charts.h"

namespace lapseam {
namespace {

constexpr Rgb8 kUnseen{128, 128, 128};

Rgb8 sample_bilinear(const ColorImage& image, const Eigen::Vector2f& pixel) {
  const float u = std::clamp(pixel.x(), 0.0f, float(image.width - 1));
  const float v = std::clamp(pixel.y(), 0.0f, float(image.height - 1));
  const int u0 = int(u), v0 = int(v), u1 = std::min(u0 + 1, image.width - 1), v1 = std::min(v0 + 1, image.height - 1);
  const float fu = u - float(u0), fv = v - float(v0);
  const auto mix = [&](std::uint8_t Rgb8::*channel) {
    const float top = float(image.at(u0, v0).*channel) * (1 - fu) + float(image.at(u1, v0).*channel) * fu;
    const float bottom = float(image.at(u0, v1).*channel) * (1 - fu) + float(image.at(u1, v1).*channel) * fu;
    return std::uint8_t(std::lround(top * (1 - fv) + bottom * fv));
  };
  return {mix(&Rgb8::r), mix(&Rgb8::g), mix(&Rgb8::b)};
}

}  // namespace

void color_vertices(Mesh& mesh, std::span<const ViewSource> sources, Context& context) {
  mesh.colors.assign(mesh.vertex_count(), kUnseen);
  std::vector<std::vector<std::uint32_t>> vertices_of_view(sources.size());
  for (std::uint32_t i = 0; i < mesh.vertex_count(); ++i)
    if (mesh.vertex_view[i] < sources.size()) vertices_of_view[mesh.vertex_view[i]].push_back(i);
  StageScope stage(context, "color", sources.size());
  parallel_for(context, sources.size(), 1, [&](std::size_t i) {
    if (sources[i].color && !vertices_of_view[i].empty()) {
      const ColorImage image = load_color(sources[i]);
      const ColorProjection projection(sources[i], mesh.origin_m);
      Eigen::Vector2f pixel;
      for (const std::uint32_t v : vertices_of_view[i])
        if (projection.project(mesh.positions_m[v], pixel)) mesh.colors[v] = sample_bilinear(image, pixel);
    }
    stage.advance();
  });
}

}  // namespace lapseam
