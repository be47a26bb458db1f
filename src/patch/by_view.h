#pragma once

// Vertices with the views that measured them.

#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "lapseam/patch.h"

namespace lapseam {

/// The vertices of each view together. Who goes through them in this order reads images that live in a file once each,
/// and can give them back in between: relieve().
class VerticesByView {
 public:
  /// The mesh needs its provenance, which counts the patches.
  VerticesByView(const Mesh& mesh, std::size_t views) : first_(views + 1, 0), order_(mesh.vertex_count()) {
    for (const std::uint32_t view : mesh.vertex_view) ++first_[view + 1];
    for (std::size_t i = 0; i < views; ++i) first_[i + 1] += first_[i];
    std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
    for (std::size_t v = 0; v < order_.size(); ++v) order_[next[mesh.vertex_view[v]]++] = std::uint32_t(v);
  }

  std::span<const std::uint32_t> of(std::size_t view) const {
    return {order_.data() + first_[view], first_[view + 1] - first_[view]};
  }

 private:
  std::vector<std::uint32_t> first_, order_;
};

/// After work on a view: where its images live in a file, and memory is short, they are given back.
inline void relieve(const Patch& patch) {
  const std::shared_ptr<PixelStore> store = patch.view.range.pixels.get_allocator().store();
  if (store) store->relieve();
}

}  // namespace lapseam
