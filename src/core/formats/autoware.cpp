// Autoware's sensors_calibration.yaml and sensor_kit_calibration.yaml: `parent: {child: {x, y, z, roll,
// pitch, yaw}}`, the pose of the child in the parent [m, rad], angles as in URDF. Conventions from
// autowarefoundation/ sample_sensor_kit_launch: a camera's entry is its *body* frame NAME/camera_link (x
// forward, y left, z up), below which monocular_camera.xacro puts NAME/camera_optical_link with rpy -pi/2 0
// -pi/2. A LiDAR's entry is its foot, NAME_base_link; its model's xacro puts the frame of the points, NAME,
// some centimetres above (VLS-128 0.06611, Pandar40P 0.047 m), which no calibration file tells.

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <stdexcept>

#include "format.hpp"
#include "frame_tree.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "text.hpp"

namespace lidar_camera_recalibration {
namespace {

namespace fs = std::filesystem;

constexpr std::array<const char*, 6> kKeys = {"x", "y", "z", "roll", "pitch", "yaw"};
constexpr std::array<const char*, 2> kFileNames = {"sensors_calibration.yaml", "sensor_kit_calibration.yaml"};
constexpr const char* kFoot = "_base_link";

bool isPose(const YAML::Node& node) {
  return node.IsMap() &&
         std::all_of(kKeys.begin(), kKeys.end(), [&](const char* key) { return node[key].IsDefined(); });
}

Eigen::Isometry3d poseOf(const YAML::Node& node, const std::string& entry) {
  Eigen::Matrix<double, 6, 1> values;
  for (std::size_t i = 0; i < kKeys.size(); ++i) {
    const YAML::Node value = node[kKeys[i]];
    if (!value) throw std::runtime_error("the entry '" + entry + "' has no " + kKeys[i]);
    try {
      values[static_cast<Eigen::Index>(i)] = value.as<double>();
    } catch (const YAML::Exception&) {
      throw std::runtime_error(std::string(kKeys[i]) + " of the entry '" + entry + "' is no number");
    }
  }
  try {
    return poseFromRpy(values.head<3>(), values.tail<3>());
  } catch (const Error& error) {
    throw Error(error.cause(), "the entry '" + entry + "': " + error.what());
  }
}

void addFrames(const YAML::Node& root, FrameTree& frames) {
  for (const auto& parent : root) {
    if (!parent.second.IsMap()) continue;
    for (const auto& child : parent.second) {
      const auto name = child.first.as<std::string>();
      frames.add(parent.first.as<std::string>(), name, poseOf(child.second, name));
    }
  }
}

/// Also of the other of the two files if it lies beside this one: a sensor may be in either.
FrameTree framesOf(const std::string& text, const fs::path& path) {
  FrameTree frames;
  addFrames(YAML::Load(text), frames);
  for (const char* name : kFileNames) {
    const fs::path other = path.parent_path() / name;
    const bool is_sibling = std::count(kFileNames.begin(), kFileNames.end(), path.filename().string()) > 0 &&
                            path.filename() != name && fs::exists(other);
    if (is_sibling) addFrames(YAML::Load(readCalibrationText(other.string())), frames);
  }
  return frames;
}

std::string without(const std::string& name, const std::string& part) {
  const std::size_t found = name.rfind(part);
  return found == std::string::npos ? name : name.substr(0, found) + name.substr(found + part.size());
}

/// An entry, and where the wanted frame lies in it.
struct Mount {
  std::string entry, frame;
  Eigen::Isometry3d T_entry_frame;
};

Eigen::Isometry3d opticalInBody() { return poseFromRpy({0.0, 0.0, 0.0}, {-M_PI / 2.0, 0.0, -M_PI / 2.0}); }

/// The only one of the entries that fits.
template <typename Fits>
std::string onlyEntry(const FrameTree& frames, const std::string& option, const Fits& fits) {
  std::vector<std::string> found;
  for (const std::string& name : frames.children()) {
    if (fits(name)) found.push_back(name);
  }
  if (found.size() == 1) return found.front();
  throw std::runtime_error(
      "name the " + option + "; " +
      (found.empty() ? "the entries are " + joined(frames.children()) : "these may be it: " + joined(found)));
}

Mount cameraMount(const FrameTree& frames, const FormatOptions& options) {
  std::string frame = options.camera_frame;
  if (frame.empty()) {
    frame = onlyEntry(frames, "camera's optical frame (camera_frame), such as camera0/camera_optical_link",
                      [](const std::string& name) { return name.find("camera") != std::string::npos; });
  }
  const bool optical = frame.find("optical") != std::string::npos;
  if (optical && frames.has(frame)) return {frame, frame, Eigen::Isometry3d::Identity()};
  const std::string body = without(frame, "_optical");
  if (!frames.has(body)) {
    throw std::runtime_error("there is no entry for the camera frame '" + frame + "' (it would be '" + body +
                             "'); the entries are " + joined(frames.children()));
  }
  const std::size_t end = body.rfind("_link");
  const std::string optical_frame = optical                    ? frame
                                    : end == std::string::npos ? body + "_optical"
                                                               : body.substr(0, end) + "_optical_link";
  return {body, optical_frame, opticalInBody()};
}

Mount lidarMount(const FrameTree& frames, const FormatOptions& options) {
  std::string frame = options.lidar_frame;
  if (frame.empty()) {
    frame = onlyEntry(
        frames, "frame of the LiDAR's points (lidar_frame), such as velodyne_top",
        [&](const std::string& name) { return hasEnding(name, {kFoot}) && !frames.isParent(name); });
  }
  if (frames.has(frame)) return {frame, frame, Eigen::Isometry3d::Identity()};
  const std::string foot = frame + kFoot;
  if (!frames.has(foot)) {
    throw std::runtime_error("there is no entry for the LiDAR frame '" + frame + "'; the entries are " +
                             joined(frames.children()));
  }
  if (!options.lidar_height) {
    throw std::runtime_error(
        "the entry '" + foot + "' is the LiDAR's foot; say how far the frame of the points '" + frame +
        "' lies above it (lidar_height; VLS-128: 0.06611, Pandar40P: 0.047 m, others: see the "
        "LiDAR's xacro)");
  }
  return {foot, frame, Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, *options.lidar_height))};
}

CalibrationContents read(const FormatSource& source) {
  const FrameTree frames = framesOf(source.text, source.path);
  const Mount camera = cameraMount(frames, source.options), lidar = lidarMount(frames, source.options);
  CalibrationContents contents;
  contents.calibration.emplace();
  contents.calibration->T_camera_lidar =
      camera.T_entry_frame.inverse() * frames.transform(camera.entry, lidar.entry) * lidar.T_entry_frame;
  contents.calibration->camera_frame = camera.frame;
  contents.calibration->lidar_frame = lidar.frame;
  if (hasEnding(lidar.frame, {kFoot}) && source.options.lidar_frame.empty()) {
    contents.notes.push_back("the extrinsic is that of the LiDAR's foot '" + lidar.entry +
                             "'; name the frame of the points if they are given in another");
  }
  return contents;
}

// --- writing ---

using Pose = std::array<double, 6>;

Pose poseNumbers(const Eigen::Isometry3d& T) {
  const Eigen::Vector3d t = T.translation(), rpy = rollPitchYaw(T.linear());
  return {t[0], t[1], t[2], rpy[0], rpy[1], rpy[2]};
}

std::string entryText(const std::string& name, const Pose& pose) {
  std::string text = "  " + name + ":\n";
  for (std::size_t i = 0; i < kKeys.size(); ++i)
    text += "    " + std::string(kKeys[i]) + ": " + number(pose[i]) + "\n";
  return text;
}

/// The text with the six numbers exchanged; comments, order and all other entries stay as they are.
std::string withPose(std::string text, const YAML::Node& entry, const Pose& pose) {
  std::vector<std::pair<std::size_t, std::size_t>>
      places;  // of a number in the text, and of its value in `pose`
  for (std::size_t i = 0; i < kKeys.size(); ++i) {
    const std::size_t begin = static_cast<std::size_t>(entry[kKeys[i]].Mark().pos);
    const std::string old = entry[kKeys[i]].Scalar();
    if (text.compare(begin, old.size(), old) != 0)
      throw std::runtime_error(std::string("the number ") + kKeys[i] +
                               " is written in a way that cannot be replaced");
    places.emplace_back(begin, i);
  }
  std::sort(places.rbegin(), places.rend());  // from the end, so that the others keep their places
  for (const auto& [begin, i] : places) text.replace(begin, entry[kKeys[i]].Scalar().size(), number(pose[i]));
  return text;
}

/// A sensor kit that stands in the LiDAR.
std::string newFile(const StoredCalibration& c, const FormatOptions& options) {
  const double height = options.lidar_height.value_or(0.0);
  const std::string foot = options.lidar_height ? c.lidar_frame + kFoot : c.lidar_frame;
  const Eigen::Isometry3d T_foot_camera =
      Eigen::Translation3d(0.0, 0.0, height) * c.T_camera_lidar.inverse() * opticalInBody().inverse();
  return "sensor_kit_base_link:\n" + entryText(foot, Pose{}) +
         entryText(without(c.camera_frame, "_optical"), poseNumbers(T_foot_camera));
}

std::string write(const CalibrationContents& contents, const FormatTarget& target) {
  const StoredCalibration& calibration = requireCalibration(contents);
  if (calibration.camera_frame.empty() || calibration.lidar_frame.empty())
    throw std::runtime_error(
        "the format names its entries after the frames: name camera_frame and lidar_frame");
  if (target.existing.empty()) return newFile(calibration, target.options);

  FormatOptions options = target.options;
  options.camera_frame = calibration.camera_frame;
  options.lidar_frame = calibration.lidar_frame;
  const FrameTree frames = framesOf(target.existing, target.path);
  const Mount camera = cameraMount(frames, options), lidar = lidarMount(frames, options);
  // The LiDAR stays where it is; the camera moves.
  const YAML::Node root = YAML::Load(target.existing);
  for (const auto& parent : root) {
    const YAML::Node entry = parent.second.IsMap() ? parent.second[camera.entry] : YAML::Node();
    if (!entry || !isPose(entry)) continue;
    const Eigen::Isometry3d T_parent_lidar =
        frames.transform(parent.first.as<std::string>(), lidar.entry) * lidar.T_entry_frame;
    const Eigen::Isometry3d T_parent_entry =
        T_parent_lidar * calibration.T_camera_lidar.inverse() * camera.T_entry_frame.inverse();
    return withPose(target.existing, entry, poseNumbers(T_parent_entry));
  }
  throw std::runtime_error("the entry '" + camera.entry + "' is in the other file");
}

/// Some entry is a pose.
bool recognises(const std::string& text) {
  if (!isYamlMapWith(text, {})) return false;
  for (const auto& parent : YAML::Load(text)) {
    if (!parent.second.IsMap()) continue;
    for (const auto& child : parent.second) {
      if (child.second.IsMap() && child.second["yaw"] && child.second["x"]) return true;
    }
  }
  return false;
}

}  // namespace

const Format kAutoware = {
    "autoware",
    "Autoware's sensors_calibration.yaml and sensor_kit_calibration.yaml",
    {true, false},
    recognises,
    [](const std::string& name) { return std::count(kFileNames.begin(), kFileNames.end(), name) > 0; },
    read,
    write};

}  // namespace lidar_camera_recalibration
