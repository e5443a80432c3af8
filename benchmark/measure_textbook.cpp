// The paper's method side by side: this package, and the same formulas written down as they stand.

#include <cmath>
#include <memory>

#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/search.hpp"
#include "measurements.hpp"
#include "simulation/rig.hpp"
#include "textbook_frame.hpp"

namespace lidar_camera_recalibration::performance {
namespace {

// Fewer candidates than a search needs to be good: the textbook is slow. Both score the same number of them.
constexpr double kRange = 2.0, kStep = 1.0;               ///< [deg]
constexpr double kOffAngle = 1.5 * kDegree, kOff = 0.05;  ///< of the start [rad], [m]
constexpr double kTranslation = 0.1;                      ///< [m]
constexpr int kRandomCandidates = 100;
constexpr std::uint64_t kSeed = 1;

std::vector<textbook::Frame> textbookFrames(const Frames& frames) {
  std::vector<textbook::Frame> result;
  for (const FramePtr& frame : frames) result.push_back(textbookFrame(*frame));
  return result;
}

ObjectiveConfig paperObjective() {
  ObjectiveConfig config;
  config.objective = "paper";
  return config;
}

void addError(const Eigen::Isometry3d& T, const Eigen::Isometry3d& truth, Counters& counters) {
  const ExtrinsicError error = extrinsicError(T, truth);
  counters["rotation_deg"] = error.angle() / kDegree;
  counters["translation_m"] = error.distance();
}

Eigen::Isometry3d toEigen(const cv::Affine3d& T) {
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) result(row, column) = T.matrix(row, column);
  }
  return result;
}

/// All points of the frames are scored by both, so that the scores can be compared.
void addEvaluations(Measurements& measurements, const std::shared_ptr<FrameStore>& store,
                    const std::string& source, std::size_t count) {
  const std::string place = source + "/frames:" + std::to_string(count);
  measurements.add("side_by_side/score_textbook/" + place, [=](Counters&) -> Work {
    const auto frames =
        std::make_shared<const std::vector<textbook::Frame>>(textbookFrames(store->frames(source, count)));
    const cv::Affine3d T = toOpenCv(store->source(source).T_camera_lidar());
    return [=](Counters& result) { result["score"] = textbook::score(*frames, T); };
  });
  measurements.add("side_by_side/score_paper/" + place, [=](Counters&) -> Work {
    const std::shared_ptr<Evaluator> evaluator =
        makeObjective(paperObjective())->evaluator(store->frames(source, count), {});
    const Eigen::Isometry3d T = store->source(source).T_camera_lidar();
    return [=](Counters& result) { result["score"] = (*evaluator)(T).total; };
  });
}

void addSearches(Measurements& measurements, const std::shared_ptr<FrameStore>& store,
                 const std::string& source, std::size_t count) {
  const std::string place = source + "/frames:" + std::to_string(count);
  const auto startOf = [=] {
    return simulation::disturbed(store->source(source).T_camera_lidar(), kOffAngle, kOff, kSeed);
  };
  measurements.add(
      "side_by_side/search_textbook/" + place,
      [=](Counters&) -> Work {
        const auto frames = std::make_shared<const std::vector<textbook::Frame>>(
            textbookFrames(store->frames(source, count)));
        const cv::Affine3d start = toOpenCv(startOf());
        textbook::SearchLimits limits;
        limits.rotation_deg = kRange;
        limits.step_deg = limits.fine_rotation_deg = kStep;
        limits.fine_translation = kTranslation;
        limits.random_candidates = kRandomCandidates;
        limits.seed = kSeed;
        return [=](Counters& result) {
          const textbook::SearchResult found = textbook::search(*frames, start, limits);
          result["candidates"] = found.evaluations;
          addError(toEigen(found.T_camera_lidar), store->source(source).T_camera_lidar(), result);
        };
      },
      1);
  measurements.add("side_by_side/search_paper/" + place, [=](Counters&) -> Work {
    const Frames frames = store->frames(source, count);
    SearchConfig config;
    config.search = "paper";
    config.grid_step_deg = kStep;
    config.refine_evaluations = kRandomCandidates;
    config.seed = kSeed;
    config.threads = 1;
    const std::shared_ptr<Search> search = makeSearch(config);
    const std::shared_ptr<Objective> objective = makeObjective(paperObjective());
    return [=](Counters& result) {
      const SearchResult found = search->run(*objective, frames, startOf(), {kRange, kTranslation}, nullptr);
      result["candidates"] = static_cast<double>(found.evaluations);
      addError(found.T_camera_lidar, store->source(source).T_camera_lidar(), result);
    };
  });
}

}  // namespace

void addSideBySide(Measurements& measurements, const std::shared_ptr<FrameStore>& store,
                   const std::string& source, std::size_t frames) {
  addEvaluations(measurements, store, source, frames);
  addSearches(measurements, store, source, frames);
}

}  // namespace lidar_camera_recalibration::performance
