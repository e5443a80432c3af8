#include "conversions.hpp"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <array>
#include <boost/endian/conversion.hpp>
#include <boost/make_shared.hpp>
#include <cctype>
#include <cmath>
#include <cstring>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <sstream>
#include <tuple>
#include <utility>

#include "lidar_camera_recalibration/error.hpp"
#include "point_times.hpp"

namespace lidar_camera_recalibration {

namespace {

// cv::remap addresses pixels with 16 bits.
constexpr std::uint64_t kMaxSide = 32766;  // [px]
// Larger images are broken headers, not cameras; memory is not spent on them.
constexpr std::uint64_t kMaxPixels = 150'000'000;

template <class... Parts>
std::string text(const Parts&... parts) {
  std::ostringstream stream;
  (stream << ... << parts);
  return stream.str();
}

template <class Message>
std::string nameOf(const char* kind, const Message& message) {
  return text(kind, " of frame '", message.header.frame_id, "'");
}

bool isHostOrder(std::uint8_t is_bigendian) {
  return (is_bigendian != 0) == (boost::endian::order::native == boost::endian::order::big);
}

// --- PointCloud2 ---

using Reader = double (*)(const std::uint8_t* bytes, bool swap);

template <class T>
double readAs(const std::uint8_t* bytes, bool swap) {
  std::array<std::uint8_t, sizeof(T)> raw;
  std::memcpy(raw.data(), bytes, sizeof(T));
  if (swap) std::reverse(raw.begin(), raw.end());
  T value;
  std::memcpy(&value, raw.data(), sizeof(T));
  return static_cast<double>(value);
}

struct Datatype {
  std::uint8_t id;
  std::size_t size;  ///< [bytes]
  Reader read;
};

const Datatype* findDatatype(std::uint8_t id) {
  using Field = sensor_msgs::PointField;
  static const Datatype datatypes[] = {
      {Field::INT8, 1, readAs<std::int8_t>},   {Field::UINT8, 1, readAs<std::uint8_t>},
      {Field::INT16, 2, readAs<std::int16_t>}, {Field::UINT16, 2, readAs<std::uint16_t>},
      {Field::INT32, 4, readAs<std::int32_t>}, {Field::UINT32, 4, readAs<std::uint32_t>},
      {Field::FLOAT32, 4, readAs<float>},      {Field::FLOAT64, 8, readAs<double>},
  };
  const auto found = std::find_if(std::begin(datatypes), std::end(datatypes),
                                  [&](const Datatype& datatype) { return datatype.id == id; });
  return found == std::end(datatypes) ? nullptr : found;
}

// Where one column of a cloud lies and how to read it.
struct Column {
  std::size_t offset;
  Reader read;
  bool swap;

  double at(const std::uint8_t* point) const { return read(point + offset, swap); }
};

const sensor_msgs::PointField* findField(const sensor_msgs::PointCloud2& message, const std::string& name) {
  const auto found =
      std::find_if(message.fields.begin(), message.fields.end(),
                   [&](const sensor_msgs::PointField& candidate) { return candidate.name == name; });
  return found == message.fields.end() ? nullptr : &*found;
}

std::string fieldNames(const sensor_msgs::PointCloud2& message) {
  std::string names;
  for (const sensor_msgs::PointField& field : message.fields)
    names += (names.empty() ? "" : ", ") + field.name;
  return names.empty() ? "none" : names;
}

Column columnOf(const sensor_msgs::PointCloud2& message, const sensor_msgs::PointField& field) {
  const std::string where = text(nameOf("cloud", message), ": field '", field.name, "' ");
  const Datatype* datatype = findDatatype(field.datatype);
  if (datatype == nullptr) {
    throw Error(ErrorCause::kCloud, text(where, "has the unknown datatype ", int(field.datatype),
                                         "; the driver must use one of INT8 ... FLOAT64 (1 to 8)"));
  }
  // Some drivers leave the count at 0.
  if (field.count > 1) {
    throw Error(ErrorCause::kCloud, text(where, "has ", field.count, " elements per point; one is expected"));
  }
  if (std::uint64_t{field.offset} + datatype->size > message.point_step) {
    throw Error(ErrorCause::kCloud, text(where, "at offset ", field.offset, " with ", datatype->size,
                                         " bytes exceeds the point_step of ", message.point_step,
                                         "; the driver fills the message wrongly"));
  }
  return {field.offset, datatype->read, !isHostOrder(message.is_bigendian)};
}

Column requiredColumn(const sensor_msgs::PointCloud2& message, const std::string& name) {
  const sensor_msgs::PointField* field = findField(message, name);
  if (field == nullptr) {
    throw Error(ErrorCause::kCloud, text(nameOf("cloud", message), " has no field '", name,
                                         "' (it has: ", fieldNames(message), ")"));
  }
  return columnOf(message, *field);
}

std::optional<Column> intensityColumn(const sensor_msgs::PointCloud2& message, const std::string& name) {
  if (!name.empty()) {
    if (findField(message, name) == nullptr) {
      throw Error(ErrorCause::kCloud,
                  text(nameOf("cloud", message), " has no field '", name, "' (it has: ", fieldNames(message),
                       "); correct the parameter intensity_field or leave it empty"));
    }
    return requiredColumn(message, name);
  }
  for (const char* candidate : {"intensity", "reflectivity", "i", "signal"}) {
    const sensor_msgs::PointField* field = findField(message, candidate);
    if (field != nullptr) return columnOf(message, *field);
  }
  return std::nullopt;
}

// Most drivers: ring; Autoware: channel. Livox's `line` is none: its lines do not run level. A cloud does
// without ring numbers, so a strange ring field is no error.
std::optional<Column> ringColumn(const sensor_msgs::PointCloud2& message) {
  for (const char* name : {"ring", "channel"}) {
    const sensor_msgs::PointField* field = findField(message, name);
    if (field != nullptr && field->count <= 1) return columnOf(message, *field);
  }
  return std::nullopt;
}

// nuScenes has whole numbers as floats.
bool isRing(double value) {
  return value >= 0.0 && value <= std::numeric_limits<std::uint16_t>::max() && value == std::floor(value);
}

// Ouster: t; Velodyne: time; Hesai, Robosense and Livox: timestamp; Livox: offset_time. Whatever cannot be a
// time is left to secondsAfter().
std::optional<Column> timeColumn(const sensor_msgs::PointCloud2& message) {
  for (const char* name : {"t", "time", "timestamp", "timeStamp", "time_stamp", "offset_time", "time_offset",
                           "stamps", "stamp"}) {
    const sensor_msgs::PointField* field = findField(message, name);
    if (field != nullptr && field->count <= 1) return columnOf(message, *field);
  }
  return std::nullopt;
}

// Bytes from row to row. Velodyne's driver left row_step at 0 until 2021, and so do some simulators.
std::uint64_t rowStep(const sensor_msgs::PointCloud2& message) {
  const std::uint64_t packed = std::uint64_t{message.width} * message.point_step;
  const bool forgotten = message.row_step == 0 && message.point_step > 0 &&
                         message.data.size() % packed == 0 && message.data.size() / packed == message.height;
  return forgotten ? packed : message.row_step;
}

// All in 64 bits: hostile sizes overflow 32.
void checkLayout(const sensor_msgs::PointCloud2& message) {
  const std::string where = nameOf("cloud", message);
  if (message.width == 0 || message.height == 0 || message.data.empty()) {
    throw Error(ErrorCause::kCloud,
                text(where, " is empty (", message.width, " x ", message.height, " points, ",
                     message.data.size(), " bytes); is the sensor running, and is this the right topic?"));
  }
  const std::uint64_t row = std::uint64_t{message.width} * message.point_step, row_step = rowStep(message);
  if (row > row_step) {
    throw Error(ErrorCause::kCloud,
                text(where, ": row_step ", message.row_step, " is less than width ", message.width,
                     " times point_step ", message.point_step, "; the driver fills the message wrongly"));
  }
  const std::uint64_t size = row_step * message.height;
  if (size != message.data.size()) {
    throw Error(
        ErrorCause::kCloud,
        text(where, ": ", message.data.size(), " bytes of data instead of row_step ", message.row_step,
             " times height ", message.height, "; the message is truncated or the driver fills it wrongly"));
  }
}

// Also sorts out doubles too large for a float.
bool finiteFloat(double value) { return std::abs(value) <= std::numeric_limits<float>::max(); }

// --- CameraInfo ---

// Region of interest, then binning, as image_geometry applies them: sensor_msgs/CameraInfo gives intrinsics
// and size of the full sensor.
void applyRoiAndBinning(const sensor_msgs::CameraInfo& message, Intrinsics& intrinsics) {
  const std::string where = nameOf("CameraInfo", message);
  const auto& roi = message.roi;
  std::uint64_t width = message.width, height = message.height;
  if (roi.width != 0 || roi.height != 0 || roi.x_offset != 0 || roi.y_offset != 0) {
    if (roi.width == 0 || roi.height == 0 || std::uint64_t{roi.x_offset} + roi.width > width ||
        std::uint64_t{roi.y_offset} + roi.height > height) {
      throw Error(ErrorCause::kCamera,
                  text(where, ": roi ", roi.width, " x ", roi.height, " at (", roi.x_offset, ", ",
                       roi.y_offset, ") does not lie in the image of ", width, " x ", height,
                       "; width and height must be those of the full sensor, or the roi all zeros"));
    }
    width = roi.width;
    height = roi.height;
    intrinsics.cx -= roi.x_offset;
    intrinsics.cy -= roi.y_offset;
  }
  const std::uint32_t bin_x = std::max(1u, message.binning_x), bin_y = std::max(1u, message.binning_y);
  if (bin_x > width || bin_y > height) {
    throw Error(ErrorCause::kCamera, text(where, ": binning ", bin_x, " x ", bin_y, " leaves nothing of ",
                                          width, " x ", height, " pixels"));
  }
  intrinsics.width = static_cast<int>(width / bin_x);
  intrinsics.height = static_cast<int>(height / bin_y);
  intrinsics.fx /= bin_x;
  intrinsics.cx /= bin_x;
  intrinsics.fy /= bin_y;
  intrinsics.cy /= bin_y;
}

void checkCameraSize(const sensor_msgs::CameraInfo& message) {
  if (message.width == 0 || message.height == 0 || message.width > kMaxSide || message.height > kMaxSide ||
      std::uint64_t{message.width} * message.height > kMaxPixels) {
    throw Error(ErrorCause::kCamera,
                text(nameOf("CameraInfo", message), ": size ", message.width, " x ", message.height,
                     " is that of no camera; set width and height to the size of the calibrated image"));
  }
}

void checkPinhole(const std::string& where, const char* matrix, const Intrinsics& intrinsics,
                  const char* remedy) {
  const bool finite = std::isfinite(intrinsics.fx) && std::isfinite(intrinsics.fy) &&
                      std::isfinite(intrinsics.cx) && std::isfinite(intrinsics.cy);
  if (finite && intrinsics.fx > 0.0 && intrinsics.fy > 0.0) return;
  throw Error(ErrorCause::kCamera, text(where, ": ", matrix, " describes no camera (fx = ", intrinsics.fx,
                                        ", fy = ", intrinsics.fy, ", cx = ", intrinsics.cx,
                                        ", cy = ", intrinsics.cy, "); ", remedy));
}

void readDistortion(const sensor_msgs::CameraInfo& message, Intrinsics& intrinsics) {
  const std::string where = nameOf("CameraInfo", message);
  const bool has_coefficients =
      std::any_of(message.D.begin(), message.D.end(), [](double value) { return value != 0.0; });
  if (message.distortion_model.empty() && has_coefficients) {
    throw Error(ErrorCause::kCamera,
                where +
                    ": D holds coefficients but distortion_model is empty; name the model (plumb_bob, "
                    "rational_polynomial or equidistant)");
  }
  try {
    intrinsics.model = distortionModelFromName(message.distortion_model);
  } catch (const Error& error) {
    throw Error(ErrorCause::kCamera, where + ": " + error.what());
  }
  if (intrinsics.model != DistortionModel::kNone) intrinsics.distortion = message.D;
}

// --- Images ---

// cv_bridge multiplies in 32 bits and trusts the header, so it gets only what passed here.
void checkLayout(const sensor_msgs::Image& message, const char* kind, std::size_t channels,
                 std::size_t channel_bytes, ErrorCause cause) {
  const std::string where = nameOf(kind, message);
  if (message.width == 0 || message.height == 0 || message.width > kMaxSide || message.height > kMaxSide ||
      std::uint64_t{message.width} * message.height > kMaxPixels) {
    throw Error(cause, text(where, ": size ", message.width, " x ", message.height, " is that of no image"));
  }
  const std::uint64_t row = std::uint64_t{message.width} * channels * channel_bytes;
  if (message.step < row || message.step % channel_bytes != 0) {
    throw Error(cause, text(where, ": step ", message.step, " does not fit a width of ", message.width,
                            " in ", message.encoding, " (", row, " bytes a row)"));
  }
  if (std::uint64_t{message.step} * message.height != message.data.size()) {
    throw Error(cause,
                text(where, ": ", message.data.size(), " bytes of data instead of step ", message.step,
                     " times height ", message.height, "; the message is truncated or filled wrongly"));
  }
}

// The pixels, in the byte order of this machine: shares the message's memory or, with the other order, is a
// copy. cv_bridge's own swapping of bytes returns an image of the wrong type.
cv::Mat pixelsOf(const sensor_msgs::Image& message, int type) {
  const cv::Mat shared(static_cast<int>(message.height), static_cast<int>(message.width), type,
                       const_cast<std::uint8_t*>(message.data.data()), message.step);
  const std::size_t channel_bytes = shared.elemSize1();
  if (channel_bytes == 1 || isHostOrder(message.is_bigendian)) return shared;
  cv::Mat swapped = shared.clone();
  for (std::uint8_t* at = swapped.data; at != swapped.dataend; at += channel_bytes) {
    std::reverse(at, at + channel_bytes);
  }
  return swapped;
}

// Encodings that only tell the memory layout are taken for the usual ones.
std::string colorEncoding(const std::string& encoding) {
  static const std::pair<const char*, const char*> names[] = {{"8UC1", "mono8"},  {"8UC3", "bgr8"},
                                                              {"8UC4", "bgra8"},  {"16UC1", "mono16"},
                                                              {"16UC3", "bgr16"}, {"16UC4", "bgra16"}};
  for (const auto& [layout, color] : names) {
    if (encoding == layout) return color;
  }
  return encoding;
}

[[noreturn]] void refuseEncoding(const sensor_msgs::Image& message) {
  throw Error(ErrorCause::kImage,
              text(nameOf("image", message), ": encoding '", message.encoding,
                   "' cannot be drawn; use a grey, colour, Bayer or yuv422 encoding with 8 "
                   "or 16 bits"));
}

// 16-bit images mostly hold 10, 12 or 14 bits: the brightest pixel tells.
cv::Mat to8Bit(const cv::Mat& image) {
  double brightest = 0.0;
  cv::minMaxLoc(image.reshape(1), nullptr, &brightest);
  int bits = 8;
  while (bits < 16 && brightest >= (1 << bits)) bits += 2;
  cv::Mat result;
  image.convertTo(result, CV_8U, 255.0 / ((1 << bits) - 1));
  return result;
}

std::string encodingWith8Bits(std::string encoding) {
  const std::size_t depth = encoding.rfind("16");
  if (depth != std::string::npos) encoding.replace(depth, 2, "8");
  return encoding;
}

struct MaskEncoding {
  std::size_t channels, channel_bytes;
};

// mono8, mono16, 8UCn, 16UCn, 32SC1
std::optional<MaskEncoding> parseMaskEncoding(const std::string& encoding) {
  if (encoding == "mono8") return MaskEncoding{1, 1};
  if (encoding == "mono16") return MaskEncoding{1, 2};
  if (encoding == "32SC1") return MaskEncoding{1, 4};
  for (const auto& [prefix, bytes] : {std::pair{std::string("8UC"), 1}, std::pair{std::string("16UC"), 2}}) {
    if (encoding.compare(0, prefix.size(), prefix) != 0) continue;
    const std::string number = encoding.substr(prefix.size());
    if (number.empty() || number.size() > 3 || number.find_first_not_of("0123456789") != std::string::npos)
      break;
    const std::size_t channels = std::stoul(number);
    if (channels < 1 || channels > CV_CN_MAX) break;
    return MaskEncoding{channels, static_cast<std::size_t>(bytes)};
  }
  return std::nullopt;
}

// --- CompressedImage ---

std::size_t bigEndian16(const std::vector<std::uint8_t>& data, std::size_t at) {
  return std::size_t{data[at]} << 8 | data[at + 1];
}

// Size as the file's header states it, so that a few bytes cannot ask for gigabytes. Nothing: neither PNG nor
// JPEG.
std::optional<std::pair<std::size_t, std::size_t>> sizeInHeader(const std::vector<std::uint8_t>& data) {
  static const std::uint8_t png[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  if (data.size() >= 24 && std::equal(std::begin(png), std::end(png), data.begin())) {
    return std::pair{bigEndian16(data, 16) << 16 | bigEndian16(data, 18),
                     bigEndian16(data, 20) << 16 | bigEndian16(data, 22)};
  }
  if (data.size() < 4 || data[0] != 0xff || data[1] != 0xd8) return std::nullopt;
  for (std::size_t at = 2; at + 8 < data.size() && data[at] == 0xff;) {
    const std::uint8_t marker = data[at + 1];
    if (marker == 0xff) {  // fill byte
      ++at;
      continue;
    }
    // Start of frame; C4, C8 and CC are tables.
    if (marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc) {
      return std::pair{bigEndian16(data, at + 7), bigEndian16(data, at + 5)};
    }
    at += 2 + bigEndian16(data, at + 2);
  }
  return std::nullopt;
}

// compressed_image_transport writes "ENCODING; png compressed ...". Bayer patterns are kept, they look grey.
std::string encodingOf(const cv::Mat& image, const std::string& format) {
  const std::string original = format.substr(0, format.find(';'));
  const bool is_16_bit = image.depth() == CV_16U;
  if (image.channels() == 1 && sensor_msgs::image_encodings::isBayer(original) &&
      (sensor_msgs::image_encodings::bitDepth(original) == 16) == is_16_bit) {
    return original;
  }
  return text(is_16_bit ? "16UC" : "8UC", image.channels());
}

}  // namespace

PointCloud toPointCloud(const sensor_msgs::PointCloud2& message, const std::string& intensity_field) {
  checkLayout(message);
  const Column x = requiredColumn(message, "x"), y = requiredColumn(message, "y"),
               z = requiredColumn(message, "z");
  const std::optional<Column> intensity = intensityColumn(message, intensity_field);
  const std::optional<Column> ring = ringColumn(message), time = timeColumn(message);

  PointCloud cloud;
  std::vector<double> times;
  bool any_intensity = false, valid_rings = ring.has_value();
  for (std::size_t row = 0; row < message.height; ++row) {
    const std::uint8_t* point = message.data.data() + row * rowStep(message);
    for (std::size_t column = 0; column < message.width; ++column, point += message.point_step) {
      const Eigen::Vector3d p(x.at(point), y.at(point), z.at(point));
      if (!finiteFloat(p.x()) || !finiteFloat(p.y()) || !finiteFloat(p.z())) continue;
      // The origin is where drivers put rays without an echo.
      const Eigen::Vector3f position = p.cast<float>();
      if (position.isZero(0.0f)) continue;
      cloud.points.push_back(position);
      if (intensity) {
        const double value = intensity->at(point);
        any_intensity = any_intensity || finiteFloat(value);
        cloud.reflectivity.push_back(finiteFloat(value) ? static_cast<float>(value) : 0.0f);
      }
      if (time) times.push_back(time->at(point));
      if (valid_rings) {
        const double value = ring->at(point);
        valid_rings = isRing(value);
        cloud.ring.push_back(valid_rings ? static_cast<std::uint16_t>(value) : 0);
      }
    }
  }
  if (cloud.points.empty()) {
    throw Error(ErrorCause::kCloud,
                text(nameOf("cloud", message), " holds ", std::uint64_t{message.width} * message.height,
                     " points, but none that is finite and away from the origin; is the sensor covered?"));
  }
  if (!any_intensity) cloud.reflectivity.clear();
  if (!valid_rings) cloud.ring.clear();
  cloud.time = secondsAfter(message.header.stamp.toSec(), times);
  return cloud;
}

// The fourth column of P is left out: the extrinsic is that of this camera's own optical centre, also in a
// stereo pair.
Camera toCamera(const sensor_msgs::CameraInfo& message, bool rectified) {
  const std::string where = nameOf("CameraInfo", message);
  checkCameraSize(message);
  Intrinsics intrinsics;
  if (rectified) {
    const auto& P = message.P;
    std::tie(intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy) = std::tie(P[0], P[5], P[2], P[6]);
    checkPinhole(
        where, "P", intrinsics,
        "a rectified image needs P; publish a CameraInfo with P or, for a raw image, set image_rectified "
        "to false");
  } else {
    const auto& K = message.K;
    std::tie(intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy) = std::tie(K[0], K[4], K[2], K[5]);
    checkPinhole(where, "K", intrinsics,
                 "the camera driver publishes no calibration; calibrate the camera first");
    readDistortion(message, intrinsics);
  }
  applyRoiAndBinning(message, intrinsics);
  try {
    return Camera(intrinsics);
  } catch (const Error& error) {
    throw Error(error.cause(), where + ": " + error.what());
  }
}

cv::Mat toBgr(const sensor_msgs::Image& message) {
  namespace encodings = sensor_msgs::image_encodings;
  const std::string encoding = colorEncoding(message.encoding);
  // The remaining abstract encodings (64FC7, 8UC2) have no colour.
  if (std::isdigit(static_cast<unsigned char>(encoding[0]))) refuseEncoding(message);
  int channels = 0, bits = 0;
  try {
    channels = encodings::numChannels(encoding);
    bits = encodings::bitDepth(encoding);
  } catch (const std::exception&) {
    refuseEncoding(message);
  }
  checkLayout(message, "image", static_cast<std::size_t>(channels), static_cast<std::size_t>(bits / 8),
              ErrorCause::kImage);
  try {
    const cv::Mat pixels = pixelsOf(message, cv_bridge::getCvType(encoding));
    const bool scale = pixels.depth() == CV_16U;
    const auto source = boost::make_shared<cv_bridge::CvImage>(
        message.header, scale ? encodingWith8Bits(encoding) : encoding, scale ? to8Bit(pixels) : pixels);
    return cv_bridge::cvtColor(source, encodings::BGR8)->image.clone();
  } catch (const std::exception& error) {
    throw Error(ErrorCause::kImage, text(nameOf("image", message), " with encoding '", message.encoding,
                                         "' cannot be converted: ", error.what()));
  }
}

std::vector<cv::Mat> toMaskLayers(const sensor_msgs::Image& message) {
  const std::optional<MaskEncoding> encoding = parseMaskEncoding(message.encoding);
  if (!encoding) {
    throw Error(ErrorCause::kMasks, text(nameOf("mask image", message), ": encoding '", message.encoding,
                                         "' is none of masks; use mono8, mono16, 8UCn, 16UCn or 32SC1"));
  }
  checkLayout(message, "mask image", encoding->channels, encoding->channel_bytes, ErrorCause::kMasks);
  const int depth = encoding->channel_bytes == 1 ? CV_8U : encoding->channel_bytes == 2 ? CV_16U : CV_32S;
  std::vector<cv::Mat> layers;
  cv::split(pixelsOf(message, CV_MAKETYPE(depth, static_cast<int>(encoding->channels))), layers);
  for (cv::Mat& layer : layers) layer.convertTo(layer, CV_32S);
  double smallest = 0.0;
  cv::minMaxLoc(layers.front(), &smallest);
  if (smallest < 0.0) {
    throw Error(ErrorCause::kMasks, text(nameOf("mask image", message), " holds the negative id ", smallest,
                                         "; use 0 for no mask and positive ids"));
  }
  return layers;
}

sensor_msgs::Image toMaskMessage(const std_msgs::Header& header, const std::vector<cv::Mat>& layers) {
  if (layers.empty() || layers.size() > CV_CN_MAX) {
    throw Error(ErrorCause::kMasks, text(layers.size(), " layers of masks do not fit into one image"));
  }
  std::vector<cv::Mat> narrow(layers.size());
  for (std::size_t i = 0; i < layers.size(); ++i) {
    if (layers[i].type() != CV_32SC1 || layers[i].empty() || layers[i].size() != layers[0].size()) {
      throw Error(ErrorCause::kMasks,
                  text("layer ", i, " of the masks is no CV_32SC1 image of the size of the first layer"));
    }
    double smallest = 0.0, largest = 0.0;
    cv::minMaxLoc(layers[i], &smallest, &largest);
    if (smallest < 0.0 || largest > std::numeric_limits<std::uint16_t>::max()) {
      throw Error(ErrorCause::kMasks, text("layer ", i, " of the masks holds ids from ", smallest, " to ",
                                           largest, "; the message has room for 0 to 65535"));
    }
    layers[i].convertTo(narrow[i], CV_16U);
  }
  cv::Mat merged;
  cv::merge(narrow, merged);
  return *cv_bridge::CvImage(header, text("16UC", layers.size()), merged).toImageMsg();
}

sensor_msgs::ImagePtr decodeMasks(const sensor_msgs::CompressedImage& message) {
  if (message.data.size() > 1 && message.data[0] == 0xff && message.data[1] == 0xd8) {
    throw Error(ErrorCause::kMasks, text(nameOf("compressed mask image", message),
                                         " is a JPEG, which changes the ids; publish masks raw or as PNG"));
  }
  return decode(message);
}

sensor_msgs::ImagePtr decode(const sensor_msgs::CompressedImage& message) {
  const std::string where = text(nameOf("compressed image", message), " (format '", message.format, "', ",
                                 message.data.size(), " bytes)");
  const auto size = sizeInHeader(message.data);
  if (!size) throw Error(ErrorCause::kImage, where + " is neither PNG nor JPEG, or truncated");
  const auto [width, height] = *size;
  if (width == 0 || height == 0 || width > kMaxSide || height > kMaxSide || width * height > kMaxPixels) {
    throw Error(ErrorCause::kImage, text(where, ": size ", width, " x ", height, " is that of no image"));
  }
  cv::Mat image;
  try {
    image = cv::imdecode(message.data, cv::IMREAD_UNCHANGED);
  } catch (const std::exception& error) {
    throw Error(ErrorCause::kImage, where + " cannot be decoded: " + error.what());
  }
  if (image.empty() || (image.depth() != CV_8U && image.depth() != CV_16U)) {
    throw Error(ErrorCause::kImage, where + " cannot be decoded; it is damaged");
  }
  return cv_bridge::CvImage(message.header, encodingOf(image, message.format), image).toImageMsg();
}

}  // namespace lidar_camera_recalibration
