#pragma once

#include <numbers>

#include "follow.hpp"

namespace validate {

/// A body under gravity on one plane, with what it needs to be followed. The other two bodies of the world
/// fall far away.
template <class Shape>
struct OnPlane {
  static constexpr double g = 9.81;
  World<Shape> system;
  States y;

  OnPlane(const Body<double, Shape>& body, const Plane<double>& plane)
      : system(World<Shape>::of(body, {plane})) {
    y[0].position = {0, 0, 1e6};
    y[2].position = {0, 0, 2e6};
  }
  RigidState<double>& body() { return y[1]; }

  /// Runs and calls look(time, state of the body) after every step, and hit(time) at every impact.
  template <class Look, class Hit>
  SimulationReport run(SimulationOptions options, const Look& look, const Hit& hit) {
    Ear<double, Shape> ear;
    ear.look = [&](double time, const States& now) { look(time, now[1]); };
    ear.hit = hit;
    return simulate(system, y, Loads{{0, 0, -g}}, Rk4{}, options, ear);
  }
  template <class Look>
  SimulationReport run(const SimulationOptions& options, const Look& look) {
    return run(options, look, [](double) {});
  }
  SimulationReport run(const SimulationOptions& options) {
    return run(options, [](double, const auto&) {});
  }
};

/// A plane that falls along x at this angle to the horizontal, and the direction down it.
struct Incline {
  double angle;
  Vector normal{std::sin(angle), 0, std::cos(angle)}, down{std::cos(angle), 0, -std::sin(angle)};
  /// Turns the axes of the world into those of the plane.
  Quat<double> turn{0, std::sin(angle / 2), 0, std::cos(angle / 2)};

  Plane<double> plane(const Material<double>& material) const { return {normal, 0, material}; }
};

inline double relative_error(double found, double expected) { return std::abs(found / expected - 1); }

}  // namespace validate
