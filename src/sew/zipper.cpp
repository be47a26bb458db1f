#include "lapseam/sew.h"

#include <cmath>

#include "core/parallel.h"
#include "sew/grown_model.h"
#include "sew/view_turn.h"

namespace lapseam {
namespace {

constexpr double kFarFromOrigin_m = 100.0;  // floats hold a millimetre's hundredth up to here

}  // namespace

struct Zipper::Impl {
  GrownModel model;
  std::vector<std::uint8_t> times_added;

  ModelAddition find(const ZipperTurn& turn, Where where, Context& context) const {
    const PatchGrid& grid = model.patches[turn.view].grid;
    if (grid.width < 2 || grid.height < 2) return {};  // no cell, no triangle
    // A panorama is cut somewhere; every second time on the other side, so that the cut is closed too.
    const bool turns = grid.wraps && (times_added[turn.view] & 1);
    return ViewTurn(model, turn.view, turn.wanted, turns ? grid.width / 2 : 0, where, context).run();
  }

  void add(std::span<const ZipperTurn> turns, Where where, Context& context) {
    if (where == Where::kBorder) model.measure_outlines();
    std::vector<ModelAddition> additions(turns.size());
    parallel_for(context, turns.size(), 1, [&](std::size_t i) { additions[i] = find(turns[i], where, context); });
    const std::vector<std::uint8_t> is_accepted = model.accept(additions, context);
    for (std::size_t i = 0; i < turns.size(); ++i) {
      if (!is_accepted[i]) {
        if (where == Where::kBorder) model.measure_outlines();
        additions[i] = find(turns[i], where, context);
        model.accept({&additions[i], 1}, context);
      }
      ++times_added[turns[i].view];
    }
  }
};

Zipper::Zipper(std::span<const Patch> patches, const OverlapOptions& options) : impl_(std::make_unique<Impl>()) {
  impl_->model.patches = patches;
  impl_->model.options = options;
  impl_->times_added.assign(patches.size(), 0);
  for (const Patch& patch : patches) {
    const Eigen::Vector3d t = patch.view.T_world_view.translation();
    if (t.norm() <= kFarFromOrigin_m) continue;
    impl_->model.mesh.origin_m = {std::round(t.x()), std::round(t.y()), std::round(t.z())};
    break;
  }
}
Zipper::~Zipper() = default;

void Zipper::add(std::span<const ZipperTurn> turns, Context& context) { impl_->add(turns, Where::kWanted, context); }

void Zipper::revisit(std::span<const ZipperTurn> turns, Context& context, std::uint32_t shortest_outline) {
  impl_->model.shortest_outline = shortest_outline;
  impl_->add(turns, Where::kBorder, context);
}

void Zipper::replace_mesh(Mesh mesh, Context& context) { impl_->model.replace(std::move(mesh), context); }

const Mesh& Zipper::mesh() const { return impl_->model.mesh; }

ZipperReport Zipper::report() const {
  ZipperReport report = impl_->model.report;
  report.open_edges = impl_->model.open.size();
  return report;
}

Mesh Zipper::take() { return impl_->model.take(); }

}  // namespace lapseam
