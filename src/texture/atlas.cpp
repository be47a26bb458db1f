// Based on: Y. Sun, C. Dumont, M. Abidi, Mesh-based Integration of Range and Color Images, 2000, §2.4.

#include <algorithm>
#include <numeric>

#include "core/parallel.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "lapseam/texture.h"
#include "texture/charts.h"

namespace lapseam {
namespace {

constexpr int kSmallestPage_px = 64;

struct PageSize {
  int width = 0, height = 0;
};

// Shelf packing, tallest first (Coffman et al. 1980, next-fit decreasing height).
std::vector<PageSize> pack(std::vector<Chart>& charts, int page_size) {
  std::vector<std::uint32_t> order(charts.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return charts[a].height != charts[b].height ? charts[a].height > charts[b].height : a < b;
  });
  std::vector<PageSize> pages;
  int x = 0, shelf_y = 0, shelf_height = 0;
  for (const std::uint32_t i : order) {
    Chart& chart = charts[i];
    if (x + chart.width > page_size) {
      x = 0;
      shelf_y += shelf_height;
      shelf_height = 0;
    }
    if (pages.empty() || shelf_y + chart.height > page_size) {
      pages.push_back({});
      x = shelf_y = shelf_height = 0;
    }
    chart.page = int(pages.size()) - 1;
    chart.x = x;
    chart.y = shelf_y;
    x += chart.width;
    shelf_height = std::max(shelf_height, chart.height);
    pages.back().width = std::max(pages.back().width, x);
    pages.back().height = std::max(pages.back().height, shelf_y + shelf_height);
  }
  return pages;
}

void copy_chart(const Chart& chart, const ColorImage& image, bool is_panorama, ColorImage& page) {
  for (int y = 0; y < chart.height; ++y) {
    const int v = std::clamp(chart.v0 + y, 0, image.height - 1);
    for (int x = 0; x < chart.width; ++x) {
      const int u = chart.u0 + x;
      const int u_in = is_panorama ? (u % image.width + image.width) % image.width : std::clamp(u, 0, image.width - 1);
      page.at(chart.x + x, chart.y + y) = image.at(u_in, v);
    }
  }
}

void set_texcoords(Mesh& mesh, const Charts& charts, const std::vector<PageSize>& pages) {
  mesh.texcoords.assign(mesh.triangle_count(),
                        {Eigen::Vector2f::Zero(), Eigen::Vector2f::Zero(), Eigen::Vector2f::Zero()});
  mesh.triangle_page.assign(mesh.triangle_count(), kInvalidIndex);
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    if (charts.chart_of_triangle[i] == kInvalidIndex) continue;
    const Chart& chart = charts.charts[charts.chart_of_triangle[i]];
    const PageSize& page = pages[std::size_t(chart.page)];
    mesh.triangle_page[i] = std::uint32_t(chart.page);
    for (std::size_t k = 0; k < 3; ++k) {
      // Pixel centres are at integers, texture coordinates measure from the page's edge.
      const float x = charts.source_pixels[i][k].x() - float(chart.u0) + float(chart.x) + 0.5f;
      const float y = charts.source_pixels[i][k].y() - float(chart.v0) + float(chart.y) + 0.5f;
      mesh.texcoords[i][k] = {x / float(page.width), y / float(page.height)};
    }
  }
}

}  // namespace

AtlasReport build_atlas(Mesh& mesh, std::span<const ViewSource> sources, const AtlasOptions& options,
                        Context& context) {
  if (options.page_size < kSmallestPage_px)
    throw InvalidInput({}, {}, "page_size", "must be at least " + std::to_string(kSmallestPage_px));
  Charts charts = make_charts(mesh, sources, options.padding_px, options.page_size, context);
  const std::vector<PageSize> sizes = pack(charts.charts, options.page_size);
  set_texcoords(mesh, charts, sizes);
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i)
    if (charts.view_of_triangle[i] != kInvalidIndex) mesh.triangle_view[i] = charts.view_of_triangle[i];

  AtlasReport report;
  report.charts = charts.charts.size();
  report.pages = sizes.size();
  mesh.pages.clear();
  for (const PageSize& size : sizes) {
    mesh.pages.emplace_back(size.width, size.height);
    report.page_pixels += mesh.pages.back().size();
  }
  report.untextured_triangles =
      std::uint64_t(std::count(charts.chart_of_triangle.begin(), charts.chart_of_triangle.end(), kInvalidIndex));

  std::vector<std::vector<std::uint32_t>> charts_of_view(sources.size());
  for (std::uint32_t c = 0; c < charts.charts.size(); ++c) {
    charts_of_view[charts.charts[c].view].push_back(c);
    report.chart_pixels += std::uint64_t(charts.charts[c].width) * std::uint64_t(charts.charts[c].height);
  }
  StageScope stage(context, "texture", sources.size());
  parallel_for(context, sources.size(), 1, [&](std::size_t i) {
    if (!charts_of_view[i].empty()) {
      const ColorImage image = load_color(sources[i]);
      const bool is_panorama = wraps(sources[i].color->camera);
      for (const std::uint32_t c : charts_of_view[i])
        copy_chart(charts.charts[c], image, is_panorama, mesh.pages[std::size_t(charts.charts[c].page)]);
    }
    stage.advance();
  });
  return report;
}

}  // namespace lapseam
