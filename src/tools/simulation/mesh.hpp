#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

namespace lidar_camera_recalibration::simulation {

enum class PartKind : std::uint8_t {
  kSky,
  kRoad,
  kLaneMarking,
  kKerb,
  kPavement,
  kGrass,
  kFacade,
  kSideWall,
  kRoof,
  kWindow,
  kDoor,
  kBalcony,
  kBody,
  kCarWindow,
  kWheel,
  kLight,
  kPlate,
  kTrunk,
  kCrown,
  kPole,
  kSignFace,
  kPerson,
  kBin,
  kFence
};

enum class Texture : std::uint8_t {
  kPlain,
  kAsphalt,
  kPaving,
  kGrass,
  kPlaster,
  kBrick,
  kTiles,
  kWood,
  kWindow,
  kPaint,
  kWheel,
  kBark,
  kLeaves,
  kSignDisc,
  kSignBoard
};

/// A surface that looks like one piece: one pane, one crown, one lane dash. Its index is the exact mask.
struct Part {
  PartKind kind = PartKind::kSky;
  int object = 0;  ///< parts of one thing (car, house, tree) share it; 0: a thing of its own
  Eigen::Vector3f color = Eigen::Vector3f::Zero();  ///< linear RGB albedo, 0..1
  float reflectivity = 0.0F;                        ///< diffuse, at the LiDAR's wavelength, 0..1
  Texture texture = Texture::kPlain;
  bool glass = false;
  bool retro_reflective = false;
};

/// Triangles, each of one part, with texture coordinates [m].
struct Mesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Eigen::Vector2f> texture;  ///< per vertex
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<std::uint32_t> parts;  ///< per triangle
};

/// Adds simple shapes to a mesh. Shapes are given in a local frame [m], x right along a front, z up.
class MeshBuilder {
 public:
  MeshBuilder(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local) : mesh_(mesh), T_mesh_local_(T_mesh_local) {}

  /// Corners in order around the edge. Texture coordinates are the local coordinates along the face, so that
  /// neighbours continue.
  void quad(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c,
            const Eigen::Vector3f& d, std::uint32_t part);
  /// The same with texture coordinates 0..1 from a to c.
  void pane(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c,
            const Eigen::Vector3f& d, std::uint32_t part);
  void triangle(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c,
                std::uint32_t part, const Eigen::Vector2f& texture);
  void box(const Eigen::Vector3f& low, const Eigen::Vector3f& high, std::uint32_t part);
  /// Cone frustum with both ends closed.
  void cylinder(const Eigen::Vector3f& from, const Eigen::Vector3f& to, float radius_from, float radius_to,
                int sides, std::uint32_t part);
  void ellipsoid(const Eigen::Vector3f& centre, const Eigen::Vector3f& radii, std::uint32_t part);
  /// Flat, with texture coordinates from the centre, 1 at the rim.
  void disc(const Eigen::Vector3f& centre, const Eigen::Vector3f& axis, float radius, int sides,
            std::uint32_t part);
  /// A quad of `frame` with a smaller quad of `inside` cut into it, flush; margins are shares of the side
  /// lengths.
  void framedPane(const std::array<Eigen::Vector3f, 4>& corners, float margin_side, float margin_low,
                  float margin_high, std::uint32_t frame, std::uint32_t inside);

 private:
  std::uint32_t vertex(const Eigen::Vector3f& local, const Eigen::Vector2f& texture);
  void quadWithTexture(const std::array<Eigen::Vector3f, 4>& corners,
                       const std::array<Eigen::Vector2f, 4>& texture, std::uint32_t part);

  Mesh& mesh_;
  Eigen::Isometry3f T_mesh_local_;
};

}  // namespace lidar_camera_recalibration::simulation
