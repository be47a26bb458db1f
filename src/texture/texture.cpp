// Based on: Y. Sun, C. Dumont, M. Abidi, Mesh-based Integration of Range and Color Images, 2000, §2.4.

#include "lapseam/texture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include "core/parallel.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "texture/align_images.h"
#include "texture/candidates.h"
#include "texture/charts.h"
#include "texture/choose_frames.h"
#include "texture/choose_images.h"
#include "texture/equalize.h"
#include "texture/foreign_colors.h"
#include "texture/layout.h"
#include "texture/level.h"
#include "texture/packing.h"
#include "texture/painting.h"
#include "texture/shared_edges.h"
#include "texture/smooth_outlines.h"
#include "texture/squeeze_outlines.h"
#include "texture/stretch.h"

namespace lapseam {
namespace {

constexpr int kSmallestPage_px = 64;

void check_options(const TextureOptions& options) {
  if (options.page_size < kSmallestPage_px)
    throw InvalidInput({}, {}, "page_size", "must be at least " + std::to_string(kSmallestPage_px));
  if (!(std::isfinite(options.texel_m) && options.texel_m >= 0))
    throw InvalidInput({}, {}, "texel_m", "must be a length");
}

/// Views with several images, again for each further one, behind all views: places of views stay what they are.
std::vector<ViewSource> one_for_each_image(std::span<const ViewSource> sources) {
  std::vector<ViewSource> all(sources.begin(), sources.end());
  for (const ViewSource& source : sources) {
    if (!source.color) continue;  // held out
    for (const ColorSource& color : source.more_colors) {
      ViewSource& view = all.emplace_back(source);
      view.color = color;
      view.more_colors.clear();
    }
  }
  return all;
}

class Texturing {
 public:
  Texturing(Mesh& mesh, std::span<const ViewSource> sources, const TextureOptions& options, Context& context)
      : mesh_(mesh),
        sources_(sources),
        options_(options),
        context_(context),
        cameras_(make_color_cameras(sources, mesh.origin_m)),
        page_blocks_(options.page_size / kBlock_px) {}

  TextureReport run() {
    look();
    equalize_views();
    align();
    choose();
    pack();
    paint();
    finish();
    return report_;
  }

 private:
  void look() {
    StageScope stage(context_, "texture: look", sources_.size());
    scene_.emplace(mesh_.positions_m, mesh_.triangles, context_);
    const auto pixels_of = [&](std::size_t i) {
      return cameras_[i] ? std::uint64_t(cameras_[i]->width()) * std::uint64_t(cameras_[i]->height()) : 0;
    };
    std::uint64_t all = 0;
    for (std::size_t i = 0; i < sources_.size(); ++i) all += pixels_of(i);
    depths_.resize(sources_.size());
    parallel_for(context_, sources_.size(), 1, [&](std::size_t i) {
      if (cameras_[i]) {
        depths_[i] = render_depth(*cameras_[i], *scene_, choose_stride(pixels_of(i), all));
        mark_fringes(depths_[i], cameras_[i]->wraps(), expected_displacement_px(i));
      }
      stage.advance();
    });
  }

  void equalize_views() {
    responses_.resize(sources_.size());
    blur_.assign(sources_.size(), 0);
    if (!options_.equalize) return;
    Equalization found = equalize(mesh_, sources_, cameras_, depths_, context_);
    responses_ = std::move(found.of_view);
    blur_ = std::move(found.blur);
    report_.observations = found.observations;
    report_.color_residual_before = found.residual_before;
    report_.color_residual_after = found.residual_after;
    for (std::size_t i = 0; i < sources_.size(); ++i) {
      if (!cameras_[i]) continue;
      const double gain = double(std::exp(responses_[i].gain.mean()));
      report_.lowest_gain = std::min(report_.lowest_gain, gain);
      report_.highest_gain = std::max(report_.highest_gain, gain);
    }
  }

  /// Fringes are then as wide as colours are seen to be displaced, where that is less than what was expected.
  void align() {
    if (!(options_.registration_error_m > 0)) {
      scene_.reset();
      return;
    }
    const Alignment found =
        align_images(mesh_, sources_, cameras_, depths_, responses_, options_.registration_error_m, context_);
    report_.displacement_before_px = found.before_px;
    report_.displacement_after_px = found.after_px;
    report_.bent_images = found.bent;
    parallel_for(context_, sources_.size(), 1, [&](std::size_t i) {
      if (!cameras_[i] || (!found.is_aligned && !(found.displacement_px[i] > 0))) return;
      if (found.is_aligned) depths_[i] = render_depth(*cameras_[i], *scene_, depths_[i].stride);
      const double expected_px = expected_displacement_px(i), found_px = double(found.displacement_px[i]);
      mark_fringes(depths_[i], cameras_[i]->wraps(), found_px > 0 ? std::min(found_px, expected_px) : expected_px);
    });
    const double error_m = options_.registration_error_m;
    if (error_m > 0)  // else images need not be decoded for it
      parallel_for(context_, sources_.size(), 1, [&](std::size_t i) {
        if (cameras_[i]) mark_foreign_colors(load_color(sources_[i]), cameras_[i]->wraps(), error_m, depths_[i]);
      });
    scene_.reset();
    // Better than what equalize finds: images are compared with what all show together, so noise is no detail.
    if (found.is_aligned && options_.equalize) {
      float sharpest = -std::numeric_limits<float>::infinity();
      for (const float sharpness : found.sharpness)
        if (!std::isnan(sharpness)) sharpest = std::max(sharpest, sharpness);
      for (std::size_t i = 0; i < blur_.size(); ++i)
        if (!std::isnan(found.sharpness[i])) blur_[i] = sharpest - found.sharpness[i];
    }
  }

  double expected_displacement_px(std::size_t view) const {
    return options_.registration_error_m / double(depths_[view].pixel_m);
  }

  void choose() {
    StageScope stage(context_, "texture: choose");
    edges_ = find_shared_edges(mesh_, context_);
    Cells cells = make_cells(mesh_, edges_);
    if (!options_.choose) cells = take_apart(cells, std::vector<std::uint8_t>(cells.count(), 1));
    Candidates candidates = find_candidates(mesh_, cells, cameras_, depths_, blur_, context_);
    // Where no image shows all of a cell, or only one from far away, through a gap of the model perhaps, others may
    // show its triangles.
    constexpr float kMostHidden = 0.02f, kCoarser = 1.5f;
    std::vector<std::uint8_t> is_unseen(cells.count());
    for (std::size_t c = 0; c < cells.count(); ++c)
      is_unseen[c] = cells.of(c).size() > 1 && (candidates.hidden[c] > kMostHidden ||
                                                candidates.largest_px[c] > kCoarser * candidates.density_px[c]);
    if (options_.choose && std::find(is_unseen.begin(), is_unseen.end(), 1) != is_unseen.end()) {
      cells = take_apart(cells, is_unseen);
      candidates = find_candidates(mesh_, cells, cameras_, depths_, blur_, context_);
    }
    std::vector<std::uint32_t> view_of_cell;
    if (options_.choose) {
      sample_colors(mesh_, cells, sources_, cameras_, responses_, candidates, context_);
      view_of_cell = choose_images(mesh_, cells, candidates, edges_, context_);
    } else {
      view_of_cell = measured_images(cells, candidates);
    }
    view_.resize(mesh_.triangle_count());
    for (std::size_t c = 0; c < cells.count(); ++c)
      for (const std::uint32_t i : cells.of(c)) view_[i] = view_of_cell[c];
    lay_out(cells);
    for (std::size_t i = 0; i < view_.size(); ++i) {
      report_.unseen_triangles += view_[i] == kInvalidIndex;
      report_.retaken_triangles +=
          view_[i] != kInvalidIndex && !mesh_.triangle_view.empty() && view_[i] != mesh_.triangle_view[i];
    }
  }

  void lay_out(const Cells& cells) {
    const bool is_joined = options_.choose && sources_.size() <= kMostParts;
    layout_ = project_frames(mesh_, cameras_, view_, is_joined ? frames_of(cells) : view_, context_);
    if (!is_joined) return;
    smooth_outlines(mesh_, edges_, cameras_, view_, layout_, context_);
    cut_sheets(layout_, page_blocks_, context_);
    smooth_outlines(mesh_, edges_, cameras_, view_, layout_, context_);  // those of cuts too
    squeeze_outlines(mesh_, cameras_, view_, layout_, context_);
  }

  /// As whose image each triangle is laid out. Cells at borders are taken apart: as triangles they make smoother ones.
  std::vector<std::uint32_t> frames_of(const Cells& cells) const {
    const std::vector<std::uint32_t> cell = cell_of_triangles(cells);
    std::vector<std::uint8_t> is_at_border(cells.count(), 0);
    for (const SharedEdge& edge : edges_)
      if (view_[edge.a] != view_[edge.b]) is_at_border[cell[edge.a]] = is_at_border[cell[edge.b]] = 1;
    const Cells finer = take_apart(cells, is_at_border);
    std::vector<std::uint32_t> view_of_cell(finer.count());
    for (std::size_t c = 0; c < finer.count(); ++c) view_of_cell[c] = view_[finer.of(c).front()];
    const std::vector<std::uint32_t> frame_of_cell =
        choose_frames(mesh_, finer, edges_, cameras_, view_of_cell, context_);
    std::vector<std::uint32_t> frame(view_);
    for (std::size_t c = 0; c < finer.count(); ++c)
      for (const std::uint32_t i : finer.of(c)) frame[i] = frame_of_cell[c];
    return frame;
  }

  /// The image that a triangle was measured with, or the best where that one does not show it. cells: single triangles.
  std::vector<std::uint32_t> measured_images(const Cells& cells, const Candidates& candidates) const {
    std::vector<std::uint32_t> view(cells.count(), kInvalidIndex);
    for (std::size_t c = 0; c < view.size(); ++c) {
      float lowest = 3e38f;
      for (const Candidate& candidate : candidates.of(c)) {
        const bool is_measured =
            !mesh_.triangle_view.empty() && candidate.view == mesh_.triangle_view[cells.of(c).front()];
        if (!is_measured && candidate.cost >= lowest) continue;
        view[c] = candidate.view;
        lowest = is_measured ? -1 : candidate.cost;
      }
    }
    return view;
  }

  // ---- the atlas

  struct RegionSize {
    double area_px = 0, area_m2 = 0;
    float extent_px = 0;  // of its largest triangle
  };

  void measure_triangle(std::size_t i, RegionSize& size) const {
    const Triangle& t = mesh_.triangles[i];
    const Corners& p = layout_.pixels[i];
    const Eigen::Vector2f ab = p[1] - p[0], ac = p[2] - p[0];
    size.area_px += double(std::abs(ab.x() * ac.y() - ab.y() * ac.x()));
    size.area_m2 += double((mesh_.positions_m[t[1]] - mesh_.positions_m[t[0]])
                               .cross(mesh_.positions_m[t[2]] - mesh_.positions_m[t[0]])
                               .norm());
    const Eigen::Vector2f extent = p[0].cwiseMax(p[1]).cwiseMax(p[2]) - p[0].cwiseMin(p[1]).cwiseMin(p[2]);
    size.extent_px = std::max(size.extent_px, extent.maxCoeff());
  }

  /// Of each region, how much smaller its image must be for the limits; 1 for most.
  std::vector<float> find_scales(const std::vector<std::uint32_t>& root, const std::vector<RegionSize>& size) const {
    // Where charts are cut, their triangles' middles lie within half a page, and their corners up to two thirds of
    // their extent from these on either side, with the padding and the blocks' alignment: all that fits on a page.
    const float most_px = 0.375f * float(page_blocks_ * kBlock_px) - 2 * float(kBlock_px);
    std::vector<float> scale(root.size(), 1);
    for (std::size_t i = 0; i < root.size(); ++i) {
      if (root[i] == kInvalidIndex) continue;
      const RegionSize& region = size[root[i]];
      double most = double(std::min(1.0f, most_px / std::max(region.extent_px, 1e-6f)));
      if (options_.texel_m > 0 && region.area_px > 0)
        most = std::min(most, std::sqrt(region.area_m2 / region.area_px) / options_.texel_m);
      most *= report_.scale;
      // Few different scales, so that regions of one image can share charts.
      scale[i] = most < 1 ? float(std::exp2(std::floor(4 * std::log2(most)) / 4)) : 1;
    }
    return scale;
  }

  void pack() {
    StageScope stage(context_, "texture: pack");
    const std::vector<std::uint32_t> root = find_regions(edges_, layout_.sheet);
    std::vector<RegionSize> size(root.size());
    for (std::size_t i = 0; i < root.size(); ++i)
      if (root[i] != kInvalidIndex) measure_triangle(i, size[root[i]]);
    constexpr int kMostTries = 12;
    for (int attempt = 0;; ++attempt) {
      const std::vector<float> scales = find_scales(root, size);
      charts_ = make_charts(layout_, view_, scales, {}, page_blocks_, context_);
      const std::vector<std::uint8_t> is_scattered = find_scattered(charts_, root);
      if (std::find(is_scattered.begin(), is_scattered.end(), 1) != is_scattered.end())
        charts_ = make_charts(layout_, view_, scales, is_scattered, page_blocks_, context_);
      const bool is_limited = options_.memory_bytes > 0;
      const std::uint64_t bytes = pack_charts(!is_limited);
      if (is_limited && bytes <= options_.memory_bytes) pack_charts(true);
      if (!is_limited || bytes <= options_.memory_bytes) break;
      if (attempt == kMostTries)
        throw InvalidInput({}, {}, "texture memory",
                           "the smallest pages that hold the texture take " + std::to_string(bytes) + " bytes");
      report_.scale *= std::min(0.84, std::sqrt(double(options_.memory_bytes) / double(bytes)));
    }
  }

  /// The best of some widths about the given one: how ragged the last rows are is chance. When it is final, the better
  /// ones are worked on.
  Packing pack_tightly(const std::vector<BlockShape>& shapes, int width, int widest, bool is_final) {
    constexpr std::size_t kTightened = 2;
    constexpr std::array<int, 6> kPercent = {100, 97, 94, 103, 106, 109};
    std::array<Packing, kPercent.size()> tries;
    parallel_for(context_, tries.size(), 1, [&](std::size_t k) {
      const int tried = std::clamp(width * kPercent[k] / 100, widest, page_blocks_);
      if (k == 0 || tried != width) tries[k] = pack_blocks(shapes, tried, page_blocks_, context_);
    });
    const auto area = [](const Packing& packing) {
      std::uint64_t sum = 0;
      for (const BlockPage& page : packing.pages) sum += std::uint64_t(page.width) * std::uint64_t(page.height);
      return sum;
    };
    std::vector<Packing*> order;
    for (Packing& packing : tries)
      if (!packing.pages.empty()) order.push_back(&packing);
    const auto is_smaller = [&](const Packing* a, const Packing* b) { return area(*a) < area(*b); };
    std::stable_sort(order.begin(), order.end(), is_smaller);
    if (is_final) {
      order.resize(std::min(order.size(), kTightened));
      parallel_for(context_, order.size(), 1, [&](std::size_t k) { tighten(shapes, *order[k], context_); });
      std::stable_sort(order.begin(), order.end(), is_smaller);
    }
    return std::move(*order.front());
  }

  static std::uint64_t owned_blocks(const Chart& chart) {
    return std::uint64_t(std::count(chart.shape.used.begin(), chart.shape.used.end(), 1));
  }

  /// Scattered charts go to pages of their own, which are painted like the others; in the end their vertices get the
  /// colours, and the pages are dropped.
  std::uint64_t pack_charts(bool is_final) {
    std::vector<std::uint32_t> kept, dropped;
    for (std::uint32_t c = 0; c < charts_.charts.size(); ++c)
      (charts_.charts[c].is_scattered ? dropped : kept).push_back(c);
    page_sizes_.clear();
    report_.charts = kept.size();
    report_.chart_pixels = kBlock_px * kBlock_px * pack_some(kept, is_final);
    report_.page_pixels = 0;
    for (const BlockPage& page : page_sizes_)
      report_.page_pixels += std::uint64_t(page.width) * std::uint64_t(page.height) * kBlock_px * kBlock_px;
    report_.pages = page_sizes_.size();
    pack_some(dropped, false);
    return 3 * report_.page_pixels;
  }

  /// Onto pages after those that are there. The number of blocks.
  std::uint64_t pack_some(const std::vector<std::uint32_t>& some, bool is_final) {
    if (some.empty()) return 0;
    std::vector<BlockShape> shapes;
    std::uint64_t blocks = 0;
    int widest = 1;
    for (const std::uint32_t c : some) {
      const Chart& chart = charts_.charts[c];
      shapes.push_back(chart.shape);
      widest = std::max(widest, chart.shape.width);
      blocks += owned_blocks(chart);
    }
    // What fits on one page makes a square one.
    const int square = int(std::ceil(std::sqrt(1.05 * double(blocks))));
    const Packing packing = pack_tightly(shapes, std::min(page_blocks_, std::max(widest, square)), widest, is_final);
    for (std::size_t k = 0; k < some.size(); ++k) {
      BlockPlace& place = charts_.charts[some[k]].place;
      place = packing.places[k];
      place.page += int(page_sizes_.size());
    }
    page_sizes_.insert(page_sizes_.end(), packing.pages.begin(), packing.pages.end());
    return blocks;
  }

  void paint() {
    mesh_.pages.clear();
    for (const BlockPage& page : page_sizes_) {
      mesh_.pages.emplace_back(page.width * kBlock_px, page.height * kBlock_px);
      map_.emplace_back(page.width * kBlock_px, page.height * kBlock_px);
    }
    StageScope stage(context_, "texture: paint", sources_.size());
    levelling_ = std::make_unique<Levelling>(mesh_, charts_, edges_);
    parallel_for(context_, charts_.charts.size(), 1, [&](std::size_t c) {
      const Chart& chart = charts_.charts[c];
      mark_parts(charts_, chart, map_[std::size_t(chart.place.page)]);
    });
    std::vector<std::vector<std::uint32_t>> triangles_of_view(sources_.size());
    for (std::uint32_t i = 0; i < mesh_.triangle_count(); ++i)
      if (charts_.chart_of_triangle[i] != kInvalidIndex) triangles_of_view[view_[i]].push_back(i);
    parallel_for(context_, sources_.size(), 1, [&](std::size_t view) {
      if (!triangles_of_view[view].empty()) paint_from(view, triangles_of_view[view]);
      triangles_of_view[view] = {};
      stage.advance();
    });
    std::vector<std::uint64_t> replaced(charts_.charts.size());
    parallel_for(context_, charts_.charts.size(), 1, [&](std::size_t c) {
      const Chart& chart = charts_.charts[c];
      const auto page = std::size_t(chart.place.page);
      replaced[c] = fill_unused(chart, depths_[chart.view].fringe_px, map_[page], mesh_.pages[page]);
    });
    for (std::size_t c = 0; c < replaced.size(); ++c)
      if (!charts_.charts[c].is_scattered) report_.fringe_pixels += replaced[c];
    for (std::size_t page = 0; page < report_.pages; ++page)
      report_.used_pixels += std::uint64_t(std::count_if(map_[page].pixels.begin(), map_[page].pixels.end(), is_used));
  }

  void paint_from(std::size_t view, const std::vector<std::uint32_t>& triangles) {
    const ColorImage image = load_color(sources_[view]);
    const Photograph photograph{image, *cameras_[view], responses_[view], depths_[view]};
    // What slivers lie over has the last word.
    for (const bool are_slender : {true, false})
      for (const std::uint32_t i : triangles) {
        if (is_slender(charts_.pixels[i]) != are_slender) continue;
        const auto page = std::size_t(charts_.charts[charts_.chart_of_triangle[i]].place.page);
        paint_triangle(mesh_, charts_, i, photograph, map_[page], mesh_.pages[page]);
      }
    levelling_->look(std::uint32_t(view), photograph);
  }

  void finish() {
    StageScope stage(context_, "texture: level");
    levelling_->solve(mesh_.pages, map_, context_);
    if (options_.level)
      parallel_for(context_, charts_.charts.size(), 1, [&](std::size_t c) {
        const Chart& chart = charts_.charts[c];
        correct_chart(chart, levelling_->correction_of(std::uint32_t(c)), mesh_.pages[std::size_t(chart.place.page)]);
      });
    report_steps();
    levelling_.reset();
    map_.clear();
    set_texcoords();
    mesh_.colors.clear();
    if (report_.unseen_triangles > 0 || mesh_.pages.size() > report_.pages) color_vertices(mesh_, context_);
    drop_pages();
    // Where a vertex is on a page too, that is the colour beside it.
    if (report_.vertex_colored_triangles > 0) color_vertices(mesh_, context_);
  }

  /// Where nothing is levelled, steps stay as they are.
  void report_steps() {
    const Levelling::Steps before = levelling_->steps_before(), inner_before = levelling_->inner_steps_before();
    const Levelling::Steps after = options_.level ? levelling_->steps_after() : before;
    const Levelling::Steps inner_after = options_.level ? levelling_->inner_steps_after() : inner_before;
    report_.step_before = before.median;
    report_.step_before_p95 = before.p95;
    report_.step_after = after.median;
    report_.step_after_p95 = after.p95;
    report_.inner_step_before = inner_before.median;
    report_.inner_step_before_p95 = inner_before.p95;
    report_.inner_step_after = inner_after.median;
    report_.inner_step_after_p95 = inner_after.p95;
  }

  /// Those of charts whose vertices have their colours now.
  void drop_pages() {
    mesh_.is_unseen.assign(mesh_.triangle_count(), 0);
    for (std::size_t i = 0; i < mesh_.triangle_count(); ++i) {
      if (mesh_.triangle_page[i] == kInvalidIndex) {
        mesh_.is_unseen[i] = 1;
      } else if (mesh_.triangle_page[i] >= report_.pages) {
        mesh_.triangle_page[i] = kInvalidIndex;
        mesh_.texcoords[i] = {Eigen::Vector2f::Zero(), Eigen::Vector2f::Zero(), Eigen::Vector2f::Zero()};
        ++report_.vertex_colored_triangles;
      }
    }
    mesh_.pages.resize(std::size_t(report_.pages));
  }

  void set_texcoords() {
    mesh_.texcoords = std::move(charts_.pixels);
    mesh_.triangle_page.assign(mesh_.triangle_count(), kInvalidIndex);
    for (std::size_t i = 0; i < mesh_.triangle_count(); ++i) {
      const std::uint32_t c = charts_.chart_of_triangle[i];
      if (c == kInvalidIndex) {
        mesh_.texcoords[i] = {Eigen::Vector2f::Zero(), Eigen::Vector2f::Zero(), Eigen::Vector2f::Zero()};
        continue;
      }
      const Chart& chart = charts_.charts[c];
      const ColorImage& page = mesh_.pages[std::size_t(chart.place.page)];
      mesh_.triangle_page[i] = std::uint32_t(chart.place.page);
      for (Eigen::Vector2f& p : mesh_.texcoords[i]) {
        const auto [x, y] = chart.on_page(p.x(), p.y());
        // Pixel centres are at integers, texture coordinates measure from the page's edge.
        p = {(x + 0.5f) / float(page.width), (y + 0.5f) / float(page.height)};
      }
    }
  }

  Mesh& mesh_;
  std::span<const ViewSource> sources_;
  const TextureOptions& options_;
  Context& context_;
  ColorCameras cameras_;
  const int page_blocks_;
  TextureReport report_;
  std::optional<RayScene> scene_;
  std::vector<DepthImage> depths_;
  std::vector<ColorResponse> responses_;
  std::vector<float> blur_;
  std::vector<SharedEdge> edges_;
  std::vector<std::uint32_t> view_;  // that shows each triangle
  Layout layout_;
  Charts charts_;
  std::vector<BlockPage> page_sizes_;
  std::vector<PartMap> map_;
  std::unique_ptr<Levelling> levelling_;
};

}  // namespace

TextureReport texture(Mesh& mesh, std::span<const ViewSource> sources, const TextureOptions& options,
                      Context& context) {
  check_options(options);
  const std::vector<ViewSource> all = one_for_each_image(sources);
  return Texturing(mesh, all, options, context).run();
}

}  // namespace lapseam
