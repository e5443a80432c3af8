#include "cameras.hpp"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <sstream>

#include "bag_topics.hpp"

namespace lidar_camera_recalibration {

namespace po = boost::program_options;

namespace {

constexpr char kForm[] = "NAME=IMAGE_TOPIC[,masks=TOPIC][,camera_info=TOPIC][,PARAMETER=VALUE]";

[[noreturn]] void refuse(const std::string& word, const std::string& what) {
  throw po::error("--camera " + word + ": " + what + "; the form is " + kForm);
}

bool isName(const std::string& name) {
  return !name.empty() && std::all_of(name.begin(), name.end(), [](unsigned char letter) {
    return std::isalnum(letter) != 0 || letter == '_' || letter == '-';
  });
}

CameraOption parseCamera(const std::string& word) {
  CameraOption camera;
  // A parameter file's topics of one camera are not those of another.
  camera.assignments = {"topics/image=", "topics/camera_info=", "topics/masks="};
  std::istringstream parts(word);
  for (std::string part; std::getline(parts, part, ',');) {
    const std::size_t equals = part.find('=');
    if (equals == std::string::npos || equals + 1 == part.size())
      refuse(word, "\"" + part + "\" names nothing");
    const std::string key = part.substr(0, equals), value = part.substr(equals + 1);
    if (camera.name.empty()) {
      if (!isName(key)) refuse(word, "a name consists of letters, digits, _ and -");
      camera.name = key;
      camera.topics.image = value;
    } else if (key == "masks") {
      camera.topics.masks = value;
    } else if (key == "camera_info") {
      camera.topics.camera_info = value;
    } else {
      camera.assignments.push_back(part);
    }
  }
  if (camera.name.empty()) refuse(word, "there is no name");
  return camera;
}

}  // namespace

void addCameraOption(po::options_description& options, std::vector<std::string>& words) {
  options.add_options()(
      "camera", po::value(&words)->composing()->value_name("NAME=IMAGE"),
      "one of several cameras, may be repeated: a name and the topic of its image; then, with commas, "
      "masks=TOPIC and camera_info=TOPIC where they are not its neighbours, and parameters that hold "
      "for it alone. Its name goes into the names of files: --out r.yaml writes r_NAME.yaml");
}

std::vector<CameraOption> parseCameras(const std::vector<std::string>& words, const InputTopics& topics) {
  if (words.empty()) return {{"", topics, {}}};
  if (!topics.image.empty() || !topics.masks.empty() || !topics.camera_info.empty())
    throw po::error(
        "--image, --camera-info and --masks are for one camera; with --camera each names its own");
  std::vector<CameraOption> cameras;
  for (const std::string& word : words) {
    CameraOption camera = parseCamera(word);
    camera.topics.points = topics.points;
    const auto taken = [&camera](const CameraOption& other) { return other.name == camera.name; };
    if (std::any_of(cameras.begin(), cameras.end(), taken)) refuse(word, "this name is taken");
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

std::string fileOf(const CameraOption& camera, const std::string& file) {
  if (camera.name.empty() || file.empty()) return file;
  std::filesystem::path path(file);
  path.replace_filename(path.stem().string() + "_" + camera.name + path.extension().string());
  return path.string();
}

std::string inputFileOf(const CameraOption& camera, const std::string& file) {
  const std::string own = fileOf(camera, file);
  std::error_code ignored;
  return std::filesystem::exists(own, ignored) ? own : file;
}

}  // namespace lidar_camera_recalibration
