#include "simulation/street_objects.hpp"

#include <algorithm>
#include <cmath>

namespace lidar_camera_recalibration::simulation {

using Eigen::Vector2f;
using Eigen::Vector3f;
using Eigen::Vector4f;

std::uint32_t ObjectFactory::addPart(PartKind kind, int object, const Vector3f& color, float reflectivity,
                                     Texture texture) {
  Part part;
  part.kind = kind;
  part.object = object;
  part.color = color;
  part.reflectivity = reflectivity;
  part.texture = texture;
  parts_.push_back(part);
  return static_cast<std::uint32_t>(parts_.size() - 1);
}

std::uint32_t ObjectFactory::addGlass(PartKind kind, int object) {
  const Texture texture = kind == PartKind::kWindow ? Texture::kWindow : Texture::kPlain;
  const std::uint32_t part = addPart(kind, object, varied({0.03F, 0.035F, 0.04F}, 0.3F), 0.08F, texture);
  parts_[part].glass = true;
  return part;
}

Vector3f ObjectFactory::varied(const Vector3f& color, float spread) {
  const float brightness = between(1 - spread, 1 + spread);
  Vector3f result;
  for (int i = 0; i < 3; ++i)
    result[i] = std::clamp(color[i] * brightness * between(1 - spread / 3, 1 + spread / 3), 0.01F, 0.9F);
  return result;
}

Vector3f ObjectFactory::paintColor() {
  static const std::array<Vector3f, 8> kPaints = {
      Vector3f(0.65F, 0.65F, 0.66F), Vector3f(0.02F, 0.02F, 0.025F), Vector3f(0.30F, 0.31F, 0.33F),
      Vector3f(0.10F, 0.11F, 0.12F), Vector3f(0.40F, 0.02F, 0.02F),  Vector3f(0.02F, 0.06F, 0.25F),
      Vector3f(0.03F, 0.14F, 0.10F), Vector3f(0.50F, 0.38F, 0.10F)};
  return varied(kPaints[static_cast<std::size_t>(random_.integer(0, 7))], 0.15F);
}

// --- vegetation ---

void ObjectFactory::leaves(MeshBuilder& builder, const Vector3f& centre, const Vector3f& radii, int count,
                           float size, std::uint32_t part) {
  const auto direction = [&] {
    const Vector3f v(static_cast<float>(random_.gaussian(1)), static_cast<float>(random_.gaussian(1)),
                     static_cast<float>(random_.gaussian(1)));
    return Vector3f(v / std::max(v.norm(), 1e-3F));
  };
  for (int i = 0; i < count; ++i) {
    // More leaves outside than inside, as light has it.
    const Vector3f middle = centre + std::pow(between(0.05, 1), 0.4F) * radii.cwiseProduct(direction());
    const Vector3f u = direction() * size * between(0.6, 1.3);
    const Vector3f v = direction().cross(u.normalized()) * size * between(0.6, 1.3);
    builder.triangle(middle - u, middle + 0.5F * u + v, middle + 0.5F * u - v, part,
                     {between(0, 1), between(0, 1)});
  }
}

void ObjectFactory::tree(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local) {
  MeshBuilder builder(mesh, T_mesh_local);
  const int object = newObject();
  const std::uint32_t trunk =
      addPart(PartKind::kTrunk, object, varied({0.10F, 0.075F, 0.05F}, 0.3F), 0.3F, Texture::kBark);
  const std::uint32_t crown =
      addPart(PartKind::kCrown, object, varied({0.07F, 0.14F, 0.03F}, 0.35F), 0.45F, Texture::kLeaves);
  const float fork = between(2.2, 3.2), radius = between(0.10, 0.22);
  builder.cylinder({0, 0, -0.1F}, {0, 0, fork}, radius * 1.2F, radius * 0.8F, 10, trunk);
  const int clumps = random_.integer(5, 8);
  const float spread = between(0.9, 1.6);
  for (int i = 0; i < clumps; ++i) {
    const float angle = 6.2832F * (static_cast<float>(i) + between(0, 0.7)) / static_cast<float>(clumps);
    const Vector3f centre(spread * std::cos(angle) * between(0.5, 1),
                          spread * std::sin(angle) * between(0.5, 1), fork + between(0.6, 2.4));
    builder.cylinder({0, 0, fork - 0.1F}, centre, radius * 0.6F, 0.03F, 6, trunk);
    leaves(builder, centre, {between(0.7, 1.1), between(0.7, 1.1), between(0.6, 1.0)}, 420, 0.11F, crown);
  }
}

void ObjectFactory::bush(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local, float length) {
  MeshBuilder builder(mesh, T_mesh_local);
  const std::uint32_t part =
      addPart(PartKind::kCrown, 0, varied({0.05F, 0.11F, 0.03F}, 0.3F), 0.4F, Texture::kLeaves);
  const float height = between(0.5, 1.3);
  for (float x = 0.4F; x < length; x += 0.6F) {
    leaves(builder, {x, 0, 0.5F * height}, {0.5F, 0.4F, 0.5F * height}, 260, 0.07F, part);
  }
}

// --- street furniture and people ---

void ObjectFactory::lamp(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local) {
  MeshBuilder builder(mesh, T_mesh_local);
  const std::uint32_t metal = addPart(PartKind::kPole, 0, varied({0.2F, 0.22F, 0.21F}, 0.3F), 0.3F);
  const float height = between(5.5, 7.5), reach = between(0.8, 1.6);
  builder.cylinder({0, 0, -0.1F}, {0, 0, 1.2F}, 0.10F, 0.09F, 10, metal);
  builder.cylinder({0, 0, 1.2F}, {0, 0, height}, 0.065F, 0.05F, 10, metal);
  builder.cylinder({0, 0, height}, {0, -reach, height + 0.25F}, 0.04F, 0.04F, 8, metal);
  builder.box({-0.13F, -reach - 0.6F, height + 0.18F}, {0.13F, -reach, height + 0.32F}, metal);
}

void ObjectFactory::sign(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local) {
  MeshBuilder builder(mesh, T_mesh_local);
  const int object = newObject();
  const std::uint32_t pole = addPart(PartKind::kPole, object, {0.35F, 0.36F, 0.37F}, 0.35F);
  const bool board = random_.chance(0.35);
  static const std::array<Vector3f, 3> kColors = {
      Vector3f(0.55F, 0.02F, 0.02F), Vector3f(0.01F, 0.08F, 0.45F), Vector3f(0.75F, 0.60F, 0.03F)};
  const Vector3f color = kColors[static_cast<std::size_t>(random_.integer(0, board ? 2 : 1))];
  const std::uint32_t face =
      addPart(PartKind::kSignFace, object, color, 0.9F, board ? Texture::kSignBoard : Texture::kSignDisc);
  parts_[face].retro_reflective = true;
  const float height = between(2.3, 3.0);
  builder.cylinder({0, 0, -0.1F}, {0, 0, height}, 0.038F, 0.038F, 8, pole);
  const float front = -0.06F, back = -0.045F;
  if (board) {
    const float w = between(0.3, 0.6), h = between(0.25, 0.45), z = height - h;
    builder.pane({front, w, z - h}, {front, -w, z - h}, {front, -w, z + h}, {front, w, z + h}, face);
    builder.box({front + 0.005F, -w, z - h}, {back, w, z + h}, pole);
  } else {
    const float radius = between(0.3, 0.42), z = height - radius;
    builder.disc({front, 0, z}, {-1, 0, 0}, radius, 20, face);
    builder.cylinder({front + 0.005F, 0, z}, {back, 0, z}, radius, radius, 20, pole);
  }
}

void ObjectFactory::person(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local) {
  MeshBuilder builder(mesh, T_mesh_local);
  const int object = newObject();
  const float s = between(0.9, 1.06);  // 1 stands for 1.75 m
  const std::uint32_t legs =
      addPart(PartKind::kPerson, object, varied({0.06F, 0.07F, 0.12F}, 0.6F), between(0.2, 0.5));
  const std::uint32_t torso = addPart(PartKind::kPerson, object, paintColor(), between(0.2, 0.6));
  const std::uint32_t head = addPart(PartKind::kPerson, object, varied({0.42F, 0.27F, 0.2F}, 0.4F), 0.4F);
  const float step = between(0.05, 0.25);
  builder.cylinder(s * Vector3f(step, 0.1F, 0), s * Vector3f(0, 0.1F, 0.85F), 0.07F * s, 0.1F * s, 8, legs);
  builder.cylinder(s * Vector3f(-step, -0.1F, 0), s * Vector3f(0, -0.1F, 0.85F), 0.07F * s, 0.1F * s, 8,
                   legs);
  builder.ellipsoid(s * Vector3f(0, 0, 1.15F), s * Vector3f(0.15F, 0.22F, 0.38F), torso);
  builder.cylinder(s * Vector3f(0, 0.24F, 1.4F), s * Vector3f(step, 0.28F, 0.85F), 0.06F * s, 0.045F * s, 6,
                   torso);
  builder.cylinder(s * Vector3f(0, -0.24F, 1.4F), s * Vector3f(-step, -0.28F, 0.85F), 0.06F * s, 0.045F * s,
                   6, torso);
  builder.ellipsoid(s * Vector3f(0, 0, 1.62F), s * Vector3f(0.1F, 0.085F, 0.13F), head);
}

void ObjectFactory::bin(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local) {
  MeshBuilder builder(mesh, T_mesh_local);
  const std::uint32_t part =
      addPart(PartKind::kBin, 0, varied({0.05F, 0.1F, 0.06F}, 0.7F), between(0.1, 0.5));
  const float height = between(0.9, 1.2);
  builder.box({-0.28F, -0.28F, 0.05F}, {0.28F, 0.28F, height}, part);
  builder.box({-0.33F, -0.31F, height}, {0.31F, 0.31F, height + 0.07F}, part);
}

void ObjectFactory::bollard(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local) {
  MeshBuilder builder(mesh, T_mesh_local);
  const int object = newObject();
  const std::uint32_t post = addPart(PartKind::kPole, object, varied({0.3F, 0.3F, 0.3F}, 0.5F), 0.3F);
  const std::uint32_t band = addPart(PartKind::kSignFace, object, {0.7F, 0.7F, 0.72F}, 0.9F);
  parts_[band].retro_reflective = true;
  builder.cylinder({0, 0, -0.05F}, {0, 0, 0.95F}, 0.06F, 0.06F, 10, post);
  builder.cylinder({0, 0, 0.75F}, {0, 0, 0.85F}, 0.064F, 0.064F, 10, band);
}

void ObjectFactory::fence(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local, float length) {
  MeshBuilder builder(mesh, T_mesh_local);
  const bool wall = random_.chance(0.5);
  const std::uint32_t part =
      wall ? addPart(PartKind::kFence, 0, varied({0.36F, 0.33F, 0.28F}, 0.3F), 0.35F, Texture::kBrick)
           : addPart(PartKind::kFence, 0, varied({0.16F, 0.10F, 0.06F}, 0.5F), 0.3F, Texture::kWood);
  if (wall) {
    builder.box({0, -0.12F, -0.1F}, {length, 0.12F, between(0.7, 1.4)}, part);
    return;
  }
  const float height = between(0.9, 1.4);
  for (float x = 0; x < length; x += 0.22F)
    builder.box({x, -0.012F, 0.08F}, {x + 0.12F, 0.012F, height}, part);
  for (const float z : {0.25F, height - 0.2F}) builder.box({0, 0.013F, z}, {length, 0.06F, z + 0.07F}, part);
}

// --- vehicles ---

void ObjectFactory::wheels(MeshBuilder& builder, int object, float half_base, float half_width,
                           float radius) {
  for (const float x : {-half_base, half_base}) {
    for (const float side : {-1.0F, 1.0F}) {
      const std::uint32_t wheel =
          addPart(PartKind::kWheel, object, {0.02F, 0.02F, 0.02F}, 0.06F, Texture::kWheel);
      const float outside = side * (half_width + 0.02F);
      builder.cylinder({x, outside - side * 0.22F, radius}, {x, outside - side * 0.004F, radius}, radius,
                       radius, 18, wheel);
      builder.disc({x, outside, radius}, {0, side, 0}, radius, 18, wheel);
    }
  }
}

/// Lamps and number plates at both ends of a vehicle.
void ObjectFactory::carEnds(MeshBuilder& builder, int object, float half_length, float half_width,
                            float height) {
  for (const float end : {-1.0F, 1.0F}) {
    const float x = end * (half_length + 0.012F);
    const Vector3f lamp_color = end > 0 ? Vector3f(0.7F, 0.7F, 0.68F) : Vector3f(0.35F, 0.01F, 0.01F);
    for (const float side : {-1.0F, 1.0F}) {
      const std::uint32_t lamp = addPart(PartKind::kLight, object, lamp_color, 0.6F, Texture::kPaint);
      parts_[lamp].retro_reflective = end < 0;
      const float y0 = side * half_width * 0.55F, y1 = side * half_width * 0.92F;
      builder.pane({x, y0, height - 0.08F}, {x, y1, height - 0.08F}, {x, y1, height + 0.08F},
                   {x, y0, height + 0.08F}, lamp);
    }
    const std::uint32_t plate =
        addPart(PartKind::kPlate, object, {0.75F, 0.75F, 0.72F}, 0.9F, Texture::kSignBoard);
    parts_[plate].retro_reflective = true;
    builder.pane({x, -0.26F, height - 0.28F}, {x, 0.26F, height - 0.28F}, {x, 0.26F, height - 0.17F},
                 {x, -0.26F, height - 0.17F}, plate);
  }
}

struct ObjectFactory::CarShape {
  int object;
  std::uint32_t body;
  float half_length, half_width, belt, top;  ///< belt: height of the lower edge of the windows [m]
  bool estate;
};

void ObjectFactory::carBody(MeshBuilder& builder, const CarShape& shape) {
  const float l = shape.half_length, w = shape.half_width, belt = shape.belt;
  // Outline of the upper edge of the body from the rear to the front: (x, z).
  const std::array<Vector2f, 6> outline = {
      Vector2f(-l, 0.72F * belt),        Vector2f(-l + 0.06F, shape.estate ? belt : 0.95F * belt),
      Vector2f(-0.45F * l, belt),        Vector2f(0.45F * l, belt),
      Vector2f(l - 0.18F, 0.80F * belt), Vector2f(l, 0.62F * belt)};
  const float low = 0.2F, waist = 0.5F;
  for (std::size_t i = 0; i + 1 < outline.size(); ++i) {
    const Vector2f p = outline[i], q = outline[i + 1];
    for (const float side : {-1.0F, 1.0F}) {
      builder.quad({p.x(), side * (w - 0.04F), low}, {q.x(), side * (w - 0.04F), low},
                   {q.x(), side * w, waist}, {p.x(), side * w, waist}, shape.body);
      builder.quad({p.x(), side * w, waist}, {q.x(), side * w, waist}, {q.x(), side * (w - 0.06F), q.y()},
                   {p.x(), side * (w - 0.06F), p.y()}, shape.body);
    }
    builder.quad({p.x(), -w + 0.06F, p.y()}, {q.x(), -w + 0.06F, q.y()}, {q.x(), w - 0.06F, q.y()},
                 {p.x(), w - 0.06F, p.y()}, shape.body);
  }
  for (const Vector2f& end : {outline.front(), outline.back()}) {
    builder.quad({end.x(), -w, low}, {end.x(), w, low}, {end.x(), w, end.y()}, {end.x(), -w, end.y()},
                 shape.body);
  }
  builder.quad({-l, -w, low}, {l, -w, low}, {l, w, low}, {-l, w, low}, shape.body);
}

/// A frustum with panes.
void ObjectFactory::carCabin(MeshBuilder& builder, const CarShape& shape) {
  const float l = shape.half_length, w = shape.half_width, top = shape.top;
  const float rear = shape.estate ? -l + 0.1F : -0.72F * l, front = 0.48F * l, base = shape.belt - 0.03F;
  const float roof_rear = shape.estate ? rear + 0.3F : rear + 0.55F, roof_front = front - between(0.6, 0.85);
  const float wb = w - 0.06F, wt = w - 0.24F, middle_base = 0.5F * (rear + front),
              middle_top = 0.5F * (roof_rear + roof_front);
  const auto pane = [&](const std::array<Vector3f, 4>& corners, float side, float low_margin,
                        float high_margin) {
    builder.framedPane(corners, side, low_margin, high_margin, shape.body,
                       addGlass(PartKind::kCarWindow, shape.object));
  };
  for (const float side : {-1.0F, 1.0F}) {
    pane({Vector3f(rear, side * wb, base), Vector3f(middle_base, side * wb, base),
          Vector3f(middle_top, side * wt, top), Vector3f(roof_rear, side * wt, top)},
         0.07F, 0.08F, 0.16F);
    pane({Vector3f(middle_base, side * wb, base), Vector3f(front, side * wb, base),
          Vector3f(roof_front, side * wt, top), Vector3f(middle_top, side * wt, top)},
         0.07F, 0.08F, 0.16F);
  }
  pane({Vector3f(front, -wb, base), Vector3f(front, wb, base), Vector3f(roof_front, wt, top),
        Vector3f(roof_front, -wt, top)},
       0.06F, 0.1F, 0.1F);
  pane({Vector3f(rear, -wb, base), Vector3f(rear, wb, base), Vector3f(roof_rear, wt, top),
        Vector3f(roof_rear, -wt, top)},
       0.1F, 0.15F, 0.15F);
  builder.quad({roof_rear, -wt, top}, {roof_front, -wt, top}, {roof_front, wt, top}, {roof_rear, wt, top},
               shape.body);
}

void ObjectFactory::car(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local) {
  MeshBuilder builder(mesh, T_mesh_local);
  const Vector3f color = paintColor();
  CarShape shape;
  shape.object = newObject();
  shape.body = addPart(PartKind::kBody, shape.object, color, 0.05F + 0.75F * color.mean(), Texture::kPaint);
  shape.half_length = between(1.9, 2.35);
  shape.half_width = between(0.84, 0.93);
  shape.belt = between(0.86, 1.0);
  shape.top = between(1.4, 1.62);
  shape.estate = random_.chance(0.5);
  carBody(builder, shape);
  carCabin(builder, shape);
  wheels(builder, shape.object, 0.62F * shape.half_length, shape.half_width, between(0.29, 0.34));
  carEnds(builder, shape.object, shape.half_length, shape.half_width, 0.55F * shape.belt + 0.02F);
}

void ObjectFactory::van(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local) {
  MeshBuilder builder(mesh, T_mesh_local);
  const int object = newObject();
  const Vector3f color = random_.chance(0.5) ? Vector3f(0.62F, 0.62F, 0.62F) : paintColor();
  const std::uint32_t body =
      addPart(PartKind::kBody, object, color, 0.05F + 0.75F * color.mean(), Texture::kPaint);
  const float l = between(2.4, 3.1), w = between(0.95, 1.02), top = between(1.95, 2.6), low = 0.25F;
  const float nose = 1.05F, cab = l - 1.0F, screen_top = l - 1.0F;
  builder.box({-l, -w, low}, {cab - 0.9F, w, top}, body);
  for (const float side : {-1.0F, 1.0F}) {
    const float y = side * w;
    builder.quad({cab - 0.9F, y, low}, {l, y, low}, {l, y, nose}, {cab - 0.9F, y, nose}, body);
    builder.framedPane({Vector3f(cab - 0.9F, y, nose), Vector3f(l - 0.15F, y, nose),
                        Vector3f(screen_top, y, top), Vector3f(cab - 0.9F, y, top)},
                       0.12F, 0.06F, 0.35F, body, addGlass(PartKind::kCarWindow, object));
  }
  builder.quad({l, -w, low}, {l, w, low}, {l, w, nose}, {l, -w, nose}, body);
  builder.quad({l - 0.15F, -w, nose}, {l - 0.15F, w, nose}, {l, w, nose}, {l, -w, nose}, body);
  builder.framedPane({Vector3f(l - 0.15F, -w, nose), Vector3f(l - 0.15F, w, nose),
                      Vector3f(screen_top, w, top), Vector3f(screen_top, -w, top)},
                     0.06F, 0.06F, 0.3F, body, addGlass(PartKind::kCarWindow, object));
  builder.quad({cab - 0.9F, -w, top}, {screen_top, -w, top}, {screen_top, w, top}, {cab - 0.9F, w, top},
               body);
  for (const float side : {-1.0F, 1.0F}) {
    const float y0 = side * 0.1F, y1 = side * (w - 0.12F), x = -l - 0.01F;
    builder.pane({x, y0, 1.2F}, {x, y1, 1.2F}, {x, y1, 1.7F}, {x, y0, 1.7F},
                 addGlass(PartKind::kCarWindow, object));
  }
  wheels(builder, object, 0.62F * l, w, 0.36F);
  carEnds(builder, object, l, w, 0.75F);
}

// --- houses ---

struct ObjectFactory::FrontStyle {
  int object;
  std::uint32_t facade, frame, side_wall;
  float window_width, window_height, recess;  ///< [m]
  int floors, columns;
  float ground, storey;  ///< heights of the ground floor and the others [m]
  bool shop;             ///< large panes on the ground floor

  float height() const { return ground + static_cast<float>(floors - 1) * storey; }
};

/// One storey-high cell (x0, x1, z0, z1) of a front at y = 0 with an opening set back into it.
void ObjectFactory::frontCell(MeshBuilder& builder, const FrontStyle& style, const Vector4f& cell, bool door,
                              bool shop) {
  const float x0 = cell[0], x1 = cell[1], z0 = cell[2], z1 = cell[3], middle = 0.5F * (x0 + x1);
  const float half = 0.5F * (door   ? 1.1F
                             : shop ? 0.82F * (x1 - x0)
                                    : std::min(style.window_width, 0.8F * (x1 - x0)));
  const float low = door ? z0 : shop ? z0 + 0.5F : z0 + 0.95F;
  const float high = door ? z0 + 2.2F : shop ? z1 - 0.7F : std::min(low + style.window_height, z1 - 0.3F);
  const float left = middle - half, right = middle + half, depth = shop ? 0.12F : style.recess;
  const auto wall = [&](float a, float b, float c, float d) {
    builder.quad({a, 0, c}, {b, 0, c}, {b, 0, d}, {a, 0, d}, style.facade);
  };
  wall(x0, left, z0, z1);
  wall(right, x1, z0, z1);
  wall(left, right, high, z1);
  if (low > z0) wall(left, right, z0, low);
  builder.quad({left, 0, low}, {left, depth, low}, {left, depth, high}, {left, 0, high}, style.frame);
  builder.quad({right, 0, low}, {right, depth, low}, {right, depth, high}, {right, 0, high}, style.frame);
  builder.quad({left, 0, low}, {right, 0, low}, {right, depth, low}, {left, depth, low}, style.frame);
  builder.quad({left, 0, high}, {right, 0, high}, {right, depth, high}, {left, depth, high}, style.frame);
  const std::uint32_t part =
      door ? addPart(PartKind::kDoor, style.object, paintColor() * 0.6F, 0.3F, Texture::kWood)
           : addGlass(PartKind::kWindow, style.object);
  builder.pane({left, depth, low}, {right, depth, low}, {right, depth, high}, {left, depth, high}, part);
  if (!door) builder.box({left - 0.08F, -0.07F, low - 0.07F}, {right + 0.08F, 0.01F, low}, style.frame);
}

void ObjectFactory::balcony(MeshBuilder& builder, const FrontStyle& style, float x0, float x1, float z) {
  const std::uint32_t part =
      addPart(PartKind::kBalcony, style.object, varied({0.4F, 0.4F, 0.38F}, 0.4F), 0.4F);
  const float reach = -1.1F;
  builder.box({x0, reach, z - 0.15F}, {x1, 0, z}, part);
  builder.box({x0, reach, z}, {x1, reach + 0.05F, z + 0.95F}, part);
  builder.box({x0, reach + 0.05F, z}, {x0 + 0.05F, 0, z + 0.95F}, part);
  builder.box({x1 - 0.05F, reach + 0.05F, z}, {x1, 0, z + 0.95F}, part);
}

void ObjectFactory::roof(MeshBuilder& builder, int object, float width, float depth, float height,
                         std::uint32_t side_wall) {
  const std::uint32_t tiles =
      addPart(PartKind::kRoof, object, varied({0.24F, 0.09F, 0.05F}, 0.5F), 0.35F, Texture::kTiles);
  if (random_.chance(0.3)) {
    builder.box({-0.1F, -0.2F, height}, {width + 0.1F, depth, height + 0.35F}, tiles);
    return;
  }
  const float ridge = height + between(1.6, 3.2), middle = 0.5F * depth, eaves = height - 0.15F, over = 0.4F;
  builder.quad({-0.1F, -over, eaves}, {width + 0.1F, -over, eaves}, {width + 0.1F, middle, ridge},
               {-0.1F, middle, ridge}, tiles);
  builder.quad({-0.1F, depth + over, eaves}, {width + 0.1F, depth + over, eaves},
               {width + 0.1F, middle, ridge}, {-0.1F, middle, ridge}, tiles);
  for (const float x : {0.0F, width}) {
    builder.triangle({x, 0, height}, {x, depth, height}, {x, middle, ridge - 0.15F}, side_wall, {0.3F, 0.3F});
  }
  const float chimney = between(0.15, 0.85) * width;
  builder.box({chimney, middle - 1.2F, height}, {chimney + 0.6F, middle - 0.6F, ridge + 0.5F}, side_wall);
}

ObjectFactory::FrontStyle ObjectFactory::frontStyle(float width) {
  static const std::array<Vector3f, 6> kWalls = {
      Vector3f(0.55F, 0.50F, 0.40F), Vector3f(0.62F, 0.60F, 0.57F), Vector3f(0.30F, 0.13F, 0.09F),
      Vector3f(0.48F, 0.33F, 0.18F), Vector3f(0.36F, 0.36F, 0.37F), Vector3f(0.42F, 0.45F, 0.36F)};
  const std::size_t wall_kind = static_cast<std::size_t>(random_.integer(0, 5));
  const bool brick = wall_kind == 2 || random_.chance(0.25);
  const Vector3f color = varied(kWalls[wall_kind], 0.2F);
  const float reflectivity = between(0.25, 0.65);
  FrontStyle style;
  style.object = newObject();
  style.facade = addPart(PartKind::kFacade, style.object, color, reflectivity,
                         brick ? Texture::kBrick : Texture::kPlaster);
  style.frame = addPart(PartKind::kFacade, style.object, varied({0.55F, 0.54F, 0.52F}, 0.3F), 0.5F);
  style.side_wall =
      addPart(PartKind::kSideWall, style.object, 0.85F * color, reflectivity * 0.9F, Texture::kPlaster);
  style.window_width = between(0.9, 1.5);
  style.window_height = between(1.2, 1.7);
  style.recess = between(0.08, 0.3);
  style.floors = random_.integer(2, 4);
  style.columns = std::max(2, static_cast<int>(width / between(2.2, 3.2)));
  style.ground = between(3.0, 3.8);
  style.storey = between(2.7, 3.2);
  style.shop = random_.chance(0.35);
  return style;
}

/// One column of the upper floors, pushed out by `reach` over the pavement.
void ObjectFactory::upperFloors(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local, const FrontStyle& style,
                                float x0, float x1, float reach) {
  Eigen::Isometry3f T_mesh_front = T_mesh_local;
  T_mesh_front.translate(Vector3f(0, -reach, 0));
  MeshBuilder front(mesh, T_mesh_front);
  for (int f = 1; f < style.floors; ++f) {
    const float z0 = style.ground + static_cast<float>(f - 1) * style.storey;
    frontCell(front, style, {x0, x1, z0, z0 + style.storey}, false, false);
  }
  if (reach <= 0) return;
  const float low = style.ground, high = style.height();
  front.quad({x0, 0, low}, {x0, reach, low}, {x0, reach, high}, {x0, 0, high}, style.facade);
  front.quad({x1, 0, low}, {x1, reach, low}, {x1, reach, high}, {x1, 0, high}, style.facade);
  front.quad({x0, 0, low}, {x1, 0, low}, {x1, reach, low}, {x0, reach, low}, style.facade);
  front.quad({x0, 0, high}, {x1, 0, high}, {x1, reach, high}, {x0, reach, high}, style.facade);
}

void ObjectFactory::house(Mesh& mesh, const Eigen::Isometry3f& T_mesh_local, float width, float depth) {
  MeshBuilder builder(mesh, T_mesh_local);
  const FrontStyle style = frontStyle(width);
  const float column = width / static_cast<float>(style.columns), height = style.height();
  const int door = random_.integer(0, style.columns - 1);
  const int balconies = random_.chance(0.35) ? random_.integer(0, style.columns - 1) : -1;
  const int bay = random_.chance(0.3) ? random_.integer(0, style.columns - 1) : -1;
  for (int c = 0; c < style.columns; ++c) {
    const float x0 = static_cast<float>(c) * column, x1 = x0 + column;
    frontCell(builder, style, {x0, x1, 0, style.ground}, c == door, style.shop);
    upperFloors(mesh, T_mesh_local, style, x0, x1, c == bay && c != balconies ? 0.8F : 0.0F);
    for (int f = 1; f < style.floors && c == balconies; ++f) {
      balcony(builder, style, x0 + 0.1F, x1 - 0.1F,
              style.ground + static_cast<float>(f - 1) * style.storey + 0.2F);
    }
  }
  if (style.shop && random_.chance(0.6)) {
    const std::uint32_t awning = addPart(PartKind::kBalcony, style.object, paintColor(), 0.5F);
    const float left = 0.3F, right = width - 0.3F, high = style.ground - 0.15F, low = high - 0.5F;
    builder.quad({left, 0, high}, {right, 0, high}, {right, -1.2F, low}, {left, -1.2F, low}, awning);
  }
  for (const float x : {0.0F, width}) {
    builder.quad({x, 0, 0}, {x, depth, 0}, {x, depth, height}, {x, 0, height}, style.side_wall);
  }
  builder.quad({0, depth, 0}, {width, depth, 0}, {width, depth, height}, {0, depth, height}, style.side_wall);
  builder.box({-0.05F, -0.3F, height - 0.25F}, {width + 0.05F, 0.02F, height}, style.frame);
  roof(builder, style.object, width, depth, height, style.side_wall);
}

}  // namespace lidar_camera_recalibration::simulation
