#include "projection.hpp"

#include "multiversion.hpp"

namespace lidar_camera_recalibration {
namespace {

LCR_MULTIVERSION void projectBlock(const Projection projection, const float* x, const float* y,
                                   const float* z, std::size_t count, float* __restrict u,
                                   float* __restrict v, float* __restrict inverse_depth) {
  for (std::size_t i = 0; i < count; ++i) {
    const Projection::Pixel pixel = projection(x[i], y[i], z[i]);
    u[i] = pixel.u;
    v[i] = pixel.v;
    inverse_depth[i] = pixel.inverse_depth;
  }
}

/// As index into an image; -1 outside of it.
LCR_MULTIVERSION void nearestPixels(const Projection projection, const float* x, const float* y,
                                    const float* z, std::size_t count, const cv::Size size,
                                    std::int32_t stride, std::int32_t* __restrict nearest) {
  const auto width = static_cast<float>(size.width), height = static_cast<float>(size.height);
  for (std::size_t i = 0; i < count; ++i) {
    const Projection::Pixel pixel = projection(x[i], y[i], z[i]);
    const float up = pixel.u + 0.5f, vp = pixel.v + 0.5f;  // then truncation rounds
    const bool inside = (up >= 0.0f) & (up < width) & (vp >= 0.0f) & (vp < height);
    const auto u = static_cast<std::int32_t>(inside ? up : 0.0f);
    const auto v = static_cast<std::int32_t>(inside ? vp : 0.0f);
    nearest[i] = inside ? v * stride + u : -1;
  }
}

}  // namespace

void Projection::project(const Places& places, std::size_t first, std::size_t count,
                         PixelBlock& pixels) const {
  projectBlock(*this, places.x.data() + first, places.y.data() + first, places.z.data() + first, count,
               pixels.u.data(), pixels.v.data(), pixels.inverse_depth.data());
}

void Projection::lookUp(const cv::Mat& image, const Places& places, std::size_t first, std::size_t count,
                        std::uint32_t outside, Block<std::uint32_t>& values) const {
  Block<std::int32_t> pixels;
  nearestPixels(*this, places.x.data() + first, places.y.data() + first, places.z.data() + first, count,
                image.size(), static_cast<std::int32_t>(image.step1()), pixels.data());
  const auto* const data = image.ptr<std::uint16_t>();
  for (std::size_t i = 0; i < count; ++i) {
    const bool inside = pixels[i] >= 0;
    const std::uint32_t value = data[inside ? pixels[i] : 0];
    values[i] = inside ? value : outside;
  }
}

}  // namespace lidar_camera_recalibration
