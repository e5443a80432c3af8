#pragma once

#include <optional>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/camera.hpp"
#include "lidar_camera_recalibration/result_file.hpp"

namespace lidar_camera_recalibration {

/// Calibration files of this and of other projects: read, written and converted. The sentences about their
/// conventions stand in src/core/formats/, one file a format.

/// What a calibration file holds. Every format has a part of it.
struct CalibrationContents {
  std::optional<StoredCalibration> calibration;
  /// Of the image as it was taken. Width and height are 0 where the format has none.
  std::optional<Intrinsics> intrinsics;
  std::optional<Intrinsics> rectified;  ///< of the rectified image, where the format has both
  std::vector<std::string> notes;       ///< what was taken for granted, in sentences
};

/// What the file alone does not tell.
struct FormatOptions {
  std::string format;        ///< by name; empty: told by the content, or for a new file by its name
  std::string camera_frame;  ///< optical frame
  std::string lidar_frame;   ///< frame of the points
  std::string camera;        ///< which one of several: KITTI's number (2), Kalibr's name (cam0)
  /// Autoware: how far the frame of the points lies above the LiDAR's foot, its `..._base_link` [m].
  std::optional<double> lidar_height;
};

struct FormatDescription {
  std::string name;
  bool has_extrinsic = false, has_intrinsics = false;
  std::string what;  ///< one line for people
};
std::vector<FormatDescription> calibrationFormats();

/// `FILE:FORMAT` or `FILE`; a colon that no known format follows belongs to the file's name.
void splitFormat(const std::string& argument, std::string& path, FormatOptions& options);

/// @throw Error(kFile) naming the file, the format that it was taken for, and what is wrong with it.
CalibrationContents readCalibrationFile(const std::string& path, const FormatOptions& options = {});

/// The extrinsic of a file. @throw Error(kFile) also if its format has none.
StoredCalibration readExtrinsic(const std::string& path, const FormatOptions& options = {});

/// The camera of a file. @throw Error(kFile) also if its format has none.
Intrinsics readIntrinsics(const std::string& path, const FormatOptions& options = {});

/// The format that a file would be written in: the one named, else that of the existing file, else by its
/// name.
/// @throw Error(kFile) if nothing tells it, Error(kParameter) for an unknown one.
FormatDescription formatForWriting(const std::string& path, const FormatOptions& options = {});

/// What writeCalibrationFile would write. If the file exists in that format, what it says of other sensors
/// stays. An empty path is a new file.
/// @throw Error(kFile) if the format needs what `contents` lacks, or the existing file does not fit.
std::string renderCalibration(const std::string& path, const CalibrationContents& contents,
                              const FormatOptions& options = {});

/// Whole or not at all, see writeFileAtomically().
void writeCalibrationFile(const std::string& path, const CalibrationContents& contents,
                          const FormatOptions& options = {});

}  // namespace lidar_camera_recalibration
