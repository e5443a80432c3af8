#pragma once

#include <cstdint>
#include <random>

namespace lidar_camera_recalibration::simulation {

/// Seeded random numbers with the few draws the simulation needs.
/// Generators of different streams are independent, so a frame or an image row never depends on what was
/// drawn elsewhere.
class Random {
 public:
  explicit Random(std::uint64_t seed, std::uint64_t stream = 0, std::uint64_t substream = 0) {
    std::seed_seq sequence{low(seed), high(seed), low(stream), high(stream), low(substream), high(substream)};
    generator_.seed(sequence);
  }

  double uniform(double from, double to) {
    return std::uniform_real_distribution<double>(from, to)(generator_);
  }
  int integer(int from, int to) {
    return std::uniform_int_distribution<int>(from, to)(generator_);
  }  ///< both ends included
  bool chance(double probability) { return uniform(0.0, 1.0) < probability; }
  double gaussian(double sigma) { return sigma * normal_(generator_); }
  std::uint64_t bits() { return generator_(); }
  std::mt19937_64& generator() { return generator_; }

 private:
  static std::uint32_t low(std::uint64_t value) { return static_cast<std::uint32_t>(value); }
  static std::uint32_t high(std::uint64_t value) { return static_cast<std::uint32_t>(value >> 32); }

  std::mt19937_64 generator_;
  std::normal_distribution<double> normal_;
};

}  // namespace lidar_camera_recalibration::simulation
