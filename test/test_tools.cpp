#include <gtest/gtest.h>

#include <unistd.h>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "bag_topics.hpp"
#include "cameras.hpp"
#include "command_line.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "parameters.hpp"
#include "perturbation.hpp"
#include "statistics.hpp"

namespace lidar_camera_recalibration {
namespace {

namespace po = boost::program_options;

Eigen::Isometry3d someExtrinsic() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  T.translation() << 0.5, -0.3, 1.2;
  return T;
}

// --- topics ---

const char kImage[] = "sensor_msgs/Image", kCompressed[] = "sensor_msgs/CompressedImage",
           kInfo[] = "sensor_msgs/CameraInfo", kCloud[] = "sensor_msgs/PointCloud2";

TEST(Topics, AreGuessedByTypeAndName) {
  const InputTopics topics = guessTopics({{"/cam_rear/camera_info", kInfo, 100},
                                          {"/cam_front/camera_info", kInfo, 90},
                                          {"/cam_front/image_raw/compressed", kCompressed, 100},
                                          {"/cam_front/image_raw", kImage, 100},
                                          {"/cam_front/image_rect_color", kImage, 120},
                                          {"/cam_front/depth/image_raw", kImage, 500},
                                          {"/cam_front/masks", kImage, 50},
                                          {"/map", kCloud, 900},
                                          {"/radar", kCloud, 800},
                                          {"/velodyne_points", kCloud, 100}},
                                         {});
  EXPECT_EQ(topics.image, "/cam_front/image_raw");
  EXPECT_EQ(topics.camera_info, "/cam_front/camera_info");
  EXPECT_EQ(topics.masks, "/cam_front/masks");
  EXPECT_EQ(topics.points, "/velodyne_points");
}

TEST(Topics, InfoIsTheNeighbourOfACompressedImage) {
  const InputTopics topics = guessTopics({{"/a/camera_info", kInfo, 900},
                                          {"/b/camera_info", kInfo, 10},
                                          {"/b/image_color/compressed", kCompressed, 10}},
                                         {});
  EXPECT_EQ(topics.image, "/b/image_color/compressed");
  EXPECT_EQ(topics.camera_info, "/b/camera_info");
  EXPECT_EQ(topics.points, "");
  EXPECT_EQ(topics.masks, "");
}

TEST(Topics, GivenNamesStay) {
  InputTopics given;
  given.image = "/b/image_raw";
  const InputTopics topics = guessTopics({{"/a/image_raw", kImage, 90},
                                          {"/a/camera_info", kInfo, 90},
                                          {"/b/image_raw", kImage, 10},
                                          {"/b/camera_info", kInfo, 10}},
                                         given);
  EXPECT_EQ(topics.image, "/b/image_raw");
  EXPECT_EQ(topics.camera_info, "/b/camera_info");
}

TEST(Topics, AreFoundWithOrWithoutSlashAndTransport) {
  InputTopics given;
  given.image = "/cam_front";
  given.points = "/lidar_top";
  const InputTopics topics =
      guessTopics({{"cam_front/compressed", kCompressed, 90}, {"lidar_top", kCloud, 90}}, given);
  EXPECT_EQ(topics.image, "cam_front/compressed");
  EXPECT_EQ(topics.points, "lidar_top");
}

TEST(Topics, OfAnotherCameraDoNotSlipIn) {
  const std::vector<BagTopic> present = {{"/a/image_raw", kImage, 90},      {"/a/camera_info", kInfo, 90},
                                         {"/a/masks", kImage, 90},          {"/b/image_raw", kImage, 99},
                                         {"/segmenter/b/masks", kImage, 9}, {"/c/image_raw", kImage, 99}};
  EXPECT_EQ(guessTopics(present, {}).image, "/a/image_raw") << "the one with masks";
  InputTopics given;
  given.image = "/b/image_raw";
  EXPECT_EQ(guessTopics(present, given).masks, "/segmenter/b/masks");
  EXPECT_EQ(guessTopics(present, given).camera_info, "");
  given.image = "/c/image_raw";
  EXPECT_EQ(guessTopics(present, given).camera_info, "");
}

// --- cameras ---

TEST(Cameras, NamesTopicsAndParameters) {
  InputTopics common;
  common.points = "/lidar";
  const auto cameras =
      parseCameras({"front=/f/image", "rear=/r/image,masks=/m,camera_info=/i,image_rectified=true"}, common);
  ASSERT_EQ(cameras.size(), 2u);
  EXPECT_EQ(cameras[0].topics.image, "/f/image");
  EXPECT_EQ(cameras[0].topics.masks, "");
  EXPECT_EQ(cameras[1].name, "rear");
  EXPECT_EQ(cameras[1].topics.masks, "/m");
  EXPECT_EQ(cameras[1].topics.camera_info, "/i");
  EXPECT_EQ(cameras[1].topics.points, "/lidar");
  EXPECT_EQ(cameras[1].assignments.back(), "image_rectified=true");
  EXPECT_EQ(fileOf(cameras[1], "out/r.yaml"), "out/r_rear.yaml");
  EXPECT_EQ(fileOf(cameras[1], ""), "");
  EXPECT_EQ(fileOf(parseCameras({}, common).at(0), "r.yaml"), "r.yaml");
  for (const std::string wrong : {"", "front", "front=", "=x", "a/b=x", "front=/x,masks"})
    EXPECT_THROW(parseCameras({wrong}, common), boost::program_options::error) << wrong;
}

TEST(Bags, BadOnesAreRefusedInWords) {
  const auto refusal = [](const std::string& path) -> std::string {
    try {
      openBag(path);
    } catch (const Error& error) {
      EXPECT_EQ(error.cause(), ErrorCause::kFile);
      return error.what();
    }
    return "opened";
  };
  EXPECT_EQ(refusal("nowhere.bag"), "\"nowhere.bag\": there is no such file");
  const auto path =
      std::filesystem::temp_directory_path() / ("test_tools_" + std::to_string(getpid()) + ".bag");
  std::ofstream(path) << "no bag at all";
  EXPECT_NE(refusal(path.string()).find("this is no ROS 1 bag"), std::string::npos);
  // A recording that was interrupted: the index position in the header is still 0.
  { rosbag::Bag bag(path.string(), rosbag::bagmode::Write); }
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  std::string head(4096, '\0');
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  file.clear();
  const std::size_t position = head.find("index_pos=");
  ASSERT_NE(position, std::string::npos);
  file.seekp(static_cast<std::streamoff>(position) + 10);
  file.write("\0\0\0\0\0\0\0\0", 8);
  file.close();
  EXPECT_NE(refusal(path.string()).find("rosbag reindex"), std::string::npos) << refusal(path.string());
  std::filesystem::remove(path);
}

// --- statistics ---

TEST(Statistics, QuantilesAreLinearBetweenOrderStatistics) {
  EXPECT_DOUBLE_EQ(quantile({4, 1, 3, 2}, 0.5), 2.5);
  EXPECT_DOUBLE_EQ(quantile({1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}, 0.9), 10.0);
  EXPECT_DOUBLE_EQ(quantile({7}, 0.9), 7.0);
  EXPECT_TRUE(std::isnan(quantile({}, 0.5)));
  EXPECT_DOUBLE_EQ(mean({1, 2, 6}), 3.0);
}

TEST(Statistics, HuberMeanSolvesItsEquation) {
  const std::vector<double> values = {1.0, 1.2, 0.9, 1.1, 1.3, 0.8, 9.0};
  const double location = huberMean(values);
  // The sum of the clipped deviations is zero. Median 1.1; the median of |x - 1.1| = .1 .1 .2 0 .2 .3 7.9 is
  // .2.
  const double limit = 1.345 * 1.4826 * 0.2;
  double sum = 0.0;
  for (const double value : values) sum += std::max(-limit, std::min(limit, value - location));
  EXPECT_NEAR(sum, 0.0, 1e-9);
  EXPECT_LT(location, 1.2);  // the mean is 2.2
  EXPECT_DOUBLE_EQ(huberMean({2, 2, 2, 50}), 2.0);
  EXPECT_NEAR(huberMean({1, 2, 3, 4, 5}), 3.0, 1e-12);
}

// --- perturbations ---

TEST(Perturbation, HasExactlyTheSizeAsked) {
  const Eigen::Isometry3d T = someExtrinsic();
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const ExtrinsicError error = extrinsicError(perturbedBy(T, 2.0 * kDegree, 0.1, seed), T);
    EXPECT_NEAR(error.angle(), 2.0 * kDegree, 1e-12);
    EXPECT_NEAR(error.distance(), 0.1, 1e-12);
  }
  const Eigen::Isometry3d a = perturbedBy(T, 0.1, 0.1, 1), b = perturbedBy(T, 0.1, 0.1, 1);
  EXPECT_EQ(a.matrix(), b.matrix());
  EXPECT_GT((a.matrix() - perturbedBy(T, 0.1, 0.1, 2).matrix()).norm(), 0.01);
}

// --- command line and parameters ---

struct Parsed {
  int status = -1;
  std::vector<std::string> files;
  NumberPair pair;
  double number = 0.0;
};

Parsed parse(std::vector<std::string> words) {
  Parsed parsed;
  words.insert(words.begin(), "tool");
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  CommandLine line{"tool", "Tests.", po::options_description("Options"), "file", "--pair"};
  line.options.add_options()("file", po::value(&parsed.files)->required()->composing())(
      "pair", po::value(&parsed.pair))("number", atLeast(-5.0, &parsed.number, "number"));
  parsed.status = runTool(static_cast<int>(words.size()), arguments.data(), line,
                          [](const po::variables_map&) { return kExitOk; });
  return parsed;
}

TEST(Tool, OptionsOfTwoWordsLeaveTheRest) {
  const Parsed parsed = parse({"--pair", "2", "-0.1", "a.bag", "--number", "-3", "b.bag"});
  EXPECT_EQ(parsed.status, kExitOk);
  EXPECT_EQ(parsed.pair.first, 2.0);
  EXPECT_EQ(parsed.pair.second, -0.1);
  EXPECT_EQ(parsed.files, (std::vector<std::string>{"a.bag", "b.bag"}));
  EXPECT_EQ(parsed.number, -3.0);
}

TEST(Tool, WrongUseIsTwo) {
  EXPECT_EQ(parse({}).status, kExitUsage);  // no file
  EXPECT_EQ(parse({"a", "--nonsense"}).status, kExitUsage);
  EXPECT_EQ(parse({"a", "--num", "3"}).status, kExitUsage);      // abbreviated
  EXPECT_EQ(parse({"a", "--number", "-6"}).status, kExitUsage);  // below the limit
  EXPECT_EQ(parse({"a", "--number", "many"}).status, kExitUsage);
  EXPECT_EQ(parse({"a", "--pair", "1"}).status, kExitUsage);
  EXPECT_EQ(parse({"--pair", "1", "a"}).status, kExitUsage);
  EXPECT_EQ(parse({"--help"}).status, kExitOk);
}

TEST(Tool, ErrorsAreOne) {
  CommandLine line{"tool", "Tests.", po::options_description("Options"), "file"};
  char name[] = "tool";
  char* arguments[] = {name, nullptr};
  EXPECT_EQ(runTool(1, arguments, line,
                    [](const po::variables_map&) -> int { throw Error(ErrorCause::kFile, "on purpose"); }),
            kExitInput);
  EXPECT_EQ(runTool(1, arguments, line, [](const po::variables_map&) -> int { throw std::bad_alloc(); }),
            kExitInput);
  EXPECT_EQ(
      runTool(1, arguments, line, [](const po::variables_map&) -> int { throw po::error("on purpose"); }),
      kExitUsage);
  EXPECT_EQ(runTool(1, arguments, line, [](const po::variables_map&) { return kExitRejected; }),
            kExitRejected);
}

TEST(Parameters, WordsComeAfterTheFile) {
  const auto path =
      std::filesystem::temp_directory_path() / ("test_tools_" + std::to_string(getpid()) + ".yaml");
  std::ofstream(path) << "gate: {min_significance: 0.5, min_distinctness: 0.25}\nframes:\n  min: 3\n";
  const ServerConfig config =
      loadServerConfig(path.string(), {"gate/min_significance=0.125", "camera_frame=eye"});
  std::filesystem::remove(path);
  EXPECT_EQ(config.calibrator.gate.min_significance, 0.125);
  EXPECT_EQ(config.calibrator.gate.min_distinctness, 0.25);
  EXPECT_EQ(config.frames_min, 3);
  EXPECT_EQ(config.camera_frame, "eye");
  EXPECT_EQ(loadServerConfig("", {}).calibrator.gate.min_significance, GateConfig().min_significance);
}

TEST(Parameters, MatrixAsWord) {
  const ServerConfig config =
      loadServerConfig("", {"initial/T_camera_lidar=[0,-1,0,1, 0,0,-1,2, 1,0,0,3, 0,0,0,1]"});
  ASSERT_TRUE(config.initial_T_camera_lidar);
  EXPECT_EQ(config.initial_T_camera_lidar->translation(), Eigen::Vector3d(1, 2, 3));
}

TEST(Parameters, WrongOnesAreRefused) {
  const auto cause = [](const std::string& file, const std::vector<std::string>& words) {
    try {
      loadServerConfig(file, words);
    } catch (const Error& error) {
      return error.cause();
    }
    ADD_FAILURE() << "nothing was thrown";
    return ErrorCause::kCloud;
  };
  EXPECT_EQ(cause("", {"gate/min_gian=0.1"}), ErrorCause::kParameter);
  EXPECT_EQ(cause("", {"gate/min_significance"}), ErrorCause::kParameter);
  EXPECT_EQ(cause("", {"gate/min_significance=much"}), ErrorCause::kParameter);
  EXPECT_EQ(cause("", {"gate/min_significance=[1"}), ErrorCause::kParameter);
  EXPECT_EQ(cause("", {"gate/min_significance=-1"}), ErrorCause::kParameter);
  EXPECT_EQ(cause("nowhere.yaml", {}), ErrorCause::kFile);
}

}  // namespace
}  // namespace lidar_camera_recalibration
