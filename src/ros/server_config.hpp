#pragma once

#include <xmlrpcpp/XmlRpcValue.h>

#include <Eigen/Geometry>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "frame_synchroniser.hpp"
#include "lidar_camera_recalibration/calibrator.hpp"
#include "lidar_camera_recalibration/drift_monitor.hpp"
#include "lidar_camera_recalibration/frame.hpp"
#include "lidar_camera_recalibration/overlay.hpp"

namespace lidar_camera_recalibration {

/// Names of topics; empty: not named.
struct InputTopics {
  std::string image, camera_info, points, masks;
};

/// All that the server can be told. config/recalibration.yaml explains every member; the defaults are here
/// and in the core's structs.
struct ServerConfig {
  std::string mode = "manual";
  double automatic_min_interval = 60.0;  ///< between two searches that a drift starts [s]

  // Inputs
  InputTopics topics;
  SynchroniserConfig synchroniser;
  std::string camera_info_file;  ///< instead of the topic
  bool image_rectified = false;
  bool compressed = false;        ///< the node subscribes to image/compressed
  bool masks_compressed = false;  ///< and to masks/compressed
  std::string intensity_field;    ///< empty: automatic
  std::string camera_frame;       ///< optical frame; empty: the image's frame id
  std::string lidar_frame;        ///< empty: the cloud's frame id
  std::string fixed_frame;        ///< in which clouds are moved to their images; empty: taken as they are
  bool deskew = true;             ///< false: clouds are compensated already, though their points carry times

  // Initial guess: the saved result, or this matrix, or tf
  std::optional<Eigen::Isometry3d> initial_T_camera_lidar;
  bool initial_from_saved = true;

  // Frames
  FrameConfig frame;
  int frames_min = 5;
  int frames_max = 15;                     ///< of two that are alike the older one leaves
  double frames_min_interval = 1.0;        ///< between the stamps of two kept frames [s]
  double frames_min_view_change = 0.1;     ///< share of the view, 0..1
  double frames_max_turn_rate_deg = 15.0;  ///< with fixed_frame [deg/s]
  std::size_t frames_max_bytes = 512u * 1024 * 1024;
  bool frames_keep_images = false;  ///< for a report of the search; not counted in frames_max_bytes

  // Search and gate
  CalibratorConfig calibrator;
  double service_timeout = 300.0;  ///< of ~recalibrate with wait [s]

  DriftConfig monitor;

  // Outputs
  std::string tf_child_frame;  ///< empty: <camera frame>_recalibrated
  bool tf_publish = true;
  std::string tf_correct_parent,
      tf_correct_child;     ///< both or none: the edge of the vehicle's chain that this node owns
  std::string result_file;  ///< written after each accepted result and by ~save; empty: never by itself
  OverlayColor overlay_color = OverlayColor::kDepth;
  bool overlay_compare = false;  ///< start and result one above the other
};

/// Looks up a parameter by its private name (`gate/min_significance`); false if it is not set.
using ParameterSource = std::function<bool(const std::string& name, XmlRpc::XmlRpcValue& value)>;

/// Parameters by their private names.
using Parameters = std::map<std::string, XmlRpc::XmlRpcValue>;

/// Every parameter that exists, in the order of config/recalibration.yaml.
std::vector<std::string> parameterNames();

/// What a parameter may be, in words: `a number from 0 to 1`. @throw Error(kParameter) for an unknown name.
std::string allowedValues(const std::string& name);

/// A member of the configuration as YAML text. @throw Error(kParameter) for an unknown name.
std::string parameterText(const ServerConfig& config, const std::string& name);

/// @throw Error(kParameter) naming the parameter, its value and what is allowed.
ServerConfig readServerConfig(const ParameterSource& source);

/// A parameter that may change while the node runs, as tools show it.
struct LiveParameter {
  std::string name;
  std::string allowed;             ///< in words
  XmlRpc::XmlRpcValue min, max;    ///< of the type of its values; "" for words
  std::vector<std::string> words;  ///< of a choice
};

/// Those of the gate and of the drawing.
std::vector<LiveParameter> liveParameters();

/// @throw Error(kParameter) for one that is not live.
XmlRpc::XmlRpcValue parameterValue(const ServerConfig& config, const std::string& name);

/// All values, or none: @throw Error(kParameter) naming the parameter, its value and what is allowed.
/// Touches no member of another parameter.
void setLiveParameters(const Parameters& values, ServerConfig& config);

/// A sentence for each name that is no parameter, with the most similar one that is.
std::vector<std::string> unknownParameters(const std::vector<std::string>& names);

/// A tree as the parameter server gives it (nested structs) to `group/name`.
Parameters flatten(const XmlRpc::XmlRpcValue& tree);

/// A parameter file, read without a parameter server. @throw Error(kFile) naming the file and the line.
Parameters readParameterFile(const std::string& path);

ParameterSource sourceOf(const Parameters& parameters);

}  // namespace lidar_camera_recalibration
