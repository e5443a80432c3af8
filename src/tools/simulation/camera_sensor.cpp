#include "simulation/camera_sensor.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "parallel.hpp"
#include "simulation/appearance.hpp"
#include "simulation/random.hpp"

namespace lidar_camera_recalibration::simulation {

using Eigen::Vector3f;

namespace {

constexpr float kOffSurface = 2e-3F;  ///< start of secondary rays above the surface [m]
constexpr int kBorderSamples = 3;     ///< per direction, where a pixel sees several parts
constexpr float kSun = 2.3F, kAmbient = 0.55F, kExposure = 0.50F;

bool isGround(PartKind kind) {
  return kind == PartKind::kRoad || kind == PartKind::kLaneMarking || kind == PartKind::kPavement ||
         kind == PartKind::kGrass;
}

/// What a smooth surface mirrors: the sky, or a dim street below it.
Vector3f mirrored(const Vector3f& direction, const Vector3f& to_sun) {
  const float street = 0.45F + 0.12F * smoothNoise(6 * direction.x() + 3 * direction.z(), 6 * direction.y());
  if (direction.z() < 0.25F) return Vector3f(0.30F, 0.29F, 0.27F) * street;
  return skyColor(direction, to_sun);
}

float toSrgb(float linear) { return linear <= 0 ? 0.0F : std::pow(std::min(linear, 1.0F), 1.0F / 2.2F); }

/// Soft shoulder, so that bright walls keep their colour.
float exposed(float radiance) { return 1.0F - std::exp(-1.9F * kExposure * radiance); }

}  // namespace

CameraSensor::CameraSensor(const Camera& camera, int threads)
    : width_(camera.intrinsics().width),
      height_(camera.intrinsics().height),
      threads_(threads),
      pixel_angle_(static_cast<float>(1.0 / camera.intrinsics().fx)) {
  rays_.resize(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
  forEachRow([&](int v) {
    for (int u = 0; u < width_; ++u)
      rays_[static_cast<std::size_t>(v * width_ + u)] = camera.ray({u, v}).cast<float>();
  });
}

template <typename Work>
void CameraSensor::forEachRow(const Work& work) const {
  parallelFor(static_cast<std::size_t>(height_), static_cast<std::size_t>(threads_),
              [&work](std::size_t, std::size_t v) { work(static_cast<int>(v)); });
}

/// Bilinear between pixel centres; distortion is far smoother than a pixel.
Vector3f CameraSensor::rayAt(float u, float v) const {
  const int u0 = std::clamp(static_cast<int>(std::floor(u)), 0, width_ - 2),
            v0 = std::clamp(static_cast<int>(std::floor(v)), 0, height_ - 2);
  const float a = u - static_cast<float>(u0), b = v - static_cast<float>(v0);
  const Vector3f* row = &rays_[static_cast<std::size_t>(v0 * width_ + u0)];
  return ((1 - b) * ((1 - a) * row[0] + a * row[1]) + b * ((1 - a) * row[width_] + a * row[width_ + 1]))
      .normalized();
}

CameraSensor::Sample CameraSensor::sample(const Scene& scene, const Vector3f& origin,
                                          const Vector3f& direction, double time) const {
  const World& world = scene.world();
  const Vector3f& to_sun = world.to_sun;
  const std::optional<Hit> hit = scene.cast(origin, direction, time);
  if (!hit) return {skyColor(direction, to_sun), 0, false};

  const Part& part = world.parts[hit->part];
  const bool leaf = part.kind == PartKind::kCrown;
  const Vector3f point = origin + hit->distance * direction + kOffSurface * hit->normal;
  const float facing = hit->normal.dot(to_sun);
  // Leaves are lit from either side, as light shines through them.
  const float sun = leaf ? 0.35F + 0.5F * std::abs(facing) : std::max(0.0F, facing);
  const bool shadow = sun <= 0.0F || scene.blocked(point, to_sun, 300.0F, time);
  float ambient = kAmbient * (0.62F + 0.38F * hit->normal.z());
  // The sky is hidden below vehicles: a short ray upwards tells.
  if (isGround(part.kind) && scene.blocked(point, Vector3f::UnitZ(), 0.7F, time)) ambient *= 0.25F;
  if (leaf && shadow) ambient *= 0.75F;

  const float footprint = hit->distance * pixel_angle_ / std::max(0.15F, -hit->normal.dot(direction));
  const Vector3f albedo = surfaceColor(part, *hit, footprint);
  Vector3f light = Vector3f(0.86F, 0.95F, 1.12F) * ambient;
  if (!shadow) light += Vector3f(1.08F, 1.0F, 0.88F) * (kSun * sun);
  Vector3f color = albedo.cwiseProduct(light);
  if (part.glass || part.texture == Texture::kPaint) {
    const Vector3f reflected = direction - 2 * direction.dot(hit->normal) * hit->normal;
    const float grazing = 1 + direction.dot(hit->normal);  // 0 head-on
    const float share = (part.glass ? 0.2F : 0.05F) + 0.7F * std::pow(grazing, 4.0F);
    color = (1 - share) * color + share * mirrored(reflected, to_sun);
  }
  const float haze = 1 - std::exp(-hit->distance / 1500.0F);
  color += haze * (Vector3f(0.62F, 0.70F, 0.80F) - color);
  return {color, hit->part, shadow};
}

/// Pixels next to another part become the mean of several rays.
void CameraSensor::smoothBorders(const Scene& scene, const Eigen::Isometry3f& pose, double time,
                                 const cv::Mat& part, cv::Mat& color) const {
  const Vector3f origin = pose.translation();
  forEachRow([&](int v) {
    for (int u = 0; u < width_; ++u) {
      const int here = part.at<int>(v, u);
      const bool border =
          (u > 0 && part.at<int>(v, u - 1) != here) || (u + 1 < width_ && part.at<int>(v, u + 1) != here) ||
          (v > 0 && part.at<int>(v - 1, u) != here) || (v + 1 < height_ && part.at<int>(v + 1, u) != here);
      if (!border) continue;
      Vector3f sum = Vector3f::Zero();
      for (int i = 0; i < kBorderSamples * kBorderSamples; ++i) {
        const float du = (static_cast<float>(i % kBorderSamples) + 0.5F) / kBorderSamples - 0.5F;
        const float dv = (static_cast<float>(i / kBorderSamples) + 0.5F) / kBorderSamples - 0.5F;
        const Vector3f ray = rayAt(static_cast<float>(u) + du, static_cast<float>(v) + dv);
        sum += sample(scene, origin, pose.linear() * ray, time).color.cwiseMin(2.0F);
      }
      sum /= static_cast<float>(kBorderSamples * kBorderSamples);
      color.at<cv::Vec3f>(v, u) = {sum.z(), sum.y(), sum.x()};
    }
  });
}

Picture CameraSensor::take(const Scene& scene, const Eigen::Isometry3d& T_world_camera, double time,
                           std::uint64_t seed) const {
  const Eigen::Isometry3f pose = T_world_camera.cast<float>();
  const Vector3f origin = pose.translation();
  Picture picture;
  picture.part.create(height_, width_, CV_32SC1);
  picture.shadow.create(height_, width_, CV_8UC1);
  picture.image.create(height_, width_, CV_8UC3);
  cv::Mat color(height_, width_, CV_32FC3);
  forEachRow([&](int v) {
    for (int u = 0; u < width_; ++u) {
      const Sample s =
          sample(scene, origin, pose.linear() * rays_[static_cast<std::size_t>(v * width_ + u)], time);
      color.at<cv::Vec3f>(v, u) = {s.color.z(), s.color.y(), s.color.x()};
      picture.part.at<int>(v, u) = static_cast<int>(s.part);
      picture.shadow.at<std::uint8_t>(v, u) = s.shadow ? 255 : 0;
    }
  });
  smoothBorders(scene, pose, time, picture.part, color);
  cv::GaussianBlur(color, color, {3, 3}, 0.5);  // the lens
  forEachRow([&](int v) {
    Random random(seed, 3,
                  static_cast<std::uint64_t>(v));  // per row: the same picture for any number of threads
    for (int u = 0; u < width_; ++u) {
      for (int c = 0; c < 3; ++c) {
        const float signal = exposed(color.at<cv::Vec3f>(v, u)[c]);
        const float sigma = 0.0025F + 0.010F * std::sqrt(signal);  // read noise and shot noise
        const float noisy = signal + static_cast<float>(random.gaussian(sigma));
        picture.image.at<cv::Vec3b>(v, u)[c] = cv::saturate_cast<std::uint8_t>(255.0F * toSrgb(noisy));
      }
    }
  });
  return picture;
}

}  // namespace lidar_camera_recalibration::simulation
