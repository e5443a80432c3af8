// The cost of one frame: makeFrame, and its stages one by one.

#include <climits>
#include <map>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <tuple>

#include "boundary_field.hpp"
#include "floor.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_edges.hpp"
#include "mask_borders.hpp"
#include "measurements.hpp"

namespace lidar_camera_recalibration::performance {
namespace {

/// A frame and what each stage of makeFrame starts from.
struct Stages {
  std::shared_ptr<FrameStore> store;
  std::string source_name;
  RawFrame raw;
  FrameConfig config;
  Points points;       ///< of the whole cloud
  PointCloud cropped;  ///< with rings
  LidarFeatures features;
  std::vector<Eigen::Vector3f> off_planes;  ///< points that belong to no plane
  std::vector<std::uint8_t> visible;
  std::vector<cv::Mat> ideal_layers;
  cv::Mat ideal_image;
  MaskSets masks;
  std::vector<Border> borders;

  const Source& source() const { return store->source(source_name); }
  const Camera& camera() const { return source().camera(); }
  const Eigen::Isometry3d& guess() const { return source().T_camera_lidar(); }
};

cv::Mat ideal(const Camera& camera, const cv::Mat& image, int interpolation) {
  return camera.distorted() ? camera.toIdeal(image, interpolation) : image;
}

/// The points that makeFrame keeps, in the order of the cloud, with their rings: the frame itself has no
/// rings.
PointCloud croppedCloud(const Stages& s) {
  FrameConfig all = s.config;
  all.cull_hidden = false;
  const FramePtr frame = prepare(s.source(), s.raw, s.guess(), all);
  std::map<std::tuple<float, float, float>, std::size_t> index;
  for (std::size_t i = 0; i < s.raw.cloud.size(); ++i) {
    const Eigen::Vector3f& p = s.raw.cloud.points[i];
    index[{p.x(), p.y(), p.z()}] = i;
  }
  std::vector<bool> kept(s.raw.cloud.size(), false);
  for (std::size_t i = 0; i < frame->points.size(); ++i) {
    kept[index.at({frame->points.x[i], frame->points.y[i], frame->points.z[i]})] = true;
  }
  const std::vector<std::uint16_t> rings = ringsOf(s.raw.cloud);
  PointCloud cropped;
  for (std::size_t i = 0; i < kept.size(); ++i) {
    if (!kept[i]) continue;
    cropped.points.push_back(s.raw.cloud.points[i]);
    if (s.raw.cloud.hasReflectivity()) cropped.reflectivity.push_back(s.raw.cloud.reflectivity[i]);
    if (!rings.empty()) cropped.ring.push_back(rings[i]);
  }
  return cropped;
}

std::shared_ptr<const Stages> runStages(const std::shared_ptr<FrameStore>& store, const std::string& source) {
  auto s = std::make_shared<Stages>();
  s->store = store;
  s->source_name = source;
  s->raw = s->source().frame(0);
  for (const Eigen::Vector3f& p : s->raw.cloud.points) s->points.add(p.x(), p.y(), p.z());
  s->cropped = croppedCloud(*s);
  s->features = computeLidarFeatures(s->cropped, s->config.features);
  for (std::size_t i = 0; i < s->cropped.size(); ++i) {
    if (s->features.segment[i] < 0 || s->features.segment[i] >= s->features.plane_count) {
      s->off_planes.push_back(s->cropped.points[i]);
    }
  }
  s->visible = visiblePoints(s->cropped.points, s->guess());
  for (const cv::Mat& layer : s->raw.layers) {
    s->ideal_layers.push_back(ideal(s->camera(), layer, cv::INTER_NEAREST));
  }
  s->ideal_image = ideal(s->camera(), s->raw.image, cv::INTER_LINEAR);
  s->masks = MaskSets::fromLayers(s->ideal_layers);
  s->borders = maskBorders(s->masks.setOfPixel(), s->ideal_image);
  return s;
}

using Stage = std::function<double(const Stages&)>;  // returns something of the result

/// makeFrame cannot be stopped after its crop, but it stops by itself when too few points are left. A camera
/// with the same view and hardly any pixels makes all else cost nothing.
double crop(const Stages& s) {
  constexpr int kShrink = 16;
  Intrinsics small = s.camera().intrinsics();
  small.width /= kShrink;
  small.height /= kShrink;
  for (double* value : {&small.fx, &small.fy, &small.cx, &small.cy}) *value /= kShrink;
  small.model = DistortionModel::kNone;
  small.distortion.clear();
  FrameConfig config = s.config;
  config.min_points = INT_MAX;
  config.min_masks = 1;
  try {
    makeFrame(0.0, Camera(small), {}, {cv::Mat::ones(small.height, small.width, CV_32SC1)}, s.raw.cloud,
              s.guess(), config);
  } catch (const Error& error) {
    if (error.cause() == ErrorCause::kNotEnough) return 1.0;
    throw;
  }
  throw std::logic_error("makeFrame did not stop at its crop");
}

/// Clusters without planes, on the points that belong to none.
double clusters(const Stages& s) {
  LidarFeatureConfig config = s.config.features;
  config.plane_max_count = 0;
  LidarFeatures features;
  features.normals.resize(s.off_planes.size(), Eigen::Vector3f::UnitZ());  // not used without planes
  segment(s.off_planes, config, features);
  return features.segment_count;
}

/// Bytes of points, reflectivity and rings.
double bytes(const PointCloud& cloud) {
  return static_cast<double>(cloud.points.size() * sizeof(Eigen::Vector3f) +
                             cloud.reflectivity.size() * sizeof(float) +
                             cloud.ring.size() * sizeof(std::uint16_t));
}

double bytes(const cv::Mat& image) { return static_cast<double>(image.total() * image.elemSize()); }

double bytes(const std::vector<cv::Mat>& images) {
  double sum = 0.0;
  for (const cv::Mat& image : images) sum += bytes(image);
  return sum;
}

/// Name, the stage itself, and the bytes that it has to read.
struct NamedStage {
  const char* name;
  Stage run;
  Stage input_bytes;
};

const std::vector<NamedStage>& stageList() {
  const auto cloud = [](const Stages& s) { return bytes(s.cropped); };
  static const std::vector<NamedStage> stages = {
      {"projection",
       [](const Stages& s) {
         return static_cast<double>(projectAll(s.points, s.camera().intrinsics(), s.guess()));
       },
       [](const Stages& s) { return static_cast<double>(3 * s.points.size() * sizeof(float)); }},
      {"rings", [](const Stages& s) { return static_cast<double>(ringsOf(s.raw.cloud).size()); },
       [](const Stages& s) { return bytes(s.raw.cloud); }},
      {"crop", crop, [](const Stages& s) { return bytes(s.raw.cloud); }},
      {"normals",
       [](const Stages& s) {
         return static_cast<double>(
             estimateNormals(s.cropped.points, s.config.features.normal_neighbours).size());
       },
       cloud},
      {"segments",
       [](const Stages& s) {
         LidarFeatures features;
         features.normals = s.features.normals;
         segment(s.cropped.points, s.config.features, features);
         return static_cast<double>(features.segment_count);
       },
       cloud},
      {"clusters", clusters, cloud},
      {"reflectivity",
       [](const Stages& s) {
         return static_cast<double>(
             normaliseReflectivity(s.cropped.reflectivity, s.config.features.reflectivity_quantile).size());
       },
       [](const Stages& s) { return static_cast<double>(s.cropped.reflectivity.size() * sizeof(float)); }},
      {"visibility",
       [](const Stages& s) { return static_cast<double>(visiblePoints(s.cropped.points, s.guess()).size()); },
       cloud},
      {"edges",
       [](const Stages& s) {
         return static_cast<double>(findLidarEdges(s.cropped, s.features, s.visible).size());
       },
       cloud},
      {"undistort",
       [](const Stages& s) {
         double sum = ideal(s.camera(), s.raw.image, cv::INTER_LINEAR).cols;
         for (const cv::Mat& layer : s.raw.layers) sum += ideal(s.camera(), layer, cv::INTER_NEAREST).cols;
         return sum;
       },
       [](const Stages& s) { return bytes(s.raw.image) + bytes(s.raw.layers); }},
      {"label_sets",
       [](const Stages& s) { return static_cast<double>(MaskSets::fromLayers(s.ideal_layers).setCount()); },
       [](const Stages& s) { return bytes(s.raw.layers); }},
      {"mask_borders",
       [](const Stages& s) {
         return static_cast<double>(maskBorders(s.masks.setOfPixel(), s.ideal_image).size());
       },
       [](const Stages& s) { return bytes(s.masks.setOfPixel()) + bytes(s.ideal_image); }},
      {"boundary_field",
       [](const Stages& s) {
         const BoundaryField field(s.borders, s.masks.setOfPixel().size(), s.camera().intrinsics().fx);
         return static_cast<double>(field.bytes());
       },
       [](const Stages& s) { return bytes(s.masks.setOfPixel()); }}};
  return stages;
}

void addSizes(const RawFrame& raw, const Frame& frame, Counters& counters) {
  counters["cloud"] = static_cast<double>(raw.cloud.size());
  counters["points"] = static_cast<double>(frame.points.size());
  counters["edges"] = static_cast<double>(frame.edges.size());
  counters["masks"] = static_cast<double>(frame.masks.maskCount());
  counters["width"] = raw.image.cols;
  counters["height"] = raw.image.rows;
  counters["memory_use"] = static_cast<double>(memoryUse(frame));
}

}  // namespace

void addPreparation(Measurements& measurements, const std::shared_ptr<FrameStore>& store,
                    const std::string& source, bool stages) {
  measurements.add("preparation/" + source + "/makeFrame", [=](Counters&) -> Work {
    const auto raw = std::make_shared<const RawFrame>(store->source(source).frame(0));
    return [=](Counters& result) {
      const Source& from = store->source(source);
      const FramePtr frame = prepare(from, *raw, from.T_camera_lidar());
      addSizes(*raw, *frame, result);
    };
  });
  if (!stages) return;
  const auto shared = std::make_shared<std::shared_ptr<const Stages>>();
  for (const NamedStage& stage : stageList()) {
    measurements.add("preparation/" + source + "/" + stage.name, [=](Counters& counters) -> Work {
      if (!*shared) *shared = runStages(store, source);
      counters["cloud"] = static_cast<double>((*shared)->raw.cloud.size());
      counters["cropped"] = static_cast<double>((*shared)->cropped.size());
      counters["input_bytes"] = stage.input_bytes(**shared);
      return [=](Counters& result) { result["result"] = stage.run(**shared); };
    });
  }
}

}  // namespace lidar_camera_recalibration::performance
