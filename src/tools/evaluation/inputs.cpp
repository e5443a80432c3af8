#include "evaluation/inputs.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "command_line.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_edges.hpp"
#include "statistics.hpp"

namespace lidar_camera_recalibration::evaluation {

namespace {

Input readInput(const Dataset& dataset, std::size_t frame, int every_ring) {
  Input input{dataset.name(frame), dataset.stamp(frame), dataset.image(frame), dataset.maskLayers(frame), {}};
  if (input.layers.empty()) {
    throw Error(
        ErrorCause::kMasks,
        "frame " + input.name + " has no masks; make them and put them into masks/" + input.name + "/");
  }
  try {
    input.cloud = keepEveryRing(dataset.cloud(frame), every_ring);
  } catch (const Error& error) {
    throw Error(error.cause(), "frame " + input.name + ": " + error.what());
  }
  return input;
}

/// Each ring's place from below, by the median elevation of its points.
std::map<std::uint16_t, std::size_t> ringRanks(const PointCloud& cloud,
                                               const std::vector<std::uint16_t>& rings) {
  std::map<std::uint16_t, std::vector<double>> elevations;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud.points[i];
    elevations[rings[i]].push_back(std::atan2(p.z(), std::hypot(p.x(), p.y())));
  }
  std::vector<std::pair<double, std::uint16_t>> order;
  for (auto& [ring, values] : elevations) order.emplace_back(quantile(std::move(values), 0.5), ring);
  std::sort(order.begin(), order.end());
  std::map<std::uint16_t, std::size_t> ranks;
  for (const auto& elevation_and_ring : order) ranks.emplace(elevation_and_ring.second, ranks.size());
  return ranks;
}

}  // namespace

std::vector<Input> readInputs(const Dataset& dataset, const InputChoice& choice) {
  std::vector<Input> inputs;
  ProgressBar progress;
  for (std::size_t i = 0; i < dataset.size(); ++i) {
    if ((choice.frame_set == "even" && i % 2 != 0) || (choice.frame_set == "odd" && i % 2 == 0)) continue;
    progress.show("reading frames", double(i) / double(dataset.size()));
    inputs.push_back(readInput(dataset, i, choice.every_ring));
  }
  progress.show("reading frames", 1.0);
  return inputs;
}

PointCloud keepEveryRing(const PointCloud& cloud, int step) {
  if (step == 1) return cloud;
  const std::vector<std::uint16_t> rings = ringsOf(cloud);
  if (rings.empty()) {
    throw Error(
        ErrorCause::kCloud,
        "the cloud has no field ring and its points do not tell; --every-ring cannot be used with it");
  }
  const std::map<std::uint16_t, std::size_t> ranks = ringRanks(cloud, rings);
  PointCloud kept;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const std::size_t rank = ranks.at(rings[i]);
    if (rank % static_cast<std::size_t>(step) != 0) continue;
    kept.points.push_back(cloud.points[i]);
    if (cloud.hasReflectivity()) kept.reflectivity.push_back(cloud.reflectivity[i]);
    kept.ring.push_back(static_cast<std::uint16_t>(rank / static_cast<std::size_t>(step)));
  }
  return kept;
}

}  // namespace lidar_camera_recalibration::evaluation
