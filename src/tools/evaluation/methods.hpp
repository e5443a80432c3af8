#pragma once

#include <string>
#include <vector>

#include "server_config.hpp"

namespace lidar_camera_recalibration::evaluation {

/// What is to be measured, by the name that its rows carry.
struct Method {
  std::string name;
  ServerConfig config;
};

/// The parameters that come before those of the method.
struct CommonParameters {
  std::string yaml_file;                 ///< empty: none
  std::vector<std::string> assignments;  ///< `name=value`, over the method's own choices
};

/// The names of the known methods, for people.
std::string knownMethods();

/// @param word  the name of a known method; or `NAME:param=value,param=value`, a variant: the method NAME, or
/// the
///              default method if NAME is none, with these parameters over all others
/// @throw Error(kParameter) naming the word
Method parseMethod(const std::string& word, const CommonParameters& common);

}  // namespace lidar_camera_recalibration::evaluation
