#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

namespace lidar_camera_recalibration {

/// The distortion models of sensor_msgs/CameraInfo. kNone is what a rectified image has.
enum class DistortionModel { kNone, kPlumbBob, kRationalPolynomial, kEquidistant };

/// `plumb_bob`, `rational_polynomial`, `equidistant` (also its other name `fisheye`); empty means none.
/// @throw Error(kCamera) naming the model if it is another one.
DistortionModel distortionModelFromName(const std::string& name);
const char* name(DistortionModel model);

struct Intrinsics {
  int width = 0, height = 0;                      ///< [px]
  double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;  ///< [px], pixel centres at integer coordinates
  DistortionModel model = DistortionModel::kNone;
  /// k1 k2 p1 p2 [k3 [k4 k5 k6]] or, equidistant, k1 k2 k3 k4. Camera fills it up with zeros to the model's
  /// number, and takes all zeros for kNone unless the model is equidistant, where they are a fisheye lens.
  std::vector<double> distortion;
};

/// A pinhole camera with distortion. Immutable.
///
/// The objective never sees distortion: masks are brought once into the *ideal* image, the pinhole image with
/// the same focal lengths, centre and size, and points are projected there.
class Camera {
 public:
  /// @throw Error(kCamera) if focal lengths, size or coefficients describe no camera.
  explicit Camera(const Intrinsics& intrinsics);

  const Intrinsics& intrinsics() const { return intrinsics_; }
  bool distorted() const { return intrinsics_.model != DistortionModel::kNone; }

  /// Pixel (u, v) in the image as it was taken, of a point in the optical frame [m].
  /// Nothing if the point lies behind the camera or where the distortion polynomial folds back on itself;
  /// the pixel may lie outside of the image.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point) const;

  /// Unit ray in the optical frame that project() maps to the pixel (iterative; sub-1e-6 px inside the
  /// image). A pixel that the distortion polynomial cannot reach gets the ray of its rim in that direction.
  Eigen::Vector3d ray(const Eigen::Vector2d& pixel) const;

  /// The image resampled into the ideal image. Pixels that the camera did not see are 0.
  /// Label images need cv::INTER_NEAREST. @throw Error(kImage) if its size is not the camera's.
  cv::Mat toIdeal(const cv::Mat& image, int interpolation) const;

 private:
  Eigen::Vector2d distort(const Eigen::Vector2d& normalised) const;
  bool reaches(const Eigen::Vector2d& normalised) const;  ///< not folded back
  void makeMaps();

  Intrinsics intrinsics_;
  double max_radius_;      ///< largest undistorted radius (tan of the angle; equidistant: the angle) before
                           ///< folding back
  cv::Mat map_x_, map_y_;  ///< ideal pixel -> raw pixel, empty without distortion
};

}  // namespace lidar_camera_recalibration
