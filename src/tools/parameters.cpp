#include "parameters.hpp"

#include <xmlrpcpp/XmlRpcValue.h>
#include <yaml-cpp/yaml.h>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {

namespace {

XmlRpc::XmlRpcValue toXmlRpc(const YAML::Node& node) {
  if (node.IsSequence()) {
    XmlRpc::XmlRpcValue list;
    list.setSize(static_cast<int>(node.size()));
    for (std::size_t i = 0; i < node.size(); ++i) list[static_cast<int>(i)] = toXmlRpc(node[i]);
    return list;
  }
  bool truth = false;
  int whole = 0;
  double real = 0.0;
  if (YAML::convert<int>::decode(node, whole)) return whole;
  if (YAML::convert<double>::decode(node, real)) return real;
  if (YAML::convert<bool>::decode(node, truth)) return truth;
  return node.IsNull() ? std::string() : node.Scalar();
}

void assign(const std::string& assignment, Parameters& parameters) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos) {
    throw Error(ErrorCause::kParameter, "\"" + assignment + "\" is not of the form name=value");
  }
  try {
    parameters[assignment.substr(0, equals)] = toXmlRpc(YAML::Load(assignment.substr(equals + 1)));
  } catch (const YAML::Exception& error) {
    throw Error(ErrorCause::kParameter, "\"" + assignment + "\" cannot be read: " + error.what());
  }
}

}  // namespace

ServerConfig loadServerConfig(const std::string& yaml_file, const std::vector<std::string>& assignments) {
  Parameters parameters;
  if (!yaml_file.empty()) parameters = readParameterFile(yaml_file);
  for (const std::string& assignment : assignments) assign(assignment, parameters);
  std::vector<std::string> names;
  for (const auto& parameter : parameters) names.push_back(parameter.first);
  const std::vector<std::string> unknown = unknownParameters(names);
  if (!unknown.empty()) throw Error(ErrorCause::kParameter, unknown.front());
  return readServerConfig(sourceOf(parameters));
}

}  // namespace lidar_camera_recalibration
