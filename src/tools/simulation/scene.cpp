#include "simulation/scene.hpp"

#include <embree3/rtcore.h>

#include <algorithm>
#include <array>
#include <limits>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration::simulation {

using Eigen::Vector3f;

namespace {

constexpr float kNearest = 1e-3F;  ///< [m]; keeps secondary rays off the surface they start from

using Affine = std::array<float, 12>;  ///< 3x4, column by column, as Embree takes it

Affine toAffine(const Eigen::Isometry3d& pose) {
  Affine affine;
  Eigen::Map<Eigen::Matrix<float, 3, 4>>(affine.data()) = pose.matrix().topRows<3>().cast<float>();
  return affine;
}

RTCScene buildMesh(RTCDevice device, const Mesh& mesh) {
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), mesh.vertices.size()));
  for (const Vector3f& vertex : mesh.vertices) vertices = std::copy_n(vertex.data(), 3, vertices);
  auto* triangles = static_cast<std::uint32_t*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(std::uint32_t),
                              mesh.triangles.size()));
  for (const auto& triangle : mesh.triangles) triangles = std::copy_n(triangle.data(), 3, triangles);
  rtcCommitGeometry(geometry);
  RTCScene scene = rtcNewScene(device);
  rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene);
  return scene;
}

}  // namespace

struct Scene::Data {
  struct Instance {
    const Mesh* mesh;
    const Trajectory* trajectory;  ///< null for what stands still
    RTCGeometry geometry;
    std::array<Eigen::Matrix3f, 2> rotation;  ///< at both ends of the interval
  };

  explicit Data(const World& w) : world(w) {}
  ~Data() {
    if (top) rtcReleaseScene(top);
    if (device) rtcReleaseDevice(device);
  }

  void add(const Mesh& mesh, const Trajectory* trajectory) {
    RTCScene scene = buildMesh(device, mesh);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
    rtcSetGeometryInstancedScene(geometry, scene);
    rtcReleaseScene(scene);
    if (trajectory) rtcSetGeometryTimeStepCount(geometry, 2);
    rtcAttachGeometryByID(top, geometry, static_cast<unsigned>(instances.size()));
    const Affine identity = toAffine(Eigen::Isometry3d::Identity());
    rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, identity.data());
    rtcCommitGeometry(geometry);
    rtcReleaseGeometry(geometry);  // the scene keeps it
    instances.push_back(
        {&mesh, trajectory, geometry, {Eigen::Matrix3f::Identity(), Eigen::Matrix3f::Identity()}});
  }

  float relativeTime(double time) const {
    return static_cast<float>(std::clamp((time - from) / (to - from), 0.0, 1.0));
  }

  const World& world;
  RTCDevice device = nullptr;
  RTCScene top = nullptr;
  std::vector<Instance> instances;
  double from = 0.0, to = 1.0;
};

Scene::Scene(const World& world) : data_(std::make_unique<Data>(world)) {
  // One thread: the tree, and with it the winner among equally distant triangles, is then the same in every
  // run.
  data_->device = rtcNewDevice("threads=1");
  if (!data_->device) {
    throw Error(ErrorCause::kParameter, "Embree could not be started (error " +
                                            std::to_string(rtcGetDeviceError(nullptr)) +
                                            "): is libembree3 intact?");
  }
  data_->top = rtcNewScene(data_->device);
  rtcSetSceneFlags(data_->top, static_cast<RTCSceneFlags>(RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_DYNAMIC));
  data_->add(world.ground_and_buildings, nullptr);
  for (const MovingObject& object : world.moving) data_->add(object.mesh, &object.pose);
  setInterval(0.0, 1.0);
}

Scene::~Scene() = default;

const World& Scene::world() const { return data_->world; }

void Scene::setInterval(double from, double to) {
  data_->from = from;
  data_->to = std::max(to, from + 1e-9);
  for (Data::Instance& instance : data_->instances) {
    if (!instance.trajectory) continue;
    for (unsigned step = 0; step < 2; ++step) {
      const Eigen::Isometry3d pose = (*instance.trajectory)(step == 0 ? data_->from : data_->to);
      const Affine affine = toAffine(pose);
      rtcSetGeometryTransform(instance.geometry, step, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, affine.data());
      instance.rotation[step] = pose.linear().cast<float>();
    }
    rtcCommitGeometry(instance.geometry);
  }
  rtcCommitScene(data_->top);
}

std::optional<Hit> Scene::cast(const Vector3f& origin, const Vector3f& direction, double time) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit query{};
  query.ray.org_x = origin.x(), query.ray.org_y = origin.y(), query.ray.org_z = origin.z();
  query.ray.dir_x = direction.x(), query.ray.dir_y = direction.y(), query.ray.dir_z = direction.z();
  query.ray.tnear = kNearest;
  query.ray.tfar = std::numeric_limits<float>::infinity();
  query.ray.time = data_->relativeTime(time);
  query.ray.mask = ~0U;
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(data_->top, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;

  const Data::Instance& instance = data_->instances[query.hit.instID[0]];
  const auto& triangle = instance.mesh->triangles[query.hit.primID];
  Vector3f normal(query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z);
  normal = ((1 - query.ray.time) * instance.rotation[0] + query.ray.time * instance.rotation[1]) * normal;
  normal.normalize();
  if (normal.dot(direction) > 0) normal = -normal;
  const auto& texture = instance.mesh->texture;
  return Hit{query.ray.tfar, instance.mesh->parts[query.hit.primID], normal,
             (1 - query.hit.u - query.hit.v) * texture[triangle[0]] + query.hit.u * texture[triangle[1]] +
                 query.hit.v * texture[triangle[2]]};
}

bool Scene::blocked(const Vector3f& origin, const Vector3f& direction, float distance, double time) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay ray{};
  ray.org_x = origin.x(), ray.org_y = origin.y(), ray.org_z = origin.z();
  ray.dir_x = direction.x(), ray.dir_y = direction.y(), ray.dir_z = direction.z();
  ray.tnear = kNearest;
  ray.tfar = distance;
  ray.time = data_->relativeTime(time);
  ray.mask = ~0U;
  rtcOccluded1(data_->top, &context, &ray);
  return ray.tfar < 0;  // Embree marks a blocked ray with -infinity
}

}  // namespace lidar_camera_recalibration::simulation
