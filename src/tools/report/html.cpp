#include "html.hpp"

#include <cstdio>

namespace lidar_camera_recalibration {

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      default:
        result += c;
    }
  }
  return result;
}

std::string fixed(double value, int digits) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text[0] == '-' ? "\u2212" + std::string(text + 1) : std::string(text);
}

std::string signedFixed(double value, int digits) { return (value > 0.0 ? "+" : "") + fixed(value, digits); }

std::string dataUri(const std::string& mime_type, const std::vector<unsigned char>& bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string uri = "data:" + mime_type + ";base64,";
  uri.reserve(uri.size() + 4 * (bytes.size() + 2) / 3);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t count = bytes.size() - i;
    const unsigned group =
        bytes[i] << 16 | (count > 1 ? bytes[i + 1] << 8 : 0) | (count > 2 ? bytes[i + 2] : 0);
    uri += kDigits[group >> 18];
    uri += kDigits[group >> 12 & 63];
    uri += count > 1 ? kDigits[group >> 6 & 63] : '=';
    uri += count > 2 ? kDigits[group & 63] : '=';
  }
  return uri;
}

}  // namespace lidar_camera_recalibration
