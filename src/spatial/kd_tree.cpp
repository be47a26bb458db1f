#include "spatial/kd_tree.h"

#include <algorithm>
#include <limits>
#include <nanoflann.hpp>

namespace lapseam {
namespace {

struct PointCloud {
  std::vector<Eigen::Vector3f> points;
  std::size_t kdtree_get_point_count() const { return points.size(); }
  float kdtree_get_pt(std::size_t index, std::size_t axis) const { return points[index][Eigen::Index(axis)]; }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

using Tree =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, PointCloud>, PointCloud, 3, std::uint32_t>;

bool is_nearer(const Neighbor& a, const Neighbor& b) {
  return a.squared_distance != b.squared_distance ? a.squared_distance < b.squared_distance : a.index < b.index;
}

// nanoflann's own k-nearest set keeps whichever of two equal distances comes first in the tree.
class NearestSet {
 public:
  using DistanceType = float;
  NearestSet(std::size_t capacity, std::vector<Neighbor>& out) : capacity_(capacity), out_(out) { out_.clear(); }
  std::size_t size() const { return out_.size(); }
  bool full() const { return out_.size() == capacity_; }
  bool addPoint(float squared_distance, std::uint32_t index) {
    const Neighbor candidate{index, squared_distance};
    if (full() && !is_nearer(candidate, out_.back())) return true;
    if (full()) out_.pop_back();
    out_.insert(std::upper_bound(out_.begin(), out_.end(), candidate, is_nearer), candidate);
    return true;
  }
  // A hair more than the worst, so that branches at equal distance are still searched.
  float worstDist() const {
    return full() ? std::nextafter(out_.back().squared_distance, std::numeric_limits<float>::infinity())
                  : std::numeric_limits<float>::infinity();
  }

 private:
  std::size_t capacity_;
  std::vector<Neighbor>& out_;
};

class RadiusSet {
 public:
  using DistanceType = float;
  RadiusSet(float squared_radius, std::vector<Neighbor>& out) : squared_radius_(squared_radius), out_(out) {
    out_.clear();
  }
  std::size_t size() const { return out_.size(); }
  bool full() const { return true; }
  bool addPoint(float squared_distance, std::uint32_t index) {
    if (squared_distance < squared_radius_) out_.push_back({index, squared_distance});
    return true;
  }
  float worstDist() const { return squared_radius_; }

 private:
  float squared_radius_;
  std::vector<Neighbor>& out_;
};

}  // namespace

struct KdTree::Impl {
  PointCloud cloud;
  std::unique_ptr<Tree> tree;
};

KdTree::KdTree(std::span<const Eigen::Vector3f> points) : impl_(std::make_unique<Impl>()) {
  impl_->cloud.points.assign(points.begin(), points.end());
  if (!points.empty())
    impl_->tree = std::make_unique<Tree>(3, impl_->cloud, nanoflann::KDTreeSingleIndexAdaptorParams(16));
}

KdTree::~KdTree() = default;
KdTree::KdTree(KdTree&&) noexcept = default;
KdTree& KdTree::operator=(KdTree&&) noexcept = default;

void KdTree::find_in_radius(const Eigen::Vector3f& query, float radius, std::vector<Neighbor>& out) const {
  RadiusSet result(radius * radius, out);
  if (impl_->tree) impl_->tree->findNeighbors(result, query.data(), nanoflann::SearchParams());
}

void KdTree::find_nearest(const Eigen::Vector3f& query, std::size_t count, std::vector<Neighbor>& out) const {
  out.clear();
  if (count == 0 || !impl_->tree) return;
  NearestSet result(count, out);
  impl_->tree->findNeighbors(result, query.data(), nanoflann::SearchParams());
}

}  // namespace lapseam
