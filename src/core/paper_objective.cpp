#include "paper_objective.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

namespace lidar_camera_recalibration {

double reflectivityConsistency(double sum, double sum_of_squares, double n) {
  const double mean = sum / n;
  return 1.0 - std::sqrt(std::max(0.0, sum_of_squares / n - mean * mean));
}

double segmentConsistency(std::vector<std::uint32_t>& counts) {
  constexpr double k = 0.4;
  std::sort(counts.begin(), counts.end(), std::greater<>());
  double weighted = 0.0, total = 0.0, factor = 1.0;
  for (const std::uint32_t c : counts) {
    weighted += factor * c;
    total += c;
    factor *= k;
  }
  return total > 0.0 ? weighted / total : 0.0;
}

double adjust(double n) { return std::max(0.0, 1.0 - 1.5 * std::pow(n, -0.4)); }

namespace {

using Directions = std::array<Eigen::Vector3f, NormalBins::kCount>;

/// Evenly spread directions on a hemisphere: the upper half of a Fibonacci sphere.
const Directions& fibonacciHemisphere() {
  static const Directions directions = [] {
    Directions d;
    const double golden_angle = M_PI * (3.0 - std::sqrt(5.0));
    for (int i = 0; i < NormalBins::kCount; ++i) {
      const double z = 1.0 - (i + 0.5) / NormalBins::kCount;
      const double r = std::sqrt(1.0 - z * z);
      d[i] = Eigen::Vector3d(r * std::cos(golden_angle * i), r * std::sin(golden_angle * i), z).cast<float>();
    }
    return d;
  }();
  return directions;
}

/// What a mask collects of the points that fall into it.
struct MaskSums {
  std::array<Eigen::Vector3f, NormalBins::kCount> normals;
  float reflectivity, reflectivity_squared;
  std::uint32_t points, points_with_normal;
};

/// The constant part of a frame, arranged for the inner loop.
struct PreparedFrame {
  FramePtr frame;
  std::vector<std::uint8_t> bin;        ///< of each point's normal
  std::vector<Eigen::Vector3f> folded;  ///< the normal on its bin's side; zero where unknown
  Eigen::Vector3d weights;              ///< w_R, w_N, w_S; sum 1
};

class PaperEvaluator : public Evaluator {
 public:
  PaperEvaluator(const Frames& frames, const Eigen::Vector3d& weights) {
    for (const FramePtr& frame : frames) {
      frames_.push_back(prepare(frame, weights));
      const std::size_t masks = frame->masks.maskCount();
      sums_.resize(std::max(sums_.size(), masks));
      class_counts_.resize(std::max(class_counts_.size(), masks * classes(*frame)));
    }
  }

  Score operator()(const Eigen::Isometry3d& T_camera_lidar) override {
    Score score;
    double weight = 0.0;  // sum of ||P_i||
    for (const PreparedFrame& prepared : frames_) {
      collect(prepared, T_camera_lidar, score);
      addMasks(prepared, score, weight);
    }
    if (weight > 0.0) {
      for (double* mean : {&score.total, &score.reflectivity, &score.normal, &score.segment}) *mean /= weight;
    }
    return score;
  }

 private:
  static std::size_t classes(const Frame& frame) {
    return static_cast<std::size_t>(frame.points.segment_count);
  }

  static PreparedFrame prepare(const FramePtr& frame, Eigen::Vector3d weights) {
    const FramePoints& points = frame->points;
    PreparedFrame prepared{frame, {}, {}, {}};
    for (std::size_t i = 0; i < points.size(); ++i) {
      Eigen::Vector3f normal(points.nx[i], points.ny[i], points.nz[i]);
      prepared.bin.push_back(static_cast<std::uint8_t>(NormalBins::fold(normal)));
      prepared.folded.push_back(normal);
    }
    if (!points.hasReflectivity()) weights.x() = 0.0;
    // Without reflectivity and with w_N = w_S = 0 nothing is left to score by: all weights stay 0.
    prepared.weights = weights.sum() > 0.0 ? Eigen::Vector3d(weights / weights.sum()) : weights;
    return prepared;
  }

  /// Projects all points, eq. (2), and adds each to the masks that its pixel belongs to, eq. (3).
  void collect(const PreparedFrame& prepared, const Eigen::Isometry3d& T_camera_lidar, Score& score) {
    const Frame& frame = *prepared.frame;
    const FramePoints& points = frame.points;
    const std::size_t class_count = classes(frame);
    std::fill_n(sums_.begin(), frame.masks.maskCount(), MaskSums{});
    std::fill_n(class_counts_.begin(), frame.masks.maskCount() * class_count, 0u);

    const Intrinsics& camera = frame.camera.intrinsics();
    Eigen::Matrix3d K;
    K << camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0;
    const Eigen::Matrix<float, 3, 4> P = (K * T_camera_lidar.matrix().topRows<3>()).cast<float>();
    const float width = static_cast<float>(camera.width) - 0.5f,
                height = static_cast<float>(camera.height) - 0.5f;
    const std::uint16_t* set_of_pixel = frame.masks.setOfPixel().ptr<std::uint16_t>();
    const std::size_t stride = frame.masks.setOfPixel().step1();
    const std::vector<std::uint32_t>&begin = frame.masks.setBegin(), &masks = frame.masks.setMasks();

    for (std::size_t i = 0; i < points.size(); ++i) {
      const float x = points.x[i], y = points.y[i], z = points.z[i];
      const float depth = P(2, 0) * x + P(2, 1) * y + P(2, 2) * z + P(2, 3);
      if (!(depth > 0.1f)) continue;
      const float u = (P(0, 0) * x + P(0, 1) * y + P(0, 2) * z + P(0, 3)) / depth;
      const float v = (P(1, 0) * x + P(1, 1) * y + P(1, 2) * z + P(1, 3)) / depth;
      if (!(u >= -0.5f && u < width && v >= -0.5f && v < height)) continue;
      const std::uint16_t set =
          set_of_pixel[static_cast<std::size_t>(v + 0.5f) * stride + static_cast<std::size_t>(u + 0.5f)];
      if (set == 0) continue;
      ++score.points;
      for (std::uint32_t m = begin[set]; m < begin[set + 1u]; ++m) add(prepared, i, masks[m], class_count);
    }
  }

  void add(const PreparedFrame& prepared, std::size_t i, std::uint32_t mask, std::size_t class_count) {
    const FramePoints& points = prepared.frame->points;
    MaskSums& sums = sums_[mask];
    ++sums.points;
    if (points.hasReflectivity()) {
      sums.reflectivity += points.reflectivity[i];
      sums.reflectivity_squared += points.reflectivity[i] * points.reflectivity[i];
    }
    const Eigen::Vector3f& normal = prepared.folded[i];
    sums.normals[prepared.bin[i]] += normal;
    sums.points_with_normal += normal != Eigen::Vector3f::Zero();
    if (points.segment[i] >= 0)
      ++class_counts_[mask * class_count + static_cast<std::size_t>(points.segment[i])];
  }

  /// Adds n_i * s_i of each mask, eq. (4) and (10).
  void addMasks(const PreparedFrame& prepared, Score& score, double& weight) {
    const std::size_t class_count = classes(*prepared.frame);
    for (std::size_t m = 0; m < prepared.frame->masks.maskCount(); ++m) {
      const MaskSums& sums = sums_[m];
      if (sums.points == 0) continue;
      const double n = sums.points;
      counts_.clear();
      for (std::size_t c = m * class_count; c < (m + 1) * class_count; ++c) {
        if (class_counts_[c] > 0) counts_.push_back(class_counts_[c]);
      }
      const Eigen::Vector3d consistency(
          prepared.weights.x() > 0.0
              ? reflectivityConsistency(sums.reflectivity, sums.reflectivity_squared, n)
              : 0.0,
          NormalBins::consistency(sums.normals.data(), sums.points_with_normal), segmentConsistency(counts_));
      ++score.masks;
      weight += n;
      score.total += n * prepared.weights.dot(consistency) * adjust(n);
      score.reflectivity += n * consistency.x();
      score.normal += n * consistency.y();
      score.segment += n * consistency.z();
    }
  }

  std::vector<PreparedFrame> frames_;
  // Scratch of one frame at a time, reused for every candidate.
  std::vector<MaskSums> sums_;
  std::vector<std::uint32_t> class_counts_;  ///< [mask][class]
  std::vector<std::uint32_t> counts_;
};

}  // namespace

int NormalBins::fold(Eigen::Vector3f& normal) {
  const Directions& directions = fibonacciHemisphere();
  int best = 0;
  float largest = -1.0f;
  for (int b = 0; b < kCount; ++b) {
    const float cosine = std::abs(directions[b].dot(normal));
    if (cosine > largest) {
      largest = cosine;
      best = b;
    }
  }
  if (directions[best].dot(normal) < 0.0f) normal = -normal;
  return best;
}

double NormalBins::consistency(const Eigen::Vector3f* sums, double n) {
  if (n <= 0.0) return 0.0;
  std::array<Eigen::Vector3f, kCount> used;
  int count = 0;
  for (int b = 0; b < kCount; ++b) {
    if (sums[b] != Eigen::Vector3f::Zero()) used[count++] = sums[b];
  }
  double diagonal = 0.0, off_diagonal = 0.0;
  for (int a = 0; a < count; ++a) {
    diagonal += used[a].squaredNorm();
    float row = 0.0f;
    for (int b = a + 1; b < count; ++b) row += std::abs(used[a].dot(used[b]));
    off_diagonal += row;
  }
  return (diagonal + 2.0 * off_diagonal) / (n * n);
}

PaperObjective::PaperObjective(const ObjectiveConfig& config) : config_(config) {
  const Eigen::Vector3d weights(config.weight_reflectivity, config.weight_normal, config.weight_segment);
  if (!weights.allFinite() || weights.minCoeff() < 0.0 || weights.sum() <= 0.0) {
    throw Error(ErrorCause::kParameter,
                "objective weights: they must not be negative, and at least one must be above 0");
  }
}

std::unique_ptr<Evaluator> PaperObjective::evaluator(const Frames& frames) const {
  return std::make_unique<PaperEvaluator>(
      frames, Eigen::Vector3d(config_.weight_reflectivity, config_.weight_normal, config_.weight_segment));
}

}  // namespace lidar_camera_recalibration
