#include "inputs.hpp"

#include <algorithm>
#include <map>
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

/// A place on a simulated street at one moment.
class StreetPlace {
 public:
  StreetPlace()
      : rig_(simulation::makeRig(kSeed)),
        street_(kSeed, 2.0 * kTime * kSpeed, kSpeed),
        scene_(street_.world()) {
    scene_.setInterval(kTime - kSweep, kTime + kSweep);
  }

  const simulation::Rig& rig() const { return rig_; }

  RawFrame frame(const SensorSizes& sizes, const Camera& camera) {
    using namespace simulation;
    MaskConfig masks;
    masks.min_masks = masks.max_masks = sizes.masks;
    const Picture& picture = pictureOf(camera);
    RawFrame raw{picture.image, simulateMasks(picture, street_.world().parts, masks, kSeed), {}};
    for (const LidarReturn& r : sweep(sizes)) {
      raw.cloud.points.push_back(r.point);
      raw.cloud.reflectivity.push_back(r.intensity);
      raw.cloud.ring.push_back(r.ring);
    }
    return raw;
  }

 private:
  static constexpr std::uint64_t kSeed = 11;
  static constexpr double kTime = 10.0, kSweep = 0.1, kSpeed = 8.0;  ///< [s], [s], [m/s]

  static int threads() { return static_cast<int>(std::max(1u, std::thread::hardware_concurrency())); }
  Eigen::Isometry3d T_world_lidar(double time) const { return street_.egoPose(time) * rig_.T_base_lidar; }

  /// Pictures take long and are the same for all clouds and masks.
  const simulation::Picture& pictureOf(const Camera& camera) {
    simulation::Picture& picture = pictures_[camera.intrinsics().width];
    if (picture.image.empty()) {
      picture = simulation::CameraSensor(camera, threads())
                    .take(scene_, T_world_lidar(kTime) * rig_.T_camera_lidar.inverse(), kTime, kSeed);
    }
    return picture;
  }

  std::vector<simulation::LidarReturn> sweep(const SensorSizes& sizes) const {
    simulation::LidarConfig config;
    config.beams = sizes.beams;
    config.azimuth_step_deg = sizes.azimuth_step_deg;
    config.sweep_duration = kSweep;
    config.threads = threads();
    const auto pose = [this](double time) { return T_world_lidar(time); };
    std::vector<simulation::LidarReturn> sweep =
        simulation::LidarSensor(config).sweep(scene_, pose, kTime, kSeed);
    motionCompensate(sweep, pose, kTime);
    return sweep;
  }

  simulation::Rig rig_;
  simulation::Street street_;
  simulation::Scene scene_;
  std::map<int, simulation::Picture> pictures_;  ///< by width
};

StreetPlace& streetPlace() {
  static StreetPlace place;
  return place;
}

class SimulatedFrame : public Source {
 public:
  explicit SimulatedFrame(const SensorSizes& sizes) : sizes_(sizes), camera_(cameraOf(sizes)) {}

  const Camera& camera() const override { return camera_; }
  const Eigen::Isometry3d& T_camera_lidar() const override { return streetPlace().rig().T_camera_lidar; }
  std::size_t size() const override { return 1; }
  RawFrame frame(std::size_t) const override { return streetPlace().frame(sizes_, camera_); }

 private:
  SensorSizes sizes_;
  Camera camera_;
};

}  // namespace

std::unique_ptr<Source> openFolder(const std::string& folder) { return std::make_unique<Folder>(folder); }

std::unique_ptr<Source> simulateFrame(const SensorSizes& sizes) {
  return std::make_unique<SimulatedFrame>(sizes);
}

}  // namespace lidar_camera_recalibration::performance
