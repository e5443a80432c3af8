#include "region_information.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "multiversion.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr std::size_t kTogether = 8;  // points that are looked at together

double computeNLogN(std::size_t n) {
  return n == 0 ? 0.0 : static_cast<double>(n) * std::log(static_cast<double>(n));
}

double nLogN(std::size_t n) {
  static const auto table = [] {
    std::array<double, 1024> values;
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = computeNLogN(i);
    return values;
  }();
  return n < table.size() ? table[n] : computeNLogN(n);
}

/// How often each set occurs.
struct Counts {
  std::uint32_t* of_set;
  std::uint32_t* touched;  ///< sets that occur, in the order of their first occurrence
  std::size_t touched_count;

  void add(std::uint32_t set, std::uint32_t points) {
    touched[touched_count] = set;
    touched_count += of_set[set] == 0;
    of_set[set] += points;
  }
};

/// Neighbours mostly lie in the same mask: then they are counted at once.
LCR_MULTIVERSION void countSets(const std::uint32_t* sets, std::size_t count, Counts& result) {
  Counts counts = result;
  std::size_t i = 0;
  for (; i + kTogether <= count; i += kTogether) {
    std::uint32_t differ = 0;
    for (std::size_t k = 0; k < kTogether; ++k) differ |= sets[i + k] ^ sets[i];
    if (differ == 0) {
      counts.add(sets[i], kTogether);
    } else {
      for (std::size_t k = 0; k < kTogether; ++k) counts.add(sets[i + k], 1);
    }
  }
  for (; i < count; ++i) counts.add(sets[i], 1);
  result = counts;
}

}  // namespace

ClassifiedPoints::ClassifiedPoints(const FramePoints& points, const std::vector<std::uint32_t>& chosen) {
  const auto classOf = [&](std::uint32_t i) { return static_cast<std::size_t>(points.segment[i] + 1); };
  std::vector<std::size_t> next(static_cast<std::size_t>(points.segment_count) + 2, 0);
  for (const std::uint32_t i : chosen) ++next[classOf(i) + 1];
  for (std::size_t c = 1; c < next.size(); ++c) next[c] += next[c - 1];
  class_end.assign(next.begin() + 1, next.end());
  for (auto* column : {&places.x, &places.y, &places.z}) column->resize(chosen.size());
  for (const std::uint32_t i : chosen) {
    const std::size_t place = next[classOf(i)]++;
    places.x[place] = points.x[i];
    places.y[place] = points.y[i];
    places.z[place] = points.z[i];
  }
}

double RegionInformation::operator()(const MaskSets& masks, const ClassifiedPoints& points,
                                     const Projection& project, std::size_t& used) {
  const auto outside = static_cast<std::uint32_t>(masks.setCount());  // counts like a set, but is left out
  in_class_.assign(outside + 1, 0);
  in_all_.assign(outside, 0);
  touched_.resize(outside + 2);
  Counts counts{in_class_.data(), touched_.data(), 0};

  // With the sums of n log n over cells, sets and classes: H = log n - sum / n.
  double cells = 0.0, classes = 0.0;
  std::size_t total = 0;
  const auto finishClass = [&] {
    std::size_t of_class = 0;
    for (std::size_t t = 0; t < counts.touched_count; ++t) {
      const std::uint32_t set = touched_[t], n = in_class_[set];
      in_class_[set] = 0;
      if (set == outside) continue;
      cells += nLogN(n);
      in_all_[set] += n;
      of_class += n;
    }
    classes += nLogN(of_class);
    total += of_class;
    counts.touched_count = 0;
  };

  Block<std::uint32_t> sets;
  auto class_end = points.class_end.begin();
  for (std::size_t first = 0; first < points.places.size(); first += kBlock) {
    const std::size_t end = std::min(first + kBlock, points.places.size());
    project.lookUp(masks.setOfPixel(), points.places, first, end - first, outside, sets);
    std::size_t i = first;
    while (*class_end <= end) {
      countSets(sets.data() + (i - first), *class_end - i, counts);
      finishClass();
      i = *class_end;
      if (++class_end == points.class_end.end()) break;
    }
    if (i < end) countSets(sets.data() + (i - first), end - i, counts);
  }

  used += total;
  if (total == 0) return 0.0;
  double all_sets = 0.0;
  for (const std::uint32_t n : in_all_) all_sets += nLogN(n);
  const double whole = nLogN(total);  // n H = whole - sum
  return whole > cells ? (whole - all_sets - classes + cells) / (whole - cells) : 0.0;
}

}  // namespace lidar_camera_recalibration
