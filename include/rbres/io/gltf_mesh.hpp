#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <vector>

#include <rbres/body/compound.hpp>
#include <rbres/body/convex_hull.hpp>
#include <rbres/body/system.hpp>

namespace rbres::RBRES_ABI::detail {

/// Triangles in two colours, so that a body is seen to turn. Counter-clockwise from outside.
struct GltfMesh {
  std::vector<float> positions, normals;                ///< 3 per vertex, m and unit
  std::array<std::vector<std::uint16_t>, 2> triangles;  ///< 3 vertices each, by colour

  std::uint16_t vertex(const Vec3<double>& position, const Vec3<double>& normal) {
    for (const double x : {position.x, position.y, position.z}) positions.push_back(static_cast<float>(x));
    for (const double x : {normal.x, normal.y, normal.z}) normals.push_back(static_cast<float>(x));
    return static_cast<std::uint16_t>(positions.size() / 3 - 1);
  }
  void triangle(int colour, int a, int b, int c) {
    for (const int i : {a, b, c})
      triangles[static_cast<std::size_t>(colour)].push_back(static_cast<std::uint16_t>(i));
  }
  /// The triangles of another mesh, moved (m). Throws Error where that makes more vertices than can be told
  /// apart.
  void append(const GltfMesh& other, const Vec3<double>& shift) {
    const std::size_t before = positions.size() / 3;
    if (before + other.positions.size() / 3 > 65536)
      refuse("glTF mesh", "65536 vertices or fewer", before + other.positions.size() / 3);
    for (std::size_t i = 0; i < other.positions.size(); i += 3) {
      const std::array<double, 3> move{shift.x, shift.y, shift.z};
      for (std::size_t k = 0; k < 3; ++k)
        positions.push_back(static_cast<float>(static_cast<double>(other.positions[i + k]) + move[k]));
    }
    normals.insert(normals.end(), other.normals.begin(), other.normals.end());
    for (std::size_t colour = 0; colour < 2; ++colour) {
      for (const std::uint16_t i : other.triangles[colour])
        triangles[colour].push_back(static_cast<std::uint16_t>(before + i));
    }
  }
  /// A flat convex polygon.
  void polygon(int colour, const std::vector<Vec3<double>>& corners, const Vec3<double>& normal) {
    const int first = vertex(corners.front(), normal);
    for (std::size_t i = 1; i < corners.size(); ++i) {
      const int last = vertex(corners[i], normal);
      if (i > 1) triangle(colour, first, last - 1, last);
    }
  }
};

/// A capsule along z, or a ball when half_length is 0: rows of vertices from pole to pole, the upper half
/// raised and the lower one sunk. The eighths of the surface change colour by turns.
inline GltfMesh round_mesh(const Quat<double>& rotation, double radius, double half_length) {
  constexpr int around = 32, rows = 9;  // rows of each half: pole to equator
  GltfMesh mesh;
  for (int row = 0; row < 2 * rows; ++row) {
    const int upper = row / rows;
    const double latitude = (row - upper - (rows - 1)) * std::numbers::pi / 2 / (rows - 1);
    for (int i = 0; i < around; ++i) {
      const double longitude = 2 * std::numbers::pi * i / around;
      const Vec3<double> normal{std::cos(latitude) * std::cos(longitude),
                                std::cos(latitude) * std::sin(longitude), std::sin(latitude)};
      const Vec3<double> centre{0, 0, upper ? half_length : -half_length};
      mesh.vertex(rotate(rotation, centre + radius * normal), rotate(rotation, normal));
    }
  }
  for (int row = 0; row + 1 < 2 * rows; ++row) {
    const int upper = row / rows;
    if (row == rows - 1 && half_length == 0) continue;  // a ball has no cylinder
    for (int i = 0; i < around; ++i) {
      const int a = row * around + i, b = row * around + (i + 1) % around;
      const int colour = (i / (around / 4) + upper) % 2;
      if (row > 0) mesh.triangle(colour, a, b, b + around);
      if (row + 2 < 2 * rows) mesh.triangle(colour, a, b + around, a + around);
    }
  }
  return mesh;
}

template <class S>
GltfMesh mesh_of(const Sphere<S>& sphere, const Quat<double>& rotation) {
  return round_mesh(rotation, static_cast<double>(sphere.radius), 0);
}

template <class S>
GltfMesh mesh_of(const Capsule<S>& capsule, const Quat<double>& rotation) {
  return round_mesh(rotation, static_cast<double>(capsule.radius), static_cast<double>(capsule.half_length));
}

/// The faces towards +x, +y, +z in one colour, the others in the other.
template <class S>
GltfMesh mesh_of(const Box<S>& box, const Quat<double>& rotation) {
  GltfMesh mesh;
  const std::array<Vec3<double>, 3> half{{{static_cast<double>(box.half.x), 0, 0},
                                          {0, static_cast<double>(box.half.y), 0},
                                          {0, 0, static_cast<double>(box.half.z)}}};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const double side : {1.0, -1.0}) {
      const Vec3<double> n = rotate(rotation, side * half[axis]);
      const Vec3<double> u = rotate(rotation, side * half[(axis + 1) % 3]);
      const Vec3<double> v = rotate(rotation, half[(axis + 2) % 3]);
      mesh.polygon(side < 0, {n - u - v, n + u - v, n + u + v, n - u + v}, (1 / norm(n)) * n);
    }
  }
  return mesh;
}

/// The faces on one side in one colour, those on the other in the other.
template <class S>
GltfMesh mesh_of(const ConvexHull<S>& hull, const Quat<double>& rotation) {
  GltfMesh mesh;
  const ConvexHull<double> exact = hull.template cast<double>();
  for (const HullFace<double>& face : exact.faces()) {
    std::vector<Vec3<double>> corners;
    for (const int i : exact.corners(face))
      corners.push_back(rotate(rotation, exact.vertices()[static_cast<std::size_t>(i)]));
    const Vec3<double>& n = face.normal;
    mesh.polygon(n.x + n.y + n.z < 0, corners, rotate(rotation, n));
  }
  return mesh;
}

/// The parts, inner faces too.
template <class S, int M, class Shape>
GltfMesh mesh_of(const Compound<S, M, Shape>& compound, const Quat<double>& rotation) {
  GltfMesh mesh;
  const auto plain = [](const auto& v) {
    return Vec3<double>{static_cast<double>(v.x), static_cast<double>(v.y), static_cast<double>(v.z)};
  };
  for (std::size_t k = 0; k < compound.parts().size(); ++k) {
    const Quat<S>& q = compound.parts()[k].orientation;
    const Quat<double> turn = rotation * Quat<double>{static_cast<double>(q.x), static_cast<double>(q.y),
                                                      static_cast<double>(q.z), static_cast<double>(q.w)};
    const GltfMesh part =
        with_shape(compound.parts()[k].shape, [&](const auto& shape) { return mesh_of(shape, turn); });
    mesh.append(part, rotate(rotation, plain(compound.placed()[k].centre)));
  }
  return mesh;
}

/// The surfaces of planes, each cut to a square around the foot of the world's origin and where it enters
/// another plane's solid; an open side has none. Seen from the free side alone, so that a room shows its
/// inside.
template <class S>
GltfMesh mesh_of(const std::vector<Plane<S>>& planes, double half_width) {
  GltfMesh mesh;
  for (const auto& plane : planes) {
    const auto face = plane.template cast<double>();
    const Vec3<double> n = face.normal,
                       side = std::abs(n.x) < 0.9 ? Vec3<double>{1, 0, 0} : Vec3<double>{0, 1, 0};
    const Vec3<double> across = cross(n, side), v = (half_width / norm(across)) * across, u = cross(v, n);
    const Vec3<double> foot = face.offset * n;
    std::vector<Vec3<double>> corners{foot - u - v, foot + u - v, foot + u + v, foot - u + v};
    for (const auto& other : planes) {
      if (&other == &plane) continue;
      const auto solid = other.template cast<double>();
      std::vector<Vec3<double>> kept;
      for (std::size_t i = 0; i < corners.size(); ++i) {
        const Vec3<double>&a = corners[i], &b = corners[(i + 1) % corners.size()];
        const double above_a = dot(solid.normal, a) - solid.offset,
                     above_b = dot(solid.normal, b) - solid.offset;
        if (above_a >= 0) kept.push_back(a);
        if ((above_a > 0 && above_b < 0) || (above_a < 0 && above_b > 0))
          kept.push_back(a + (above_a / (above_a - above_b)) * (b - a));
      }
      corners = std::move(kept);
    }
    if (corners.size() >= 3) mesh.polygon(0, corners, n);
  }
  return mesh;
}

/// The ends of a horizontal grid's lines, pair by pair: through multiples of `width` along x and y, around
/// all between two corners, and by `width` below them.
inline std::vector<float> grid_lines(const Vec3<double>& low, const Vec3<double>& high, double width) {
  const double first_x = std::floor(low.x / width), last_x = std::ceil(high.x / width),
               first_y = std::floor(low.y / width), last_y = std::ceil(high.y / width);
  std::vector<float> ends;
  const auto add = [&](double x, double y) {
    for (const double number : {x * width, y * width, low.z - width})
      ends.push_back(static_cast<float>(number));
  };
  for (int i = 0; i <= static_cast<int>(last_x - first_x); ++i) {
    add(first_x + i, first_y);
    add(first_x + i, last_y);
  }
  for (int i = 0; i <= static_cast<int>(last_y - first_y); ++i) {
    add(first_x, first_y + i);
    add(last_x, first_y + i);
  }
  return ends;
}

}  // namespace rbres::RBRES_ABI::detail
