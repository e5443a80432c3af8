#include "lidar_camera_recalibration/files.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr std::size_t kMaxFileSize = 1024 * 1024;  // [bytes]; a calibration has about 3 KB

Error fileError(const std::string& path, const std::string& what) {
  return Error(ErrorCause::kFile, "calibration file '" + path + "': " + what);
}

bool writeAll(int file, const std::string& text) {
  std::size_t done = 0;
  while (done < text.size()) {
    const ssize_t count = ::write(file, text.data() + done, text.size() - done);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return false;
    done += static_cast<std::size_t>(count);
  }
  return true;
}

/// Not even a power cut may leave the new name without its content, hence fsync before the rename.
bool writeAndRename(int file, const std::string& temporary, const std::string& path,
                    const std::string& text) {
  const bool written = writeAll(file, text) && ::fsync(file) == 0;
  const int error = errno;
  const bool closed = ::close(file) == 0;
  if (!written) errno = error;
  return written && closed && ::rename(temporary.c_str(), path.c_str()) == 0;
}

}  // namespace

std::string readCalibrationText(const std::string& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) throw fileError(path, std::strerror(errno));
  if (!S_ISREG(status.st_mode)) throw fileError(path, "is not a regular file");
  if (static_cast<std::size_t>(status.st_size) > kMaxFileSize) {
    throw fileError(path,
                    "has " + std::to_string(status.st_size) + " bytes; a calibration has less than 1 MB");
  }
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  if (!file.is_open() || file.bad()) throw fileError(path, std::strerror(errno));
  return text;
}

void writeFileAtomically(const std::string& path, const std::string& text) {
  static std::atomic<unsigned> counter{0};
  const std::string temporary =
      path + "." + std::to_string(::getpid()) + "." + std::to_string(counter++) + ".tmp";
  const auto fail = [&path](int error) {
    return Error(ErrorCause::kFile, "cannot write '" + path + "': " + std::strerror(error) +
                                        "; give a file in an existing, writable folder with free space");
  };
  const int file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (file < 0) throw fail(errno);
  if (!writeAndRename(file, temporary, path, text)) {
    const int error = errno;
    ::unlink(temporary.c_str());
    throw fail(error);
  }
}

}  // namespace lidar_camera_recalibration
