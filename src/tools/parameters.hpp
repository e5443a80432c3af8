#pragma once

#include <string>
#include <vector>

#include "server_config.hpp"

namespace lidar_camera_recalibration {

/// The node's parameters without a parameter server: a YAML file (may be empty), then `name=value` words.
/// Other than the node, which may be given more than it knows, this refuses names that do not exist.
/// @throw Error(kParameter, kFile)
ServerConfig loadServerConfig(const std::string& yaml_file, const std::vector<std::string>& assignments);

}  // namespace lidar_camera_recalibration
