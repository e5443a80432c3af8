// Converts calibration files between the formats of calibration_formats.hpp.

#include <iomanip>
#include <iostream>

#include "calibration_options.hpp"
#include "command_line.hpp"

namespace lidar_camera_recalibration {

namespace po = boost::program_options;

namespace {

void listFormats() {
  for (const FormatDescription& format : calibrationFormats()) {
    const char* parts = format.has_extrinsic && format.has_intrinsics ? "extrinsic, intrinsics"
                        : format.has_extrinsic                        ? "extrinsic"
                                                                      : "intrinsics";
    std::cout << std::left << std::setw(16) << format.name << std::setw(23) << parts << format.what << '\n';
  }
}

void convert(const std::vector<std::string>& files, const std::string& from, const std::string& to,
             const std::string& intrinsics, const FormatOptions& hints) {
  FormatOptions input = hints, output = hints;
  if (!from.empty()) input.format = from;
  CalibrationContents contents = readCalibrationArgument(files[0], input);
  if (!intrinsics.empty()) {
    const CalibrationContents camera = intrinsicsArgument(intrinsics, hints);
    contents.intrinsics = camera.intrinsics;
    contents.rectified = camera.rectified;
  }
  if (contents.calibration) {  // the names that the user gives count more than those of the file
    if (!hints.camera_frame.empty()) contents.calibration->camera_frame = hints.camera_frame;
    if (!hints.lidar_frame.empty()) contents.calibration->lidar_frame = hints.lidar_frame;
  }
  std::string path;
  splitFormat(files[1], path, output);
  if (!to.empty()) output.format = to;
  writeCalibrationFile(path, contents, output);
  std::cout << path << ": written as " << formatForWriting(path, output).name << '\n';
}

}  // namespace

int convertCalibrationMain(int argc, char** argv) {
  std::vector<std::string> files;
  std::string from, to, intrinsics;
  FormatOptions hints;
  CommandLine line{
      "convert_calibration IN OUT [options]",
      "Writes the calibration of the file IN to the file OUT in another format. Formats are told by the "
      "content of an\n"
      "existing file and by the name of a new one, or named (--list), with options or as FILE:FORMAT. "
      "What an existing\n"
      "file OUT of the same format says of other sensors stays.",
      po::options_description("Options"), "file"};
  line.options.add_options()("file", po::value(&files)->value_name("FILE"), "IN and OUT")(
      "from", po::value(&from)->value_name("FORMAT"), "of IN")("to", po::value(&to)->value_name("FORMAT"),
                                                               "of OUT")(
      "intrinsics", po::value(&intrinsics)->value_name("FILE[:FORMAT]"),
      "take the camera's intrinsics from this file, where OUT needs them and IN has none")(
      "list", po::bool_switch(), "show the formats");
  addCalibrationOptions(line.options, hints);
  return runTool(argc, argv, line, [&](const po::variables_map& values) {
    if (values["list"].as<bool>()) {
      listFormats();
      return kExitOk;
    }
    if (files.size() != 2) throw po::error("two files are needed, IN and OUT");
    convert(files, from, to, intrinsics, hints);
    return kExitOk;
  });
}

}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) { return lidar_camera_recalibration::convertCalibrationMain(argc, argv); }
