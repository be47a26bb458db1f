#include "texture/layout.h"

#include <map>

#include "core/parallel.h"

namespace lapseam {
namespace {

constexpr float kAffine_px = 0.25f;

}  // namespace

bool project_corners(const Mesh& mesh, std::uint32_t triangle, const ColorCamera& camera, Corners& p) {
  for (std::size_t k = 0; k < 3; ++k)
    if (!camera.project_beyond(mesh.positions_m[mesh.triangles[triangle][k]], p[k])) return false;
  if (camera.wraps()) unwrap(p, camera.width());
  return true;
}

bool project_triangle(const Mesh& mesh, std::uint32_t triangle, const ColorCamera& camera, Corners& p, bool& is_copy) {
  if (!project_corners(mesh, triangle, camera, p)) return false;
  const Triangle& t = mesh.triangles[triangle];
  is_copy = true;
  for (std::size_t k = 0; k < 3; ++k) {
    Eigen::Vector2f middle;
    const std::size_t next = (k + 1) % 3;
    if (!camera.project_beyond(0.5f * (mesh.positions_m[t[k]] + mesh.positions_m[t[next]]), middle)) return false;
    Eigen::Vector2f off = middle - 0.5f * (p[k] + p[next]);
    if (camera.wraps()) off.x() -= float(camera.width()) * std::round(off.x() / float(camera.width()));
    is_copy = is_copy && off.norm() <= kAffine_px;
  }
  for (Eigen::Vector2f& q : p) q = snap(q);
  return true;
}

Layout project_frames(const Mesh& mesh, const ColorCameras& cameras, std::span<const std::uint32_t> view_of_triangle,
                      std::span<const std::uint32_t> frame_of_triangle, Context& context) {
  const std::size_t count = mesh.triangle_count();
  Layout out;
  out.pixels.assign(count, Corners{Eigen::Vector2f::Zero(), Eigen::Vector2f::Zero(), Eigen::Vector2f::Zero()});
  out.sheet.assign(count, kInvalidIndex);
  out.is_resampled.assign(count, 0);
  std::vector<std::uint8_t> is_seen(count, 0);
  parallel_for(context, count, 16384, [&](std::size_t k) {
    const auto i = std::uint32_t(k);
    if (frame_of_triangle[i] == kInvalidIndex) return;
    bool is_copy = false;
    is_seen[i] = project_triangle(mesh, i, *cameras[frame_of_triangle[i]], out.pixels[i], is_copy);
    out.is_resampled[i] = !is_copy || frame_of_triangle[i] != view_of_triangle[i];
  });
  std::vector<std::vector<std::uint32_t>> triangles(cameras.size()), label(cameras.size());
  for (std::uint32_t i = 0; i < count; ++i)
    if (is_seen[i]) triangles[frame_of_triangle[i]].push_back(i);
  parallel_for(context, cameras.size(), 1,
               [&](std::size_t frame) { label[frame] = connect_by_blocks(triangles[frame], out.pixels); });
  std::vector<std::size_t> next(cameras.size(), 0);
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> number;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (!is_seen[i]) continue;
    const std::uint32_t frame = frame_of_triangle[i];
    const auto [found, is_new] =
        number.try_emplace({frame, label[frame][next[frame]++]}, std::uint32_t(out.frame.size()));
    if (is_new) out.frame.push_back(frame);
    out.sheet[i] = found->second;
  }
  return out;
}

std::vector<std::vector<std::uint32_t>> triangles_of_sheets(std::span<const std::uint32_t> sheet, std::size_t sheets) {
  std::vector<std::vector<std::uint32_t>> triangles(sheets);
  for (std::uint32_t i = 0; i < sheet.size(); ++i)
    if (sheet[i] != kInvalidIndex) triangles[sheet[i]].push_back(i);
  return triangles;
}

}  // namespace lapseam
