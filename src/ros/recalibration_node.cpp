#include <ros/ros.h>

#include "node_interface.hpp"

int main(int argc, char** argv) {
  ros::init(argc, argv, "recalibration");
  const lidar_camera_recalibration::NodeInterface interface { ros::NodeHandle(), ros::NodeHandle("~") };
  if (!interface.isWorking()) return 1;
  ros::spin();
  return 0;
}
