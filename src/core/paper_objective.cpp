#include "paper_objective.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numeric>

#include "multiversion.hpp"
#include "projection.hpp"

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

/// Adds to each vector's sum its absolute dot products with the vectors before it.
LCR_MULTIVERSION void addPairs(const float* x, const float* y, const float* z, int count,
                               float* __restrict pairs) {
  for (int a = 0; a < count; ++a) {
    const float ax = x[a], ay = y[a], az = z[a];
    for (int b = a + 1; b < count; ++b) pairs[b] += std::abs(ax * x[b] + ay * y[b] + az * z[b]);
  }
}

/// What a mask collects of the points that fall into it.
struct MaskSums {
  std::array<Eigen::Vector3f, NormalBins::kCount> normals;
  double reflectivity, reflectivity_squared;  ///< in float their difference would be noise
  std::uint32_t points, points_with_normal;
};

/// What the inner loop reads of a frame: the points to be scored, as structure of arrays.
struct PreparedFrame {
  FramePtr frame;
  Places places;
  std::vector<Eigen::Vector3f> normal;  ///< folded to its bin's side; zero where unknown
  std::vector<std::uint8_t> bin;        ///< of the normal
  std::vector<float> reflectivity;      ///< 0 where the sensor gives none
  std::vector<std::int32_t> segment;
  Eigen::Vector3d weights;  ///< w_R, w_N, w_S; sum 1

  std::size_t size() const { return places.size(); }
  std::size_t maskCount() const { return frame->masks.maskCount(); }
  std::size_t classCount() const { return static_cast<std::size_t>(frame->points.segment_count); }
};

class PaperEvaluator : public Evaluator {
 public:
  PaperEvaluator(const Frames& frames, const Views& in_view, const Eigen::Vector3d& weights) {
    for (const FramePtr& frame : frames) {
      frames_.push_back(prepare(frame, in_view, weights));
      const PreparedFrame& prepared = frames_.back();
      sums_.resize(std::max(sums_.size(), prepared.maskCount()));
      class_counts_.resize(std::max(class_counts_.size(), prepared.maskCount() * prepared.classCount()));
    }
  }

  Score operator()(const Eigen::Isometry3d& T_camera_lidar) override {
    Score score;
    double weight = 0.0;  // sum of ||P_i||
    for (const PreparedFrame& frame : frames_) {
      collect(frame, T_camera_lidar, score);
      addMasks(frame, score, weight);
    }
    if (weight > 0.0) {
      for (double* mean : {&score.total, &score.reflectivity, &score.normal, &score.segment}) *mean /= weight;
    }
    return score;
  }

 private:
  static PreparedFrame prepare(const FramePtr& frame, const Views& in_view, Eigen::Vector3d weights) {
    const FramePoints& points = frame->points;
    std::vector<Projection> views;
    for (const Eigen::Isometry3d& T : in_view) views.emplace_back(frame->camera.intrinsics(), T);
    const float margin = kViewMargin * static_cast<float>(frame->camera.intrinsics().height);
    PreparedFrame prepared;
    prepared.frame = frame;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const auto sees = [&](const Projection& view) {
        return view.wellInside(points.x[i], points.y[i], points.z[i], margin);
      };
      if (!std::all_of(views.begin(), views.end(), sees)) continue;
      prepared.places.add(points.x[i], points.y[i], points.z[i]);
      Eigen::Vector3f normal(points.nx[i], points.ny[i], points.nz[i]);
      prepared.bin.push_back(static_cast<std::uint8_t>(NormalBins::fold(normal)));
      prepared.normal.push_back(normal);
      prepared.reflectivity.push_back(points.hasReflectivity() ? points.reflectivity[i] : 0.0f);
      prepared.segment.push_back(points.segment[i]);
    }
    if (!points.hasReflectivity()) weights.x() = 0.0;
    // Without reflectivity and with w_N = w_S = 0 nothing is left to score by: all weights stay 0.
    prepared.weights = weights.sum() > 0.0 ? Eigen::Vector3d(weights / weights.sum()) : weights;
    return prepared;
  }

  /// Projects all points and adds each to the masks that its pixel belongs to, eq. (3).
  void collect(const PreparedFrame& frame, const Eigen::Isometry3d& T_camera_lidar, Score& score) {
    std::fill_n(sums_.begin(), frame.maskCount(), MaskSums{});
    std::fill_n(class_counts_.begin(), frame.maskCount() * frame.classCount(), 0u);
    const MaskSets& sets = frame.frame->masks;
    const Projection project(frame.frame->camera.intrinsics(), T_camera_lidar);
    Block<std::uint32_t> set;
    for (std::size_t first = 0; first < frame.size(); first += kBlock) {
      const std::size_t count = std::min(kBlock, frame.size() - first);
      project.lookUp(sets.setOfPixel(), frame.places, first, count, 0, set);
      for (std::size_t i = 0; i < count; ++i) {
        if (set[i] == 0) continue;
        ++score.points;
        for (std::uint32_t m = sets.setBegin()[set[i]]; m < sets.setBegin()[set[i] + 1]; ++m) {
          add(frame, first + i, sets.setMasks()[m]);
        }
      }
    }
  }

  void add(const PreparedFrame& frame, std::size_t i, std::uint32_t mask) {
    MaskSums& sums = sums_[mask];
    ++sums.points;
    const auto reflectivity = static_cast<double>(frame.reflectivity[i]);
    sums.reflectivity += reflectivity;
    sums.reflectivity_squared += reflectivity * reflectivity;
    sums.normals[frame.bin[i]] += frame.normal[i];
    sums.points_with_normal += frame.normal[i] != Eigen::Vector3f::Zero();
    if (frame.segment[i] >= 0)
      ++class_counts_[mask * frame.classCount() + static_cast<std::size_t>(frame.segment[i])];
  }

  /// Adds n_i * s_i of each mask, eq. (4) and (10).
  void addMasks(const PreparedFrame& frame, Score& score, double& weight) {
    for (std::size_t m = 0; m < frame.maskCount(); ++m) {
      const MaskSums& sums = sums_[m];
      if (sums.points == 0) continue;
      const double n = sums.points;
      counts_.clear();
      for (std::size_t c = m * frame.classCount(); c < (m + 1) * frame.classCount(); ++c) {
        if (class_counts_[c] > 0) counts_.push_back(class_counts_[c]);
      }
      const Eigen::Vector3d consistency(
          frame.weights.x() > 0.0 ? reflectivityConsistency(sums.reflectivity, sums.reflectivity_squared, n)
                                  : 0.0,
          NormalBins::consistency(sums.normals.data(), sums.points_with_normal), segmentConsistency(counts_));
      ++score.masks;
      weight += n;
      score.total += n * frame.weights.dot(consistency) * adjust(n);
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
  std::array<float, kCount> x, y, z, pairs = {};
  int count = 0;
  double diagonal = 0.0;
  for (int b = 0; b < kCount; ++b) {
    if (sums[b] == Eigen::Vector3f::Zero()) continue;
    x[count] = sums[b].x();
    y[count] = sums[b].y();
    z[count++] = sums[b].z();
    diagonal += sums[b].squaredNorm();
  }
  addPairs(x.data(), y.data(), z.data(), count, pairs.data());
  const double off_diagonal = std::accumulate(pairs.begin(), pairs.end(), 0.0);
  return (diagonal + 2.0 * off_diagonal) / (n * n);
}

PaperObjective::PaperObjective(const ObjectiveConfig& config) : config_(config) {
  const Eigen::Vector3d weights(config.weight_reflectivity, config.weight_normal, config.weight_segment);
  if (!weights.allFinite() || weights.minCoeff() < 0.0 || weights.sum() <= 0.0) {
    throw Error(ErrorCause::kParameter,
                "objective weights: they must not be negative, and at least one must be above 0");
  }
}

std::unique_ptr<Evaluator> PaperObjective::evaluator(const Frames& frames, const Views& in_view) const {
  return std::make_unique<PaperEvaluator>(
      frames, in_view,
      Eigen::Vector3d(config_.weight_reflectivity, config_.weight_normal, config_.weight_segment));
}

}  // namespace lidar_camera_recalibration
