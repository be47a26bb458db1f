#pragma once

// Takes the colour steps out of the borders between charts.

#include <span>
#include <vector>

#include "texture/charts.h"
#include "texture/equalize.h"
#include "texture/painting.h"
#include "texture/shared_edges.h"

namespace lapseam {

class Context;

/// What is added to the pixels of every chart, after its image's response: an offset that varies slowly over the chart,
/// found for all charts together so that they meet, and near borders what is then left of each step, half to either
/// side, falling off within a few pixels. Pixels away from borders keep their differences.
class Levelling {
 public:
  /// pages: filled, not yet corrected.
  Levelling(const Mesh& mesh, const Charts& charts, const std::vector<SharedEdge>& edges, const ColorCameras& cameras,
            std::span<const ColorResponse> responses, const std::vector<ColorImage>& pages, Context& context);
  ~Levelling();
  Levelling(const Levelling&) = delete;
  Levelling& operator=(const Levelling&) = delete;

  Correction correction_of(std::uint32_t chart) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lapseam
