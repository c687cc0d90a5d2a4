#include <cmath>

#include <rbres/body/mechanics.hpp>
#include <rbres/core/philox.hpp>
#include <rbres/learn/spring_damper.hpp>

#include "io_support.hpp"

using namespace rbres;

namespace {

const std::vector<Plane<double>> floor_only{floor_plane<double>()};

/// Balls in one frame time, and where they start (twice: a trajectory has two frames).
TrajectorySet still(const std::vector<Body<double>>& bodies, const std::vector<RigidState<double>>& start,
                    const Vec3<double>& gravity, double frame_time) {
  auto states = start;
  states.insert(states.end(), start.begin(), start.end());
  return {frame_time, gravity, floor_only, {{bodies, states}}};
}

}  // namespace

TEST_CASE("without damping a ball sinks by v / sqrt(stiffness) and leaves as fast as it came") {
  RigidState<double> ball;
  ball.position = {0, 0, 0.1};
  ball.velocity = {0, 0, -2};
  const TrajectorySet set = still({{Sphere{0.1}, 0.7}}, {ball}, {}, 1e-3);
  SpringDamperSimulator step(set, set[0], {.stiffness = 1e4, .damping = 0, .friction = 0});
  SceneState state{{ball}};
  double lowest = 1;
  for (int k = 0; k < 60; ++k) {
    step(state);
    lowest = std::min(lowest, state[0].position.z);
  }
  CHECK(0.1 - lowest == doctest::Approx(2 / std::sqrt(1e4)).epsilon(0.05));
  CHECK(state[0].velocity.z == doctest::Approx(2).epsilon(0.1));
  CHECK(state[0].position.z > 0.1);
}

TEST_CASE("a collision keeps momentum and makes no energy") {
  std::vector<RigidState<double>> start(2);
  start[0].position = {0, 0, 1};
  start[0].velocity = {1, 0.2, 0};
  start[0].angular_velocity = {3, 1, 5};
  start[1].position = {0.23, 0.05, 1};
  const std::vector<Body<double>> bodies{{Sphere{0.1}, 0.5}, {Box{0.08, 0.1, 0.12}, 2.0}};
  const TrajectorySet set = still(bodies, start, {}, 0.01);
  SpringDamperSimulator step(set, set[0], {.stiffness = 1e4, .damping = 30, .friction = 0.3});
  const System<double, 2> system{{bodies[0], bodies[1]}};
  SystemState<double, 2> y{{start[0], start[1]}};
  const double energy = kinetic_energy(system, y);
  const Vec3<double> p = linear_momentum(system, y), l = angular_momentum(system, y);
  SceneState state{start};
  for (int t = 0; t < 30; ++t) step(state);
  for (int i = 0; i < 2; ++i) y[i] = state[i];
  CHECK(norm(y[1].velocity) > 0.1);  // they did collide
  CHECK(norm(linear_momentum(system, y) - p) < 1e-12);
  CHECK(norm(angular_momentum(system, y) - l) < 1e-9);
  CHECK(kinetic_energy(system, y) < energy);
}

TEST_CASE("bounces give back the law that they were made by") {
  const SpringDamper truth{.stiffness = 4000, .damping = 12, .friction = 0.2};
  std::vector<Trajectory> scenes;
  for (std::uint64_t s = 0; s < 12; ++s) {
    Random random(3, s);
    RigidState<double> ball;
    ball.position = {0, 0, 0.12 + 0.1 * random.uniform()};
    ball.velocity = {1 + random.uniform(), 0, -1 - random.uniform()};
    ball.angular_velocity = {0, 4 * random.uniform(), 0};
    const std::vector<Body<double>> bodies{{Sphere{0.1}, 0.7}};
    const TrajectorySet set = still(bodies, {ball}, {0, 0, -9.81}, 0.01);
    SpringDamperSimulator step(set, set[0], truth);
    SceneState state{{ball}};
    std::vector<RigidState<double>> states{ball};
    for (int t = 0; t < 30; ++t) {
      step(state);
      states.push_back(state[0]);
    }
    scenes.push_back({bodies, states});
  }
  const TrajectorySet set(0.01, {0, 0, -9.81}, floor_only, scenes);
  const SpringDamper found = fit_spring_damper(set, 30, 10'000);
  CHECK(found.stiffness == doctest::Approx(truth.stiffness).epsilon(0.05));
  CHECK(found.damping == doctest::Approx(truth.damping).epsilon(0.05));
  CHECK(found.friction == doctest::Approx(truth.friction).epsilon(0.05));
}
