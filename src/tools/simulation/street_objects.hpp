#pragma once

#include "simulation/mesh.hpp"
#include "simulation/random.hpp"
#include "simulation/scene.hpp"

namespace lidar_camera_recalibration::simulation {

/// Builds single things into a mesh, each with new parts and random looks. All stand on z = 0 of their own
/// frame.
class ObjectFactory {
 public:
  ObjectFactory(std::vector<Part>& parts, Random& random) : parts_(parts), random_(random) {}

  /// x along the front (0 ... width), y into the house, z up. The front varies in depth by bays, balconies
  /// and recessed windows.
  void house(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local, float width, float depth);
  /// x forward, origin below its middle.
  void car(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local);
  void van(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local);
  void tree(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local);
  void bush(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local, float length);
  void lamp(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local);  ///< the arm reaches towards -y
  void sign(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local);  ///< faces -x
  void person(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local);
  void bin(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local);
  void bollard(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local);
  void fence(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local, float length);

  std::uint32_t addPart(PartKind kind, int object, const Eigen::Vector3f& color, float reflectivity,
                        Texture texture = Texture::kPlain);

 private:
  struct FrontStyle;
  struct CarShape;
  int newObject() { return ++last_object_; }
  float between(double from, double to) { return static_cast<float>(random_.uniform(from, to)); }
  Eigen::Vector3f varied(const Eigen::Vector3f& color, float spread);
  Eigen::Vector3f paintColor();
  std::uint32_t addGlass(PartKind kind, int object);
  void leaves(MeshBuilder& builder, const Eigen::Vector3f& centre, const Eigen::Vector3f& radii, int count,
              float size, std::uint32_t part);
  void wheels(MeshBuilder& builder, int object, float half_base, float half_width, float radius);
  void carEnds(MeshBuilder& builder, int object, float half_length, float half_width, float height);
  void frontCell(MeshBuilder& builder, const FrontStyle& style, const Eigen::Vector4f& cell, bool door,
                 bool shop);
  FrontStyle frontStyle(float width);
  void upperFloors(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local, const FrontStyle& style, float x0,
                   float x1, float reach);
  void carBody(MeshBuilder& builder, const CarShape& shape);
  void carCabin(MeshBuilder& builder, const CarShape& shape);
  void balcony(MeshBuilder& builder, const FrontStyle& style, float x0, float x1, float z);
  void roof(MeshBuilder& builder, int object, float width, float depth, float height,
            std::uint32_t side_wall);

  std::vector<Part>& parts_;
  Random& random_;
  int last_object_ = 0;
};

}  // namespace lidar_camera_recalibration::simulation
