#include "evaluation/methods.hpp"

#include <algorithm>
#include <array>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/objective.hpp"
#include "lidar_camera_recalibration/search.hpp"
#include "parameters.hpp"

namespace lidar_camera_recalibration::evaluation {

namespace {

/// A method is a name for an objective and the search that belongs to it.
struct KnownMethod {
  std::string name, objective, search;
};
const std::array<KnownMethod, 2> kMethods = {
    {{"paper", "paper", "paper"}, {"consistency_edges", "consistency_edges", "coarse_to_fine"}}};
const std::string kDefaultMethod = "consistency_edges";  ///< of variants

const KnownMethod* find(const std::string& name) {
  const auto found = std::find_if(kMethods.begin(), kMethods.end(),
                                  [&name](const KnownMethod& method) { return method.name == name; });
  return found == kMethods.end() ? nullptr : &*found;
}

/// At the commas outside of brackets: values may be lists.
std::vector<std::string> splitAssignments(const std::string& text) {
  std::vector<std::string> parts(1);
  int depth = 0;
  for (const char c : text) {
    depth += (c == '[') - (c == ']');
    if (c == ',' && depth == 0) {
      parts.emplace_back();
    } else {
      parts.back() += c;
    }
  }
  return parts;
}

}  // namespace

std::string knownMethods() {
  std::string names;
  for (const KnownMethod& method : kMethods) names += (names.empty() ? "" : ", ") + method.name;
  return names;
}

Method parseMethod(const std::string& word, const CommonParameters& common) {
  const std::size_t colon = word.find(':');
  Method method{word.substr(0, colon), {}};
  const KnownMethod* known = find(method.name);
  if (!known && colon == std::string::npos) {
    throw Error(ErrorCause::kParameter, "--method " + word + ": must be one of " + knownMethods() +
                                            ", or a variant NAME:param=value,param=value");
  }
  if (!known) known = find(kDefaultMethod);
  std::vector<std::string> assignments = {"objective=" + known->objective, "search=" + known->search};
  assignments.insert(assignments.end(), common.assignments.begin(), common.assignments.end());
  if (colon != std::string::npos) {
    for (const std::string& assignment : splitAssignments(word.substr(colon + 1)))
      assignments.push_back(assignment);
  }
  try {
    method.config = loadServerConfig(common.yaml_file, assignments);
    makeObjective(method.config.calibrator.objective);
    makeSearch(method.config.calibrator.search);
  } catch (const Error& error) {
    throw Error(error.cause(), "--method " + word + ": " + error.what());
  }
  return method;
}

}  // namespace lidar_camera_recalibration::evaluation
