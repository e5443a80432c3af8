#include "lidar_edges.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>

#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {
namespace {

using Indices = std::vector<std::size_t>;

// A laser may start so far from the origin of the cloud; this shifts its rays' directions [m].
constexpr float kMaxLaserHeight = 0.25f;

constexpr std::size_t kMinRings = 4;
constexpr std::size_t kMaxRings = 512;
constexpr std::size_t kMinRingPoints = 10;

// Limits of neighbourhood, in steps of the ring's azimuth and of the rings' elevation.
constexpr float kMaxSteps = 1.6f;
constexpr float kMaxRingSteps = 2.2f;
// A step of the range that is an edge [m], [m/m].
constexpr float kAzimuthGap = 0.3f, kRelativeAzimuthGap = 0.03f;
constexpr float kRingGap = 0.8f, kRelativeRingGap = 0.08f;
// Surfaces that look up more than this end at the horizon of the ground, not at a silhouette.
constexpr float kMaxUpward = 0.85f;
// A step of the reflectivity: against 0..1, and against the scatter on both sides.
constexpr float kReflectivityStep = 0.08f;
constexpr float kStepToScatter = 4.0f;

constexpr float kFullGap = 2.0f;           // [m]; smaller steps of the range count less
constexpr float kFullReflectivity = 0.2f;  // likewise
constexpr float kFullRingGap = 0.3f * static_cast<float>(kDegree);  // [rad]; wider gaps count less

// The gap between two rings is sampled this finely [rad], but by not more than so many places.
constexpr float kGapSampling = 0.1f * static_cast<float>(kDegree);
constexpr int kMaxGapSamples = 24;
// The surface is continued into the gap by at most this share of its distance: normals are rough near edges.
constexpr float kMaxContinuation = 0.03f;

float azimuthOf(const Eigen::Vector3f& p) { return std::atan2(p.y(), p.x()); }
float elevationOf(const Eigen::Vector3f& p) { return std::atan2(p.z(), std::hypot(p.x(), p.y())); }

float median(std::vector<float> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Whether there are so many different numbers. Some drivers have the column and leave it at 0.
bool differ(const std::vector<std::uint16_t>& numbers, std::size_t count) {
  std::set<std::uint16_t> seen;
  return std::any_of(numbers.begin(), numbers.end(), [&](std::uint16_t number) {
    seen.insert(number);
    return seen.size() >= count;
  });
}

std::vector<std::uint16_t> ringsFromTurns(const std::vector<Eigen::Vector3f>& points) {
  constexpr float kTurn = 2.0f * static_cast<float>(M_PI);
  std::vector<float> azimuth;
  for (const auto& p : points) azimuth.push_back(azimuthOf(p));
  long direction = 0;
  for (std::size_t i = 1; i < azimuth.size(); ++i) {
    const float step = std::remainder(azimuth[i] - azimuth[i - 1], kTurn);
    if (std::abs(step) < 0.05f) direction += step > 0.0f ? 1 : -1;
  }
  // The angle since the first point; a degree more, because not all rings start at the same azimuth.
  const float sign = direction >= 0 ? 1.0f : -1.0f, lead = static_cast<float>(kDegree);
  float extent = 0.0f;
  for (float& a : azimuth) {
    const float turned = std::remainder(sign * (a - azimuthOf(points.front())) + lead, kTurn);
    a = turned < 0.0f ? turned + kTurn : turned;
    extent = std::max(extent, a);
  }
  std::vector<std::uint16_t> rings(points.size(), 0);
  std::size_t ring = 0, begin = 0;
  for (std::size_t i = 1; i < points.size(); ++i) {
    if (azimuth[i - 1] - azimuth[i] > 0.5f * extent && i - begin >= kMinRingPoints) {
      if (++ring >= kMaxRings) return {};  // not ring by ring
      begin = i;
    }
    rings[i] = static_cast<std::uint16_t>(ring);
  }
  return ring + 1 >= kMinRings ? rings : std::vector<std::uint16_t>();
}

// Rings are the peaks of the histogram of the elevation; they end at its valleys.
std::vector<std::uint16_t> ringsFromElevation(const std::vector<Eigen::Vector3f>& points) {
  constexpr double kBin = 0.04 * kDegree;
  constexpr std::size_t kBins = static_cast<std::size_t>(M_PI / kBin) + 2;
  std::vector<std::size_t> bin;
  std::vector<double> histogram(kBins + 2, 0.0);
  for (const auto& p : points) {
    bin.push_back(1 + static_cast<std::size_t>((elevationOf(p) + M_PI / 2.0) / kBin));
    ++histogram[bin.back()];
  }
  std::vector<double> smooth(histogram.size(), 0.0);
  for (std::size_t b = 1; b + 1 < histogram.size(); ++b) {
    smooth[b] = 0.25 * histogram[b - 1] + 0.5 * histogram[b] + 0.25 * histogram[b + 1];
  }
  std::vector<std::uint16_t> ring_of_bin(histogram.size(), 0);
  std::size_t ring = 0;
  double peak = 0.0, valley = 0.0;
  for (std::size_t b = 1; b < smooth.size(); ++b) {
    valley = std::min(valley, smooth[b]);
    if (peak >= static_cast<double>(kMinRingPoints) && smooth[b] > 3.0 * valley + kMinRingPoints &&
        valley < 0.5 * peak) {
      ++ring;
      peak = 0.0;
    }
    if (smooth[b] > peak) {
      peak = smooth[b];
      valley = peak;
    }
    ring_of_bin[b] = static_cast<std::uint16_t>(ring);
  }
  if (ring + 1 < kMinRings || ring >= kMaxRings) return {};
  std::vector<std::uint16_t> rings;
  for (const std::size_t b : bin) rings.push_back(ring_of_bin[b]);
  return rings;
}

// The points of one laser in the order of their azimuth, which is counted from the middle of the cloud.
struct Ring {
  Indices points;
  float elevation = 0.0f;  // median [rad]
  // The lasers do not all start at the origin of the cloud. At the horizontal distance h the ring is at
  // z = height + slope * h.
  float height = 0.0f, slope = 0.0f;  // [m], [m/m]
  float step = 0.0f;                  // median distance of neighbours in azimuth [rad]
};

class EdgeFinder {
 public:
  EdgeFinder(const PointCloud& cloud, const LidarFeatures& features, const std::vector<std::uint8_t>& visible)
      : cloud_(cloud), features_(features), visible_(visible) {
    Eigen::Vector3f middle = Eigen::Vector3f::Zero();
    for (const auto& p : cloud.points) middle += p.normalized();
    for (const auto& p : cloud.points) {
      azimuth_.push_back(static_cast<float>(std::remainder(azimuthOf(p) - azimuthOf(middle), 2.0 * M_PI)));
      elevation_.push_back(elevationOf(p));
      range_.push_back(p.norm());
    }
    makeRings();
  }

  EdgePoints find() {
    for (const Ring& ring : rings_) {
      addAzimuthGaps(ring);
      if (!features_.reflectivity.empty()) addReflectivitySteps(ring);
    }
    addRingGaps();
    for (auto* column : {&edges_.x, &edges_.y, &edges_.z, &edges_.weight}) column->shrink_to_fit();
    edges_.kind.shrink_to_fit();
    edges_.ring_step = ringStep();
    return std::move(edges_);
  }

 private:
  void makeRings() {
    std::map<std::uint16_t, Ring> by_number;
    for (std::size_t i = 0; i < cloud_.size(); ++i) by_number[cloud_.ring[i]].points.push_back(i);
    for (auto& [number, ring] : by_number) {
      if (ring.points.size() < kMinRingPoints) continue;
      std::stable_sort(ring.points.begin(), ring.points.end(),
                       [&](std::size_t a, std::size_t b) { return azimuth_[a] < azimuth_[b]; });
      std::vector<float> elevations, steps;
      for (std::size_t k = 0; k < ring.points.size(); ++k) {
        elevations.push_back(elevation_[ring.points[k]]);
        if (k > 0) steps.push_back(azimuth_[ring.points[k]] - azimuth_[ring.points[k - 1]]);
      }
      ring.elevation = median(std::move(elevations));
      ring.step = median(std::move(steps));
      fitCone(ring);
      rings_.push_back(std::move(ring));
    }
    // Sensors number their rings by elevation, which is more reliable than the measured one; but not all do.
    const auto rises = [](const Ring& a, const Ring& b) { return a.elevation < b.elevation; };
    std::size_t rising = 0;
    for (std::size_t r = 1; r < rings_.size(); ++r) rising += rises(rings_[r - 1], rings_[r]);
    if (10 * rising < 2 * rings_.size()) {
      std::reverse(rings_.begin(), rings_.end());
    } else if (10 * rising < 8 * rings_.size()) {
      std::stable_sort(rings_.begin(), rings_.end(), rises);
    }
  }

  double ringStep() const {
    if (rings_.size() < 2) return 0.0;
    std::vector<float> steps;
    for (std::size_t r = 1; r < rings_.size(); ++r)
      steps.push_back(std::abs(rings_[r].elevation - rings_[r - 1].elevation));
    return static_cast<double>(median(std::move(steps)));
  }

  // Height and slope by least squares of z/h = slope + height/h. The height stays near 0 where a ring has met
  // only one distance.
  void fitCone(Ring& ring) const {
    constexpr double kNoise = 0.001, kHeight = 0.1;  // of z/h; usual height [m]
    double n = 0.0, sx = 0.0, sy = 0.0, sxx = 0.0, sxy = 0.0;
    for (const std::size_t i : ring.points) {
      const auto& p = cloud_.points[i];
      const double x = 1.0 / std::max(0.1, std::hypot<double>(p.x(), p.y())), y = p.z() * x;
      n += 1.0;
      sx += x;
      sy += y;
      sxx += x * x;
      sxy += x * y;
    }
    const double height = (sxy - sx * sy / n) / (sxx - sx * sx / n + kNoise * kNoise / (kHeight * kHeight));
    ring.height = static_cast<float>(height);
    ring.slope = static_cast<float>((sy - height * sx) / n);
  }

  // Neighbours of one ring. A point that was given the wrong ring shows in its elevation.
  bool adjacent(const Ring& ring, std::size_t a, std::size_t b) const {
    return std::abs(azimuth_[a] - azimuth_[b]) <= kMaxSteps * ring.step &&
           std::abs(elevation_[a] - elevation_[b]) <= ring.step + parallax(a, b);
  }

  // Between the elevations of two points of one laser [rad].
  float parallax(std::size_t a, std::size_t b) const {
    return kMaxLaserHeight * std::abs(1.0f / range_[a] - 1.0f / range_[b]);
  }

  static float gapAt(float range) { return std::max(kAzimuthGap, kRelativeAzimuthGap * range); }

  // Whether the `count` points from position k on in a direction (+-1) are neighbours on one surface.
  bool smooth(const Ring& ring, std::size_t k, int direction, int count) const {
    for (int n = 1; n < count; ++n) {
      const std::size_t next = k + static_cast<std::size_t>(direction);  // wraps below 0: then too large
      if (next >= ring.points.size()) return false;
      const std::size_t a = ring.points[k], b = ring.points[next];
      if (!adjacent(ring, a, b)) return false;
      if (std::abs(range_[a] - range_[b]) > 0.5f * gapAt(std::min(range_[a], range_[b]))) return false;
      k = next;
    }
    return true;
  }

  void addAzimuthGaps(const Ring& ring) {
    constexpr int kSmooth = 2;
    for (std::size_t k = 0; k + 1 < ring.points.size(); ++k) {
      const std::size_t a = ring.points[k], b = ring.points[k + 1];
      const float gap = std::abs(range_[a] - range_[b]);
      if (gap <= gapAt(std::min(range_[a], range_[b])) || !adjacent(ring, a, b)) continue;
      const bool first = range_[a] < range_[b];
      if (!smooth(ring, first ? k : k + 1, first ? -1 : 1, kSmooth)) continue;
      const std::size_t near = first ? a : b, far = first ? b : a;
      if (!visible(near)) continue;
      // The silhouette is half a step further. Not half way to the far point: in a cloud that was moved to
      // another time the far point stands elsewhere, as seen from the near one.
      const float turn = std::copysign(0.5f * ring.step, azimuth_[far] - azimuth_[near]);
      const Eigen::Vector3f& p = cloud_.points[near];
      const float sine = std::sin(turn), cosine = std::cos(turn);
      add({cosine * p.x() - sine * p.y(), sine * p.x() + cosine * p.y(), p.z()}, gapWeight(near, far),
          EdgePoints::Kind::kAzimuthGap);
    }
  }

  // Two points on each side of a step, and two in the middle. The beam is as wide as a step of the azimuth:
  // what the two in the middle have of each side tells the place of the step to a fraction of that.
  void addReflectivitySteps(const Ring& ring) {
    constexpr std::size_t kWindow = 6;
    for (std::size_t k = 0; k + kWindow <= ring.points.size(); ++k) {
      if (!smooth(ring, k, 1, kWindow)) continue;
      std::array<float, kWindow> r;
      for (std::size_t n = 0; n < kWindow; ++n) r[n] = features_.reflectivity[ring.points[k + n]];
      const float before = 0.5f * (r[0] + r[1]), after = 0.5f * (r[4] + r[5]), step = after - before;
      const float scatter = 0.5f * std::hypot(r[1] - r[0], r[5] - r[4]);
      if (std::abs(step) <= std::max(kReflectivityStep, kStepToScatter * scatter)) continue;
      const std::size_t a = ring.points[k + 2], b = ring.points[k + 3];
      if (!visible(a)) continue;
      const auto shareBefore = [&](float value) { return std::clamp((after - value) / step, 0.0f, 1.0f); };
      const float place = shareBefore(r[2]) + shareBefore(r[3]) - 0.5f;  // from a to b, in steps
      add(cloud_.points[a] + place * (cloud_.points[b] - cloud_.points[a]),
          std::min(1.0f, std::abs(step) / kFullReflectivity), EdgePoints::Kind::kReflectivity);
    }
  }

  void addRingGaps() {
    if (rings_.size() < kMinRings) return;
    std::vector<float> spacings;
    for (std::size_t r = 1; r < rings_.size(); ++r) {
      spacings.push_back(rings_[r].elevation - rings_[r - 1].elevation);
    }
    const float limit = kMaxRingSteps * median(spacings);
    for (std::size_t r = 1; r < rings_.size(); ++r) addRingGaps(rings_[r - 1], rings_[r], limit);
  }

  void addRingGaps(const Ring& lower, const Ring& upper, float limit) {
    std::size_t k = 0;
    const float reach = std::max(lower.step, upper.step);
    for (const std::size_t a : lower.points) {
      const auto distance = [&](std::size_t n) { return std::abs(azimuth_[upper.points[n]] - azimuth_[a]); };
      while (k + 1 < upper.points.size() && distance(k + 1) <= distance(k)) ++k;
      const std::size_t b = upper.points[k];
      if (distance(k) > reach || std::abs(elevation_[b] - elevation_[a]) > limit + parallax(a, b)) continue;
      const std::size_t near = range_[a] < range_[b] ? a : b, far = range_[a] < range_[b] ? b : a;
      if (range_[far] - range_[near] <= std::max(kRingGap, kRelativeRingGap * range_[near])) continue;
      if (features_.segment[near] == features_.segment[far]) continue;
      if (std::abs(features_.normals[near].z()) >= kMaxUpward) continue;
      if (visible(near)) addSilhouetteBetween(near, far, near == a ? upper : lower);
    }
  }

  // Somewhere between the near point and the ring that misses its surface the silhouette runs, all places are
  // as likely: the edge is sampled over the whole gap. Then a border anywhere in the gap pulls to neither
  // side, where the middle alone would be drawn by the gap's half width, 2.5 px of 64 beams and 12 px of 16.
  // The wider the gap, the less the silhouette tells.
  void addSilhouetteBetween(std::size_t near, std::size_t far, const Ring& other) {
    const Eigen::Vector3f& p = cloud_.points[near];
    const float from = std::hypot(p.x(), p.y()), to = distanceOnSurface(near, other);
    const float height = other.height + other.slope * to;
    const float width = std::abs(std::atan2(height, to) - elevation_[near]);
    const int samples = std::clamp(static_cast<int>(std::ceil(width / kGapSampling)), 1, kMaxGapSamples);
    const float weight = gapWeight(near, far) * std::min(1.0f, kFullRingGap / width);
    for (int k = 0; k < samples; ++k) {
      const float share = (static_cast<float>(k) + 0.5f) / static_cast<float>(samples);
      const float stretch = 1.0f + share * (to / from - 1.0f);
      add({stretch * p.x(), stretch * p.y(), p.z() + share * (height - p.z())},
          weight / static_cast<float>(samples), EdgePoints::Kind::kRingGap);
    }
  }

  // Horizontal distance [m] at which another ring would meet the plane of the surface at a point, above or
  // below it.
  float distanceOnSurface(std::size_t near, const Ring& other) const {
    const Eigen::Vector3f& p = cloud_.points[near];
    const Eigen::Vector3f& n = features_.normals[near];
    const float here = std::hypot(p.x(), p.y());
    const Eigen::Vector3f ray(p.x() / here, p.y() / here, other.slope);
    const float there = (n.dot(p) - n.z() * other.height) / n.dot(ray);
    if (!std::isfinite(there)) return here;
    return std::clamp(there, here * (1.0f - kMaxContinuation), here * (1.0f + kMaxContinuation));
  }

  float gapWeight(std::size_t near, std::size_t far) const {
    return std::min(1.0f, (range_[far] - range_[near]) / kFullGap);
  }

  void add(const Eigen::Vector3f& point, float weight, EdgePoints::Kind kind) {
    edges_.x.push_back(point.x());
    edges_.y.push_back(point.y());
    edges_.z.push_back(point.z());
    edges_.weight.push_back(weight);
    edges_.kind.push_back(kind);
  }

  bool visible(std::size_t i) const { return visible_.empty() || visible_[i] != 0; }

  const PointCloud& cloud_;
  const LidarFeatures& features_;
  const std::vector<std::uint8_t>& visible_;
  std::vector<float> azimuth_, elevation_;  // [rad]
  std::vector<float> range_;                // [m]
  std::vector<Ring> rings_;                 // from the lowest to the highest
  EdgePoints edges_;
};

}  // namespace

std::vector<std::uint16_t> ringsOf(const PointCloud& cloud) {
  if (cloud.ring.size() == cloud.size() && differ(cloud.ring, kMinRings)) return cloud.ring;
  if (cloud.points.empty()) return {};
  const std::vector<std::uint16_t> rings = ringsFromTurns(cloud.points);
  return rings.empty() ? ringsFromElevation(cloud.points) : rings;
}

EdgePoints findLidarEdges(const PointCloud& cloud, const LidarFeatures& features,
                          const std::vector<std::uint8_t>& visible) {
  if (cloud.points.empty() || cloud.ring.size() != cloud.size()) return {};
  return EdgeFinder(cloud, features, visible).find();
}

}  // namespace lidar_camera_recalibration
