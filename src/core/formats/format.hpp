#pragma once

#include <filesystem>
#include <initializer_list>
#include <string>
#include <utility>

#include "lidar_camera_recalibration/calibration_formats.hpp"

namespace lidar_camera_recalibration {

/// One row of the table of formats (calibration_formats.cpp). Functions throw any std::exception with a
/// sentence about the content; the caller puts the file's name before it.
struct FormatSource {
  std::filesystem::path path;  ///< for files beside it
  std::string text;
  const FormatOptions& options;
};

struct FormatTarget {
  std::filesystem::path path;  ///< for files beside it; empty: none
  std::string existing;        ///< what the file holds in the same format; empty if it is new
  const FormatOptions& options;
};

struct FormatParts {
  bool extrinsic, intrinsics;
};

struct Format {
  const char* name;
  const char* what;
  FormatParts parts;
  bool (*recognises)(const std::string& text);
  bool (*fitsName)(const std::string& file_name);  ///< of a new file
  CalibrationContents (*read)(const FormatSource& source);
  std::string (*write)(const CalibrationContents& contents, const FormatTarget& target);
};

extern const Format kResultYaml, kKittiRaw, kKittiOdometry, kCalibAnything, kVisualLidar, kAutoware, kKalibr,
    kCameraInfo, kUrdf;

// What several of them need.

bool hasEnding(const std::string& name, std::initializer_list<const char*> endings);

/// Whether the text is a YAML map (no JSON) with all these keys.
bool isYamlMapWith(const std::string& text, std::initializer_list<const char*> keys);

/// Whether the text is a JSON object with one of these keys.
bool isJsonObjectWith(const std::string& text, std::initializer_list<const char*> keys);

/// @throw std::runtime_error saying that the format cannot be written without it.
const StoredCalibration& requireCalibration(const CalibrationContents& contents);
const Intrinsics& requireIntrinsics(const CalibrationContents& contents);
const Intrinsics& requireSizedIntrinsics(const CalibrationContents& contents);  ///< with the image's size

}  // namespace lidar_camera_recalibration
