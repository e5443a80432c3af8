#pragma once

#include <boost/program_options.hpp>
#include <string>
#include <vector>

#include "server_config.hpp"

namespace lidar_camera_recalibration {

/// One of several cameras of a recording, as `--camera
/// NAME=IMAGE[,masks=TOPIC][,camera_info=TOPIC][,PARAMETER=VALUE]` names it.
struct CameraOption {
  std::string name;                      ///< empty: the only one
  InputTopics topics;                    ///< empty ones are to be guessed
  std::vector<std::string> assignments;  ///< parameters that hold for this camera, `name=value`
};

/// `--camera`, into words for parseCameras().
void addCameraOption(boost::program_options::options_description& options, std::vector<std::string>& words);

/// @param topics  of the other options, which every camera shares
/// @return one for each word; without words one without a name, with the topics given
/// @throw boost::program_options::error
std::vector<CameraOption> parseCameras(const std::vector<std::string>& words, const InputTopics& topics);

/// The file of a camera: its name goes before the extension, `result.yaml` becomes `result_front.yaml`. Empty
/// stays empty.
std::string fileOf(const CameraOption& camera, const std::string& file);

/// The same of a file to be read, where there is one; else the file itself, which then holds for all cameras.
std::string inputFileOf(const CameraOption& camera, const std::string& file);

}  // namespace lidar_camera_recalibration
