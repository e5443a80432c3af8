#pragma once

#include <string>
#include <vector>

namespace lidar_camera_recalibration {

/// Text as content or attribute.
std::string escaped(const std::string& text);

/// printf's %.*f, with a minus sign and not a hyphen.
std::string fixed(double value, int digits);

/// The same with a plus sign where it is due.
std::string signedFixed(double value, int digits);

/// A picture as the source of an <img>.
std::string dataUri(const std::string& mime_type, const std::vector<unsigned char>& bytes);

}  // namespace lidar_camera_recalibration
