#include "parameters.hpp"

#include <xmlrpcpp/XmlRpcValue.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {

namespace {

using Values = std::map<std::string, XmlRpc::XmlRpcValue>;

XmlRpc::XmlRpcValue toXmlRpc(const std::string& name, const YAML::Node& node) {
  if (node.IsSequence()) {
    XmlRpc::XmlRpcValue list;
    list.setSize(static_cast<int>(node.size()));
    for (std::size_t i = 0; i < node.size(); ++i) list[static_cast<int>(i)] = toXmlRpc(name, node[i]);
    return list;
  }
  if (!node.IsScalar()) throw Error(ErrorCause::kParameter, "the parameter " + name + " has no value");
  bool truth = false;
  int integer = 0;
  double number = 0.0;
  const bool quoted = node.Tag() == "!";
  if (quoted) return XmlRpc::XmlRpcValue(node.Scalar());
  if (YAML::convert<int>::decode(node, integer)) return XmlRpc::XmlRpcValue(integer);
  if (YAML::convert<double>::decode(node, number)) return XmlRpc::XmlRpcValue(number);
  if (YAML::convert<bool>::decode(node, truth)) return XmlRpc::XmlRpcValue(truth);
  return XmlRpc::XmlRpcValue(node.Scalar());
}

void checkName(const std::string& name) {
  const std::vector<std::string> known = parameterNames();
  if (std::find(known.begin(), known.end(), name) != known.end()) return;
  std::string list;
  for (const std::string& candidate : known) list += (list.empty() ? "" : ", ") + candidate;
  throw Error(ErrorCause::kParameter, "there is no parameter " + name + "; there are: " + list);
}

/// Nested maps become names with slashes, as on the parameter server.
void flatten(const YAML::Node& node, const std::string& prefix, Values& values) {
  for (const auto& entry : node) {
    const std::string name = prefix + entry.first.as<std::string>();
    if (entry.second.IsMap()) {
      flatten(entry.second, name + "/", values);
    } else {
      checkName(name);
      values[name] = toXmlRpc(name, entry.second);
    }
  }
}

void loadFile(const std::string& file, Values& values) {
  try {
    const YAML::Node root = YAML::LoadFile(file);
    if (!root.IsMap()) throw Error(ErrorCause::kFile, "it holds no parameters");
    flatten(root, "", values);
  } catch (const YAML::Exception& error) {
    throw Error(ErrorCause::kFile, "\"" + file + "\" cannot be read: " + error.what());
  } catch (const Error& error) {
    throw Error(error.cause(), "\"" + file + "\": " + error.what());
  }
}

void assign(const std::string& assignment, Values& values) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos) {
    throw Error(ErrorCause::kParameter, "\"" + assignment + "\" is not of the form name=value");
  }
  const std::string name = assignment.substr(0, equals);
  checkName(name);
  try {
    const YAML::Node value = YAML::Load(assignment.substr(equals + 1));
    values[name] = value.IsNull() ? XmlRpc::XmlRpcValue("") : toXmlRpc(name, value);
  } catch (const YAML::Exception& error) {
    throw Error(ErrorCause::kParameter, "\"" + assignment + "\" cannot be read: " + error.what());
  }
}

}  // namespace

ServerConfig loadServerConfig(const std::string& yaml_file, const std::vector<std::string>& assignments) {
  Values values;
  if (!yaml_file.empty()) loadFile(yaml_file, values);
  for (const std::string& assignment : assignments) assign(assignment, values);
  return readServerConfig([&values](const std::string& name, XmlRpc::XmlRpcValue& value) {
    const auto found = values.find(name);
    if (found == values.end()) return false;
    value = found->second;
    return true;
  });
}

}  // namespace lidar_camera_recalibration
