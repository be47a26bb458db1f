#pragma once

// Takes the colour steps out of the borders between images.

#include <span>
#include <vector>

#include "texture/charts.h"
#include "texture/painting.h"
#include "texture/shared_edges.h"

namespace lapseam {

class Context;

/// What is added to the pixels of every part of every chart: an offset that varies slowly over the part, found for all
/// together so that they meet, and near borders what is then left of each step, half to either side, falling off within
/// a few pixels. Pixels away from borders keep their differences.
class Levelling {
 public:
  /// Finds the places of borders that are looked at.
  Levelling(const Mesh& mesh, const Charts& charts, const std::vector<SharedEdge>& edges);
  ~Levelling();
  Levelling(const Levelling&) = delete;
  Levelling& operator=(const Levelling&) = delete;

  /// Colours of the borders within charts as a view's image has them: pages show only one side of each. Once for every
  /// view, any number at a time.
  void look(std::uint32_t view, const Photograph& photograph);
  /// pages: painted, not yet corrected. They and the map live as long.
  void solve(const std::vector<ColorImage>& pages, const std::vector<PartMap>& map, Context& context);

  Correction correction_of(std::uint32_t chart) const;

  /// Steps at borders between images, of all and of those within charts, root mean square of the channels in levels.
  struct Steps {
    double median = 0, p95 = 0;
  };
  Steps steps_before() const, steps_after() const;
  Steps inner_steps_before() const, inner_steps_after() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lapseam
