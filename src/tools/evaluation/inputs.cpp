#include "evaluation/inputs.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <random>

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

/// Largest first, as ids count.
std::vector<cv::Mat> largestMasks(const std::vector<cv::Mat>& layers, std::size_t count) {
  std::map<int, int> areas;
  for (const cv::Mat& layer : layers) {
    for (auto id = layer.begin<int>(); id != layer.end<int>(); ++id) areas[*id] += *id > 0;
  }
  std::vector<std::pair<int, int>> order;
  for (const auto& [id, area] : areas) order.emplace_back(-area, id);
  std::sort(order.begin(), order.end());
  std::vector<cv::Mat> masks;
  for (std::size_t i = 0; i < std::min(count, order.size()); ++i) {
    masks.push_back(cv::Mat::zeros(layers.front().size(), CV_8UC1));
    for (const cv::Mat& layer : layers) masks.back() |= layer == order[i].second;
  }
  return layersFromBinaryMasks(masks);
}

std::vector<cv::Mat> garbage(const cv::Size& size, std::mt19937& random) {
  constexpr int kMasks = 40;
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const auto upTo = [&](double most) { return static_cast<int>(most * uniform(random)); };
  std::vector<cv::Mat> masks;
  for (int i = 0; i < kMasks; ++i) {
    masks.push_back(cv::Mat::zeros(size, CV_8UC1));
    const cv::Point middle(upTo(size.width), upTo(size.height));
    const cv::Size axes(5 + upTo(0.1 * size.width), 5 + upTo(0.2 * size.height));
    cv::ellipse(masks.back(), middle, axes, upTo(180.0), 0.0, 360.0, cv::Scalar(255), cv::FILLED);
  }
  return layersFromBinaryMasks(masks);
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
  spoilMasks(choice.masks, inputs);
  return inputs;
}

void spoilMasks(const std::string& how, std::vector<Input>& inputs) {
  constexpr std::size_t kFew = 6;
  if (how == "given") return;
  if (how == "another") {
    std::vector<std::vector<cv::Mat>> layers;
    for (Input& input : inputs) layers.push_back(std::move(input.layers));
    std::rotate(layers.begin(), layers.begin() + static_cast<std::ptrdiff_t>(inputs.size() / 2),
                layers.end());
    for (std::size_t i = 0; i < inputs.size(); ++i) inputs[i].layers = std::move(layers[i]);
    return;
  }
  std::mt19937 random(1);
  for (Input& input : inputs) {
    if (how == "largest") {
      input.layers = largestMasks(input.layers, kFew);
    } else if (how == "garbage") {
      input.layers = garbage(input.layers.front().size(), random);
    } else {
      throw Error(ErrorCause::kParameter, "--masks " + how + ": must be given, largest, garbage or another");
    }
  }
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
