#include "lidar_camera_recalibration/search.hpp"

#include "lidar_camera_recalibration/error.hpp"
#include "paper_search.hpp"

namespace lidar_camera_recalibration {

std::unique_ptr<Search> makeSearch(const SearchConfig& config) {
  if (config.search == "paper") return std::make_unique<PaperSearch>(config);
  throw Error(ErrorCause::kParameter, "search: '" + config.search + "' is unknown; use 'paper'");
}

}  // namespace lidar_camera_recalibration
