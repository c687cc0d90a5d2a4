#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <vector>

#include "uniform.hpp"

/// The scenes of the physics benchmark, described once and in plain C++, so that every engine starts from the
/// same numbers: bodies let go above a floor z = 0, under gravity and quadratic air drag. SI units.
namespace rbres::bench {

using Vec3 = std::array<double, 3>;

enum class Shape { sphere, box, capsule };
inline constexpr std::array shapes{Shape::sphere, Shape::box};  // of the bodies that are thrown
constexpr const char* name(Shape shape) { return shape == Shape::sphere ? "spheres" : "boxes"; }

inline constexpr double radius = 0.25;
inline constexpr Vec3 half_extents{0.30, 0.22, 0.15};
inline constexpr double mass = 1.0;
inline constexpr double gravity = 9.81;
inline constexpr double friction = 0.3;
inline constexpr double restitution = 0.9;
inline constexpr double duration = 5.0;

inline constexpr double air_density = 1.2;
constexpr double drag_coefficient(Shape shape) { return shape == Shape::sphere ? 0.47 : 1.05; }

/// Air drag on a body, world frame: -1/2 rho C_d A |v| v, A the area that the shape turns towards its
/// velocity, which is given in the world frame and in the body's.
inline Vec3 drag(Shape shape, const Vec3& velocity, const Vec3& in_body) {
  const auto [x, y, z] = velocity;
  const auto [a, b, c] = half_extents;
  const double area_times_speed = shape == Shape::sphere
                                      ? std::numbers::pi * radius * radius * std::sqrt(x * x + y * y + z * z)
                                      : 4.0 * (b * c * std::abs(in_body[0]) + c * a * std::abs(in_body[1]) +
                                               a * b * std::abs(in_body[2]));
  const double factor = -0.5 * air_density * drag_coefficient(shape) * area_times_speed;
  return {factor * x, factor * y, factor * z};
}

/// How one body is let go: orientation x, y, z, w (body to world), velocity in the world frame, spin in the
/// body's.
struct Start {
  Vec3 position;
  std::array<double, 4> orientation;
  Vec3 velocity;
  Vec3 spin;
};

/// Number of bodies of a scene, and of different scenes that a row runs, so that no row is one lucky scene.
inline constexpr int body_count = 5;
inline constexpr int scene_count = 16;

/// Scene `index` of `bodies` bodies: a shaken lattice 1 m wide, no two bodies touching, thrown loosely at its
/// middle so that they meet in the air and on the floor.
inline std::vector<Start> scene(int index, int bodies = body_count) {
  Uniform uniform(static_cast<std::uint64_t>(index));
  int side = 1;
  while (side * side * side < bodies) ++side;
  const double middle = 0.5 * (side - 1);
  std::vector<Start> starts(static_cast<std::size_t>(bodies));
  for (int i = 0; i < bodies; ++i) {
    Start& start = starts[static_cast<std::size_t>(i)];
    const Vec3 cell{i % side - middle, i / side % side - middle, static_cast<double>(i / side / side)};
    double norm = 0.0;
    for (std::size_t k = 0; k < 3; ++k) {
      start.position[k] = cell[k] + uniform(-0.08, 0.08) + (k == 2 ? 0.8 : 0.0);
      start.velocity[k] = uniform(-2.0, 2.0) - (k == 2 ? 0.0 : 2.0 * cell[k]);
      start.spin[k] = uniform(-4.0, 4.0);
    }
    for (double& q : start.orientation) {
      q = uniform(-1.0, 1.0);
      norm += q * q;
    }
    for (double& q : start.orientation) q /= std::sqrt(norm);
  }
  return starts;
}

/// One body of a scene: a sphere of radius size[0]; a box of half extents `size`; or a capsule along z of
/// radius size[0] and half length size[1].
struct Item {
  Shape shape;
  Vec3 size;
  double mass;
  Start start;
};
/// The points p with dot(normal, p) < offset are solid.
struct Wall {
  Vec3 normal;
  double offset;
};
/// What an engine simulates.
struct Scene {
  std::vector<Item> items;
  std::vector<Wall> walls{{{0.0, 0.0, 1.0}, 0.0}};
  double gravity = bench::gravity;
  double restitution = bench::restitution;
  double friction = bench::friction;
  bool air = false;  ///< drag on the bodies, which are those that are thrown
  double seconds = duration;
};

/// Scene `index` of the bodies that are thrown.
inline Scene thrown(Shape shape, int index, int bodies = body_count) {
  Scene thrown;
  thrown.air = true;
  for (const Start& start : scene(index, bodies)) {
    const Vec3 size = shape == Shape::sphere ? Vec3{radius, 0.0, 0.0} : half_extents;
    thrown.items.push_back({shape, size, mass, start});
  }
  return thrown;
}

/// Floor and four walls: |x|, |y| <= half_width.
inline std::vector<Wall> pit(double half_width) {
  return {{{0.0, 0.0, 1.0}, 0.0},
          {{1.0, 0.0, 0.0}, -half_width},
          {{-1.0, 0.0, 0.0}, -half_width},
          {{0.0, 1.0, 0.0}, -half_width},
          {{0.0, -1.0, 0.0}, -half_width}};
}

/// Spheres, boxes and capsules that fall into a pit, in layers of columns^2, and come to rest in a heap.
/// Starts differ by 1e-6 m each.
inline Scene pile(int bodies, int start, int columns = 3) {
  Scene pile;
  pile.walls = pit(0.06 * (3 * columns + 1));
  pile.restitution = 0.3;
  pile.friction = 0.5;
  pile.seconds = 10.0;
  Uniform uniform(1);
  const double middle = 0.5 * (columns - 1);
  for (int i = 0; i < bodies; ++i) {
    Item item{Shape(i % 3), {0.1, 0.1, 0.1}, 1.0, {}};
    if (item.shape == Shape::box) item.size = {0.12, 0.08, 0.1};
    if (item.shape == Shape::capsule) item.size = {0.07, 0.08, 0.0};
    item.start.position = {0.36 * (i % columns - middle) + uniform(-0.02, 0.02),
                           0.36 * (i / columns % columns - middle) + uniform(-0.02, 0.02),
                           0.3 + 0.36 * (i / (columns * columns))};
    item.start.orientation = {std::sin(0.5 * i), 0.0, 0.0, std::cos(0.5 * i)};
    pile.items.push_back(item);
  }
  pile.items.front().start.position[0] += 1e-6 * start;
  return pile;
}

/// How such a heap comes to rest, and how long that takes, the least difference decides: so there are
/// several.
inline std::vector<Scene> piles(int bodies) {
  std::vector<Scene> all;
  for (int start = 0; start < 8; ++start) all.push_back(pile(bodies, start));
  return all;
}

/// Four layers of such bodies, as deep whatever their number, until they have nearly come to rest.
inline Scene wide_pile(int bodies) {
  int columns = 1;
  while (4 * columns * columns < bodies) ++columns;
  Scene wide = pile(bodies, 0, columns);
  wide.seconds = 2.0;
  return wide;
}

/// Boxes that stand on one another.
inline Scene stack(int bodies) {
  Scene stack;
  stack.restitution = 0.0;
  stack.friction = 0.5;
  stack.seconds = 10.0;
  for (int i = 0; i < bodies; ++i)
    stack.items.push_back(
        {Shape::box, {0.2, 0.2, 0.1}, 1.0, {{0.0, 0.0, 0.1 + 0.2 * i}, {0.0, 0.0, 0.0, 1.0}, {}, {}}});
  return stack;
}

/// Elastic spheres without gravity in a closed box, as dense whatever their number.
inline Scene gas(int bodies) {
  constexpr double spacing = 0.3;
  int side = 1;
  while (side * side * side < bodies) ++side;
  const double half = 0.5 * spacing * side;
  Scene gas;
  gas.walls = pit(half);
  gas.walls.push_back({{0.0, 0.0, -1.0}, -2.0 * half});
  gas.gravity = gas.friction = 0.0;
  gas.restitution = 1.0;
  gas.seconds = 1.0;
  Uniform uniform(1);
  for (int i = 0; i < bodies; ++i) {
    Item item{Shape::sphere, {0.05, 0.0, 0.0}, 1.0, {{}, {0.0, 0.0, 0.0, 1.0}, {}, {}}};
    const std::array cell{i % side, i / side % side, i / side / side};
    for (std::size_t k = 0; k < 3; ++k) {
      item.start.position[k] = spacing * (cell[k] + 0.5) - (k == 2 ? 0.0 : half);
      item.start.velocity[k] = uniform(-2.0, 2.0);
    }
    gas.items.push_back(item);
  }
  return gas;
}

}  // namespace rbres::bench
