#include "lidar_camera_recalibration/search.hpp"

#include "coarse_to_fine_search.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "paper_search.hpp"

namespace lidar_camera_recalibration {

std::unique_ptr<Search> makeSearch(const SearchConfig& config) {
  if (config.search == "paper") return std::make_unique<PaperSearch>(config);
  if (config.search == "coarse_to_fine") return std::make_unique<CoarseToFineSearch>(config);
  throw Error(ErrorCause::kParameter,
              "search: '" + config.search + "' is unknown; use 'coarse_to_fine' or 'paper'");
}

}  // namespace lidar_camera_recalibration
