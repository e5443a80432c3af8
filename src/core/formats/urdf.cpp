// URDF: an <origin xyz rpy/> is the pose of the child link in the parent link, R = Rz(yaw) Ry(pitch) Rx(roll)
// (wiki.ros.org/urdf/XML/joint). Read are a bare <origin/>, as the camera's optical frame (child) in the
// LiDAR frame (parent), one <joint>, and a whole <robot>, along its fixed joints. Written is one joint, for
// pasting.

#include <tinyxml2.h>

#include <stdexcept>

#include "format.hpp"
#include "frame_tree.hpp"
#include "text.hpp"

namespace lidar_camera_recalibration {
namespace {

using tinyxml2::XMLElement;

void parse(const std::string& text, tinyxml2::XMLDocument& document) {
  if (document.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS || document.RootElement() == nullptr)
    throw std::runtime_error(std::string("is no XML: ") + document.ErrorStr());
}

Eigen::Vector3d vector(const XMLElement& origin, const char* attribute) {
  const char* text = origin.Attribute(attribute);
  if (text == nullptr) return Eigen::Vector3d::Zero();
  if (std::string(text).find("${") != std::string::npos)
    throw std::runtime_error(std::string("the origin's ") + attribute + " is \"" + text +
                             "\": resolve the macros with xacro first");
  const std::vector<double> values = numbersFrom(text);
  if (values.size() != 3)
    throw std::runtime_error(std::string("the origin's ") + attribute + " has " +
                             std::to_string(values.size()) + " numbers, not 3");
  return {values[0], values[1], values[2]};
}

/// The identity where a joint has none.
Eigen::Isometry3d pose(const XMLElement* origin) {
  return origin == nullptr ? Eigen::Isometry3d::Identity()
                           : poseFromRpy(vector(*origin, "xyz"), vector(*origin, "rpy"));
}

std::string link(const XMLElement& joint, const char* end) {
  const XMLElement* element = joint.FirstChildElement(end);
  const char* name = element == nullptr ? nullptr : element->Attribute("link");
  if (name == nullptr) throw std::runtime_error(std::string("a joint has no <") + end + " link=\"...\"/>");
  return name;
}

/// What joints that move carry hangs on nothing.
FrameTree fixedFrames(const XMLElement& robot) {
  FrameTree frames;
  for (const XMLElement* joint = robot.FirstChildElement("joint"); joint != nullptr;
       joint = joint->NextSiblingElement("joint")) {
    const char* type = joint->Attribute("type");
    if (type == nullptr || std::string(type) != "fixed") continue;
    frames.add(link(*joint, "parent"), link(*joint, "child"), pose(joint->FirstChildElement("origin")));
  }
  return frames;
}

StoredCalibration readRobot(const XMLElement& robot, const FormatOptions& options) {
  const FrameTree frames = fixedFrames(robot);
  if (options.camera_frame.empty() || options.lidar_frame.empty())
    throw std::runtime_error(
        "name the camera's optical frame and the frame of the points (camera_frame, lidar_frame); the "
        "links of fixed joints are " +
        joined(frames.children()));
  StoredCalibration calibration;
  calibration.T_camera_lidar = frames.transform(options.camera_frame, options.lidar_frame);
  return calibration;
}

CalibrationContents read(const FormatSource& source) {
  tinyxml2::XMLDocument document;
  parse(source.text, document);
  const XMLElement& root = *document.RootElement();
  const std::string name = root.Name();
  CalibrationContents contents;
  if (name == "robot") {
    contents.calibration = readRobot(root, source.options);
  } else if (name == "joint" || name == "origin") {
    contents.calibration.emplace();
    const XMLElement* origin = name == "origin" ? &root : root.FirstChildElement("origin");
    contents.calibration->T_camera_lidar = pose(origin).inverse();
    if (name == "joint") {
      contents.calibration->lidar_frame = link(root, "parent");
      contents.calibration->camera_frame = link(root, "child");
    }
  } else {
    throw std::runtime_error("the outermost element is <" + name + ">, none of <robot>, <joint>, <origin>");
  }
  return contents;
}

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    result += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '"' ? "&quot;" : std::string(1, c);
  }
  return result;
}

std::string write(const CalibrationContents& contents, const FormatTarget& target) {
  const StoredCalibration& c = requireCalibration(contents);
  if (target.existing.find("<robot") != std::string::npos)
    throw std::runtime_error(
        "a robot's description is not changed; write to another file and paste the joint");
  const std::string child = escaped(c.camera_frame);
  return "<joint name=\"" + child + "_joint\" type=\"fixed\">\n  <parent link=\"" + escaped(c.lidar_frame) +
         "\"/>\n  <child link=\"" + child + "\"/>\n  " + urdfOrigin(c) + "\n</joint>\n";
}

}  // namespace

const Format kUrdf = {"urdf",
                      "URDF: a fixed joint between LiDAR and optical frame; reads a whole robot",
                      {true, false},
                      [](const std::string& text) {
                        return text.find_first_not_of(" \t\r\n") != std::string::npos &&
                               text[text.find_first_not_of(" \t\r\n")] == '<';
                      },
                      [](const std::string& name) {
                        return hasEnding(name, {".urdf", ".xml", ".xacro"});
                      },
                      read,
                      write};

}  // namespace lidar_camera_recalibration
