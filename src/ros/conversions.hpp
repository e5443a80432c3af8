#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/camera.hpp"
#include "lidar_camera_recalibration/point_cloud.hpp"

namespace lidar_camera_recalibration {

/// Messages to core types and back. All of them validate what they read: an Error names the field, its value
/// and the remedy.

/// Finite points away from the origin, with reflectivity, ring and time (see secondsAfter) where the cloud
/// has them, whatever numeric PointField type they have. A point whose reflectivity is not finite gets 0.
/// @param intensity_field  empty: the first of `intensity`, `reflectivity`, `i`, `signal` that exists
/// @throw Error(kCloud) for a cloud without usable x, y, z, with a layout that contradicts its size, or
/// without a finite point;
///        Error(kCloud) also when an explicitly named intensity field does not exist.
PointCloud toPointCloud(const sensor_msgs::PointCloud2& message, const std::string& intensity_field);

/// The camera of the published image: region of interest and binning are applied.
/// @param rectified  the image is the rectified one (image_rect*): uses P instead of K and D
/// @throw Error(kCamera)
Camera toCamera(const sensor_msgs::CameraInfo& message, bool rectified);

/// CV_8UC3 BGR from any colour, grey, Bayer or yuv422 encoding; 16 bits are scaled by the bits in use. @throw
/// Error(kImage)
cv::Mat toBgr(const sensor_msgs::Image& message);

/// Label images CV_32SC1, one per channel, from `mono8`, `mono16`, `8UCn`, `16UCn` or `32SC1`; 0 = no mask.
/// @throw Error(kMasks) naming the encoding or the size.
std::vector<cv::Mat> toMaskLayers(const sensor_msgs::Image& message);

/// Label images to the mask message: `16UCn`, n = number of layers. @throw Error(kMasks) if an id does not
/// fit into 16 bits.
sensor_msgs::Image toMaskMessage(const std_msgs::Header& header, const std::vector<cv::Mat>& layers);

/// PNG or JPEG to a raw image message with the same header; depth and number of channels are kept (8UCn,
/// 16UCn or the Bayer encoding named in the format). @throw Error(kImage)
sensor_msgs::ImagePtr decode(const sensor_msgs::CompressedImage& message);

/// The same for masks, which a JPEG would spoil. @throw Error(kImage), Error(kMasks) for a JPEG
sensor_msgs::ImagePtr decodeMasks(const sensor_msgs::CompressedImage& message);

}  // namespace lidar_camera_recalibration
