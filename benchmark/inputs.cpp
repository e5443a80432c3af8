#include "inputs.hpp"

#include <algorithm>
#include <thread>

#include "dataset.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/lidar_sensor.hpp"
#include "simulation/mask_model.hpp"
#include "simulation/rig.hpp"
#include "simulation/scene.hpp"
#include "simulation/street.hpp"

namespace lidar_camera_recalibration::performance {
namespace {

class Folder : public Source {
 public:
  explicit Folder(const std::string& folder)
      : dataset_(Dataset::open(folder)), camera_(dataset_->intrinsics()) {
    if (!dataset_->reference()) {
      throw Error(ErrorCause::kFile, folder + " has no reference extrinsic, which the benchmark starts from");
    }
  }

  const Camera& camera() const override { return camera_; }
  const Eigen::Isometry3d& T_camera_lidar() const override { return *dataset_->reference(); }
  std::size_t size() const override { return dataset_->size(); }
  RawFrame frame(std::size_t index) const override {
    return {dataset_->image(index), dataset_->maskLayers(index), dataset_->cloud(index)};
  }

 private:
  std::unique_ptr<Dataset> dataset_;
  Camera camera_;
};

/// The lens of simulate_drive.
Intrinsics cameraOf(const SensorSizes& sizes) {
  Intrinsics intrinsics;
  intrinsics.width = sizes.width;
  intrinsics.height = sizes.height;
  intrinsics.fx = intrinsics.fy = 0.58 * sizes.width;
  intrinsics.cx = 0.491 * sizes.width;
  intrinsics.cy = 0.482 * sizes.height;
  intrinsics.model = DistortionModel::kPlumbBob;
  intrinsics.distortion = {-0.19, 0.05, 0.0006, -0.0009, 0.0};
  return intrinsics;
}

class SimulatedFrame : public Source {
 public:
  explicit SimulatedFrame(const SensorSizes& sizes)
      : sizes_(sizes), camera_(cameraOf(sizes)), rig_(simulation::makeRig(kSeed)) {}

  const Camera& camera() const override { return camera_; }
  const Eigen::Isometry3d& T_camera_lidar() const override { return rig_.T_camera_lidar; }
  std::size_t size() const override { return 1; }

  RawFrame frame(std::size_t) const override {
    using namespace simulation;
    const Street street(kSeed, 2.0 * kTime * kSpeed, kSpeed);
    Scene scene(street.world());
    LidarConfig lidar;
    lidar.beams = sizes_.beams;
    lidar.azimuth_step_deg = sizes_.azimuth_step_deg;
    lidar.threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
    scene.setInterval(kTime - lidar.sweep_duration, kTime + lidar.sweep_duration);

    const auto T_world_lidar = [&](double time) { return street.egoPose(time) * rig_.T_base_lidar; };
    const Picture picture =
        CameraSensor(camera_, lidar.threads)
            .take(scene, T_world_lidar(kTime) * rig_.T_camera_lidar.inverse(), kTime, kSeed);
    std::vector<LidarReturn> sweep = LidarSensor(lidar).sweep(scene, T_world_lidar, kTime, kSeed);
    motionCompensate(sweep, T_world_lidar, kTime);
    MaskConfig masks;
    masks.min_masks = masks.max_masks = sizes_.masks;
    RawFrame raw{picture.image, simulateMasks(picture, street.world().parts, masks, kSeed), {}};
    for (const LidarReturn& r : sweep) {
      raw.cloud.points.push_back(r.point);
      raw.cloud.reflectivity.push_back(r.intensity);
      raw.cloud.ring.push_back(r.ring);
    }
    return raw;
  }

 private:
  static constexpr std::uint64_t kSeed = 11;
  static constexpr double kTime = 10.0, kSpeed = 8.0;  ///< [s], [m/s]

  SensorSizes sizes_;
  Camera camera_;
  simulation::Rig rig_;
};

}  // namespace

std::unique_ptr<Source> openFolder(const std::string& folder) { return std::make_unique<Folder>(folder); }

std::unique_ptr<Source> simulateFrame(const SensorSizes& sizes) {
  return std::make_unique<SimulatedFrame>(sizes);
}

}  // namespace lidar_camera_recalibration::performance
