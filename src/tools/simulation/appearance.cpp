#include "simulation/appearance.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace lidar_camera_recalibration::simulation {

using Eigen::Vector2f;
using Eigen::Vector3f;

namespace {

/// -1..1, the same for the same lattice point.
float latticeValue(std::int32_t x, std::int32_t y) {
  std::uint32_t h = static_cast<std::uint32_t>(x) * 0x8da6b343U ^ static_cast<std::uint32_t>(y) * 0xd8163841U;
  h = (h ^ (h >> 15)) * 0x2c1b3c6dU;
  h = (h ^ (h >> 12)) * 0x297a2d39U;
  h ^= h >> 15;
  return static_cast<float>(h) * (2.0F / 4294967295.0F) - 1.0F;
}

/// Noise of a wave length [m], gone where a pixel covers more than that.
float detail(const Vector2f& at, float wave_length, float footprint) {
  const float ratio = footprint / wave_length;
  if (ratio > 3.0F) return 0.0F;
  return smoothNoise(at.x() / wave_length, at.y() / wave_length) / (1.0F + ratio * ratio);
}

float fraction(float value) { return value - std::floor(value); }

/// 1 on the lines between cells of the given size, 0 inside; faded by the footprint.
float joints(const Vector2f& at, const Vector2f& cell, float line, float footprint, bool staggered) {
  const float row = std::floor(at.y() / cell.y());
  const float shift = staggered ? 0.5F * cell.x() * (std::fmod(std::abs(row), 2.0F)) : 0.0F;
  const float x = fraction((at.x() + shift) / cell.x()) * cell.x(),
              y = fraction(at.y() / cell.y()) * cell.y();
  const float share = line / cell.x() + line / cell.y();  // what a pixel sees that covers many cells
  const float blend = std::clamp(footprint / (0.5F * cell.minCoeff()), 0.0F, 1.0F);
  const float sharp = x < line || y < line ? 1.0F : 0.0F;
  return (1 - blend) * sharp + blend * share;
}

/// Glass in a white frame with a cross bar and curtains; coordinates 0..1 over the pane.
Vector3f windowColor(const Part& part, const Vector2f& at) {
  const bool frame = at.x() < 0.06F || at.x() > 0.94F || at.y() < 0.05F || at.y() > 0.95F ||
                     std::abs(at.x() - 0.5F) < 0.025F;
  if (frame) return {0.55F, 0.55F, 0.53F};
  const float curtain = smoothNoise(9.0F * at.x() + 50.0F * part.color.x() * 31.0F, 3.0F);
  const bool drawn = fraction(part.color.y() * 977.0F) < 0.4F && (at.x() < 0.25F || at.x() > 0.75F);
  return drawn ? Vector3f(Vector3f(0.32F, 0.31F, 0.29F) * (1 + 0.3F * curtain)) : part.color;
}

Vector3f signColor(const Part& part, const Vector2f& at) {
  const float radius = at.norm();
  const bool red = part.color.x() > part.color.z();
  const Vector3f white(0.75F, 0.75F, 0.75F);
  if (red)
    return radius > 0.72F                                       ? part.color
           : std::abs(at.x()) < 0.3F && std::abs(at.y()) < 0.3F ? Vector3f(0.03F, 0.03F, 0.03F)
                                                                : white;
  return radius > 0.92F || (std::abs(at.y() - at.x()) < 0.22F && radius < 0.65F) ? white : part.color;
}

Vector3f boardColor(const Part& part, const Vector2f& at) {
  const bool text =
      fraction(at.y() * 3.0F) > 0.35F && fraction(at.y() * 3.0F) < 0.75F && at.x() > 0.1F && at.x() < 0.9F &&
      latticeValue(static_cast<std::int32_t>(at.x() * 24), static_cast<std::int32_t>(at.y() * 3)) > -0.3F;
  const bool dark_text = part.color.mean() > 0.4F;
  return text ? (dark_text ? Vector3f(0.03F, 0.03F, 0.03F) : Vector3f(0.7F, 0.7F, 0.7F)) : part.color;
}

}  // namespace

float smoothNoise(float x, float y) {
  const float fx = std::floor(x), fy = std::floor(y);
  const auto ix = static_cast<std::int32_t>(fx), iy = static_cast<std::int32_t>(fy);
  const auto ease = [](float t) { return t * t * (3 - 2 * t); };
  const float u = ease(x - fx), v = ease(y - fy);
  const float low = (1 - u) * latticeValue(ix, iy) + u * latticeValue(ix + 1, iy);
  const float high = (1 - u) * latticeValue(ix, iy + 1) + u * latticeValue(ix + 1, iy + 1);
  return (1 - v) * low + v * high;
}

Vector3f surfaceColor(const Part& part, const Hit& hit, float footprint) {
  const Vector2f& at = hit.texture;
  switch (part.texture) {
    case Texture::kAsphalt: {
      const float crack =
          std::abs(smoothNoise(at.x() / 4.0F, at.y() / 2.5F)) < 0.02F / (1 + 10 * footprint) ? -0.45F : 0.0F;
      return part.color * (1 + 0.30F * detail(at, 0.012F, footprint) + 0.15F * detail(at, 0.06F, footprint) +
                           0.12F * detail(at, 1.7F, footprint) +
                           0.12F * detail({at.x() * 0.1F, at.y()}, 0.8F, footprint) + crack);
    }
    case Texture::kPaving:
      return part.color * (1 - 0.4F * joints(at, {0.4F, 0.4F}, 0.015F, footprint, false) +
                           0.12F * detail(at, 0.4F, footprint) + 0.15F * detail(at, 0.03F, footprint) +
                           0.1F * detail(at, 2.0F, footprint));
    case Texture::kGrass:
      return part.color * (1 + 0.4F * detail(at, 0.05F, footprint) + 0.3F * detail(at, 0.5F, footprint) +
                           0.2F * detail(at, 4.0F, footprint));
    case Texture::kPlaster:
      return part.color * (1 + 0.08F * detail(at, 0.04F, footprint) +
                           0.13F * detail({at.x(), 0.3F * at.y()}, 1.1F, footprint));
    case Texture::kBrick: {
      const float mortar = joints(at, {0.24F, 0.077F}, 0.012F, footprint, true);
      const Vector3f stone = part.color * (1 + 0.25F * detail({at.x() / 3.1F, at.y()}, 0.077F, footprint) +
                                           0.08F * detail(at, 1.3F, footprint));
      return (1 - mortar) * stone + mortar * Vector3f(0.38F, 0.36F, 0.33F);
    }
    case Texture::kTiles:
      return part.color * (1 - 0.35F * joints(at, {0.25F, 0.3F}, 0.03F, footprint, true) +
                           0.2F * detail(at, 0.5F, footprint));
    case Texture::kWood:
      return part.color * (1 + 0.2F * detail({at.x(), 0.1F * at.y()}, 0.05F, footprint));
    case Texture::kBark:
      return part.color * (1 + 0.4F * detail({at.x(), 0.3F * at.y()}, 0.05F, footprint));
    case Texture::kLeaves:
      return part.color.cwiseProduct(
          Vector3f(0.6F + 0.9F * at.x(), 0.7F + 0.6F * at.x(), 0.6F + 0.8F * at.y()));
    case Texture::kWheel:
      // Spokes on the rim, rubber outside.
      if (at.norm() > 0.68F || at.norm() < 1e-6F) return part.color;
      return std::cos(5 * std::atan2(at.y(), at.x())) > -0.3F ? Vector3f(0.36F, 0.37F, 0.38F)
                                                              : Vector3f(0.04F, 0.04F, 0.04F);
    case Texture::kWindow:
      return windowColor(part, at);
    case Texture::kSignDisc:
      return signColor(part, at);
    case Texture::kSignBoard:
      return boardColor(part, at);
    case Texture::kPaint:
    case Texture::kPlain:
      break;
  }
  return part.color;
}

Vector3f skyColor(const Vector3f& direction, const Vector3f& to_sun) {
  const float up = std::max(0.0F, direction.z());
  const Vector3f horizon(0.72F, 0.80F, 0.90F), zenith(0.16F, 0.33F, 0.72F);
  Vector3f color = horizon + (zenith - horizon) * std::min(1.0F, 1.6F * std::sqrt(up) * (0.4F + up));
  // Clouds on a plane overhead.
  const float scale = 1.5F / (up + 0.15F);
  const float x = direction.x() * scale, y = direction.y() * scale;
  const float cloud = 0.6F * smoothNoise(x, y) + 0.3F * smoothNoise(2.3F * x, 2.3F * y) +
                      0.15F * smoothNoise(5.1F * x, 5.1F * y);
  const float cover = std::clamp(2.0F * (cloud - 0.05F), 0.0F, 0.85F);
  color += cover * (Vector3f(0.9F, 0.9F, 0.92F) - color);
  const float glow = std::pow(std::max(0.0F, direction.dot(to_sun)), 24.0F);
  return color + glow * Vector3f(0.6F, 0.55F, 0.4F);
}

}  // namespace lidar_camera_recalibration::simulation
