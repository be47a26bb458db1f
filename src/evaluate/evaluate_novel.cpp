#include "lapseam/evaluate_novel.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "evaluate/finite_or_null.h"
#include "evaluate/image_difference.h"
#include "evaluate/table.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "lapseam/render.h"

namespace lapseam {
namespace {

using Json = nlohmann::ordered_json;

// Rays per pixel, squared: a camera's pixel averages over its area.
constexpr int kSamplesPerSide = 3;

NovelViewFigures compare_with_image(const Renderer& renderer, const ViewSource& source, const RenderOptions& options,
                                    Context& context) {
  const RenderCamera camera{source.color->camera, source.T_world_view * source.color->T_view_color};
  const CoveredPicture picture = renderer.render_covered(camera, options, context);
  Image<std::uint8_t> mask(picture.image.width, picture.image.height);
  for (std::size_t i = 0; i < mask.size(); ++i) mask.pixels[i] = picture.coverage.pixels[i] >= 1;
  const ImageDifference difference = compare_images(picture.image, load_color(source), mask);
  NovelViewFigures figures;
  figures.view = source.name;
  figures.pixels = difference.pixels;
  figures.covered_share = double(difference.pixels) / double(mask.size());
  figures.gain = difference.gain;
  figures.psnr_db = difference.psnr_db;
  figures.ssim = difference.ssim;
  return figures;
}

void summarize(NovelEvaluation& out) {
  double views = 0, windows = 0;
  for (const NovelViewFigures& view : out.views) {
    if (view.pixels == 0) continue;
    out.lowest_psnr_db = views > 0 ? std::min(out.lowest_psnr_db, view.psnr_db) : view.psnr_db;
    out.highest_psnr_db = views > 0 ? std::max(out.highest_psnr_db, view.psnr_db) : view.psnr_db;
    out.mean_psnr_db += view.psnr_db;
    out.mean_covered_share += view.covered_share;
    ++views;
    if (std::isnan(view.ssim)) continue;
    out.mean_ssim += view.ssim;
    ++windows;
  }
  if (views > 0) out.mean_psnr_db /= views, out.mean_covered_share /= views;
  if (windows > 0) out.mean_ssim /= windows;
}

}  // namespace

NovelEvaluation evaluate_novel(const Mesh& model, std::span<const ViewSource> views, Context& context) {
  const auto has_color = [](const ViewSource& view) { return view.color.has_value(); };
  const auto count = std::count_if(views.begin(), views.end(), has_color);
  if (count == 0) throw InvalidInput({}, {}, "views", "none has a colour image to compare with");
  const bool is_textured = !model.triangle_page.empty() && !model.pages.empty();
  if (!is_textured && model.colors.empty()) throw InvalidInput({}, {}, "texture", "the mesh has no colours");
  NovelEvaluation out;
  const Renderer renderer(model, context);
  const RenderOptions options{.mode = is_textured ? RenderMode::kTextured : RenderMode::kColors,
                              .samples_per_side = kSamplesPerSide};
  StageScope stage(context, "evaluate novel views", std::uint64_t(count));
  for (const ViewSource& view : views) {
    if (!has_color(view)) continue;
    out.views.push_back(compare_with_image(renderer, view, options, context));
    stage.advance();
  }
  summarize(out);
  out.steps = measure_color_steps(model, context);
  return out;
}

std::string to_text(const NovelEvaluation& evaluation) {
  Table table;
  table.head("novel views (pictures of the model against images, after one gain each)");
  table.text(fmt::format("  {:<24}{:>10}{:>10}{:>12}{:>10}\n", "view", "PSNR dB", "SSIM", "covered %", "gain"));
  for (const NovelViewFigures& view : evaluation.views)
    table.text(fmt::format("  {:<24}{:>10.2f}{:>10.4f}{:>12.2f}{:>10.4f}\n", view.view, view.psnr_db, view.ssim,
                           100 * view.covered_share, view.gain));
  table.text(fmt::format("  {:<24}{:>10.2f}{:>10.4f}{:>12.2f}\n", "mean", evaluation.mean_psnr_db, evaluation.mean_ssim,
                         100 * evaluation.mean_covered_share));
  table.head("colour steps where the texture is cut (levels of 255)");
  const ColorStepFigures& steps = evaluation.steps;
  table.metres("length of cuts", steps.length_m);
  table.count("samples", steps.samples);
  if (steps.samples > 0) {
    table.line("step, median", fmt::format("{:.2f}", steps.median));
    table.line("step, 95 %", fmt::format("{:.2f}", steps.p95));
  }
  if (steps.vertex_color_samples > 0)
    table.line("to vertex colours, median and 95 %",
               fmt::format("{:.2f}  {:.2f}", steps.vertex_color_median, steps.vertex_color_p95));
  return table.take();
}

std::string to_json(const NovelEvaluation& evaluation) {
  const ColorStepFigures& steps = evaluation.steps;
  const auto step = [&](double x) { return steps.samples > 0 ? Json(x) : Json(nullptr); };
  Json json = {{"mean_psnr_db", finite_or_null(evaluation.mean_psnr_db)},
               {"lowest_psnr_db", finite_or_null(evaluation.lowest_psnr_db)},
               {"highest_psnr_db", finite_or_null(evaluation.highest_psnr_db)},
               {"mean_ssim", evaluation.mean_ssim},
               {"mean_covered_percent", 100 * evaluation.mean_covered_share}};
  json["steps"] = {
      {"length_m", steps.length_m},
      {"edges", steps.edges},
      {"samples", steps.samples},
      {"median", step(steps.median)},
      {"p95", step(steps.p95)},
      {"vertex_color_samples", steps.vertex_color_samples},
      {"vertex_color_median", steps.vertex_color_samples > 0 ? Json(steps.vertex_color_median) : Json(nullptr)},
      {"vertex_color_p95", steps.vertex_color_samples > 0 ? Json(steps.vertex_color_p95) : Json(nullptr)}};
  json["views"] = Json::array();
  for (const NovelViewFigures& view : evaluation.views)
    json["views"].push_back({{"view", view.view},
                             {"psnr_db", finite_or_null(view.psnr_db)},
                             {"ssim", finite_or_null(view.ssim)},
                             {"covered_percent", 100 * view.covered_share},
                             {"gain", view.gain}});
  return json.dump();
}

}  // namespace lapseam
