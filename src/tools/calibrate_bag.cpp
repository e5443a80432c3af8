// Recalibrates from bags: the node's server, fed as fast as it can work.

#include <boost/make_shared.hpp>

#include <ros/time.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2/buffer_core.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>
#include <yaml-cpp/yaml.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <optional>

#include "bag_topics.hpp"
#include "bag_writing.hpp"
#include "calibration_options.hpp"
#include "cameras.hpp"
#include "command_line.hpp"
#include "frame_builder.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/overlay.hpp"
#include "lidar_camera_recalibration/result_file.hpp"
#include "parameters.hpp"
#include "report/report.hpp"
#include "server.hpp"

namespace lidar_camera_recalibration {

namespace po = boost::program_options;

namespace {

struct Options {
  std::vector<std::string> bags, assignments, cameras;
  std::string config, out, out_format, overlay, report, json, reference, initial, intrinsics;
  FormatOptions hints;  ///< about calibration files
  InputTopics topics;
  int min_frames = 0;  ///< 0: as the parameters say
};

using Bags = std::vector<std::unique_ptr<rosbag::Bag>>;

ServerConfig serverConfig(const Options& options) {
  ServerConfig config = loadServerConfig(options.config, options.assignments);
  config.mode = "manual";
  // Masks may be recorded long after their images, and no vehicle needs the memory here.
  constexpr std::size_t kCacheBytes = 1024u * 1024 * 1024;
  config.synchroniser.max_bytes = std::max(config.synchroniser.max_bytes, kCacheBytes);
  // An offline run depends on what it is given and on nothing left from runs before.
  config.initial_from_saved = false;
  config.result_file.clear();
  config.frames_keep_images = !options.report.empty();
  if (!options.hints.camera_frame.empty()) config.camera_frame = options.hints.camera_frame;
  if (!options.hints.lidar_frame.empty()) config.lidar_frame = options.hints.lidar_frame;
  if (options.min_frames > 0) {
    config.frames_min = options.min_frames;
    config.frames_max = std::max(config.frames_max, options.min_frames);
  }
  return config;
}

InputTopics inputTopics(const Bags& bags, const Options& options, const ServerConfig& config) {
  const std::vector<BagTopic> present = topicsOf(bags);
  InputTopics topics = guessTopics(present, firstOf(options.topics, config.topics));
  const bool info_from_file = !config.camera_info_file.empty();
  if (info_from_file) topics.camera_info.clear();
  std::string list;
  for (const BagTopic& topic : present) list += "\n  " + topic.name + "  " + topic.type;
  const auto require = [&](const std::string& topic, const std::string& option) {
    const auto named = [&topic](const BagTopic& candidate) {
      return candidate.name == topic && candidate.count > 0;
    };
    if (std::any_of(present.begin(), present.end(), named)) return;
    throw Error(ErrorCause::kFile,
                (topic.empty() ? "no topic fits --" + option : "there are no messages on " + topic) +
                    "; name the topic with --" + option + ". The topics are:" + list);
  };
  require(topics.image, "image");
  if (options.intrinsics.empty() && !info_from_file) require(topics.camera_info, "camera-info");
  require(topics.points, "points");
  require(topics.masks, "masks");
  const std::string& info_file = options.intrinsics.empty() ? config.camera_info_file : options.intrinsics;
  std::cerr << "image " << topics.image << ", camera_info "
            << (info_file.empty() ? topics.camera_info : info_file) << ", points " << topics.points
            << ", masks " << topics.masks << '\n';
  return topics;
}

/// Frames that the files must speak of, where they speak of several.
FormatOptions completed(FormatOptions hints, const ServerConfig& config, const Bags& bags,
                        const InputTopics& topics) {
  hints.camera_frame = !config.camera_frame.empty() ? config.camera_frame : frameIdOf(bags, topics.image);
  hints.lidar_frame = !config.lidar_frame.empty() ? config.lidar_frame : frameIdOf(bags, topics.points);
  return hints;
}

/// Whether the result can be written, before the search costs its time.
void checkOutput(const Options& options, const FormatOptions& hints) {
  if (options.out.empty()) return;
  const FormatDescription format = formatForWriting(options.out, hints);
  if (!format.has_extrinsic)
    throw Error(ErrorCause::kFile,
                "\"" + options.out + "\": the format " + format.name + " holds no extrinsic");
  CalibrationContents contents;
  contents.calibration.emplace();
  contents.calibration->camera_frame = hints.camera_frame;
  contents.calibration->lidar_frame = hints.lidar_frame;
  contents.intrinsics.emplace();
  renderCalibration(options.out, contents, hints);
}

void addTo(tf2::BufferCore& tf, const rosbag::MessageInstance& message, bool is_static) {
  const auto transforms = message.instantiate<tf2_msgs::TFMessage>();
  if (!transforms) return;
  for (const auto& transform : transforms->transforms) tf.setTransform(transform, "bag", is_static);
}

/// Transforms of the bags: the static ones at once, the others a little ahead of the messages that need them.
class TfReader {
 public:
  TfReader(const Bags& bags, tf2::BufferCore& tf) : tf_(tf) {
    rosbag::View fixed;
    for (const auto& bag : bags) {
      fixed.addQuery(*bag, rosbag::TopicQuery("/tf_static"));
      moving_.addQuery(*bag, rosbag::TopicQuery("/tf"));
    }
    for (const rosbag::MessageInstance& message : fixed) addTo(tf_, message, true);
    next_ = moving_.begin();
  }

  void advanceTo(const ros::Time& recorded) {
    constexpr double kAhead = 1.0;  // [s]
    for (; next_ != moving_.end() && next_->getTime().toSec() <= recorded.toSec() + kAhead; ++next_) {
      addTo(tf_, *next_, false);
    }
  }

 private:
  tf2::BufferCore& tf_;
  rosbag::View moving_;
  rosbag::View::iterator next_;
};

/// Puts the bags' messages into the server.
class Feeder {
 public:
  /// @param camera  instead of the CameraInfo of the bags
  Feeder(const Bags& bags, const InputTopics& topics, const std::optional<Intrinsics>& camera,
         tf2::BufferCore& tf)
      : topics_(topics), camera_(camera), tf_reader_(bags, tf) {
    std::vector<std::string> names = {topics.image, topics.points, topics.masks};
    if (!camera) names.push_back(topics.camera_info);
    for (const auto& bag : bags) view_.addQuery(*bag, rosbag::TopicQuery(names));
  }

  void run(RecalibrationServer& server, ProgressBar& progress) {
    const double begin = view_.getBeginTime().toSec(), length = view_.getEndTime().toSec() - begin;
    for (const rosbag::MessageInstance& message : view_) {
      tf_reader_.advanceTo(message.getTime());
      feed(server, message);
      // The server's queue drops what it cannot take; here there is time.
      server.waitUntilIdle();
      if (length > 0.0) progress.show("reading", (message.getTime().toSec() - begin) / length);
    }
    server.flush();
    server.waitUntilIdle();
    progress.show("reading", 1.0);
  }

 private:
  void feed(RecalibrationServer& server, const rosbag::MessageInstance& message) {
    const std::string& topic = message.getTopic();
    if (topic == topics_.image || topic == topics_.masks) {
      const sensor_msgs::ImageConstPtr image = decoded(message, topic == topics_.masks);
      if (!image) return;
      if (topic == topics_.image) {
        if (camera_) server.addCameraInfo(cameraInfo(*image));
        server.addImage(image);
      } else {
        server.addMasks(image);
      }
    } else if (const auto info = message.instantiate<sensor_msgs::CameraInfo>()) {
      server.addCameraInfo(info);
    } else if (const auto cloud = message.instantiate<sensor_msgs::PointCloud2>()) {
      server.addCloud(cloud);
    }
  }

  /// One unreadable image is no reason to stop, but one to speak.
  static sensor_msgs::ImageConstPtr decoded(const rosbag::MessageInstance& message, bool masks) {
    try {
      return masks ? masksFrom(message) : imageFrom(message);
    } catch (const Error& error) {
      std::cerr << message.getTopic() << ": " << error.what() << '\n';
      return nullptr;
    }
  }

  sensor_msgs::CameraInfoConstPtr cameraInfo(const sensor_msgs::Image& image) const {
    Intrinsics intrinsics = *camera_;
    if (intrinsics.width == 0) {  // of a format without a size
      intrinsics.width = static_cast<int>(image.width);
      intrinsics.height = static_cast<int>(image.height);
    }
    return boost::make_shared<sensor_msgs::CameraInfo>(toCameraInfo(image.header, intrinsics));
  }

  InputTopics topics_;
  std::optional<Intrinsics> camera_;
  TfReader tf_reader_;
  rosbag::View view_;
};

std::string droppedByCause(const RecalibrationState& state) {
  const std::vector<std::pair<const char*, std::uint64_t>> causes = {
      {"without camera_info or cloud", state.dropped_unmatched},
      {"without masks in time", state.dropped_no_masks},
      {"malformed", state.dropped_invalid},
      {"too poor", state.dropped_poor},
      {"without initial extrinsic", state.dropped_no_extrinsic},
      {"without tf to the parameter fixed_frame", state.dropped_no_motion},
      {"for lack of memory", state.dropped_memory},
      {"masks of unknown images", state.dropped_unknown_masks},
      {"clouds and camera_infos without image", state.dropped_unused}};
  std::string text;
  for (const auto& [cause, count] : causes) {
    if (count > 0) text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + cause;
  }
  return text.empty() ? "nothing" : text;
}

CalibrationResult calibrateFrames(RecalibrationServer& server, const ServerConfig& config) {
  const RecalibrationState state = server.state();
  if (state.frames < static_cast<std::uint32_t>(config.frames_min)) {
    throw Error(ErrorCause::kNotEnough,
                "only " + std::to_string(state.frames) + " of " + std::to_string(config.frames_min) +
                    " frames could be gathered; given up: " + droppedByCause(state) + ". " + state.text +
                    ". check_bag tells what does not fit, --min-frames asks for fewer");
  }
  Recalibrate::Request request;
  request.wait = true;
  request.timeout = 1e6;  // [s]; a batch run ends when the search does
  const Recalibrate::Response response = server.recalibrate(request);
  if (!response.success) throw Error(ErrorCause::kNotEnough, response.message);
  return response.result;
}

/// Of the images that the node works on: as taken, or rectified.
std::optional<Intrinsics> cameraFromFile(const Options& options, const ServerConfig& config) {
  if (options.intrinsics.empty()) return std::nullopt;
  const CalibrationContents contents = intrinsicsArgument(options.intrinsics, options.hints);
  if (!config.image_rectified) return contents.intrinsics;
  if (contents.rectified) return contents.rectified;
  if (contents.intrinsics->model != DistortionModel::kNone)
    throw Error(ErrorCause::kCamera,
                "\"" + options.intrinsics +
                    "\" describes a camera with distortion, but the parameter image_rectified "
                    "says that the images have none");
  return contents.intrinsics;
}

// --- output ---

Eigen::Isometry3d isometry(const geometry_msgs::TransformStamped& transform) {
  return Eigen::Isometry3d(tf2::transformToEigen(transform).matrix());
}

StoredCalibration stored(const CalibrationResult& result, const Options& options) {
  StoredCalibration calibration;
  calibration.T_camera_lidar = isometry(result.transform);
  calibration.camera_frame = result.transform.header.frame_id;
  calibration.lidar_frame = result.transform.child_frame_id;
  if (result.covariance[0] >= 0.0) {
    calibration.covariance =
        Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(result.covariance.data());
  }
  calibration.score_before = result.score_before;
  calibration.score_after = result.score_after;
  calibration.accepted = result.accepted;
  calibration.reason = result.reason;
  calibration.frames = result.frames;
  calibration.frames_left_out = result.frames_left_out;
  calibration.stamp = result.header.stamp.toSec();
  for (const std::string& bag : options.bags)
    calibration.source += (calibration.source.empty() ? "" : " ") + bag;
  return calibration;
}

/// Only this package's own format says whether the result was accepted; no other file gets a rejected one.
void writeResult(const std::string& file, const CalibrationContents& contents, const FormatOptions& hints) {
  const bool accepted = contents.calibration->accepted;
  if (!accepted && formatForWriting(file, hints).name != "yaml") {
    std::cout << "result: not written, " << file << " cannot say that it was rejected\n";
    return;
  }
  writeCalibrationFile(file, contents, hints);
  std::cout << "result: " << file << (accepted ? "" : " (says that it was rejected)") << '\n';
}

void printError(const char* label, const ExtrinsicError& error) {
  const Eigen::Vector3d rotation = error.rotation / kDegree, translation = 100.0 * error.translation;
  std::printf("error %-7s %.3f deg (%+.3f %+.3f %+.3f)   %.1f cm (%+.1f %+.1f %+.1f)\n", label,
              error.angle() / kDegree, rotation.x(), rotation.y(), rotation.z(), 100.0 * error.distance(),
              translation.x(), translation.y(), translation.z());
}

void printSigmas(const CalibrationResult& result) {
  if (result.covariance[0] < 0.0) {
    std::printf("standard deviation: not known, fewer than 5 frames\n");
    return;
  }
  const auto sigma = [&](std::size_t axis) { return std::sqrt(result.covariance[7 * axis]); };
  std::printf("standard deviation rx ry rz %.3f %.3f %.3f deg, tx ty tz %.1f %.1f %.1f cm\n",
              sigma(0) / kDegree, sigma(1) / kDegree, sigma(2) / kDegree, 100.0 * sigma(3), 100.0 * sigma(4),
              100.0 * sigma(5));
}

void print(const CalibrationResult& result, const std::optional<Eigen::Isometry3d>& reference) {
  const std::string verdict = result.accepted ? "accepted" : "rejected";
  const bool said = result.reason.rfind(verdict, 0) == 0;
  std::printf("%s\n", said ? result.reason.c_str() : (verdict + ": " + result.reason).c_str());
  std::printf("score %.4f -> %.4f on %u frames; on unseen ones it rises by %.4f +- %.4f\n",
              result.score_before, result.score_after, result.frames, result.unseen_gain,
              result.unseen_gain_sigma);
  if (result.frames_left_out > 0) {
    std::printf("%u of %u frames left out because they contradict the others\n", result.frames_left_out,
                result.frames + result.frames_left_out);
  }
  printSigmas(result);
  std::printf("image shift at 10, 20, 40 m: %.1f, %.1f, %.1f px; %u extrinsics scored in %.1f s\n",
              result.pixel_shift[0], result.pixel_shift[1], result.pixel_shift[2], result.evaluations,
              result.duration);
  if (!reference) return;
  printError("before", extrinsicError(isometry(result.start), *reference));
  printError("after", extrinsicError(isometry(result.transform), *reference));
}

std::string toJson(const CalibrationResult& result, const std::optional<Eigen::Isometry3d>& reference,
                   double seconds) {
  YAML::Emitter out;
  useJson(out);
  const auto put = [&out](const char* key, const auto& value) {
    out << YAML::Key << key << YAML::Value << value;
  };
  out << YAML::BeginMap;
  put("accepted", result.accepted != 0);
  put("reason", result.reason);
  put("frames", result.frames);
  put("frames_left_out", result.frames_left_out);
  put("evaluations", result.evaluations);
  put("score_before", result.score_before);
  put("score_after", result.score_after);
  put("unseen_gain", result.unseen_gain);
  put("unseen_gain_sigma", result.unseen_gain_sigma);
  put("distinctness", result.distinctness);
  put("kept", std::vector<int>(result.kept.begin(), result.kept.end()));
  put("pixel_shift", std::vector<double>(result.pixel_shift.begin(), result.pixel_shift.end()));
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> matrix = isometry(result.transform).matrix();
  put("T_camera_lidar", std::vector<double>(matrix.data(), matrix.data() + 16));
  if (reference) {
    const ExtrinsicError before = extrinsicError(isometry(result.start), *reference);
    const ExtrinsicError after = extrinsicError(isometry(result.transform), *reference);
    put("rotation_error_before_deg", before.angle() / kDegree);
    put("rotation_error_after_deg", after.angle() / kDegree);
    put("translation_error_before_m", before.distance());
    put("translation_error_after_m", after.distance());
  }
  put("search_seconds", result.duration);
  put("seconds", seconds);
  out << YAML::EndMap;
  return out.c_str();
}

void writeOverlay(const std::string& file, const Frame& frame, const CalibrationResult& result,
                  const ServerConfig& config) {
  bool written = false;
  try {
    written = cv::imwrite(file, drawBeforeAfter(frame, isometry(result.start), isometry(result.transform),
                                                config.overlay_color));
  } catch (const cv::Exception& error) {
    throw Error(ErrorCause::kFile, "\"" + file + "\" cannot be written: " + error.what());
  }
  if (!written) throw Error(ErrorCause::kFile, "\"" + file + "\" cannot be written");
  std::cout << "overlay: " << file << '\n';
}

/// What the server says while it works. Written by its thread, read when it is idle.
struct Record {
  FramePtr newest;
  ReportInput report;
};

ServerOutputs recording(Record& record, ProgressBar& progress) {
  ServerOutputs outputs;
  outputs.kept = [&record](const FramePtr& frame) { record.newest = frame; };
  outputs.score = [&record](const CalibrationScore& score) {
    record.report.images.push_back({score.header.stamp.toSec(), score.used != 0, score.reason});
  };
  outputs.outcome = [&record](const CalibrationOutcome& outcome, const Frames& frames) {
    record.report.outcome = outcome;
    record.report.frames = frames;
  };
  outputs.state = [&progress](const RecalibrationState& state) {
    if (state.state == RecalibrationState::SEARCHING) progress.show("searching", state.progress);
  };
  return outputs;
}

int calibrateCamera(const Options& options) {
  const auto begin = std::chrono::steady_clock::now();
  ros::Time::init();
  ServerConfig config = serverConfig(options);
  const Bags bags = openBags(options.bags);
  const InputTopics topics = inputTopics(bags, options, config);

  // Calibration files, before anything costs time.
  const FormatOptions hints = completed(options.hints, config, bags, topics);
  FormatOptions out_hints = hints;
  out_hints.format = options.out_format;
  checkOutput(options, out_hints);
  std::optional<Eigen::Isometry3d> reference;
  if (!options.reference.empty()) reference = extrinsicArgument(options.reference, hints).T_camera_lidar;
  if (!options.initial.empty())
    config.initial_T_camera_lidar = extrinsicArgument(options.initial, hints).T_camera_lidar;
  const std::optional<Intrinsics> camera = cameraFromFile(options, config);

  // Masks come late, and the transform is looked up at the stamp of their image.
  tf2::BufferCore tf(ros::Duration(2.0 * config.synchroniser.mask_timeout + 10.0));
  Feeder feeder(bags, topics, camera, tf);
  ProgressBar progress;
  Record record;
  RecalibrationServer server(config, tf, "calibrate_bag", recording(record, progress));
  feeder.run(server, progress);
  const CalibrationResult result = calibrateFrames(server, config);
  progress.finish();

  print(result, reference);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  ReportInput& report = record.report;
  report.contents.calibration = stored(result, options);
  report.contents.intrinsics = record.newest->camera.intrinsics();
  if (!options.out.empty()) writeResult(options.out, report.contents, out_hints);
  if (!options.report.empty()) {
    report.config = config.calibrator;
    report.hints = hints;
    report.given_up = droppedByCause(server.state());
    report.reference = reference;
    writeFileAtomically(options.report, reportHtml(report));
    std::cout << "report: " << options.report << '\n';
  }
  if (!options.json.empty()) writeFileAtomically(options.json, toJson(result, reference, seconds) + "\n");
  if (!options.overlay.empty()) writeOverlay(options.overlay, *record.newest, result, config);
  return result.accepted ? kExitOk : kExitRejected;
}

/// The options of one of several cameras.
Options optionsOf(const CameraOption& camera, Options options) {
  options.assignments.insert(options.assignments.end(), camera.assignments.begin(), camera.assignments.end());
  options.topics = camera.topics;
  for (std::string* file : {&options.out, &options.overlay, &options.report, &options.json})
    *file = fileOf(camera, *file);
  for (std::string* file : {&options.initial, &options.intrinsics, &options.reference})
    *file = inputFileOf(camera, *file);
  return options;
}

/// One camera after the other; one that fails is no reason to leave out the rest.
int calibrateBags(const Options& options) {
  const std::vector<CameraOption> cameras = parseCameras(options.cameras, options.topics);
  if (options.cameras.empty()) return calibrateCamera(options);
  std::vector<int> statuses;
  for (const CameraOption& camera : cameras) {
    std::cout << "camera " << camera.name << std::endl;
    try {
      statuses.push_back(calibrateCamera(optionsOf(camera, options)));
    } catch (const std::exception& error) {
      std::cerr << "camera " << camera.name << ": " << error.what() << '\n';
      statuses.push_back(kExitInput);
    }
  }
  for (const int status : {kExitInput, kExitRejected}) {
    if (std::count(statuses.begin(), statuses.end(), status) > 0) return status;
  }
  return kExitOk;
}

}  // namespace

int calibrateBagMain(int argc, char** argv) {
  Options options;
  CommandLine line{"calibrate_bag BAG... [options]",
                   "Finds the extrinsic between camera and LiDAR from a recording with images, CameraInfo, "
                   "clouds, masks and\n"
                   "tf. Several bags are taken as one recording. The start is --initial, else the parameter "
                   "initial guess of\n"
                   "--config, else tf. Exit status 0: accepted, 3: rejected, 1: the input cannot be used, 2: "
                   "wrong options.",
                   po::options_description("Options"), "bag"};
  line.options.add_options()("bag", po::value(&options.bags)->required()->composing()->value_name("BAG"),
                             "the recording")("config", po::value(&options.config)->value_name("YAML"),
                                              "parameters of the node (default: its defaults)")(
      "set", po::value(&options.assignments)->composing()->value_name("NAME=VALUE"),
      "one parameter, such as gate/min_distinctness=6; may be repeated")(
      "out", po::value(&options.out)->value_name("FILE"),
      "the result, in this package's YAML also a rejected one; its format is told by an existing file's "
      "content, else by "
      "the name, see convert_calibration --list")(
      "out-format", po::value(&options.out_format)->value_name("FORMAT"), "or by this")(
      "overlay", po::value(&options.overlay)->value_name("PNG"), "the newest frame before and after")(
      "report", po::value(&options.report)->value_name("HTML"),
      "one page with pictures, score, frames, numbers and lines to paste")(
      "json", po::value(&options.json)->value_name("FILE"), "summary for scripts")(
      "reference", po::value(&options.reference)->value_name("FILE[:FORMAT]"),
      "an extrinsic to compare with")("initial", po::value(&options.initial)->value_name("FILE[:FORMAT]"),
                                      "the extrinsic to start from")(
      "intrinsics", po::value(&options.intrinsics)->value_name("FILE[:FORMAT]"),
      "the camera, instead of the recording's CameraInfo")(
      "min-frames", atLeast(1, &options.min_frames, "min-frames")->value_name("N"),
      "default: the parameter frames/min");
  addCalibrationOptions(line.options, options.hints);
  addTopicOptions(line.options, options.topics);
  addCameraOption(line.options, options.cameras);
  return runTool(argc, argv, line, [&options](const po::variables_map&) { return calibrateBags(options); });
}

}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) { return lidar_camera_recalibration::calibrateBagMain(argc, argv); }
