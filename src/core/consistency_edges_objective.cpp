#include "consistency_edges_objective.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "lidar_camera_recalibration/error.hpp"
#include "multiversion.hpp"

namespace lidar_camera_recalibration {
namespace {

using View = ConsistencyEdgesEvaluator::View;
using Edges = ConsistencyEdgesEvaluator::Edges;

/// Beside the end of a border: nearer to its line than to itself by this much [px].
constexpr float kBesideEnd = 2.0f;

BoundaryField::Direction directionOf(EdgePoints::Kind kind) {
  return kind == EdgePoints::Kind::kRingGap ? BoundaryField::kLevel : BoundaryField::kUpright;
}

/// Of a block of edges with weights; each place of a block has a sum of its own, so that the order of
/// additions does not depend on the CPU.
LCR_MULTIVERSION void addProducts(const float* weight, const float* value, std::size_t count,
                                  float* __restrict sums) {
  for (std::size_t i = 0; i < count; ++i) sums[i] += weight[i] * value[i];
}

/// Sums by place in a block.
using BlockSums = Block<float>;

/// Calls function(direction, edges, first, count) for all edges of a view, block by block.
template <typename Function>
void forEachBlock(const View& view, const Function& function) {
  for (const auto direction : {BoundaryField::kUpright, BoundaryField::kLevel}) {
    const Edges& edges = view.edges[direction];
    for (std::size_t first = 0; first < edges.size(); first += kBlock) {
      function(direction, edges, first, std::min(kBlock, edges.size() - first));
    }
  }
}

/// Weight times closeness.
void addEdges(const View& view, const Projection& project, std::size_t level, BlockSums& sums) {
  PixelBlock pixels;
  Block<float> closeness;
  forEachBlock(view, [&](BoundaryField::Direction direction, const Edges& edges, std::size_t first,
                         std::size_t count) {
    project.project(edges.places, first, count, pixels);
    view.frame->borders->closeness(direction, level, pixels, count, closeness);
    addProducts(edges.weight.data() + first, closeness.data(), count, sums.data());
  });
}

double meanOf(const BlockSums& sums, double weight) {
  return weight > 0.0 ? std::accumulate(sums.begin(), sums.end(), 0.0) / weight : 0.0;
}

/// Edges with the lines of their borders, and what a step of Gauss-Newton needs of them.
struct Matches {
  std::size_t count;
  Block<float> x, y, inverse_depth;  ///< of the edge in the optical frame: x / z, y / z, 1 / z [1/m]
  Block<float> nu, nv;               ///< across the line
  Block<float> residual;             ///< in widths of the border
  Block<float> weight;
};

/// Products of the columns of a block are summed in so many lanes side by side.
constexpr std::size_t kLanes = 32;
static_assert(kBlock % kLanes == 0);
constexpr std::size_t kColumns = 7;  // 6 derivatives and the residual

/// The derivatives of the residuals by the perturbation and the residuals, times the root of the weights.
/// @param share  sums up weight times closeness by place in the block, as addProducts
LCR_MULTIVERSION void weightedColumns(const Matches& matches, float fx, float fy,
                                      Block<float>* __restrict columns, float* __restrict share) {
  for (std::size_t i = 0; i < matches.count; ++i) {
    const float x = matches.x[i], y = matches.y[i], residual = matches.residual[i];
    // exp(-t) = exp(-t / 32)^32; to 1e-6 where it is above 1e-3.
    const float t = residual * residual * (-0.5f / 32.0f);
    float closeness =
        1.0f + t * (1.0f + t * (0.5f + t * (1.0f / 6.0f + t * (1.0f / 24.0f + t * (1.0f / 120.0f)))));
    for (int square = 0; square < 5; ++square) closeness *= closeness;
    share[i] += matches.weight[i] * closeness;
    const float root = std::sqrt(0.5f * matches.weight[i] * closeness);
    // The pixel moves with the point, d(exp(xi) p) = omega x p + v; a, b, c are its derivatives times the
    // depth.
    const float a = root * fx * matches.nu[i], b = root * fy * matches.nv[i], c = -(a * x + b * y);
    columns[0][i] = y * c - b;
    columns[1][i] = a - x * c;
    columns[2][i] = x * b - y * a;
    columns[3][i] = matches.inverse_depth[i] * a;
    columns[4][i] = matches.inverse_depth[i] * b;
    columns[5][i] = matches.inverse_depth[i] * c;
    columns[6][i] = root * residual;
  }
}

/// @param count  a multiple of kLanes
LCR_MULTIVERSION float scalarProduct(const float* a, const float* b, std::size_t count) {
  float lanes[kLanes] = {};
  for (std::size_t i = 0; i < count; i += kLanes) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) lanes[lane] += a[i + lane] * b[i + lane];
  }
  float sum = 0.0f;
  for (const float lane : lanes) sum += lane;
  return sum;
}

}  // namespace

void Edges::add(float x, float y, float z, float edge_weight) {
  places.add(x, y, z);
  weight.push_back(edge_weight);
}

ConsistencyEdgesEvaluator::ConsistencyEdgesEvaluator(std::vector<View> views, double region_weight)
    : views_(std::move(views)), region_weight_(region_weight) {
  for (const View& view : views_) {
    for (const Edges& edges : view.edges) {
      edge_count_ += edges.size();
      for (const float weight : edges.weight) weight_ += static_cast<double>(weight);
    }
  }
}

Score ConsistencyEdgesEvaluator::operator()(const Eigen::Isometry3d& T_camera_lidar) {
  Score score;
  BlockSums edge_sums = {};
  RegionInformation information;
  for (const View& view : views_) {
    const Projection project(view.camera(), T_camera_lidar);
    addEdges(view, project, kScoreLevel, edge_sums);
    std::size_t used = 0;
    score.region +=
        information(view.frame->masks, view.points, project, used) / static_cast<double>(views_.size());
    score.points += used;
    if (used > 0) score.masks += view.frame->masks.maskCount();
  }
  score.edges = meanOf(edge_sums, weight_);
  score.total = score.edges + region_weight_ * score.region;
  return score;
}

double ConsistencyEdgesEvaluator::edgeScore(const Eigen::Isometry3d& T_camera_lidar,
                                            std::size_t level) const {
  BlockSums sums = {};
  for (const View& view : views_) addEdges(view, Projection(view.camera(), T_camera_lidar), level, sums);
  return meanOf(sums, weight_);
}

Linearisation ConsistencyEdgesEvaluator::linearise(const Eigen::Isometry3d& T_camera_lidar,
                                                   std::size_t level) const {
  // Edges with less closeness have no say.
  static const auto kMaxResidual = static_cast<float>(std::sqrt(-2.0 * std::log(1e-3)));
  PixelBlock pixels;
  Block<std::int32_t> nearest;
  Matches matches;
  std::array<Block<float>, kColumns> columns;
  BlockSums shares = {};
  Eigen::Matrix<double, kColumns, kColumns> sums;
  sums.setZero();
  for (const View& view : views_) {
    const Projection project(view.camera(), T_camera_lidar);
    forEachBlock(view, [&](BoundaryField::Direction direction, const Edges& edges, std::size_t first,
                           std::size_t count) {
      project.project(edges.places, first, count, pixels);
      view.frame->borders->nearest(direction, pixels, count, nearest);
      const std::vector<BoundaryField::Line>& lines = view.frame->borders->lines(direction);
      const Intrinsics& camera = view.camera();
      const auto fx = static_cast<float>(camera.fx), fy = static_cast<float>(camera.fy);
      const auto cx = static_cast<float>(camera.cx), cy = static_cast<float>(camera.cy);
      const auto width = static_cast<float>(camera.fx * kBoundaryWidths[level] * kDegree);  // [px]
      matches.count = 0;
      for (std::size_t i = 0; i < count; ++i) {
        if (nearest[i] < 0) continue;
        const BoundaryField::Line& line = lines[static_cast<std::size_t>(nearest[i])];
        const float du = pixels.u[i] - line.u, dv = pixels.v[i] - line.v;
        const float across = du * line.nu + dv * line.nv, end = std::abs(across) + kBesideEnd;
        // Written first and counted after: nobody can guess which edges match.
        const std::size_t m = matches.count;
        matches.x[m] = (pixels.u[i] - cx) / fx;
        matches.y[m] = (pixels.v[i] - cy) / fy;
        matches.inverse_depth[m] = pixels.inverse_depth[i];
        matches.nu[m] = line.nu / width;
        matches.nv[m] = line.nv / width;
        matches.residual[m] = across / width;
        matches.weight[m] = edges.weight[first + i];
        matches.count += static_cast<std::size_t>((du * du + dv * dv <= end * end) &
                                                  (std::abs(matches.residual[m]) < kMaxResidual));
      }
      weightedColumns(matches, fx, fy, columns.data(), shares.data());
      const std::size_t padded = (matches.count + kLanes - 1) / kLanes * kLanes;
      for (Block<float>& column : columns) {
        std::fill(column.begin() + matches.count, column.begin() + padded, 0.0f);
      }
      for (std::size_t row = 0; row < kColumns; ++row) {
        for (std::size_t column = 0; column <= row; ++column) {
          sums(row, column) +=
              static_cast<double>(scalarProduct(columns[row].data(), columns[column].data(), padded));
        }
      }
    });
  }
  Linearisation result;
  result.H = sums.topLeftCorner<6, 6>().selfadjointView<Eigen::Lower>();
  result.b = sums.row(6).head<6>();
  result.cost = weight_ - std::accumulate(shares.begin(), shares.end(), 0.0);
  return result;
}

ConsistencyEdgesEvaluator ConsistencyEdgesEvaluator::thinned(std::size_t count) const {
  const std::size_t step = std::max<std::size_t>(1, edge_count_ / std::max<std::size_t>(1, count));
  std::vector<View> views;
  std::size_t number = 0;
  for (const View& view : views_) {
    View thin{view.frame, {}, {}};
    for (std::size_t direction = 0; direction < view.edges.size(); ++direction) {
      const Edges& edges = view.edges[direction];
      for (std::size_t i = 0; i < edges.size(); ++i) {
        if (number++ % step != 0) continue;
        thin.edges[direction].add(edges.places.x[i], edges.places.y[i], edges.places.z[i], edges.weight[i]);
      }
    }
    views.push_back(std::move(thin));
  }
  return ConsistencyEdgesEvaluator(std::move(views), 0.0);
}

ConsistencyEdgesObjective::ConsistencyEdgesObjective(const ObjectiveConfig& config)
    : edge_weights_{static_cast<float>(config.weight_azimuth_gap), static_cast<float>(config.weight_ring_gap),
                    static_cast<float>(config.weight_reflectivity_step)},
      region_weight_(config.weight_region) {
  const std::array<double, 4> weights = {config.weight_azimuth_gap, config.weight_ring_gap,
                                         config.weight_reflectivity_step, config.weight_region};
  const bool valid =
      std::all_of(weights.begin(), weights.end(), [](double w) { return std::isfinite(w) && w >= 0.0; });
  if (!valid || weights[0] + weights[1] + weights[2] <= 0.0) {
    throw Error(ErrorCause::kParameter,
                "consistency_edges weights: they must not be negative, and one of weight_azimuth_gap, "
                "weight_ring_gap and weight_reflectivity_step must be above 0");
  }
}

std::unique_ptr<Evaluator> ConsistencyEdgesObjective::evaluator(const Frames& frames,
                                                                const Views& in_view) const {
  std::vector<View> views;
  for (const FramePtr& frame : frames) {
    if (!frame->borders) {
      throw Error(ErrorCause::kParameter,
                  "objective 'consistency_edges': a frame was made without edges; set FrameConfig::edges");
    }
    std::vector<Projection> bounds;
    for (const Eigen::Isometry3d& T : in_view) bounds.emplace_back(frame->camera.intrinsics(), T);
    const float margin = kViewMargin * static_cast<float>(frame->camera.intrinsics().height);
    const auto seen = [&](float x, float y, float z, float distance) {
      return std::all_of(bounds.begin(), bounds.end(),
                         [&](const Projection& view) { return view.wellInside(x, y, z, distance); });
    };
    View view{frame, {}, {}};
    const EdgePoints& edges = frame->edges;
    for (std::size_t i = 0; i < edges.size(); ++i) {
      const float weight = edges.weight[i] * edge_weights_[static_cast<std::size_t>(edges.kind[i])];
      if (!(weight > 0.0f) || !seen(edges.x[i], edges.y[i], edges.z[i], 0.0f)) continue;
      view.edges[directionOf(edges.kind[i])].add(edges.x[i], edges.y[i], edges.z[i], weight);
    }
    const FramePoints& points = frame->points;
    std::vector<std::uint32_t> chosen;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (seen(points.x[i], points.y[i], points.z[i], margin))
        chosen.push_back(static_cast<std::uint32_t>(i));
    }
    view.points = ClassifiedPoints(points, chosen);
    views.push_back(std::move(view));
  }
  return std::make_unique<ConsistencyEdgesEvaluator>(std::move(views), region_weight_);
}

}  // namespace lidar_camera_recalibration
