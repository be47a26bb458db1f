#include "spatial/ray_scene.h"

#include <embree3/rtcore.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>

#include "core/parallel.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

// Debian's Embree is built with ray masks: a ray whose mask is 0 hits nothing.
constexpr unsigned kAllGeometry = 0xFFFFFFFFu;

Eigen::Vector3d closest_on_segment(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const Eigen::Vector3d ab = b - a;
  const double squared = ab.squaredNorm();
  return squared > 0 ? Eigen::Vector3d(a + ab * std::clamp(ab.dot(p - a) / squared, 0.0, 1.0)) : a;
}

Eigen::Vector3d closest_on_edges(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                 const Eigen::Vector3d& c) {
  Eigen::Vector3d best = closest_on_segment(p, a, b);
  for (const Eigen::Vector3d& q : {closest_on_segment(p, b, c), closest_on_segment(p, c, a)})
    if ((p - q).squaredNorm() < (p - best).squaredNorm()) best = q;
  return best;
}

// Ericson, Real-Time Collision Detection, 5.1.5. In double: in float, slivers return points of themselves that are
// millimetres from the closest one.
Eigen::Vector3d closest_on_triangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                    const Eigen::Vector3d& c) {
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a;
  const Eigen::Vector3d normal = ab.cross(ac);
  // Where the area drowns in rounding, the triangle is no more than its edges.
  if (normal.squaredNorm() <= 1e-20 * ab.squaredNorm() * ac.squaredNorm()) return closest_on_edges(p, a, b, c);
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return a;
  const Eigen::Vector3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return b;
  const double vc = normal.dot(ab.cross(ap));  // d1·d4 − d3·d2 without its cancellation
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + ab * (d1 / (d1 - d3));
  const Eigen::Vector3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return c;
  const double vb = normal.dot(ap.cross(ac));
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + ac * (d2 / (d2 - d6));
  const double va = normal.dot((c - b).cross(bp));
  if (va <= 0 && (d4 - d3) >= 0 && (d5 - d6) >= 0) return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
  const double sum = va + vb + vc;
  return a + ab * (vb / sum) + ac * (vc / sum);
}

}  // namespace

struct RayScene::Impl {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  std::vector<Eigen::Vector3f> positions;
  std::vector<Triangle> triangles;

  ~Impl() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }
};

namespace {

struct ClosestQuery {
  const std::vector<Eigen::Vector3f>* positions;
  const std::vector<Triangle>* triangles;
  float best_squared;
  ClosestPoint best;
};

bool visit_triangle(RTCPointQueryFunctionArguments* arguments) {
  auto& query = *static_cast<ClosestQuery*>(arguments->userPtr);
  const Triangle& t = (*query.triangles)[arguments->primID];
  const auto& positions = *query.positions;
  const Eigen::Vector3f p(arguments->query->x, arguments->query->y, arguments->query->z);
  const Eigen::Vector3d from = p.cast<double>();
  const Eigen::Vector3d q = closest_on_triangle(from, positions[t[0]].cast<double>(), positions[t[1]].cast<double>(),
                                                positions[t[2]].cast<double>());
  // Rounded, so that triangles that share the closest point tie.
  const auto squared = float((from - q).squaredNorm());
  const bool is_better =
      squared < query.best_squared || (squared == query.best_squared && arguments->primID < query.best.triangle);
  if (!is_better) return false;
  query.best_squared = squared;
  query.best = {q.cast<float>(), std::sqrt(squared), arguments->primID};
  // A hair wider than the best distance, so that ties are still visited and the smaller index wins.
  arguments->query->radius =
      std::min(arguments->query->radius, std::nextafter(query.best.distance * 1.0000002f, 3e38f));
  return true;
}

}  // namespace

RayScene::RayScene(std::span<const Eigen::Vector3f> positions_m, std::span<const Triangle> triangles, Context& context)
    : impl_(std::make_unique<Impl>()) {
  impl_->positions.assign(positions_m.begin(), positions_m.end());
  impl_->triangles.assign(triangles.begin(), triangles.end());
  run_in_arena(context, [&] {
    // No thread count here: Embree would set it for the whole process. The build joins this arena instead.
    impl_->device = rtcNewDevice(nullptr);
    if (!impl_->device) throw Error("Embree: cannot create a device");
    impl_->scene = rtcNewScene(impl_->device);
    rtcSetSceneFlags(impl_->scene, RTC_SCENE_FLAG_ROBUST);
    if (!impl_->triangles.empty()) {
      const RTCGeometry geometry = rtcNewGeometry(impl_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
      // Embree reads 16 bytes per vertex: its own copy is padded.
      auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(
          geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), impl_->positions.size()));
      auto* indices = static_cast<std::uint32_t*>(rtcSetNewGeometryBuffer(
          geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(std::uint32_t), impl_->triangles.size()));
      if (!vertices || !indices) throw Error("Embree: out of memory");
      std::memcpy(vertices, impl_->positions.data()->data(), impl_->positions.size() * 3 * sizeof(float));
      std::memcpy(indices, impl_->triangles.data(), impl_->triangles.size() * 3 * sizeof(std::uint32_t));
      rtcSetGeometryMask(geometry, kAllGeometry);
      rtcCommitGeometry(geometry);
      rtcAttachGeometry(impl_->scene, geometry);
      rtcReleaseGeometry(geometry);
    }
    rtcJoinCommitScene(impl_->scene);
    if (const RTCError error = rtcGetDeviceError(impl_->device); error != RTC_ERROR_NONE)
      throw Error("Embree: building the BVH failed with error " + std::to_string(int(error)));
  });
}

RayScene::~RayScene() = default;
RayScene::RayScene(RayScene&&) noexcept = default;
RayScene& RayScene::operator=(RayScene&&) noexcept = default;

RayHit RayScene::cast(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float t_near,
                      float t_far) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit query{};
  query.ray.org_x = origin.x(), query.ray.org_y = origin.y(), query.ray.org_z = origin.z();
  query.ray.dir_x = direction.x(), query.ray.dir_y = direction.y(), query.ray.dir_z = direction.z();
  query.ray.tnear = t_near;
  query.ray.tfar = t_far;
  query.ray.mask = kAllGeometry;
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(impl_->scene, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
  return {query.ray.tfar, query.hit.primID, query.hit.u, query.hit.v};
}

bool RayScene::is_occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float t_near,
                           float t_far) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay ray{};
  ray.org_x = origin.x(), ray.org_y = origin.y(), ray.org_z = origin.z();
  ray.dir_x = direction.x(), ray.dir_y = direction.y(), ray.dir_z = direction.z();
  ray.tnear = t_near;
  ray.tfar = t_far;
  ray.mask = kAllGeometry;
  rtcOccluded1(impl_->scene, &context, &ray);
  return ray.tfar < 0;
}

ClosestPoint RayScene::closest(const Eigen::Vector3f& point, float max_distance) const {
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  RTCPointQuery query{};
  query.x = point.x(), query.y = point.y(), query.z = point.z();
  query.radius = max_distance < 3.0e38f ? max_distance : std::numeric_limits<float>::infinity();
  ClosestQuery state{&impl_->positions, &impl_->triangles, query.radius * query.radius, {}};
  rtcPointQuery(impl_->scene, &query, &context, visit_triangle, &state);
  return state.best;
}

}  // namespace lapseam
