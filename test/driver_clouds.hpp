#pragma once

#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <limits>
#include <random>
#include <string>
#include <vector>

/// Clouds laid out as the drivers publish them: fields, types, offsets, padding, order. Made of a simulated
/// one with x y z intensity (float) and ring (uint16); times are those of a sensor that turns in 0.1 s.
namespace lidar_camera_recalibration {

struct DriverPoint {
  float x, y, z, intensity, time;
  std::uint16_t ring;
};

inline std::vector<DriverPoint> pointsOf(const sensor_msgs::PointCloud2& cloud) {
  sensor_msgs::PointCloud2ConstIterator<float> xyz(cloud, "x"), intensity(cloud, "intensity");
  sensor_msgs::PointCloud2ConstIterator<std::uint16_t> ring(cloud, "ring");
  std::vector<DriverPoint> points;
  for (; xyz != xyz.end(); ++xyz, ++intensity, ++ring) {
    const float time = 0.05f * std::atan2(xyz[1], xyz[0]) / static_cast<float>(M_PI);
    points.push_back({xyz[0], xyz[1], xyz[2], *intensity, time, *ring});
  }
  return points;
}

struct DriverField {
  const char* name;
  std::uint32_t offset;
  std::uint8_t type;
};

/// An empty cloud of a layout, one row.
inline sensor_msgs::PointCloud2 laidOut(const sensor_msgs::PointCloud2& like, std::uint32_t point_step,
                                        std::initializer_list<DriverField> fields, std::size_t count) {
  sensor_msgs::PointCloud2 cloud;
  cloud.header = like.header;
  cloud.height = 1;
  cloud.width = static_cast<std::uint32_t>(count);
  cloud.point_step = point_step;
  cloud.row_step = cloud.width * point_step;
  cloud.data.assign(cloud.row_step, 0xcd);  // padding holds rubbish
  for (const DriverField& field : fields) {
    sensor_msgs::PointField own;
    own.name = field.name;
    own.offset = field.offset;
    own.datatype = field.type;
    own.count = 1;
    cloud.fields.push_back(own);
  }
  return cloud;
}

template <typename T>
void put(sensor_msgs::PointCloud2& cloud, std::size_t index, std::size_t offset, T value) {
  std::memcpy(cloud.data.data() + index * cloud.point_step + offset, &value, sizeof(T));
}

inline void putXyz(sensor_msgs::PointCloud2& cloud, std::size_t index, const DriverPoint& point) {
  put(cloud, index, 0, point.x);
  put(cloud, index, 4, point.y);
  put(cloud, index, 8, point.z);
}

/// x, y, z and one more, packed floats, as kitti2bag ("i") and nuscenes2bag ("intensity") write them.
inline sensor_msgs::PointCloud2 xyzi(const sensor_msgs::PointCloud2& cloud, const std::string& frame,
                                     const std::string& intensity) {
  using Field = sensor_msgs::PointField;
  sensor_msgs::PointCloud2ConstIterator<float> xyz(cloud, "x"), value(cloud, "intensity");
  const std::size_t count = std::size_t{cloud.width} * cloud.height;
  sensor_msgs::PointCloud2 result = laidOut(cloud, 16,
                                            {{"x", 0, Field::FLOAT32},
                                             {"y", 4, Field::FLOAT32},
                                             {"z", 8, Field::FLOAT32},
                                             {intensity.c_str(), 12, Field::FLOAT32}},
                                            count);
  result.header.frame_id = frame;
  for (std::size_t i = 0; i < count; ++i, ++xyz, ++value) {
    putXyz(result, i, {xyz[0], xyz[1], xyz[2], 0.0f, 0.0f, 0});
    put(result, i, 12, *value);
  }
  return result;
}

/// velodyne_pointcloud: packed, 22 bytes.
inline sensor_msgs::PointCloud2 velodyne(const sensor_msgs::PointCloud2& like) {
  using Field = sensor_msgs::PointField;
  const std::vector<DriverPoint> points = pointsOf(like);
  sensor_msgs::PointCloud2 cloud = laidOut(like, 22,
                                           {{"x", 0, Field::FLOAT32},
                                            {"y", 4, Field::FLOAT32},
                                            {"z", 8, Field::FLOAT32},
                                            {"intensity", 12, Field::FLOAT32},
                                            {"ring", 16, Field::UINT16},
                                            {"time", 18, Field::FLOAT32}},
                                           points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    putXyz(cloud, i, points[i]);
    put(cloud, i, 12, points[i].intensity);
    put(cloud, i, 16, points[i].ring);
    put(cloud, i, 18, points[i].time);
  }
  return cloud;
}

/// The same of the years when it left row_step at 0.
inline sensor_msgs::PointCloud2 velodyne2018(const sensor_msgs::PointCloud2& like) {
  sensor_msgs::PointCloud2 cloud = velodyne(like);
  cloud.row_step = 0;
  return cloud;
}

/// ouster_ros: a PCL struct of 48 bytes, a row for each laser, zeros where nothing came back.
inline sensor_msgs::PointCloud2 ousterInOrder(const sensor_msgs::PointCloud2& like, bool transposed) {
  using Field = sensor_msgs::PointField;
  const std::vector<DriverPoint> points = pointsOf(like);
  std::uint32_t rings = 0;
  for (const DriverPoint& point : points) rings = std::max<std::uint32_t>(rings, point.ring + 1u);
  std::vector<std::vector<const DriverPoint*>> rows(rings);
  for (const DriverPoint& point : points) rows[point.ring].push_back(&point);
  std::size_t columns = 0;
  for (const auto& row : rows) columns = std::max(columns, row.size() + 3);
  sensor_msgs::PointCloud2 cloud = laidOut(like, 48,
                                           {{"x", 0, Field::FLOAT32},
                                            {"y", 4, Field::FLOAT32},
                                            {"z", 8, Field::FLOAT32},
                                            {"intensity", 16, Field::FLOAT32},
                                            {"t", 20, Field::UINT32},
                                            {"reflectivity", 24, Field::UINT16},
                                            {"ring", 26, Field::UINT16},
                                            {"ambient", 28, Field::UINT16},
                                            {"range", 32, Field::UINT32}},
                                           rings * columns);
  cloud.height = transposed ? static_cast<std::uint32_t>(columns) : rings;
  cloud.width = transposed ? rings : static_cast<std::uint32_t>(columns);
  cloud.row_step = cloud.width * cloud.point_step;
  float first = 0.0f;
  for (const DriverPoint& point : points) first = std::min(first, point.time);
  cloud.header.stamp = like.header.stamp + ros::Duration(first);  // of the first column
  for (std::size_t row = 0; row < rings; ++row) {
    for (std::size_t column = 0; column < columns; ++column) {
      const bool hit = column < rows[row].size();
      const DriverPoint point = hit ? *rows[row][column] : DriverPoint{0, 0, 0, 0, first, std::uint16_t(row)};
      const std::size_t i = transposed ? column * rings + row : row * columns + column;
      putXyz(cloud, i, point);
      put(cloud, i, 16, 30.0f * point.intensity);
      put(cloud, i, 20, static_cast<std::uint32_t>(std::lround(1e9 * (double(point.time) - first))));
      put(cloud, i, 24, static_cast<std::uint16_t>(point.intensity));
      put(cloud, i, 26, point.ring);
      put(cloud, i, 28, std::uint16_t{7});
      put(cloud, i, 32, static_cast<std::uint32_t>(1e3f * std::hypot(point.x, point.y, point.z)));
    }
  }
  return cloud;
}
inline sensor_msgs::PointCloud2 ouster(const sensor_msgs::PointCloud2& like) {
  return ousterInOrder(like, false);
}
inline sensor_msgs::PointCloud2 ousterTransposed(const sensor_msgs::PointCloud2& like) {
  return ousterInOrder(like, true);
}

/// HesaiLidar_ROS_2.0: packed, 26 bytes, absolute times in s.
inline sensor_msgs::PointCloud2 hesai(const sensor_msgs::PointCloud2& like) {
  using Field = sensor_msgs::PointField;
  const std::vector<DriverPoint> points = pointsOf(like);
  sensor_msgs::PointCloud2 cloud = laidOut(like, 26,
                                           {{"x", 0, Field::FLOAT32},
                                            {"y", 4, Field::FLOAT32},
                                            {"z", 8, Field::FLOAT32},
                                            {"intensity", 12, Field::FLOAT32},
                                            {"ring", 16, Field::UINT16},
                                            {"timestamp", 18, Field::FLOAT64}},
                                           points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    putXyz(cloud, i, points[i]);
    put(cloud, i, 12, points[i].intensity);
    put(cloud, i, 16, points[i].ring);
    put(cloud, i, 18, like.header.stamp.toSec() + double(points[i].time));
  }
  return cloud;
}

/// HesaiLidar_General_ROS: a PCL struct of 48 bytes, the time before the ring.
inline sensor_msgs::PointCloud2 hesaiGeneral(const sensor_msgs::PointCloud2& like) {
  using Field = sensor_msgs::PointField;
  const std::vector<DriverPoint> points = pointsOf(like);
  sensor_msgs::PointCloud2 cloud = laidOut(like, 48,
                                           {{"x", 0, Field::FLOAT32},
                                            {"y", 4, Field::FLOAT32},
                                            {"z", 8, Field::FLOAT32},
                                            {"intensity", 16, Field::FLOAT32},
                                            {"timestamp", 24, Field::FLOAT64},
                                            {"ring", 32, Field::UINT16}},
                                           points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    putXyz(cloud, i, points[i]);
    put(cloud, i, 16, points[i].intensity);
    put(cloud, i, 24, like.header.stamp.toSec() + double(points[i].time));
    put(cloud, i, 32, points[i].ring);
  }
  return cloud;
}

/// livox_ros_driver2 with xfer_format 0: packed, 26 bytes, absolute times in ns.
inline sensor_msgs::PointCloud2 livoxOf(const sensor_msgs::PointCloud2& like,
                                        const std::vector<DriverPoint>& points) {
  using Field = sensor_msgs::PointField;
  sensor_msgs::PointCloud2 cloud = laidOut(like, 26,
                                           {{"x", 0, Field::FLOAT32},
                                            {"y", 4, Field::FLOAT32},
                                            {"z", 8, Field::FLOAT32},
                                            {"intensity", 12, Field::FLOAT32},
                                            {"tag", 16, Field::UINT8},
                                            {"line", 17, Field::UINT8},
                                            {"timestamp", 18, Field::FLOAT64}},
                                           points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    putXyz(cloud, i, points[i]);
    put(cloud, i, 12, points[i].intensity);
    put(cloud, i, 16, std::uint8_t{0});
    put(cloud, i, 17, static_cast<std::uint8_t>(points[i].ring % 6));
    put(cloud, i, 18, 1e9 * (like.header.stamp.toSec() + double(points[i].time)));
  }
  return cloud;
}
inline sensor_msgs::PointCloud2 livox2(const sensor_msgs::PointCloud2& like) {
  return livoxOf(like, pointsOf(like));
}

/// What a Livox with a rosette of prisms would see of the scene, from the points of the spinning one: each
/// direction of the pattern takes the range of the nearest point. 70 deg wide, six lines, nothing level.
inline sensor_msgs::PointCloud2 livoxRosette(const sensor_msgs::PointCloud2& like) {
  constexpr int kColumns = 720, kRows = 160;  // a range image of 70 x 35 deg
  constexpr float kDeg = static_cast<float>(M_PI / 180.0), kHalfWidth = 35.0f, kHalfHeight = 17.5f;
  std::vector<const DriverPoint*> image(kColumns * kRows, nullptr);
  const std::vector<DriverPoint> points = pointsOf(like);
  const auto pixel = [&](float azimuth, float elevation) {
    const int column = static_cast<int>((azimuth / kHalfWidth + 1.0f) * 0.5f * kColumns);
    const int row = static_cast<int>((elevation / kHalfHeight + 1.0f) * 0.5f * kRows);
    return column < 0 || row < 0 || column >= kColumns || row >= kRows ? -1 : row * kColumns + column;
  };
  for (const DriverPoint& point : points) {
    const float distance = std::hypot(point.x, point.y);
    const int at = pixel(std::atan2(point.y, point.x) / kDeg, std::atan2(point.z, distance) / kDeg);
    if (at >= 0) image[at] = &point;
  }
  std::vector<DriverPoint> seen;
  constexpr int kCount = 40000, kLines = 6;
  for (int i = 0; i < kCount; ++i) {
    const float phase = 2.0f * static_cast<float>(M_PI) * static_cast<float>(i / kLines) / (kCount / kLines);
    const float radius = std::cos(37.3f * phase), turn = 11.7f * phase;
    const float azimuth = kHalfWidth * radius * std::cos(turn);
    const float elevation =
        0.45f * kHalfHeight * radius * std::sin(turn) + 0.21f * static_cast<float>(i % kLines) - 0.5f;
    const int middle = pixel(azimuth, elevation);
    if (middle < 0) continue;
    for (const int step :
         {0, kColumns, -kColumns, 2 * kColumns, -2 * kColumns, 3 * kColumns, -3 * kColumns}) {
      const int at = middle + step;
      if (at < 0 || at >= kColumns * kRows || image[at] == nullptr) continue;
      const DriverPoint& near = *image[at];
      const float range = std::hypot(near.x, near.y, near.z);
      seen.push_back({range * std::cos(elevation * kDeg) * std::cos(azimuth * kDeg),
                      range * std::cos(elevation * kDeg) * std::sin(azimuth * kDeg),
                      range * std::sin(elevation * kDeg), near.intensity,
                      0.1f * static_cast<float>(i) / kCount, static_cast<std::uint16_t>(i % kLines)});
      break;
    }
  }
  return livoxOf(like, seen);
}

}  // namespace lidar_camera_recalibration
