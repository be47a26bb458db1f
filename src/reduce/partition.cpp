#include "reduce/partition.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include "core/parallel.h"

namespace lapseam {
namespace {

constexpr std::size_t kGrain = 65536;
constexpr std::uint32_t kLargestBits = 10;  ///< per axis

// Spreads the low ten bits, two zeros between each.
std::uint32_t spread_bits(std::uint32_t x) {
  x = (x | (x << 16)) & 0x030000FF;
  x = (x | (x << 8)) & 0x0300F00F;
  x = (x | (x << 4)) & 0x030C30C3;
  return (x | (x << 2)) & 0x09249249;
}

struct Cells {
  Eigen::Vector3f lowest_m;
  float per_m = 0;
  std::uint32_t bits = 1;

  std::uint32_t of(const Eigen::Vector3f& p) const {
    const float last = float((1u << bits) - 1);
    std::uint32_t cell = 0;
    for (int k = 0; k < 3; ++k) {
      const float x = std::clamp((p[k] - lowest_m[k]) * per_m, 0.f, last);
      cell |= spread_bits(std::uint32_t(x)) << k;
    }
    return cell;
  }
};

Cells make_cells(const StridedPositions& positions_m, std::size_t parts, float shift, Context& context) {
  const Eigen::AlignedBox3f box = parallel_reduce(
      context, positions_m.size, kGrain, Eigen::AlignedBox3f(),
      [&](std::size_t begin, std::size_t end, Eigen::AlignedBox3f value) {
        for (std::size_t i = begin; i < end; ++i) value.extend(positions_m[i]);
        return value;
      },
      [](const Eigen::AlignedBox3f& a, const Eigen::AlignedBox3f& b) { return a.merged(b); });
  Cells cells;
  // A surface takes about 4^bits of the 8^bits cells: some hundreds for each part, so that parts come out alike.
  while (cells.bits < kLargestBits && (std::size_t(1) << (2 * cells.bits)) < 512 * parts) ++cells.bits;
  const float extent = std::max(box.sizes().maxCoeff(), 1e-30f);
  // A third more than the extent, of which the shift takes a part.
  cells.per_m = float(1u << cells.bits) / (extent * 4 / 3);
  cells.lowest_m = box.min().array() - shift * extent / 3;
  return cells;
}

// Runs of cells with about the same number of vertices: the first cell of each part. Only cells that hold something are
// counted, by sorting: a grid of all would be larger than most meshes.
std::vector<std::uint32_t> first_cells(const std::vector<std::uint32_t>& cell_of_vertex, std::size_t piece_vertices,
                                       Context& context) {
  std::vector<std::uint32_t> sorted = cell_of_vertex;
  parallel_sort(context, sorted.begin(), sorted.end(), std::less<>());
  std::vector<std::uint32_t> first = {0};
  std::size_t in_part = 0;
  for (std::size_t i = 0; i < sorted.size();) {
    std::size_t end = i + 1;
    while (end < sorted.size() && sorted[end] == sorted[i]) ++end;
    if (in_part > 0 && in_part + (end - i) / 2 >= piece_vertices) {
      first.push_back(sorted[i]);
      in_part = 0;
    }
    in_part += end - i;
    i = end;
  }
  return first;
}

// count → scan → fill over blocks: items of each part, in increasing order. each(item, emit) calls emit(part) once for
// each part that the item is of.
template <typename Offset, typename Each>
void group(std::size_t n, std::size_t parts, const Each& each, std::vector<Offset>& offset,
           std::vector<std::uint32_t>& items, Context& context) {
  // Few blocks, or the counts of large meshes, blocks × parts, would outgrow the mesh.
  const std::size_t grain = std::max(kGrain, n / 256 + 1), blocks = (n + grain - 1) / grain;
  std::vector<std::uint32_t> counts(blocks * parts, 0);
  parallel_blocks(context, n, grain, [&](std::size_t begin, std::size_t end) {
    std::uint32_t* count = counts.data() + begin / grain * parts;
    for (std::size_t i = begin; i < end; ++i) each(i, [&](std::uint32_t part) { ++count[part]; });
  });
  offset.assign(parts + 1, 0);
  std::vector<Offset> start(blocks * parts);
  Offset sum = 0;
  for (std::size_t part = 0; part < parts; ++part) {
    offset[part] = sum;
    for (std::size_t block = 0; block < blocks; ++block) {
      start[block * parts + part] = sum;
      sum += counts[block * parts + part];
    }
  }
  offset[parts] = sum;
  items.resize(std::size_t(sum));
  parallel_blocks(context, n, grain, [&](std::size_t begin, std::size_t end) {
    Offset* next = start.data() + begin / grain * parts;
    for (std::size_t i = begin; i < end; ++i)
      each(i, [&](std::uint32_t part) { items[std::size_t(next[part]++)] = std::uint32_t(i); });
  });
}

}  // namespace

Partition partition(const StridedPositions& positions_m, std::span<const Triangle> triangles,
                    std::size_t piece_vertices, float shift, Context& context) {
  Partition out;
  const std::size_t n = positions_m.size;
  const Cells cells = make_cells(positions_m, n / piece_vertices + 1, shift, context);
  out.part_of_vertex.resize(n);
  parallel_for(context, n, kGrain, [&](std::size_t i) { out.part_of_vertex[i] = cells.of(positions_m[i]); });
  const std::vector<std::uint32_t> first = first_cells(out.part_of_vertex, piece_vertices, context);
  out.parts = first.size();
  parallel_for(context, n, kGrain, [&](std::size_t i) {
    const auto after = std::upper_bound(first.begin(), first.end(), out.part_of_vertex[i]);
    out.part_of_vertex[i] = std::uint32_t(after - first.begin() - 1);
  });

  group(
      n, out.parts, [&](std::size_t i, const auto& emit) { emit(out.part_of_vertex[i]); }, out.vertex_offset,
      out.vertices, context);
  out.rank_of_vertex.resize(n);
  parallel_for(context, n, kGrain, [&](std::size_t i) {
    const std::uint32_t v = out.vertices[i];
    out.rank_of_vertex[v] = std::uint32_t(i) - out.vertex_offset[out.part_of_vertex[v]];
  });
  group(
      triangles.size(), out.parts,
      [&](std::size_t i, const auto& emit) {
        const Triangle& t = triangles[i];
        if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) return;
        const std::uint32_t a = out.part_of_vertex[t[0]], b = out.part_of_vertex[t[1]], c = out.part_of_vertex[t[2]];
        emit(a);
        if (b != a) emit(b);
        if (c != a && c != b) emit(c);
      },
      out.triangle_offset, out.triangles, context);
  return out;
}

}  // namespace lapseam
