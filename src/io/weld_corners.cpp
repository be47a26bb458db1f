#include "io/weld_corners.h"

namespace lapseam {
namespace {

/// Triangles ordered by page, untextured last, and unseen after these, and where each page begins: a stable counting
/// sort.
struct PageOrder {
  std::vector<std::uint32_t> triangles;
  std::vector<std::size_t> begin;
};

PageOrder order_by_page(const Mesh& mesh) {
  const std::size_t untextured = mesh.pages.size();
  const auto slot_of = [&](std::size_t i) {
    if (!mesh.triangle_page.empty() && mesh.triangle_page[i] != kInvalidIndex)
      return std::size_t(mesh.triangle_page[i]);
    return untextured + (mesh.is_unseen.empty() || mesh.is_unseen[i] ? 1u : 0u);
  };
  PageOrder order;
  order.begin.assign(untextured + 3, 0);
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) ++order.begin[slot_of(i) + 1];
  for (std::size_t s = 1; s < order.begin.size(); ++s) order.begin[s] += order.begin[s - 1];
  order.triangles.resize(mesh.triangle_count());
  std::vector<std::size_t> next(order.begin.begin(), order.begin.end() - 1);
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) order.triangles[next[slot_of(i)]++] = std::uint32_t(i);
  return order;
}

/// Per mesh vertex, the chain of its welded vertices on the page at hand. Chains are short: one to a few coordinates.
class Welder {
 public:
  explicit Welder(const Mesh& mesh) : mesh_(mesh), first_(mesh.vertex_count(), kInvalidIndex) {}

  void add_triangle(std::uint32_t triangle, bool is_textured, WeldedPage& out) {
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const Eigen::Vector2f uv = is_textured ? mesh_.texcoords[triangle][corner] : Eigen::Vector2f(0, 0);
      out.indices.push_back(find_or_add(mesh_.triangles[triangle][corner], uv, is_textured, out));
    }
  }

  void finish_page(const WeldedPage& page) {
    for (const std::uint32_t vertex : page.vertices) first_[vertex] = kInvalidIndex;
    next_.clear();
  }

 private:
  std::uint32_t find_or_add(std::uint32_t vertex, const Eigen::Vector2f& uv, bool is_textured, WeldedPage& out) {
    for (std::uint32_t i = first_[vertex]; i != kInvalidIndex; i = next_[i])
      if (!is_textured || out.texcoords[i] == uv) return i;
    const auto added = std::uint32_t(out.vertices.size());
    out.vertices.push_back(vertex);
    if (is_textured) out.texcoords.push_back(uv);
    next_.push_back(first_[vertex]);
    first_[vertex] = added;
    return added;
  }

  const Mesh& mesh_;
  std::vector<std::uint32_t> first_;
  std::vector<std::uint32_t> next_;
};

}  // namespace

std::vector<WeldedPage> weld_corners(const Mesh& mesh) {
  const PageOrder order = order_by_page(mesh);
  Welder welder(mesh);
  std::vector<WeldedPage> pages;
  for (std::size_t slot = 0; slot + 1 < order.begin.size(); ++slot) {
    if (order.begin[slot] == order.begin[slot + 1]) continue;
    const bool is_textured = slot < mesh.pages.size();
    WeldedPage page;
    if (is_textured) page.page = std::uint32_t(slot);
    page.is_unseen = slot > mesh.pages.size();
    page.indices.reserve(3 * (order.begin[slot + 1] - order.begin[slot]));
    for (std::size_t i = order.begin[slot]; i < order.begin[slot + 1]; ++i)
      welder.add_triangle(order.triangles[i], is_textured, page);
    welder.finish_page(page);
    pages.push_back(std::move(page));
  }
  return pages;
}

}  // namespace lapseam
