#pragma once

#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

namespace lidar_camera_recalibration {

/// @throw std::runtime_error naming the key.
inline const nlohmann::json& jsonMember(const nlohmann::json& object, const std::string& key) {
  if (!object.is_object() || object.count(key) == 0)
    throw std::runtime_error("the key " + key + " is missing");
  return object.at(key);
}

/// @param where  what the object is, for the message
template <typename Value>
Value jsonValue(const nlohmann::json& object, const std::string& key, const std::string& where) {
  const std::string name = where.empty() ? key : where + "/" + key;
  if (!object.is_object() || object.count(key) == 0)
    throw std::runtime_error("the key " + name + " is missing");
  try {
    return object.at(key).get<Value>();
  } catch (const nlohmann::json::exception& error) {
    throw std::runtime_error("the key " + name + " has an unsuitable value: " + error.what());
  }
}

}  // namespace lidar_camera_recalibration
