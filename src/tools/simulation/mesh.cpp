#include "simulation/mesh.hpp"

#include <cmath>

namespace lidar_camera_recalibration::simulation {

using Eigen::Vector2f;
using Eigen::Vector3f;

namespace {

constexpr float kTurn = 6.28318530718F;

/// Two vectors that span the plane across an axis.
std::array<Vector3f, 2> across(const Vector3f& axis) {
  const Vector3f helper = std::abs(axis.z()) < 0.9F * axis.norm() ? Vector3f::UnitZ() : Vector3f::UnitX();
  const Vector3f first = axis.cross(helper).normalized();
  return {first, axis.cross(first).normalized()};
}

}  // namespace

std::uint32_t MeshBuilder::vertex(const Vector3f& local, const Vector2f& texture) {
  mesh_.vertices.push_back(T_mesh_local_ * local);
  mesh_.texture.push_back(texture);
  return static_cast<std::uint32_t>(mesh_.vertices.size() - 1);
}

void MeshBuilder::quadWithTexture(const std::array<Vector3f, 4>& corners,
                                  const std::array<Vector2f, 4>& texture, std::uint32_t part) {
  std::array<std::uint32_t, 4> index;
  for (int i = 0; i < 4; ++i) index[i] = vertex(corners[i], texture[i]);
  mesh_.triangles.push_back({index[0], index[1], index[2]});
  mesh_.triangles.push_back({index[0], index[2], index[3]});
  mesh_.parts.insert(mesh_.parts.end(), 2, part);
}

void MeshBuilder::quad(const Vector3f& a, const Vector3f& b, const Vector3f& c, const Vector3f& d,
                       std::uint32_t part) {
  const std::array<Vector3f, 4> corners = {a, b, c, d};
  int main_axis = 0;
  (c - a).cross(d - b).cwiseAbs().maxCoeff(&main_axis);
  const int u = main_axis == 0 ? 1 : 0;
  const int v = main_axis == 2 ? 1 : 2;
  std::array<Vector2f, 4> texture;
  for (int i = 0; i < 4; ++i) texture[i] = {corners[i][u], corners[i][v]};
  quadWithTexture(corners, texture, part);
}

void MeshBuilder::pane(const Vector3f& a, const Vector3f& b, const Vector3f& c, const Vector3f& d,
                       std::uint32_t part) {
  quadWithTexture({a, b, c, d}, {Vector2f(0, 0), Vector2f(1, 0), Vector2f(1, 1), Vector2f(0, 1)}, part);
}

void MeshBuilder::triangle(const Vector3f& a, const Vector3f& b, const Vector3f& c, std::uint32_t part,
                           const Vector2f& texture) {
  mesh_.triangles.push_back({vertex(a, texture), vertex(b, texture), vertex(c, texture)});
  mesh_.parts.push_back(part);
}

void MeshBuilder::box(const Vector3f& low, const Vector3f& high, std::uint32_t part) {
  const auto corner = [&](int x, int y, int z) {
    return Vector3f(x ? high.x() : low.x(), y ? high.y() : low.y(), z ? high.z() : low.z());
  };
  quad(corner(0, 0, 0), corner(1, 0, 0), corner(1, 0, 1), corner(0, 0, 1), part);
  quad(corner(1, 1, 0), corner(0, 1, 0), corner(0, 1, 1), corner(1, 1, 1), part);
  quad(corner(0, 1, 0), corner(0, 0, 0), corner(0, 0, 1), corner(0, 1, 1), part);
  quad(corner(1, 0, 0), corner(1, 1, 0), corner(1, 1, 1), corner(1, 0, 1), part);
  quad(corner(0, 0, 1), corner(1, 0, 1), corner(1, 1, 1), corner(0, 1, 1), part);
  quad(corner(0, 1, 0), corner(1, 1, 0), corner(1, 0, 0), corner(0, 0, 0), part);
}

void MeshBuilder::cylinder(const Vector3f& from, const Vector3f& to, float radius_from, float radius_to,
                           int sides, std::uint32_t part) {
  const auto [e1, e2] = across((to - from).normalized());
  const auto rim = [&, e1 = e1, e2 = e2](const Vector3f& centre, float radius, int i) -> Vector3f {
    const float angle = kTurn * static_cast<float>(i) / static_cast<float>(sides);
    return centre + radius * (std::cos(angle) * e1 + std::sin(angle) * e2);
  };
  for (int i = 0; i < sides; ++i) {
    quad(rim(from, radius_from, i), rim(from, radius_from, i + 1), rim(to, radius_to, i + 1),
         rim(to, radius_to, i), part);
    triangle(from, rim(from, radius_from, i), rim(from, radius_from, i + 1), part, Vector2f::Zero());
    triangle(to, rim(to, radius_to, i), rim(to, radius_to, i + 1), part, Vector2f::Zero());
  }
}

void MeshBuilder::ellipsoid(const Vector3f& centre, const Vector3f& radii, std::uint32_t part) {
  constexpr int kRings = 7, kSides = 10;
  const auto point = [&](int ring, int side) -> Vector3f {
    const float polar = 0.5F * kTurn * static_cast<float>(ring) / kRings;
    const float angle = kTurn * static_cast<float>(side) / kSides;
    const Vector3f unit(std::sin(polar) * std::cos(angle), std::sin(polar) * std::sin(angle),
                        std::cos(polar));
    return centre + radii.cwiseProduct(unit);
  };
  for (int ring = 0; ring < kRings; ++ring) {
    for (int side = 0; side < kSides; ++side) {
      quad(point(ring, side), point(ring, side + 1), point(ring + 1, side + 1), point(ring + 1, side), part);
    }
  }
}

void MeshBuilder::disc(const Vector3f& centre, const Vector3f& axis, float radius, int sides,
                       std::uint32_t part) {
  const auto [e1, e2] = across(axis.normalized());
  const std::uint32_t middle = vertex(centre, Vector2f::Zero());
  const std::uint32_t first = middle + 1;
  for (int i = 0; i < sides; ++i) {
    const float angle = kTurn * static_cast<float>(i) / static_cast<float>(sides);
    vertex(centre + radius * (std::cos(angle) * e1 + std::sin(angle) * e2),
           {std::cos(angle), std::sin(angle)});
  }
  for (int i = 0; i < sides; ++i) {
    mesh_.triangles.push_back(
        {middle, first + static_cast<std::uint32_t>(i), first + static_cast<std::uint32_t>((i + 1) % sides)});
    mesh_.parts.push_back(part);
  }
}

void MeshBuilder::framedPane(const std::array<Vector3f, 4>& corners, float margin_side, float margin_low,
                             float margin_high, std::uint32_t frame, std::uint32_t inside) {
  const auto at = [&](float u, float v) -> Vector3f {
    return (1 - v) * ((1 - u) * corners[0] + u * corners[1]) + v * ((1 - u) * corners[3] + u * corners[2]);
  };
  const float left = margin_side, right = 1 - margin_side, low = margin_low, high = 1 - margin_high;
  quad(at(0, 0), at(1, 0), at(1, low), at(0, low), frame);
  quad(at(0, high), at(1, high), at(1, 1), at(0, 1), frame);
  quad(at(0, low), at(left, low), at(left, high), at(0, high), frame);
  quad(at(right, low), at(1, low), at(1, high), at(right, high), frame);
  pane(at(left, low), at(right, low), at(right, high), at(left, high), inside);
}

}  // namespace lidar_camera_recalibration::simulation
