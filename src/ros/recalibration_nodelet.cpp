#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include <memory>

#include "node_interface.hpp"

namespace lidar_camera_recalibration {

class RecalibrationNodelet : public nodelet::Nodelet {
 private:
  void onInit() override {
    interface_ = std::make_unique<NodeInterface>(getNodeHandle(), getPrivateNodeHandle());
  }

  std::unique_ptr<NodeInterface> interface_;
};

}  // namespace lidar_camera_recalibration

PLUGINLIB_EXPORT_CLASS(lidar_camera_recalibration::RecalibrationNodelet, nodelet::Nodelet)
