#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "lapseam/texture.h"

namespace lapseam {
namespace {

const Eigen::Vector3f kNothingAround(128, 128, 128);
// Rounds of averaging that make what was carried inwards smooth.
constexpr int kRounds = 60;

Eigen::Vector3f sample_page(const ColorImage& page, const Eigen::Vector2f& uv) {
  const float x = std::clamp(uv.x() * float(page.width) - 0.5f, 0.0f, float(page.width - 1));
  const float y = std::clamp(uv.y() * float(page.height) - 0.5f, 0.0f, float(page.height - 1));
  const int x0 = int(x), y0 = int(y), x1 = std::min(x0 + 1, page.width - 1), y1 = std::min(y0 + 1, page.height - 1);
  const float fx = x - float(x0), fy = y - float(y0);
  const auto at = [&](int u, int v) {
    const Rgb8 c = page.at(u, v);
    return Eigen::Vector3f(float(c.r), float(c.g), float(c.b));
  };
  return (1 - fy) * ((1 - fx) * at(x0, y0) + fx * at(x1, y0)) + fy * ((1 - fx) * at(x0, y1) + fx * at(x1, y1));
}

/// For each of some vertices, those that it shares an edge with.
struct Neighbours {
  std::vector<std::uint32_t> vertices;
  std::vector<std::vector<std::uint32_t>> around;
};

Neighbours neighbours_of(const Mesh& mesh, const std::vector<std::uint8_t>& is_wanted) {
  Neighbours out;
  std::vector<std::uint32_t> number(mesh.vertex_count(), kInvalidIndex);
  for (std::uint32_t v = 0; v < mesh.vertex_count(); ++v)
    if (is_wanted[v]) {
      number[v] = std::uint32_t(out.vertices.size());
      out.vertices.push_back(v);
    }
  out.around.resize(out.vertices.size());
  for (const Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k)
      if (number[t[k]] != kInvalidIndex)
        for (const std::size_t other : {(k + 1) % 3, (k + 2) % 3}) out.around[number[t[k]]].push_back(t[other]);
  return out;
}

/// Carries known colours to vertices without, nearest first, then smooths these.
void spread_colors(const Mesh& mesh, std::vector<Eigen::Vector3f>& color, std::vector<std::uint8_t>& is_known) {
  std::vector<std::uint8_t> is_wanted(is_known.size());
  std::transform(is_known.begin(), is_known.end(), is_wanted.begin(), [](std::uint8_t k) { return std::uint8_t(!k); });
  const Neighbours graph = neighbours_of(mesh, is_wanted);
  const auto mean_around = [&](std::size_t i, Eigen::Vector3f& mean) {
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    float count = 0;
    for (const std::uint32_t other : graph.around[i])
      if (is_known[other]) sum += color[other], ++count;
    if (count > 0) mean = sum / count;
    return count > 0;
  };
  for (bool is_growing = true; is_growing;) {
    std::vector<std::pair<std::uint32_t, Eigen::Vector3f>> reached;
    Eigen::Vector3f mean;
    for (std::size_t i = 0; i < graph.vertices.size(); ++i)
      if (!is_known[graph.vertices[i]] && mean_around(i, mean)) reached.emplace_back(graph.vertices[i], mean);
    for (const auto& [vertex, value] : reached) color[vertex] = value, is_known[vertex] = 1;
    is_growing = !reached.empty();
  }
  for (int round = 0; round < kRounds; ++round)
    for (std::size_t i = 0; i < graph.vertices.size(); ++i)
      if (is_known[graph.vertices[i]]) mean_around(i, color[graph.vertices[i]]);
}

}  // namespace

std::vector<Rgb8> vertex_colors(const Mesh& mesh, Context& context) {
  std::vector<Eigen::Vector3f> color(mesh.vertex_count(), Eigen::Vector3f::Zero());
  std::vector<float> corners(mesh.vertex_count(), 0);
  for (std::size_t i = 0; i < mesh.triangle_page.size(); ++i) {
    if (mesh.triangle_page[i] == kInvalidIndex) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      color[mesh.triangles[i][k]] += sample_page(mesh.pages[mesh.triangle_page[i]], mesh.texcoords[i][k]);
      ++corners[mesh.triangles[i][k]];
    }
  }
  std::vector<std::uint8_t> is_known(mesh.vertex_count());
  for (std::size_t v = 0; v < is_known.size(); ++v)
    if (corners[v] > 0)
      color[v] /= corners[v], is_known[v] = 1;
    else if (!mesh.colors.empty())
      color[v] = Eigen::Vector3f(mesh.colors[v].r, mesh.colors[v].g, mesh.colors[v].b), is_known[v] = 1;
  context.throw_if_cancelled();
  spread_colors(mesh, color, is_known);
  std::vector<Rgb8> colors(mesh.vertex_count());
  const auto channel = [](float x) { return std::uint8_t(std::clamp(x, 0.0f, 255.0f) + 0.5f); };
  for (std::size_t v = 0; v < colors.size(); ++v) {
    const Eigen::Vector3f& c = is_known[v] ? color[v] : kNothingAround;
    colors[v] = {channel(c.x()), channel(c.y()), channel(c.z())};
  }
  return colors;
}

void color_vertices(Mesh& mesh, Context& context) { mesh.colors = vertex_colors(mesh, context); }

}  // namespace lapseam
