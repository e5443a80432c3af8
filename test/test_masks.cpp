#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/masks.hpp"

namespace lcr = lidar_camera_recalibration;

namespace {

using Layers = std::vector<cv::Mat>;

std::set<std::uint32_t> setAt(const lcr::MaskSets& sets, int v, int u) {
  const std::size_t s = sets.setOfPixel().at<std::uint16_t>(v, u);
  return {sets.setMasks().begin() + sets.setBegin()[s], sets.setMasks().begin() + sets.setBegin()[s + 1]};
}

/// The ids of all layers at a pixel.
std::set<int> idsAt(const Layers& layers, int v, int u) {
  std::set<int> ids;
  for (const cv::Mat& layer : layers) ids.insert(layer.at<int>(v, u));
  ids.erase(0);
  return ids;
}

void expectSets(const lcr::MaskSets& sets, const Layers& layers) {
  std::set<int> all;
  for (int v = 0; v < layers[0].rows; ++v) {
    for (int u = 0; u < layers[0].cols; ++u) {
      for (const int id : idsAt(layers, v, u)) all.insert(id);
    }
  }
  ASSERT_EQ(sets.maskCount(), all.size());
  const std::vector<int> id_of_mask(all.begin(), all.end());  // masks are numbered in the order of their ids
  for (int v = 0; v < layers[0].rows; ++v) {
    for (int u = 0; u < layers[0].cols; ++u) {
      std::set<int> ids;
      for (const std::uint32_t mask : setAt(sets, v, u)) ids.insert(id_of_mask.at(mask));
      ASSERT_EQ(ids, idsAt(layers, v, u)) << v << " " << u;
    }
  }
}

Layers randomLayers(int count, int ids, int width, int height, std::uint64_t seed) {
  cv::RNG random(seed);
  Layers layers;
  for (int l = 0; l < count; ++l) {
    layers.emplace_back(height, width, CV_32SC1);
    random.fill(layers.back(), cv::RNG::UNIFORM, 0, ids + 1);
  }
  return layers;
}

void expectRefused(const Layers& layers, const std::string& word) {
  try {
    lcr::MaskSets::fromLayers(layers);
    FAIL() << "accepted; expected an error with: " << word;
  } catch (const lcr::Error& error) {
    EXPECT_EQ(error.cause(), lcr::ErrorCause::kMasks);
    EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
  }
}

/// The binary masks of one real frame; empty if the data is not there.
std::vector<cv::Mat> realMasks(const std::string& frame) {
  const std::filesystem::path folder = std::filesystem::path(SHARED_DATA) / "kitti_00/masks" / frame;
  std::vector<std::string> files;
  if (!std::filesystem::is_directory(folder)) return {};
  for (const auto& entry : std::filesystem::directory_iterator(folder)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<cv::Mat> masks;
  for (const std::string& file : files) masks.push_back(cv::imread(file, cv::IMREAD_GRAYSCALE));
  return masks;
}

}  // namespace

TEST(Masks, SmallImageByHand) {
  const cv::Mat first = (cv::Mat_<int>(2, 4) << 0, 7, 7, 3, 0, 0, 7, 3);
  const cv::Mat second = (cv::Mat_<int>(2, 4) << 0, 0, 3, 3, 900000, 0, 7, 0);
  const lcr::MaskSets sets = lcr::MaskSets::fromLayers({first, second});

  EXPECT_EQ(sets.width(), 4);
  EXPECT_EQ(sets.height(), 2);
  EXPECT_EQ(sets.maskCount(), 3U);  // 3 -> 0, 7 -> 1, 900000 -> 2
  EXPECT_EQ(sets.setCount(), 5U);   // {}, {7}, {3, 7}, {3}, {900000}
  using Set = std::set<std::uint32_t>;
  EXPECT_EQ(setAt(sets, 0, 0), Set());
  EXPECT_EQ(setAt(sets, 0, 1), Set({1}));
  EXPECT_EQ(setAt(sets, 0, 2), Set({0, 1}));
  EXPECT_EQ(setAt(sets, 0, 3), Set({0}));  // in both layers, counted once
  EXPECT_EQ(setAt(sets, 1, 0), Set({2}));
  EXPECT_EQ(setAt(sets, 1, 2), Set({1}));
  EXPECT_EQ(sets.setOfPixel().at<std::uint16_t>(0, 3), sets.setOfPixel().at<std::uint16_t>(1, 3));
  EXPECT_EQ(sets.setOfPixel().at<std::uint16_t>(0, 0), 0);
  EXPECT_EQ(sets.setBegin()[1], 0U);  // set 0 is empty
}

TEST(Masks, RandomLayersPixelByPixel) {
  const Layers layers = randomLayers(3, 12, 61, 47, 3);
  const lcr::MaskSets sets = lcr::MaskSets::fromLayers(layers);
  expectSets(sets, layers);
  for (std::size_t s = 0; s < sets.setCount(); ++s) {
    const auto begin = sets.setMasks().begin() + sets.setBegin()[s];
    const auto end = sets.setMasks().begin() + sets.setBegin()[s + 1];
    EXPECT_TRUE(std::is_sorted(begin, end));
  }
}

TEST(Masks, OrderOfLayersDoesNotMatter) {
  const Layers layers = randomLayers(3, 9, 50, 40, 5);
  const lcr::MaskSets a = lcr::MaskSets::fromLayers(layers);
  const lcr::MaskSets b = lcr::MaskSets::fromLayers({layers[2], layers[0], layers[1]});
  EXPECT_EQ(cv::countNonZero(a.setOfPixel() != b.setOfPixel()), 0);
  EXPECT_EQ(a.setBegin(), b.setBegin());
  EXPECT_EQ(a.setMasks(), b.setMasks());
}

TEST(Masks, MoreThan255Masks) {
  const Layers layers = randomLayers(1, 3000, 200, 150, 11);
  const lcr::MaskSets sets = lcr::MaskSets::fromLayers(layers);
  EXPECT_GT(sets.maskCount(), 2900U);
  expectSets(sets, layers);
}

TEST(Masks, RegionOfALargerImage) {
  const Layers whole = randomLayers(2, 5, 80, 60, 13);
  const Layers layers = {whole[0](cv::Rect(10, 5, 40, 30)), whole[1](cv::Rect(10, 5, 40, 30))};
  expectSets(lcr::MaskSets::fromLayers(layers), layers);
}

TEST(Masks, NoiseIsRefusedAtTheLimitOf16Bits) {
  cv::Mat ids(256, 256, CV_32SC1);
  for (int i = 0; i < 65536; ++i) ids.at<int>(i / 256, i % 256) = i;  // 0 and 65535 masks
  const lcr::MaskSets sets = lcr::MaskSets::fromLayers({ids});
  EXPECT_EQ(sets.setCount(), 65536U);
  EXPECT_EQ(setAt(sets, 255, 255), std::set<std::uint32_t>({65534}));
  ids.at<int>(0, 0) = 65536;
  expectRefused({ids}, "65535");
}

TEST(Masks, BadLayersAreRefused) {
  const cv::Mat good = cv::Mat::ones(4, 6, CV_32SC1);
  expectRefused({}, "no mask layer");
  expectRefused({cv::Mat()}, "no mask layer");
  expectRefused({good, cv::Mat::ones(6, 4, CV_32SC1)}, "layer 1 is 4x6");
  expectRefused({good, cv::Mat::ones(4, 6, CV_8UC1)}, "CV_32SC1");
  expectRefused({cv::Mat::ones(4, 6, CV_32SC2)}, "CV_32SC1");
  expectRefused({cv::Mat::zeros(4, 6, CV_32SC1)}, "no mask");
  cv::Mat negative = good.clone();
  negative.at<int>(2, 3) = -5;
  expectRefused({good, negative}, "negative id -5 at pixel [3, 2]");
}

TEST(Masks, BinaryMasksShareALayerWhereTheyCan) {
  cv::Mat left = cv::Mat::zeros(4, 6, CV_8UC1), right = left.clone(), middle = left.clone();
  left.colRange(0, 3) = 255;
  right.colRange(3, 6) = 1;
  middle.colRange(2, 4) = 255;
  const cv::Mat empty = cv::Mat::zeros(4, 6, CV_8UC1);
  const Layers layers = lcr::layersFromBinaryMasks({left, empty, middle, right});
  ASSERT_EQ(layers.size(), 2U);
  EXPECT_EQ(layers[0].at<int>(0, 0), 1);
  EXPECT_EQ(layers[0].at<int>(0, 5), 4);
  EXPECT_EQ(layers[1].at<int>(0, 1), 0);
  EXPECT_EQ(layers[1].at<int>(0, 2), 3);
  EXPECT_TRUE(lcr::layersFromBinaryMasks({}).empty());
  EXPECT_TRUE(lcr::layersFromBinaryMasks({empty}).empty());
}

TEST(Masks, BadBinaryMasksAreRefused) {
  const cv::Mat good = cv::Mat::ones(4, 6, CV_8UC1);
  for (const cv::Mat& bad :
       {cv::Mat(cv::Mat::ones(4, 7, CV_8UC1)), cv::Mat(cv::Mat::ones(4, 6, CV_8UC3)), cv::Mat()}) {
    try {
      lcr::layersFromBinaryMasks({good, bad});
      FAIL();
    } catch (const lcr::Error& error) {
      EXPECT_EQ(error.cause(), lcr::ErrorCause::kMasks);
      EXPECT_NE(std::string(error.what()).find("binary mask 1"), std::string::npos) << error.what();
    }
  }
}

TEST(Masks, RealFrame) {
  const std::vector<cv::Mat> masks = realMasks("000000");
  if (masks.empty()) GTEST_SKIP() << "no kitti_00 in " << SHARED_DATA;
  const Layers layers = lcr::layersFromBinaryMasks(masks);
  EXPECT_LT(layers.size(), masks.size() / 2);
  const lcr::MaskSets sets = lcr::MaskSets::fromLayers(layers);
  ASSERT_EQ(sets.maskCount(), masks.size());  // none of them is empty, so mask i keeps its place
  for (int v = 0; v < sets.height(); ++v) {
    for (int u = 0; u < sets.width(); ++u) {
      std::set<std::uint32_t> expected;
      for (std::size_t i = 0; i < masks.size(); ++i) {
        if (masks[i].at<std::uint8_t>(v, u) != 0) expected.insert(static_cast<std::uint32_t>(i));
      }
      ASSERT_EQ(setAt(sets, v, u), expected) << v << " " << u;
    }
  }
}

TEST(Masks, RealFrameTakesMilliseconds) {
  const std::vector<cv::Mat> masks = realMasks("000000");
  if (masks.empty()) GTEST_SKIP() << "no kitti_00 in " << SHARED_DATA;
  Layers layers = lcr::layersFromBinaryMasks(masks);
  layers.resize(4, layers[0]);
  cv::TickMeter meter;
  std::vector<double> milliseconds;
  for (int i = 0; i < 9; ++i) {
    meter.reset();
    meter.start();
    lcr::MaskSets::fromLayers(layers);
    meter.stop();
    milliseconds.push_back(meter.getTimeMilli());
  }
  const double fastest = *std::min_element(milliseconds.begin(), milliseconds.end());
  RecordProperty("milliseconds", std::to_string(fastest));
  std::cout << "4 layers of " << layers[0].cols << "x" << layers[0].rows << ": " << fastest << " ms\n";
#if defined(__OPTIMIZE__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  EXPECT_LT(fastest, 50.0);  // generous, for loaded machines
#endif
}

TEST(MaskSets, EnterTheIdealImageLikeTheirLayers) {
  lcr::Intrinsics i;
  i.width = 160;
  i.height = 120;
  i.fx = i.fy = 90.0;
  i.cx = 79.5;
  i.cy = 59.5;
  i.model = lcr::DistortionModel::kPlumbBob;
  i.distortion = {-0.25, 0.05, 0.002, -0.001, 0.0};
  const lcr::Camera camera(i);
  Layers layers = randomLayers(3, 40, i.width, i.height, 8), ideal;
  layers[0].col(0).setTo(1000);  // not in the ideal image
  for (const cv::Mat& layer : layers) ideal.push_back(camera.toIdeal(layer, cv::INTER_NEAREST));
  ASSERT_EQ(cv::countNonZero(ideal[0] == 1000), 0);
  const lcr::MaskSets expected = lcr::MaskSets::fromLayers(ideal);
  const lcr::MaskSets sets = lcr::MaskSets::fromLayers(layers).toIdeal(camera);
  EXPECT_EQ(sets.maskCount(), expected.maskCount());
  EXPECT_EQ(cv::countNonZero(sets.setOfPixel() != expected.setOfPixel()), 0);
  EXPECT_EQ(sets.setBegin(), expected.setBegin());
  EXPECT_EQ(sets.setMasks(), expected.setMasks());
}
