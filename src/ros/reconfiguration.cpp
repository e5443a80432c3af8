#include "reconfiguration.hpp"

#include <string>

namespace lidar_camera_recalibration {
namespace {

using XmlRpc::XmlRpcValue;

constexpr const char* kGroup = "Default";  // what the tools take for the root

template <typename Entries, typename Value>
void add(Entries& entries, const std::string& name, const Value& value) {
  entries.emplace_back();
  entries.back().name = name;
  entries.back().value = value;
}

void add(dynamic_reconfigure::Config& config, const std::string& name, const XmlRpcValue& value) {
  switch (value.getType()) {
    case XmlRpcValue::TypeBoolean:
      return add(config.bools, name, static_cast<const bool&>(value));
    case XmlRpcValue::TypeInt:
      return add(config.ints, name, static_cast<const int&>(value));
    case XmlRpcValue::TypeDouble:
      return add(config.doubles, name, static_cast<const double&>(value));
    default:
      return add(config.strs, name, static_cast<const std::string&>(value));
  }
}

dynamic_reconfigure::Config inOneGroup() {
  dynamic_reconfigure::Config config;
  config.groups.resize(1);
  config.groups[0].name = kGroup;
  config.groups[0].state = true;
  return config;
}

const char* typeOf(const XmlRpcValue& value) {
  switch (value.getType()) {
    case XmlRpcValue::TypeBoolean:
      return "bool";
    case XmlRpcValue::TypeInt:
      return "int";
    case XmlRpcValue::TypeDouble:
      return "double";
    default:
      return "str";
  }
}

/// A choice, as the literal that the tools evaluate; empty for what is none.
std::string editMethod(const LiveParameter& parameter) {
  if (parameter.words.empty()) return "";
  std::string words;
  for (const std::string& word : parameter.words) {
    words += (words.empty() ? "" : ", ") +
             ("{'name': '" + word + "', 'type': 'str', 'value': '" + word +
              "', 'description': '', 'srcline': 0, 'srcfile': '', 'cconsttype': 'const char * const', "
              "'ctype': 'std::string'}");
  }
  return "{'enum_description': '" + parameter.name + "', 'enum': [" + words + "]}";
}

}  // namespace

dynamic_reconfigure::ConfigDescription describeLiveParameters() {
  dynamic_reconfigure::ConfigDescription description;
  description.dflt = liveConfig(ServerConfig());
  description.min = description.max = inOneGroup();
  description.groups.resize(1);
  description.groups[0].name = kGroup;
  for (const LiveParameter& parameter : liveParameters()) {
    add(description.min, parameter.name, parameter.min);
    add(description.max, parameter.name, parameter.max);
    dynamic_reconfigure::ParamDescription described;
    described.name = parameter.name;
    described.type = typeOf(parameter.min);
    described.description = parameter.allowed;
    described.edit_method = editMethod(parameter);
    description.groups[0].parameters.push_back(described);
  }
  return description;
}

dynamic_reconfigure::Config liveConfig(const ServerConfig& config) {
  dynamic_reconfigure::Config result = inOneGroup();
  for (const LiveParameter& parameter : liveParameters())
    add(result, parameter.name, parameterValue(config, parameter.name));
  return result;
}

Parameters valuesOf(const dynamic_reconfigure::Config& config) {
  Parameters values;
  for (const auto& entry : config.bools) values[entry.name] = XmlRpcValue(static_cast<bool>(entry.value));
  for (const auto& entry : config.ints) values[entry.name] = XmlRpcValue(static_cast<int>(entry.value));
  for (const auto& entry : config.doubles) values[entry.name] = XmlRpcValue(entry.value);
  for (const auto& entry : config.strs) values[entry.name] = XmlRpcValue(entry.value);
  return values;
}

}  // namespace lidar_camera_recalibration
