#pragma once

#include <map>
#include <string>
#include <vector>

#include "server_config.hpp"

namespace XmlRpc {
class XmlRpcValue;
}

namespace lidar_camera_recalibration {

/// The node's parameters without a parameter server: a YAML file as `rosparam load` takes it, then
/// `name=value` words.
/// @throw Error(kParameter) for a name that does not exist or a value that cannot be read, Error(kFile) for
/// the file.
ServerConfig loadServerConfig(const std::string& yaml_file, const std::vector<std::string>& assignments);

}  // namespace lidar_camera_recalibration
