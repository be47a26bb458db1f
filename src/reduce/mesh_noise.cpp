#include "reduce/mesh_noise.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

#include "core/parallel.h"

namespace lapseam {
namespace {

constexpr std::size_t kPieces = 24, kSamplesPerPiece = 48;
constexpr std::size_t kNeighborhood = 40, kFewest = 16;  ///< vertices; a fit has six unknowns

// The triangles around each vertex of a piece.
struct Stars {
  explicit Stars(const Piece& piece) : offset(piece.vertices.size() + 1, 0) {
    for (const Triangle& t : piece.triangles)
      for (const std::uint32_t v : t) ++offset[v + 1];
    for (std::size_t v = 1; v < offset.size(); ++v) offset[v] += offset[v - 1];
    triangle.resize(offset.back());
    std::vector<std::uint32_t> next(offset.begin(), offset.end() - 1);
    for (std::size_t i = 0; i < piece.triangles.size(); ++i)
      for (const std::uint32_t v : piece.triangles[i]) triangle[next[v]++] = std::uint32_t(i);
  }
  std::vector<std::uint32_t> offset, triangle;
};

// The vertices nearest in the mesh, the first one included, breadth first; and the sum of the normals passed.
std::vector<std::uint32_t> neighborhood(const Piece& piece, const Stars& stars, std::uint32_t v,
                                        Eigen::Vector3f& normal) {
  std::vector<std::uint32_t> found = {v};
  for (std::size_t i = 0; i < found.size() && found.size() < kNeighborhood; ++i) {
    for (std::uint32_t k = stars.offset[found[i]]; k < stars.offset[found[i] + 1]; ++k) {
      const Triangle& t = piece.triangles[stars.triangle[k]];
      const Eigen::Vector3f& p = piece.vertices[t[0]].position_m;
      normal += (piece.vertices[t[1]].position_m - p).cross(piece.vertices[t[2]].position_m - p);
      for (const std::uint32_t w : t)
        if (std::find(found.begin(), found.end(), w) == found.end()) found.push_back(w);
    }
  }
  return found;
}

// Root mean square off the least-squares quadratic height field over the mean plane, for the degrees of freedom left.
std::optional<double> roughness(const Piece& piece, const Stars& stars, std::uint32_t v) {
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  const std::vector<std::uint32_t> near = neighborhood(piece, stars, v, normal);
  if (near.size() < kFewest || !(normal.norm() > 0)) return std::nullopt;
  const Eigen::Vector3d n = normal.cast<double>().normalized(), x_axis = n.unitOrthogonal(), y_axis = n.cross(x_axis);
  const Eigen::Vector3d center = piece.vertices[v].position_m.cast<double>();
  double reach = 0;
  for (const std::uint32_t w : near)
    reach = std::max(reach, (piece.vertices[w].position_m.cast<double>() - center).norm());
  if (!(reach > 0)) return std::nullopt;
  Eigen::Matrix<double, Eigen::Dynamic, 6> rows(near.size(), 6);
  Eigen::VectorXd heights(near.size());
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    const Eigen::Vector3d d = (piece.vertices[near[std::size_t(i)]].position_m.cast<double>() - center) / reach;
    const double x = d.dot(x_axis), y = d.dot(y_axis);
    rows.row(i) << 1, x, y, x * x, x * y, y * y;
    heights[i] = d.dot(n);
  }
  const Eigen::Matrix<double, 6, 6> normal_matrix = rows.transpose() * rows;
  const Eigen::Matrix<double, 6, 1> fit = normal_matrix.ldlt().solve(rows.transpose() * heights);
  const double squares = (rows * fit - heights).squaredNorm();
  if (!std::isfinite(squares)) return std::nullopt;
  return reach * std::sqrt(squares / double(near.size() - 6));
}

}  // namespace

double estimate_mesh_noise(const Surface& surface, const Partition& parts, Context& context) {
  const std::size_t pieces = std::min(kPieces, parts.parts);
  std::vector<std::vector<double>> found(pieces);
  parallel_for(context, pieces, 1, [&](std::size_t i) {
    const LoadedPiece loaded = load_piece(surface, parts, i * parts.parts / pieces);
    const Stars stars(loaded.piece);
    const std::size_t step = std::max<std::size_t>(1, loaded.own * pieces / (kPieces * kSamplesPerPiece));
    for (std::size_t v = step / 2; v < loaded.own; v += step)
      if (const auto value = roughness(loaded.piece, stars, std::uint32_t(v))) found[i].push_back(*value);
  });
  std::vector<double> all;
  for (const auto& values : found) all.insert(all.end(), values.begin(), values.end());
  if (all.empty()) return 0;
  const auto middle = all.begin() + std::ptrdiff_t(all.size() / 2);
  std::nth_element(all.begin(), middle, all.end());
  return *middle;
}

}  // namespace lapseam
