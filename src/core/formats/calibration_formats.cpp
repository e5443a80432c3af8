#include "lidar_camera_recalibration/calibration_formats.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <stdexcept>

#include "format.hpp"
#include "json.hpp"
#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

namespace fs = std::filesystem;

/// The first that recognises a file wins, and the first whose kind of name fits.
const std::array<const Format*, 9>& table() {
  static const std::array<const Format*, 9> formats = {&kKittiRaw,    &kKittiOdometry, &kCalibAnything,
                                                       &kVisualLidar, &kAutoware,      &kKalibr,
                                                       &kCameraInfo,  &kUrdf,          &kResultYaml};
  return formats;
}

std::string known() {
  std::string text;
  for (const Format* format : table()) text += "\n  " + std::string(format->name) + ": " + format->what;
  return text;
}

Error fileError(const fs::path& path, const std::string& what) {
  return Error(ErrorCause::kFile, "calibration file '" + path.string() + "': " + what);
}

const Format* byName(const std::string& name) {
  for (const Format* format : table()) {
    if (format->name == name) return format;
  }
  return nullptr;
}

const Format& namedFormat(const std::string& name) {
  if (const Format* format = byName(name)) return *format;
  throw Error(ErrorCause::kParameter, "unknown calibration format '" + name + "'; known are" + known());
}

const Format* byContent(const std::string& text) {
  for (const Format* format : table()) {
    if (format->recognises(text)) return format;
  }
  return nullptr;
}

/// For the message about a file of no known format: what it is like.
std::string likeness(const std::string& text) {
  if (text.find_first_not_of(" \t\r\n") == std::string::npos) return "it is empty";
  if (text.find_first_of("{[") == text.find_first_not_of(" \t\r\n")) {
    const nlohmann::json root = nlohmann::json::parse(text, nullptr, false);
    if (root.is_discarded()) return "it begins like JSON, but is none";
    std::string keys;
    for (const auto& member : root.items()) keys += (keys.empty() ? "" : ", ") + member.key();
    return "it is JSON with the keys " + keys.substr(0, 200);
  }
  try {
    const YAML::Node root = YAML::Load(text);
    if (!root.IsMap()) return "it is no list of `key: value`";
    std::string keys;
    for (const auto& member : root) keys += (keys.empty() ? "" : ", ") + member.first.as<std::string>();
    return "it is YAML with the keys " + keys.substr(0, 200);
  } catch (const YAML::Exception& error) {
    return std::string("it is neither JSON nor XML nor YAML (") + error.what() + ")";
  }
}

const Format& formatOfFile(const fs::path& path, const std::string& text, const FormatOptions& options) {
  if (!options.format.empty()) return namedFormat(options.format);
  if (const Format* format = byContent(text)) return *format;
  throw fileError(path, "none of the known formats: " + likeness(text) + ". Known are" + known());
}

/// The file's own format if it exists and is known, else the one that its name asks for.
const Format& formatOfTarget(const fs::path& path, const std::string& existing,
                             const FormatOptions& options) {
  if (!options.format.empty()) return namedFormat(options.format);
  if (const Format* format = existing.empty() ? nullptr : byContent(existing)) return *format;
  for (const Format* format : table()) {
    if (format->fitsName(path.filename().string())) return *format;
  }
  throw fileError(path, "its name tells no format; name one of" + known());
}

std::string existingText(const std::string& path) {
  return !path.empty() && fs::exists(path) ? readCalibrationText(path) : "";
}

FormatDescription description(const Format& format) {
  return {format.name, format.parts.extrinsic, format.parts.intrinsics, format.what};
}

}  // namespace

// --- format.hpp ---

bool hasEnding(const std::string& name, std::initializer_list<const char*> endings) {
  return std::any_of(endings.begin(), endings.end(), [&name](const std::string& ending) {
    return name.size() >= ending.size() &&
           name.compare(name.size() - ending.size(), ending.size(), ending) == 0;
  });
}

bool isYamlMapWith(const std::string& text, std::initializer_list<const char*> keys) {
  try {
    const YAML::Node root = YAML::Load(text);
    return root.IsMap() &&
           std::all_of(keys.begin(), keys.end(), [&root](const char* key) { return root[key].IsDefined(); });
  } catch (const YAML::Exception&) {
    return false;
  }
}

bool isJsonObjectWith(const std::string& text, std::initializer_list<const char*> keys) {
  const nlohmann::json root = nlohmann::json::parse(text, nullptr, false);
  return root.is_object() &&
         std::any_of(keys.begin(), keys.end(), [&root](const char* key) { return root.count(key) > 0; });
}

const StoredCalibration& requireCalibration(const CalibrationContents& contents) {
  if (!contents.calibration) throw std::runtime_error("the format needs an extrinsic, and there is none");
  return *contents.calibration;
}

const Intrinsics& requireIntrinsics(const CalibrationContents& contents) {
  if (!contents.intrinsics)
    throw std::runtime_error("the format needs the camera's intrinsics; name a file that has them");
  return *contents.intrinsics;
}

const Intrinsics& requireSizedIntrinsics(const CalibrationContents& contents) {
  const Intrinsics& intrinsics = requireIntrinsics(contents);
  if (intrinsics.width <= 0 || intrinsics.height <= 0)
    throw std::runtime_error("the format needs the size of the image, which the other file does not tell");
  return intrinsics;
}

// --- the public face ---

std::vector<FormatDescription> calibrationFormats() {
  std::vector<FormatDescription> descriptions;
  for (const Format* format : table()) descriptions.push_back(description(*format));
  return descriptions;
}

void splitFormat(const std::string& argument, std::string& path, FormatOptions& options) {
  const std::size_t colon = argument.rfind(':');
  const bool named = colon != std::string::npos && byName(argument.substr(colon + 1)) != nullptr;
  path = named ? argument.substr(0, colon) : argument;
  if (named) options.format = argument.substr(colon + 1);
}

CalibrationContents readCalibrationFile(const std::string& path, const FormatOptions& options) {
  const std::string text = readCalibrationText(path);
  const Format& format = formatOfFile(path, text, options);
  try {
    CalibrationContents contents = format.read({path, text, options});
    if (contents.calibration) {
      StoredCalibration& calibration = *contents.calibration;
      if (calibration.camera_frame.empty()) calibration.camera_frame = options.camera_frame;
      if (calibration.lidar_frame.empty()) calibration.lidar_frame = options.lidar_frame;
      if (calibration.source.empty()) calibration.source = path;
    }
    if (contents.intrinsics && contents.intrinsics->width > 0) Camera(*contents.intrinsics);  // checks them
    return contents;
  } catch (const std::exception& error) {
    throw fileError(path, std::string(error.what()) + " (read as " + format.name + ")");
  }
}

StoredCalibration readExtrinsic(const std::string& path, const FormatOptions& options) {
  const CalibrationContents contents = readCalibrationFile(path, options);
  if (!contents.calibration) throw fileError(path, "holds intrinsics only, no extrinsic");
  return *contents.calibration;
}

Intrinsics readIntrinsics(const std::string& path, const FormatOptions& options) {
  const CalibrationContents contents = readCalibrationFile(path, options);
  if (!contents.intrinsics) throw fileError(path, "holds an extrinsic only, no intrinsics");
  return *contents.intrinsics;
}

FormatDescription formatForWriting(const std::string& path, const FormatOptions& options) {
  return description(formatOfTarget(path, existingText(path), options));
}

std::string renderCalibration(const std::string& path, const CalibrationContents& contents,
                              const FormatOptions& options) {
  std::string existing = existingText(path);
  const Format& format = formatOfTarget(path, existing, options);
  if (!format.recognises(existing)) existing.clear();
  try {
    return format.write(contents, {path, existing, options});
  } catch (const std::exception& error) {
    throw fileError(path, std::string("cannot be written as ") + format.name + ": " + error.what());
  }
}

void writeCalibrationFile(const std::string& path, const CalibrationContents& contents,
                          const FormatOptions& options) {
  writeFileAtomically(path, renderCalibration(path, contents, options));
}

}  // namespace lidar_camera_recalibration
