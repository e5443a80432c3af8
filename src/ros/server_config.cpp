#include "server_config.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <sstream>
#include <type_traits>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {

namespace {

using XmlRpc::XmlRpcValue;

constexpr std::size_t kMegabyte = 1024 * 1024;
constexpr int kMaxYamlDepth = 16;

// One line of the table below. `set` returns false if the value is not allowed.
struct Parameter {
  std::string name;
  std::string allowed;  ///< in words
  std::function<bool(const XmlRpcValue& value, ServerConfig& config)> set;
  std::function<std::string(const ServerConfig& config)> text;
  // Of parameters that may change while the node runs.
  std::function<XmlRpcValue(const ServerConfig& config)> value{};
  XmlRpcValue min{std::string()}, max{std::string()};
  std::vector<std::string> words{};
  bool live = false;
};

Parameter live(Parameter parameter) {
  parameter.live = true;
  return parameter;
}

template <class T>
std::string toText(const T& value) {
  std::ostringstream stream;
  stream.precision(10);
  stream << value;
  return stream.str();
}

std::string quoted(const std::string& value) { return '"' + value + '"'; }

// Whole numbers are numbers, too: people write 60 for 60.0.
std::optional<double> toNumber(const XmlRpcValue& value) {
  if (value.getType() == XmlRpcValue::TypeInt) return static_cast<const int&>(value);
  if (value.getType() == XmlRpcValue::TypeDouble) return static_cast<const double&>(value);
  return std::nullopt;
}

std::optional<std::string> toString(const XmlRpcValue& value) {
  if (value.getType() != XmlRpcValue::TypeString) return std::nullopt;
  return static_cast<const std::string&>(value);
}

std::string toText(const XmlRpcValue& value) {
  if (const auto string = toString(value)) return quoted(*string);
  std::ostringstream stream;
  value.write(stream);
  return stream.str();
}

// `member` maps a configuration, const or not, to a reference.
template <class Member>
Parameter number(const char* name, double min, double max, Member member) {
  using Type = std::decay_t<decltype(member(std::declval<ServerConfig&>()))>;
  constexpr bool is_whole = std::is_integral_v<Type>;
  const std::string allowed =
      (is_whole ? "a whole number from " : "a number from ") + toText(min) + " to " + toText(max);
  const auto set = [=](const XmlRpcValue& value, ServerConfig& config) {
    const std::optional<double> read = toNumber(value);
    if (is_whole && value.getType() != XmlRpcValue::TypeInt) return false;
    if (!read || !(*read >= min && *read <= max)) return false;  // also refuses NaN
    member(config) = static_cast<Type>(*read);
    return true;
  };
  // The parameter server and dynamic_reconfigure know int and double only.
  using Shown = std::conditional_t<is_whole, int, double>;
  return {name,
          allowed,
          set,
          [=](const ServerConfig& config) { return toText(member(config)); },
          [=](const ServerConfig& config) { return XmlRpcValue(static_cast<Shown>(member(config))); },
          XmlRpcValue(static_cast<Shown>(min)),
          XmlRpcValue(static_cast<Shown>(max))};
}

template <class Member>
Parameter megabytes(const char* name, int min, int max, Member member) {
  const auto set = [=](const XmlRpcValue& value, ServerConfig& config) {
    if (value.getType() != XmlRpcValue::TypeInt) return false;
    const int read = value;
    if (read < min || read > max) return false;
    member(config) = static_cast<std::size_t>(read) * kMegabyte;
    return true;
  };
  return {name, "a whole number from " + toText(min) + " to " + toText(max), set,
          [=](const ServerConfig& config) { return toText(member(config) / kMegabyte); }};
}

template <class Member>
Parameter flag(const char* name, Member member) {
  const auto set = [=](const XmlRpcValue& value, ServerConfig& config) {
    if (value.getType() != XmlRpcValue::TypeBoolean) return false;
    member(config) = static_cast<const bool&>(value);
    return true;
  };
  return {name,
          "true or false",
          set,
          [=](const ServerConfig& config) { return std::string(member(config) ? "true" : "false"); },
          [=](const ServerConfig& config) { return XmlRpcValue(bool{member(config)}); },
          XmlRpcValue(false),
          XmlRpcValue(true)};
}

template <class Member>
Parameter string(const char* name, const char* allowed, Member member,
                 bool (*valid)(const std::string&) = nullptr) {
  const auto set = [=](const XmlRpcValue& value, ServerConfig& config) {
    const std::optional<std::string> read = toString(value);
    if (!read || (valid != nullptr && !valid(*read))) return false;
    member(config) = *read;
    return true;
  };
  return {name, allowed, set, [=](const ServerConfig& config) { return quoted(member(config)); }};
}

// tf2 refuses names that begin with a slash.
template <class Member>
Parameter frameId(const char* name, Member member) {
  return string(name, "a tf2 frame id (no leading slash, no blanks) or \"\"", member,
                [](const std::string& id) {
                  return id.find_first_of(" \t\n") == std::string::npos && (id.empty() || id.front() != '/');
                });
}

template <class Member>
Parameter topic(const char* name, Member member) {
  return string(name, "the name of a topic or \"\"", member,
                [](const std::string& id) { return id.find_first_of(" \t\n") == std::string::npos; });
}

// One of a few words. `fromWord` makes the member of a word.
template <class Member, class FromWord>
Parameter choice(const char* name, const std::vector<std::string>& words, const std::string& remark,
                 Member member, FromWord fromWord) {
  const std::string allowed = std::accumulate(std::next(words.begin()), words.end(), quoted(words.front()),
                                              [](const std::string& sum, const std::string& word) {
                                                return sum + ", " + quoted(word);
                                              }) +
                              remark;
  const auto set = [=](const XmlRpcValue& value, ServerConfig& config) {
    const std::optional<std::string> read = toString(value);
    if (!read || std::find(words.begin(), words.end(), *read) == words.end()) return false;
    member(config) = fromWord(*read);
    return true;
  };
  const auto wordOf = [=](const ServerConfig& config) {
    const auto word = std::find_if(words.begin(), words.end(), [&](const std::string& candidate) {
      return fromWord(candidate) == member(config);
    });
    return word == words.end() ? std::string() : *word;
  };
  Parameter parameter{name, allowed, set, [=](const ServerConfig& config) { return quoted(wordOf(config)); },
                      [=](const ServerConfig& config) { return XmlRpcValue(wordOf(config)); }};
  parameter.words = words;
  return parameter;
}

std::string sameWord(const std::string& word) { return word; }

bool setInitialExtrinsic(const XmlRpcValue& value, ServerConfig& config) {
  if (value.getType() != XmlRpcValue::TypeArray) return false;
  config.initial_T_camera_lidar.reset();
  if (value.size() == 0) return true;
  if (value.size() != 16) return false;
  Eigen::Matrix4d matrix;
  for (int i = 0; i < 16; ++i) {
    const std::optional<double> element = toNumber(value[i]);
    if (!element) return false;
    matrix(i / 4, i % 4) = *element;
  }
  try {
    config.initial_T_camera_lidar = isometryFromMatrix(matrix);
  } catch (const Error&) {
    return false;
  }
  return true;
}

std::string initialExtrinsicText(const ServerConfig& config) {
  if (!config.initial_T_camera_lidar) return "[]";
  const Eigen::IOFormat format(10, Eigen::DontAlignCols, ", ", ", ", "", "", "[", "]");
  std::ostringstream stream;
  // Adding 0 turns -0 into 0.
  stream << (config.initial_T_camera_lidar->matrix().array() + 0.0).matrix().format(format);
  return stream.str();
}

#define MEMBER(path) \
  [](auto& config) -> auto& { return config.path; }

std::vector<Parameter> inputParameters() {
  return {
      choice("mode", {"manual", "monitor", "automatic"}, "", MEMBER(mode), sameWord),
      number("automatic/min_interval", 0.0, 86400.0, MEMBER(automatic_min_interval)),
      topic("topics/image", MEMBER(topics.image)),
      topic("topics/camera_info", MEMBER(topics.camera_info)),
      topic("topics/points", MEMBER(topics.points)),
      topic("topics/masks", MEMBER(topics.masks)),
      string("camera_info_file", "a path or \"\"", MEMBER(camera_info_file)),
      flag("image_rectified", MEMBER(image_rectified)),
      flag("compressed", MEMBER(compressed)),
      flag("masks_compressed", MEMBER(masks_compressed)),
      string("intensity_field", "the name of a point field or \"\"", MEMBER(intensity_field)),
      frameId("camera_frame", MEMBER(camera_frame)),
      frameId("lidar_frame", MEMBER(lidar_frame)),
      frameId("fixed_frame", MEMBER(fixed_frame)),
      flag("deskew", MEMBER(deskew)),
      number("sync/max_stamp_gap", 0.0, 1.0, MEMBER(synchroniser.max_stamp_gap)),
      number("sync/mask_timeout", 0.1, 3600.0, MEMBER(synchroniser.mask_timeout)),
      number("sync/max_unmatched", 2, 1000, MEMBER(synchroniser.max_unmatched)),
      megabytes("sync/max_bytes_mb", 16, 65536, MEMBER(synchroniser.max_bytes)),
      {"initial/T_camera_lidar", "16 numbers, row by row, of a rigid 4x4 transform, or []",
       setInitialExtrinsic, initialExtrinsicText},
      flag("initial/from_saved", MEMBER(initial_from_saved)),
  };
}

std::vector<Parameter> frameParameters() {
  return {
      number("frames/min", 1, 1000, MEMBER(frames_min)),
      number("frames/max", 1, 1000, MEMBER(frames_max)),
      number("frames/min_interval", 0.0, 3600.0, MEMBER(frames_min_interval)),
      number("frames/min_view_change", 0.0, 1.0, MEMBER(frames_min_view_change)),
      number("frames/max_turn_rate_deg", 0.0, 360.0, MEMBER(frames_max_turn_rate_deg)),
      megabytes("frames/max_bytes_mb", 16, 65536, MEMBER(frames_max_bytes)),
      number("frame/crop_margin_deg", 0.0, 90.0, MEMBER(frame.crop_margin_deg)),
      number("frame/min_range", 0.0, 1000.0, MEMBER(frame.min_range)),
      number("frame/max_range", 1.0, 1000.0, MEMBER(frame.max_range)),
      flag("frame/cull_hidden", MEMBER(frame.cull_hidden)),
      number("frame/min_points", 1, 1000000, MEMBER(frame.min_points)),
      number("frame/min_masks", 1, 10000, MEMBER(frame.min_masks)),
      number("features/normal_neighbours", 3, 200, MEMBER(frame.features.normal_neighbours)),
      number("features/reflectivity_quantile", 0.5, 1.0, MEMBER(frame.features.reflectivity_quantile)),
      number("features/plane_distance", 0.01, 2.0, MEMBER(frame.features.plane_distance)),
      number("features/plane_min_points", 10, 1000000, MEMBER(frame.features.plane_min_points)),
      number("features/plane_max_count", 0, 100, MEMBER(frame.features.plane_max_count)),
      number("features/cluster_tolerance", 0.01, 10.0, MEMBER(frame.features.cluster_tolerance)),
      number("features/cluster_tolerance_slope", 0.0, 0.2, MEMBER(frame.features.cluster_tolerance_slope)),
      number("features/cluster_min_points", 1, 100000, MEMBER(frame.features.cluster_min_points)),
  };
}

std::vector<Parameter> searchParameters() {
  return {
      choice("objective", {"consistency_edges", "paper"}, "", MEMBER(calibrator.objective.objective),
             sameWord),
      choice("search", {"coarse_to_fine", "paper"}, "", MEMBER(calibrator.search.search), sameWord),
      number("search_range/rotation_deg", 0.1, 45.0, MEMBER(calibrator.range.rotation_deg)),
      number("search_range/translation_m", 0.0, 5.0, MEMBER(calibrator.range.translation_m)),
      number("edges/weight_azimuth_gap", 0.0, 1000.0, MEMBER(calibrator.objective.weight_azimuth_gap)),
      number("edges/weight_ring_gap", 0.0, 1000.0, MEMBER(calibrator.objective.weight_ring_gap)),
      number("edges/weight_reflectivity_step", 0.0, 1000.0,
             MEMBER(calibrator.objective.weight_reflectivity_step)),
      number("edges/weight_region", 0.0, 1000.0, MEMBER(calibrator.objective.weight_region)),
      number("paper/weight_reflectivity", 0.0, 1000.0, MEMBER(calibrator.objective.weight_reflectivity)),
      number("paper/weight_normal", 0.0, 1000.0, MEMBER(calibrator.objective.weight_normal)),
      number("paper/weight_segment", 0.0, 1000.0, MEMBER(calibrator.objective.weight_segment)),
      number("paper/grid_step_deg", 0.05, 10.0, MEMBER(calibrator.search.grid_step_deg)),
      number("paper/refine_evaluations", 0, 10000000, MEMBER(calibrator.search.refine_evaluations)),
      number("seed", 0, 2147483647, MEMBER(calibrator.search.seed)),
      number("threads", 1, 256, MEMBER(calibrator.search.threads)),
      number("monitor/rotation_tolerance", 0.05, 1.0, MEMBER(monitor.rotation_tolerance_deg)),
      number("monitor/translation_tolerance", 0.01, 0.3, MEMBER(monitor.translation_tolerance_m)),
      number("monitor/window", 3, 1000, MEMBER(monitor.window)),
      live(number("gate/min_significance", 0.0, 100.0, MEMBER(calibrator.gate.min_significance))),
      live(number("gate/min_distinctness", 0.0, 100.0, MEMBER(calibrator.gate.min_distinctness))),
      live(number("gate/min_rotation_deg", 0.0, 10.0, MEMBER(calibrator.gate.min_rotation_deg))),
      live(number("gate/min_translation_m", 0.0, 10.0, MEMBER(calibrator.gate.min_translation_m))),
      live(number("gate/max_rotation_sigma_deg", 0.0, 10.0, MEMBER(calibrator.gate.max_rotation_sigma_deg))),
      live(
          number("gate/max_translation_sigma_m", 0.0, 10.0, MEMBER(calibrator.gate.max_translation_sigma_m))),
      number("service_timeout", 0.1, 86400.0, MEMBER(service_timeout)),
  };
}

std::vector<Parameter> outputParameters() {
  return {
      flag("tf/publish", MEMBER(tf_publish)),
      frameId("tf/child_frame", MEMBER(tf_child_frame)),
      frameId("tf/correct_parent", MEMBER(tf_correct_parent)),
      frameId("tf/correct_child", MEMBER(tf_correct_child)),
      string("result_file", "a path or \"\"", MEMBER(result_file)),
      live(choice("overlay/color", {"depth", "reflectivity", "normal", "segment", "mask"}, "",
                  MEMBER(overlay_color), overlayColorFromName)),
      live(flag("overlay/compare", MEMBER(overlay_compare))),
  };
}

#undef MEMBER

// Everything there is to know about the parameters: names, types, ranges, members, and their order in the
// manual.
const std::vector<Parameter>& table() {
  static const std::vector<Parameter> parameters = [] {
    std::vector<Parameter> all;
    for (const auto& group : {inputParameters(), frameParameters(), searchParameters(), outputParameters()}) {
      all.insert(all.end(), group.begin(), group.end());
    }
    return all;
  }();
  return parameters;
}

const Parameter& find(const std::string& name) {
  const auto found = std::find_if(table().begin(), table().end(),
                                  [&](const Parameter& parameter) { return parameter.name == name; });
  if (found == table().end()) throw Error(ErrorCause::kParameter, "there is no parameter '" + name + "'");
  return *found;
}

[[noreturn]] void refuse(const std::string& what) { throw Error(ErrorCause::kParameter, what); }

// What depends on more than one parameter.
void checkTogether(const ServerConfig& config) {
  if (config.frames_min > config.frames_max) {
    refuse("parameter frames/min = " + toText(config.frames_min) + " exceeds frames/max = " +
           toText(config.frames_max) + "; the buffer would never be full enough to search");
  }
  if (config.frame.min_range >= config.frame.max_range) {
    refuse("parameter frame/min_range = " + toText(config.frame.min_range) +
           " must be less than frame/max_range = " + toText(config.frame.max_range));
  }
  if (config.frame.crop_margin_deg < config.calibrator.range.rotation_deg) {
    refuse("parameter frame/crop_margin_deg = " + toText(config.frame.crop_margin_deg) +
           " is less than search_range/rotation_deg = " + toText(config.calibrator.range.rotation_deg) +
           "; points that the search needs would be cut away");
  }
  if (config.tf_correct_parent.empty() != config.tf_correct_child.empty()) {
    refuse("parameters tf/correct_parent = " + quoted(config.tf_correct_parent) + " and tf/correct_child = " +
           quoted(config.tf_correct_child) + " name an edge of the tf tree together; set both or neither");
  }
  if (!config.tf_correct_parent.empty() && config.tf_correct_parent == config.tf_correct_child) {
    refuse("parameters tf/correct_parent and tf/correct_child are both " + quoted(config.tf_correct_parent) +
           "; an edge of the tf tree joins two frames");
  }
  const ObjectiveConfig& objective = config.calibrator.objective;
  if (objective.weight_reflectivity + objective.weight_normal + objective.weight_segment <= 0.0) {
    refuse(
        "parameters paper/weight_reflectivity, paper/weight_normal and paper/weight_segment are all 0; at "
        "least one must be positive");
  }
  if (objective.weight_azimuth_gap + objective.weight_ring_gap + objective.weight_reflectivity_step <= 0.0) {
    refuse(
        "parameters edges/weight_azimuth_gap, edges/weight_ring_gap and edges/weight_reflectivity_step are "
        "all "
        "0; at least one must be positive");
  }
  if (objective.objective == "paper" && config.calibrator.search.search == "coarse_to_fine") {
    refuse(
        "parameter search = \"coarse_to_fine\" needs the edges of objective \"consistency_edges\"; set "
        "search "
        "to \"paper\" as well");
  }
}

// Levenshtein's distance.
std::size_t editDistance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

// A right name in the wrong group is a near miss.
std::size_t dissimilarity(const std::string& name, const std::string& known) {
  const auto last_part = [](const std::string& path) { return path.substr(path.rfind('/') + 1); };
  return std::min(editDistance(name, known), 1 + 2 * editDistance(last_part(name), last_part(known)));
}

XmlRpcValue scalarFromYaml(const YAML::Node& node) {
  if (node.Tag() == "!") return node.Scalar();  // in quotes
  int whole = 0;
  double real = 0.0;
  bool truth = false;
  if (YAML::convert<int>::decode(node, whole)) return whole;
  if (YAML::convert<double>::decode(node, real)) return real;
  // As the parameter server's loader, which knows yes and no but not y and n.
  if (node.Scalar().size() > 1 && YAML::convert<bool>::decode(node, truth)) return truth;
  return node.Scalar();
}

XmlRpcValue fromYaml(const YAML::Node& node, const std::string& name, int depth = 0) {
  if (depth > kMaxYamlDepth) refuse("parameter " + name + " is nested too deeply");
  XmlRpcValue value;
  if (node.IsScalar()) return scalarFromYaml(node);
  if (node.IsSequence()) {
    value.setSize(0);
    for (std::size_t i = 0; i < node.size(); ++i) {
      value[static_cast<int>(i)] = fromYaml(node[i], name, depth + 1);
    }
    return value;
  }
  if (!node.IsMap())
    refuse("parameter " + name + " has no value; remove it or write \"\" for an empty string");
  for (const auto& item : node) {
    const std::string key = item.first.Scalar();
    value[key] = fromYaml(item.second, name.empty() ? key : name + "/" + key, depth + 1);
  }
  return value;
}

void flattenInto(const std::string& name, const XmlRpcValue& value, Parameters& parameters) {
  if (value.getType() != XmlRpcValue::TypeStruct) {
    parameters[name] = value;
    return;
  }
  for (const auto& [key, child] : value) {
    flattenInto(name.empty() ? key : name + "/" + key, child, parameters);
  }
}

}  // namespace

std::vector<std::string> parameterNames() {
  std::vector<std::string> names;
  for (const Parameter& parameter : table()) names.push_back(parameter.name);
  return names;
}

std::string allowedValues(const std::string& name) { return find(name).allowed; }

std::string parameterText(const ServerConfig& config, const std::string& name) {
  return find(name).text(config);
}

std::vector<LiveParameter> liveParameters() {
  std::vector<LiveParameter> result;
  for (const Parameter& parameter : table()) {
    if (parameter.live)
      result.push_back({parameter.name, parameter.allowed, parameter.min, parameter.max, parameter.words});
  }
  return result;
}

XmlRpcValue parameterValue(const ServerConfig& config, const std::string& name) {
  const Parameter& parameter = find(name);
  if (!parameter.live) refuse("parameter " + name + " cannot change while the node runs");
  return parameter.value(config);
}

void setLiveParameters(const Parameters& values, ServerConfig& config) {
  ServerConfig tried = config;
  for (const auto& [name, value] : values) {
    const Parameter& parameter = find(name);
    if (!parameter.live)
      refuse("parameter " + name + " cannot change while the node runs; set it before the start");
    if (!parameter.set(value, tried))
      refuse("parameter " + name + " = " + toText(value) + ": must be " + parameter.allowed);
  }
  for (const auto& [name, value] : values) find(name).set(value, config);
}

ServerConfig readServerConfig(const ParameterSource& source) {
  ServerConfig config;
  for (const Parameter& parameter : table()) {
    XmlRpcValue value;
    if (!source(parameter.name, value)) continue;
    if (!parameter.set(value, config)) {
      refuse("parameter " + parameter.name + " = " + toText(value) + ": must be " + parameter.allowed);
    }
  }
  checkTogether(config);
  config.frame.edges = config.calibrator.objective.objective == "consistency_edges";
  return config;
}

std::vector<std::string> unknownParameters(const std::vector<std::string>& names) {
  // Read by the libraries below the node.
  static const std::vector<std::string> foreign = {"image_transport", "num_worker_threads",
                                                   "diagnostic_period"};
  const std::vector<std::string> known = parameterNames();
  std::vector<std::string> sentences;
  for (const std::string& name : names) {
    if (std::find(known.begin(), known.end(), name) != known.end() ||
        std::find(foreign.begin(), foreign.end(), name) != foreign.end()) {
      continue;
    }
    const auto nearest =
        std::min_element(known.begin(), known.end(), [&](const std::string& a, const std::string& b) {
          return dissimilarity(name, a) < dissimilarity(name, b);
        });
    sentences.push_back("there is no parameter '" + name + "'; did you mean '" + *nearest + "'?");
  }
  return sentences;
}

Parameters flatten(const XmlRpcValue& tree) {
  Parameters parameters;
  if (tree.getType() == XmlRpcValue::TypeStruct) flattenInto("", tree, parameters);
  return parameters;
}

Parameters readParameterFile(const std::string& path) {
  YAML::Node root;
  try {
    root = YAML::LoadFile(path);
  } catch (const std::exception& error) {
    throw Error(ErrorCause::kFile, "parameter file " + path + " cannot be read: " + error.what());
  }
  if (!root || root.IsNull()) return {};
  if (!root.IsMap()) {
    throw Error(ErrorCause::kFile, "parameter file " + path + " holds no `name: value` pairs");
  }
  try {
    return flatten(fromYaml(root, ""));
  } catch (const std::exception& error) {
    throw Error(ErrorCause::kFile, "parameter file " + path + ": " + error.what());
  }
}

ParameterSource sourceOf(const Parameters& parameters) {
  return [parameters](const std::string& name, XmlRpcValue& value) {
    const auto found = parameters.find(name);
    if (found == parameters.end()) return false;
    value = found->second;
    return true;
  };
}

}  // namespace lidar_camera_recalibration
