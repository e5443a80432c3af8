#include "lidar_camera_recalibration/frame.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>

#include "boundary_field.hpp"
#include "edge_weights.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_edges.hpp"
#include "mask_borders.hpp"

namespace lidar_camera_recalibration {
namespace {

// What the ideal image shows, as a pyramid with its tip at the camera.
class FieldOfView {
 public:
  explicit FieldOfView(const Intrinsics& k) {
    const double left = -0.5 - k.cx, right = k.width - 0.5 - k.cx;
    const double top = -0.5 - k.cy, bottom = k.height - 0.5 - k.cy;
    corners_ = {Eigen::Vector3d(left / k.fx, top / k.fy, 1.0), Eigen::Vector3d(right / k.fx, top / k.fy, 1.0),
                Eigen::Vector3d(right / k.fx, bottom / k.fy, 1.0),
                Eigen::Vector3d(left / k.fx, bottom / k.fy, 1.0)};
    for (auto& corner : corners_) corner.normalize();
    for (int i = 0; i < 4; ++i) sides_[i] = corners_[i].cross(corners_[(i + 1) % 4]).normalized();
  }

  // Smallest angle between a unit vector and a ray of the image [rad], also behind the camera.
  double angleTo(const Eigen::Vector3d& direction) const {
    bool inside = true;
    double largest_cosine = -1.0;
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector3d& from = corners_[i];
      const Eigen::Vector3d& to = corners_[(i + 1) % 4];
      largest_cosine = std::max(largest_cosine, direction.dot(from));
      const double height = direction.dot(sides_[i]);
      if (height >= 0.0) continue;
      inside = false;
      const Eigen::Vector3d foot = direction - height * sides_[i];
      if (from.cross(foot).dot(sides_[i]) >= 0.0 && foot.cross(to).dot(sides_[i]) >= 0.0) {
        largest_cosine = std::max(largest_cosine, foot.norm());
      }
    }
    return inside ? 0.0 : std::acos(std::min(largest_cosine, 1.0));
  }

 private:
  std::array<Eigen::Vector3d, 4> corners_;  // unit vectors, clockwise in the image
  std::array<Eigen::Vector3d, 4> sides_;    // unit normals of the planes between them, inwards
};

std::string sizeText(const cv::Mat& image) {
  return std::to_string(image.cols) + "x" + std::to_string(image.rows);
}

std::string sizeText(const Intrinsics& k) { return std::to_string(k.width) + "x" + std::to_string(k.height); }

bool hasSizeOf(const cv::Mat& image, const Intrinsics& k) {
  return image.cols == k.width && image.rows == k.height;
}

// A copy, because the caller's pixels may belong to a message.
cv::Mat colourCopy(const cv::Mat& image, const Intrinsics& k) {
  if (image.empty()) return {};
  if (!hasSizeOf(image, k)) {
    throw Error(ErrorCause::kImage, "The image is " + sizeText(image) + " but the camera info says " +
                                        sizeText(k) + ": use the camera info that belongs to this image.");
  }
  cv::Mat colour;
  if (image.type() == CV_8UC3) {
    colour = image.clone();
  } else if (image.type() == CV_8UC1) {
    cv::cvtColor(image, colour, cv::COLOR_GRAY2BGR);
  } else {
    throw Error(ErrorCause::kImage, "The image has OpenCV type " + cv::typeToString(image.type()) +
                                        ": convert it to CV_8UC1 or CV_8UC3 (mono8 or bgr8).");
  }
  return colour;
}

cv::Mat idealImage(const Camera& camera, const cv::Mat& image) {
  return camera.distorted() && !image.empty() ? camera.toIdeal(image, cv::INTER_LINEAR) : image;
}

MaskSets idealMasks(const Camera& camera, const std::vector<cv::Mat>& layers, int min_masks) {
  if (layers.empty())
    throw Error(ErrorCause::kMasks, "The frame has no mask layer: give at least one label image.");
  for (const cv::Mat& layer : layers) {
    if (!hasSizeOf(layer, camera.intrinsics())) {
      throw Error(ErrorCause::kMasks,
                  "A mask layer is " + sizeText(layer) + " but the camera's image is " +
                      sizeText(camera.intrinsics()) +
                      ": make the masks from the full image, without scaling or cropping.");
    }
    if (layer.type() != CV_32SC1) {
      throw Error(ErrorCause::kMasks, "A mask layer has OpenCV type " + cv::typeToString(layer.type()) +
                                          ": convert it to a CV_32SC1 label image.");
    }
  }
  MaskSets masks = MaskSets::fromLayers(layers);
  if (camera.distorted()) masks = masks.toIdeal(camera);
  if (static_cast<long>(masks.maskCount()) < min_masks) {
    throw Error(ErrorCause::kNotEnough, "The frame has " + std::to_string(masks.maskCount()) +
                                            " masks, min_masks is " + std::to_string(min_masks) +
                                            ": let the segmentation make finer masks, or lower min_masks.");
  }
  return masks;
}

// The points within the range limits that come into the image by some rotation within the margin.
PointCloud crop(const PointCloud& cloud, const FieldOfView& field, const Eigen::Isometry3d& guess,
                const FrameConfig& config) {
  const double margin = config.crop_margin_deg * kDegree;
  const std::vector<std::uint16_t> rings = ringsOf(cloud);
  PointCloud result;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double range = cloud.points[i].norm();
    if (range < config.min_range || range > config.max_range) continue;
    const Eigen::Vector3d in_camera = guess * cloud.points[i].cast<double>();
    if (field.angleTo(in_camera.normalized()) > margin) continue;
    result.points.push_back(cloud.points[i]);
    if (cloud.hasReflectivity()) result.reflectivity.push_back(cloud.reflectivity[i]);
    if (!rings.empty()) result.ring.push_back(rings[i]);
  }
  const std::size_t min_points = static_cast<std::size_t>(std::max(config.min_points, 1));
  if (result.size() < min_points) {
    throw Error(ErrorCause::kNotEnough,
                "Only " + std::to_string(result.size()) + " of the cloud's " + std::to_string(cloud.size()) +
                    " points are between min_range and max_range and near the camera's view, min_points is " +
                    std::to_string(min_points) +
                    ": check the initial extrinsic and its frames, or lower min_points.");
  }
  if (config.edges && rings.empty()) {
    throw Error(
        ErrorCause::kCloud,
        "The cloud shows no rings, on which the objective consistency_edges finds its edges: set "
        "objective and search to paper for a LiDAR that does not spin; for one that does, let the driver "
        "publish the field ring.");
  }
  return result;
}

FramePoints framePoints(const PointCloud& cloud, const LidarFeatures& features,
                        const std::vector<std::size_t>& chosen) {
  FramePoints p;
  p.segment_count = features.segment_count;
  for (auto* column : {&p.x, &p.y, &p.z, &p.nx, &p.ny, &p.nz}) column->reserve(chosen.size());
  p.segment.reserve(chosen.size());
  if (!features.reflectivity.empty()) p.reflectivity.reserve(chosen.size());
  for (const std::size_t i : chosen) {
    p.x.push_back(cloud.points[i].x());
    p.y.push_back(cloud.points[i].y());
    p.z.push_back(cloud.points[i].z());
    p.nx.push_back(features.normals[i].x());
    p.ny.push_back(features.normals[i].y());
    p.nz.push_back(features.normals[i].z());
    p.segment.push_back(features.segment[i]);
    if (!features.reflectivity.empty()) p.reflectivity.push_back(features.reflectivity[i]);
  }
  return p;
}

template <typename T>
std::size_t bytes(const std::vector<T>& values) {
  return values.capacity() * sizeof(T);
}

std::size_t bytes(const cv::Mat& image) { return image.total() * image.elemSize(); }

}  // namespace

FramePtr makeFrame(double stamp, const Camera& camera, const cv::Mat& image,
                   const std::vector<cv::Mat>& layers, const PointCloud& cloud,
                   const Eigen::Isometry3d& guess, const FrameConfig& config) {
  checkCloud(cloud);
  cv::Mat colour = colourCopy(image, camera.intrinsics());
  MaskSets masks = idealMasks(camera, layers, config.min_masks);
  const PointCloud cropped = crop(cloud, FieldOfView(camera.intrinsics()), guess, config);
  const LidarFeatures features = computeLidarFeatures(cropped, config.features);
  const std::vector<std::uint8_t> visible = visiblePoints(cropped.points, guess);

  EdgePoints edges;
  std::shared_ptr<const BoundaryField> borders;
  if (config.edges) {
    edges = findLidarEdges(cropped, features, config.cull_hidden ? visible : std::vector<std::uint8_t>());
    shareWeights(edges);
    borders =
        std::make_shared<const BoundaryField>(maskBorders(masks.setOfPixel(), idealImage(camera, colour)),
                                              masks.setOfPixel().size(), camera.intrinsics().fx);
  }

  std::vector<std::size_t> chosen;
  std::vector<std::uint8_t> chosen_visible;
  for (std::size_t i = 0; i < cropped.size(); ++i) {
    if (config.cull_hidden && !visible[i]) continue;
    chosen.push_back(i);
    chosen_visible.push_back(visible[i]);
  }
  chosen_visible.shrink_to_fit();
  return std::make_shared<const Frame>(
      Frame{stamp, camera, std::move(colour), std::move(masks), framePoints(cropped, features, chosen),
            std::move(chosen_visible), std::move(edges), std::move(borders)});
}

std::size_t memoryUse(const Frame& frame) {
  const FramePoints& p = frame.points;
  std::size_t sum = sizeof(Frame) + bytes(frame.image) + bytes(frame.visible);
  sum += bytes(frame.masks.setOfPixel()) + bytes(frame.masks.setBegin()) + bytes(frame.masks.setMasks());
  for (const auto* column : {&p.x, &p.y, &p.z, &p.nx, &p.ny, &p.nz, &p.reflectivity}) sum += bytes(*column);
  const EdgePoints& e = frame.edges;
  for (const auto* column : {&e.x, &e.y, &e.z, &e.weight}) sum += bytes(*column);
  if (frame.borders) sum += frame.borders->bytes();
  return sum + bytes(e.kind) + bytes(p.segment);
}

}  // namespace lidar_camera_recalibration
