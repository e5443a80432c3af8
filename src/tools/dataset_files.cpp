#include "dataset_files.hpp"

#include <pcl/PCLPointCloud2.h>
#include <pcl/io/pcd_io.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <numeric>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/masks.hpp"

namespace lidar_camera_recalibration {

namespace fs = std::filesystem;

namespace {

// Far above any sensor; a file that claims more is damaged or not what it seems.
constexpr std::uintmax_t kMaxTextBytes = 16u << 20;
constexpr std::uintmax_t kMaxImageBytes = 256u << 20;
constexpr std::uintmax_t kMaxCloudBytes = 1024u << 20;
constexpr std::size_t kMaxPoints = 20'000'000;
constexpr std::size_t kMaxMasks = 65535;  // ids of the mask message have 16 bits

[[noreturn]] void refuse(const fs::path& file, const std::string& what) {
  throw Error(ErrorCause::kFile, "\"" + file.string() + "\": " + what);
}

std::uintmax_t checkedSize(const fs::path& file, std::uintmax_t limit) {
  std::error_code error;
  if (!fs::is_regular_file(file, error)) refuse(file, "there is no such file");
  const std::uintmax_t size = fs::file_size(file, error);
  if (error) refuse(file, error.message());
  if (size == 0) refuse(file, "the file is empty");
  if (size > limit) {
    refuse(file, std::to_string(size) + " bytes are more than the limit of " + std::to_string(limit));
  }
  return size;
}

cv::Mat decodeImage(const fs::path& file, int flags) {
  checkedSize(file, kMaxImageBytes);
  cv::Mat image;
  try {
    image = cv::imread(file.string(), flags);
  } catch (const cv::Exception& error) {
    refuse(file, std::string("cannot be decoded: ") + error.what());
  }
  if (image.empty()) refuse(file, "cannot be decoded as an image");
  return image;
}

/// Reads one value of a PCD field, whatever its numeric type.
using FieldReader = std::function<double(const std::uint8_t* point)>;

template <typename T>
FieldReader readerOf(std::size_t offset) {
  return [offset](const std::uint8_t* point) {
    T value;
    std::memcpy(&value, point + offset, sizeof value);
    return static_cast<double>(value);
  };
}

/// Empty if the cloud has no such field.
FieldReader fieldReader(const pcl::PCLPointCloud2& cloud, const std::string& name, const fs::path& file) {
  using Field = pcl::PCLPointField;
  const auto field = std::find_if(cloud.fields.begin(), cloud.fields.end(),
                                  [&name](const Field& candidate) { return candidate.name == name; });
  if (field == cloud.fields.end()) return nullptr;
  switch (field->datatype) {
    case Field::INT8:
      return readerOf<std::int8_t>(field->offset);
    case Field::UINT8:
      return readerOf<std::uint8_t>(field->offset);
    case Field::INT16:
      return readerOf<std::int16_t>(field->offset);
    case Field::UINT16:
      return readerOf<std::uint16_t>(field->offset);
    case Field::INT32:
      return readerOf<std::int32_t>(field->offset);
    case Field::UINT32:
      return readerOf<std::uint32_t>(field->offset);
    case Field::FLOAT32:
      return readerOf<float>(field->offset);
    case Field::FLOAT64:
      return readerOf<double>(field->offset);
  }
  refuse(file, "field " + name + " has the unknown type " + std::to_string(field->datatype));
}

FieldReader firstFieldReader(const pcl::PCLPointCloud2& cloud, const std::vector<std::string>& names,
                             const fs::path& file) {
  for (const std::string& name : names) {
    if (FieldReader reader = fieldReader(cloud, name, file)) return reader;
  }
  return nullptr;
}

bool usable(const Eigen::Vector3f& point) { return point.allFinite() && !point.isZero(0.0F); }

/// PCL's reader sets memory aside for whatever the header claims before it returns the header.
void checkPcdClaims(const fs::path& file) {
  double width = 0, height = 1, points = 0;
  std::vector<double> sizes, counts;
  std::ifstream stream(file, std::ios::binary);
  for (std::string line; std::getline(stream, line);) {
    std::istringstream words(line);
    std::string key;
    words >> key;
    if (key == "DATA") break;
    if (key == "WIDTH") words >> width;
    if (key == "HEIGHT") words >> height;
    if (key == "POINTS") words >> points;
    if (key != "SIZE" && key != "COUNT") continue;
    std::vector<double>& values = key == "SIZE" ? sizes : counts;
    values.assign(std::istream_iterator<double>(words), {});
  }
  counts.resize(sizes.size(), 1.0);
  const double step = std::inner_product(sizes.begin(), sizes.end(), counts.begin(), 0.0);
  const double most = std::max(width * height, points);
  const bool negative = std::min({width, height, points, step}) < 0.0;  // PCL reads -1 as 4294967295
  if (negative || !(most <= kMaxPoints) || !(most * step <= kMaxCloudBytes)) {
    std::ostringstream what;
    what << "claims " << most << " points of " << step << " bytes, more than any sensor delivers";
    refuse(file, what.str());
  }
}

/// PCL's reader believes the header and crashes where the file does not hold what it promises.
void checkPcdHeader(const fs::path& file, std::uintmax_t size) {
  pcl::PCLPointCloud2 header;
  Eigen::Vector4f origin;
  Eigen::Quaternionf orientation;
  int version = 0, data_type = 0;
  unsigned int data_begin = 0;
  const int status =
      pcl::PCDReader().readHeader(file.string(), header, origin, orientation, version, data_type, data_begin);
  const std::uintmax_t points = std::uintmax_t(header.width) * header.height;
  if (status != 0 || points == 0 || header.fields.empty() || header.point_step == 0) {
    refuse(file, "not a readable PCD file, or one without points");
  }
  constexpr int kBinary = 1, kCompressed = 2;
  const std::uintmax_t bytes = points * header.point_step;
  std::uintmax_t expected = data_type == kBinary ? bytes : 0;
  if (data_type == kCompressed) {
    std::array<std::uint32_t, 2> sizes = {0, 0};  // of the compressed data and of what they hold
    std::ifstream stream(file, std::ios::binary);
    stream.seekg(data_begin);
    stream.read(reinterpret_cast<char*>(sizes.data()), sizeof sizes);
    if (!stream || sizes[1] != bytes)
      refuse(file, "its compressed data are not of the size that its header says");
    expected = sizeof sizes + sizes[0];
  }
  if (data_begin + expected > size) refuse(file, "ends before the last point: cut short?");
}

pcl::PCLPointCloud2 loadPcd(const fs::path& file) {
  const std::uintmax_t size = checkedSize(file, kMaxCloudBytes);
  pcl::PCLPointCloud2 cloud;
  try {
    checkPcdClaims(file);
    checkPcdHeader(file, size);
    if (pcl::PCDReader().read(file.string(), cloud) != 0) refuse(file, "not a readable PCD file");
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    refuse(file, std::string("not a readable PCD file: ") + error.what());
  }
  if (cloud.data.size() < std::size_t(cloud.width) * cloud.height * cloud.point_step) {
    refuse(file, "holds fewer points than its header says");
  }
  return cloud;
}

PointCloud readPcd(const fs::path& file) {
  const pcl::PCLPointCloud2 pcd = loadPcd(file);
  const FieldReader x = fieldReader(pcd, "x", file), y = fieldReader(pcd, "y", file),
                    z = fieldReader(pcd, "z", file);
  if (!x || !y || !z) refuse(file, "has no fields x, y and z");
  const FieldReader intensity = firstFieldReader(pcd, {"intensity", "reflectivity", "i", "signal"}, file);
  const FieldReader ring = fieldReader(pcd, "ring", file);

  PointCloud cloud;
  const std::size_t count = std::size_t(pcd.width) * pcd.height;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t* data = pcd.data.data() + i * pcd.point_step;
    const Eigen::Vector3f point = Eigen::Vector3d(x(data), y(data), z(data)).cast<float>();
    if (!usable(point)) continue;
    cloud.points.push_back(point);
    if (intensity) {
      const double value = intensity(data);
      cloud.reflectivity.push_back(std::isfinite(value) ? static_cast<float>(value) : 0.0F);
    }
    if (ring) {
      const double value = ring(data);
      constexpr double kMaxRing = std::numeric_limits<std::uint16_t>::max();
      if (!(value >= 0.0 && value <= kMaxRing)) refuse(file, "field ring holds " + std::to_string(value));
      cloud.ring.push_back(static_cast<std::uint16_t>(value));
    }
  }
  return cloud;
}

PointCloud readKittiBin(const fs::path& file) {
  constexpr std::size_t kPointBytes = 4 * sizeof(float);
  const std::uintmax_t size =
      checkedSize(file, std::min<std::uintmax_t>(kMaxCloudBytes, kMaxPoints * kPointBytes));
  if (size % kPointBytes != 0) {
    refuse(file, std::to_string(size) + " bytes are no whole number of points (4 floats each): cut short?");
  }
  std::vector<float> values(size / sizeof(float));
  std::ifstream stream(file, std::ios::binary);
  if (!stream.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(size))) {
    refuse(file, "cannot be read");
  }
  PointCloud cloud;
  for (std::size_t i = 0; i < values.size(); i += 4) {
    const Eigen::Vector3f point(values[i], values[i + 1], values[i + 2]);
    if (!usable(point)) continue;
    cloud.points.push_back(point);
    cloud.reflectivity.push_back(std::isfinite(values[i + 3]) ? values[i + 3] : 0.0F);
  }
  return cloud;
}

std::vector<cv::Mat> readBinaryMasks(const fs::path& folder) {
  const std::vector<std::string> names = stems(folder, ".png");
  if (names.size() > kMaxMasks) {
    refuse(folder, "holds " + std::to_string(names.size()) + " masks, at most " + std::to_string(kMaxMasks) +
                       " are possible");
  }
  std::vector<cv::Mat> masks;
  for (const std::string& name : names) {
    masks.push_back(decodeImage(folder / (name + ".png"), cv::IMREAD_GRAYSCALE));
  }
  if (masks.empty()) return {};
  try {
    return layersFromBinaryMasks(masks);
  } catch (const Error& error) {
    refuse(folder, error.what());
  }
}

std::vector<cv::Mat> readLabelImage(const fs::path& file) {
  const cv::Mat labels = decodeImage(file, cv::IMREAD_UNCHANGED);
  if (labels.depth() != CV_8U && labels.depth() != CV_16U) refuse(file, "a label image has 8 or 16 bits");
  cv::Mat wide;
  labels.convertTo(wide, CV_32S);
  std::vector<cv::Mat> layers;
  cv::split(wide, layers);
  // PNG has no images of two channels, so two layers come as three.
  while (layers.size() > 1 && cv::countNonZero(layers.back()) == 0) layers.pop_back();
  return layers;
}

/// `2011-09-26 13:02:25.964389445`, KITTI raw's clock, in seconds since 1970 [s]. NaN for anything else.
double parseDate(const std::string& line) {
  std::tm date{};
  double seconds = 0.0;
  if (std::sscanf(line.c_str(), "%d-%d-%d %d:%d:%lf", &date.tm_year, &date.tm_mon, &date.tm_mday,
                  &date.tm_hour, &date.tm_min, &seconds) != 6) {
    return std::nan("");
  }
  date.tm_year -= 1900;
  date.tm_mon -= 1;
  return static_cast<double>(timegm(&date)) + seconds;
}

double parseSeconds(const std::string& line) {
  char* end = nullptr;
  const double value = std::strtod(line.c_str(), &end);
  const bool whole =
      end != line.c_str() && line.find_first_not_of(" \t\r", end - line.c_str()) == std::string::npos;
  return whole ? value : std::nan("");
}

}  // namespace

std::string readText(const fs::path& file) {
  const std::uintmax_t size = checkedSize(file, kMaxTextBytes);
  std::string text(size, '\0');
  std::ifstream stream(file, std::ios::binary);
  if (!stream.read(text.data(), static_cast<std::streamsize>(size))) refuse(file, "cannot be read");
  return text;
}

std::vector<double> readTimes(const fs::path& file) {
  std::vector<double> times;
  std::istringstream lines(readText(file));
  for (std::string line; std::getline(lines, line);) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    double time = parseDate(line);
    if (!std::isfinite(time)) time = parseSeconds(line);
    if (!std::isfinite(time))
      refuse(file, "line " + std::to_string(times.size() + 1) + " is no time: " + line);
    times.push_back(time);
  }
  return times;
}

cv::Mat readImage(const fs::path& file) { return decodeImage(file, cv::IMREAD_COLOR); }

PointCloud readCloud(const fs::path& file) {
  if (file.extension() != ".pcd" && file.extension() != ".bin")
    refuse(file, "clouds are .pcd or KITTI .bin files");
  PointCloud cloud = file.extension() == ".pcd" ? readPcd(file) : readKittiBin(file);
  if (cloud.size() == 0) refuse(file, "holds no finite point away from the origin");
  return cloud;
}

std::vector<cv::Mat> readMaskLayers(const fs::path& base) {
  if (fs::is_directory(base)) return readBinaryMasks(base);
  const fs::path labels = base.string() + ".png";
  if (fs::exists(labels)) return readLabelImage(labels);
  return {};
}

std::vector<std::string> stems(const fs::path& folder, const std::string& extension) {
  std::vector<std::string> names;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (entry.path().extension() == extension) names.push_back(entry.path().stem().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace lidar_camera_recalibration
