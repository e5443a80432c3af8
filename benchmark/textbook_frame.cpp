#include "textbook_frame.hpp"

namespace lidar_camera_recalibration::performance {
namespace {

std::vector<cv::Mat> binaryMasks(const MaskSets& sets) {
  std::vector<cv::Mat> masks;
  for (std::size_t m = 0; m < sets.maskCount(); ++m) {
    masks.push_back(cv::Mat::zeros(sets.setOfPixel().size(), CV_8UC1));
  }
  for (int v = 0; v < sets.height(); ++v) {
    for (int u = 0; u < sets.width(); ++u) {
      const std::uint16_t set = sets.setOfPixel().at<std::uint16_t>(v, u);
      for (std::uint32_t k = sets.setBegin()[set]; k < sets.setBegin()[set + 1u]; ++k) {
        masks[sets.setMasks()[k]].at<std::uint8_t>(v, u) = 255;
      }
    }
  }
  return masks;
}

}  // namespace

textbook::Frame textbookFrame(const Frame& frame) {
  const Intrinsics& camera = frame.camera.intrinsics();
  textbook::Frame result;
  result.K = cv::Matx33d(camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0);
  result.masks = binaryMasks(frame.masks);
  const FramePoints& p = frame.points;
  for (std::size_t i = 0; i < p.size(); ++i) {
    result.points.push_back({{p.x[i], p.y[i], p.z[i]},
                             {p.nx[i], p.ny[i], p.nz[i]},
                             p.hasReflectivity() ? p.reflectivity[i] : 0.0,
                             p.segment[i]});
  }
  return result;
}

}  // namespace lidar_camera_recalibration::performance
