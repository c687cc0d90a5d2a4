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

enum class Shape { sphere, box };
inline constexpr std::array shapes{Shape::sphere, Shape::box};
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

}  // namespace rbres::bench
