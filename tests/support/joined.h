#pragma once

// From views to one mesh by claims and the zipper alone: no smoothing, no clean-up.

#include <vector>

#include "lapseam/overlap.h"
#include "lapseam/sew.h"
#include "support/patches.h"

namespace lapseam::test {

struct Joined {
  Mesh mesh;
  std::vector<Patch> patches;
  std::vector<Image<std::uint8_t>> claims;
  std::vector<ClaimCounts> counts;
  ZipperReport report;

  /// Triangles of one view's samples alone.
  std::size_t triangles_of(std::uint32_t view) const {
    std::size_t count = 0;
    for (std::size_t i = 0; i < mesh.triangle_count(); ++i)
      count += mesh.triangle_view[i] == view && mesh.triangle_tag[i] == TriangleTag::kMeasured;
    return count;
  }
  std::uint64_t phantoms() const {
    std::uint64_t sum = 0;
    for (const ClaimCounts& c : counts) sum += c.phantom;
    return sum;
  }
};

inline Joined join(const std::vector<View>& views, const NoiseModel& noise, Context& context,
                   const OverlapOptions& options = {}) {
  Joined out;
  for (const View& view : views) out.patches.push_back(make_patch(view, noise, context));
  out.counts.resize(views.size());
  out.claims = claim_samples(out.patches, options, out.counts, context);
  Zipper zipper(out.patches, options);
  for (const Claim least : {Claim::kBest, Claim::kYields})
    for (std::uint32_t i = 0; i < views.size(); ++i) {
      Image<std::uint8_t> wanted = out.claims[i];
      for (std::uint8_t& c : wanted.pixels) c = c == std::uint8_t(Claim::kBest) || c == std::uint8_t(least);
      if (least == Claim::kBest)
        zipper.add({i, wanted}, context);
      else
        zipper.revisit({i, wanted}, context);
    }
  out.report = zipper.report();
  out.mesh = zipper.take();
  return out;
}

}  // namespace lapseam::test
