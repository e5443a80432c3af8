#pragma once

#include <dynamic_reconfigure/Config.h>
#include <dynamic_reconfigure/ConfigDescription.h>
#include <dynamic_reconfigure/Reconfigure.h>

#include "server_config.hpp"

namespace lidar_camera_recalibration {

/// The live parameters in the messages of dynamic_reconfigure, for `dynparam` and `rqt_reconfigure`. They
/// come from the table of server_config, not from a .cfg file: names, ranges and defaults are written down
/// once.
dynamic_reconfigure::ConfigDescription describeLiveParameters();

dynamic_reconfigure::Config liveConfig(const ServerConfig& config);

/// Not checked; setLiveParameters() does that.
Parameters valuesOf(const dynamic_reconfigure::Config& config);

}  // namespace lidar_camera_recalibration
