#include <cmath>

#include <rbres/core/philox.hpp>
#include <rbres/learn/identify.hpp>
#include <rbres/sim/simulate.hpp>

#include "io_support.hpp"

using namespace rbres;

namespace {

constexpr double frame_time = 0.01;
const Vec3<double> nominal_gravity{0, 0, -9.81};

RigidState<double> thrown(Random& random) {
  const auto within = [&](double size) { return size * (2 * random.uniform() - 1); };
  RigidState<double> y;
  y.position = {0, 0, 0.15 + 0.1 * random.uniform()};
  y.orientation = normalized(Quat<double>{within(1), within(1), within(1), within(1)});
  y.velocity = {within(1), within(1), within(0.5)};
  y.angular_velocity = {within(8), within(8), within(8)};
  return y;
}

const Box<double> nominal_box{0.05, 0.05, 0.05};
constexpr double mass = 0.37;

/// Tosses of a box whose friction, restitution, gravity, inertia and size are not the nominal ones. One in
/// twelve has nothing to do with the rest.
TrajectorySet tosses(int count, int frames, double noise) {
  const Material<double> material{0.35, 0.22};
  const Body box{nominal_box, mass};
  const System<double, 1, Box<double>> world{{box.scaled(0.97, 1, 1.25, material)}, {floor_plane(material)}};
  std::vector<Trajectory> scenes;
  for (int s = 0; s < count; ++s) {
    Random random(5, static_cast<std::uint64_t>(s));
    SystemState<double, 1> y{{thrown(random)}};
    const SimulationOptions options{.step = frame_time / 2, .contacts = ContactMode::discrete};
    Stepper stepper(world, Gravity{Vec3<double>{0, 0, -9.5}}, Rk4{}, options);
    std::vector<RigidState<double>> states{y[0]};
    while (std::ssize(states) <= frames) {
      for (int k = 0; k < 2; ++k) stepper.step(y, 0, frame_time / 2);
      states.push_back(y[0]);
      Vec3<double>& p = states.back().position;
      p += noise * Vec3<double>{random.normal(), random.normal(), random.normal()};
      if (s % 12 == 11) p += {0, 0, random.uniform()};
    }
    scenes.push_back({{Body<double>(box)}, states});
  }
  return {frame_time, nominal_gravity, {floor_plane<double>()}, scenes};
}

const std::vector<double> truth{0.35, 0.22, 9.5, 1.25, 0.97};  // in the order of IdentifyOptions::unknowns
IdentifyOptions options_for_tosses() { return {.step = {.steps = 2}, .window = 40}; }

}  // namespace

TEST_CASE("a line among gross errors, with the uncertainty of its numbers") {
  // y = 2 - 3 t with noise of 0.1, and every tenth sample wrong by far; 400 samples, each a cluster.
  constexpr Eigen::Index n = 400;
  Eigen::VectorXd y(n);
  Random random(1, 0);
  const auto t = [](Eigen::Index i) { return static_cast<double>(37 * i % n) / n - 0.5; };
  for (Eigen::Index i = 0; i < n; ++i) y(i) = 2 - 3 * t(i) + 0.1 * random.normal() + (i % 10 == 0 ? 50 : 0);
  std::vector<Eigen::Index> clusters;
  for (Eigen::Index i = 0; i <= n; ++i) clusters.push_back(i);
  const auto errors = [&](const Eigen::VectorXd& x, Eigen::MatrixXd& e) {
    for (Eigen::Index i = 0; i < e.cols(); ++i) e(0, i) = x(0) + x(1) * t(i) - y(i);
  };
  const std::vector<FitNumber> numbers{{0, 1, -10, 10}, {0, 1, -10, 10}};
  const FitResult fit = RobustFit(numbers, 1, clusters, errors, {.tolerance = 1e-4}).run();
  // Least squares would be off by 5 and know its numbers to 0.8.
  const double error = std::sqrt(fit.covariance(0, 0)), slope = std::sqrt(fit.covariance(1, 1));
  CHECK(error == doctest::Approx(0.1 / std::sqrt(0.9 * n)).epsilon(0.5));
  CHECK(slope == doctest::Approx(0.1 / std::sqrt(0.9 * n / 12)).epsilon(0.5));
  CHECK(std::abs(fit.value(0) - 2) < 0.1);
  CHECK(std::abs(fit.value(1) + 3) < 3 * slope);

  // Bounds hold; and of two numbers of which only the sum matters the data do not say each.
  const FitResult bounded =
      RobustFit(std::vector<FitNumber>{{0, 1, -10, 1}, {0, 1, -10, 10}}, 1, clusters, errors).run();
  CHECK(bounded.value(0) == 1);
  const auto sum = [&](const Eigen::VectorXd& x, Eigen::MatrixXd& e) {
    for (Eigen::Index i = 0; i < e.cols(); ++i) e(0, i) = x(0) + x(1) - 2 + 3 * t(i) * x(2) - y(i) + 2;
  };
  const FitResult undetermined =
      RobustFit(std::vector<FitNumber>{{0, 1, -10, 10}, {0, 1, -10, 10}, {0, 1, -10, 10}}, 1, clusters, sum)
          .run();
  CHECK(std::isinf(undetermined.covariance(0, 0)));
  CHECK(std::isinf(undetermined.covariance(1, 1)));
  CHECK(std::isfinite(undetermined.covariance(2, 2)));
}

TEST_CASE("a scene is simulated as a System of its bodies is, to the bit") {
  const Material<double> m{0.6, 0.4};
  const std::vector<Body<double>> bodies{
      {Body{Sphere{0.1}, 1.0, m}}, {Body{Box{0.2, 0.1, 0.1}, 2.0, m}}, {Body{Capsule{0.1, 0.2}, 1.5, m}}};
  const System<double, 3> system{{bodies[0], bodies[1], bodies[2]}, {floor_plane(m)}};
  SystemState<double, 3> y;
  SceneState state;
  for (int i = 0; i < 3; ++i) {
    y[i].position = {0.1 * i, 0.05 * i, 0.2 + 0.3 * i};
    y[i].angular_velocity = {1, 2, -1};
    state.body.push_back(y[i]);
  }
  const std::array<Wrench<double>, 3> wrenches{{{{0.3, 0, 0}, {}}, {{}, {0, 0.1, 0}}, {{0, -0.2, 0}, {}}}};
  const FluidFriction<double> fluid{2, 0.4, 0.01};
  const TrajectorySet set(
      0.02, nominal_gravity, {floor_plane(m)},
      {{bodies, {y[0], y[1], y[2], y[0], y[1], y[2]}, {wrenches.begin(), wrenches.end()}}}, {fluid, {7, 7}});
  WorldNumbers numbers;
  numbers[Unknown::damping] = 0.2;
  SceneSimulator simulator(set, set[0], numbers, {.steps = 4});
  const Forces forces{Gravity{nominal_gravity}, fluid, Damping{0.2, 0.2},
                      ConstantWrench<double, 3>{wrenches}};
  Stepper stepper(system, forces, Rk4{}, {.step = 0.005, .contacts = ContactMode::discrete});
  for (int t = 0; t < 50; ++t) {
    simulator(state);
    for (int k = 0; k < 4; ++k) stepper.step(y, 0, 0.005);
  }
  CHECK(stepper.tally().impacts > 10);
  for (int i = 0; i < 3; ++i) CHECK(state[i] == y[i]);
}

TEST_CASE("velocities that are the mean over a frame") {
  const TrajectorySet set = tosses(1, 4, 0);
  SceneSimulator simulator(set, set[0], {}, {.velocity = SceneStep::Velocity::mean});
  SceneState state{{set[0].state(0, 0)}};
  const Vec3<double> before = state[0].position;
  simulator(state);
  CHECK(norm(state[0].position - before - frame_time * state[0].velocity) < 1e-15);

  // However many steps a frame has, they are means over frames: free flight is the same.
  const std::vector<Body<double>> ball{{Sphere{0.1}, 1.0}};
  SceneState in_one{{RigidState<double>{}}};
  in_one[0].velocity = {1, 0, 3};
  const TrajectorySet flight(frame_time, nominal_gravity, {}, {{ball, {in_one[0], in_one[0]}}});
  SceneSimulator one(flight, flight[0], {}, {.velocity = SceneStep::Velocity::mean});
  for (const int steps : {2, 5}) {
    SceneSimulator several(flight, flight[0], {}, {steps, SceneStep::Velocity::mean});
    SceneState a = in_one, b = in_one;
    for (int t = 0; t < 20; ++t) one(a), several(b);
    CHECK(norm(a[0].position - b[0].position) < 1e-12);
    CHECK(norm(a[0].velocity - b[0].velocity) < 1e-12);
  }
}

TEST_CASE("tosses give back the world that they were made in") {
  const auto check = [](double noise) {
    const Identification found = identify(tosses(36, 40, noise), options_for_tosses());
    for (std::size_t i = 0; i < truth.size(); ++i) {
      CAPTURE(name(found.unknowns[i]));
      const double value = found.value(static_cast<Eigen::Index>(i));
      CHECK(value == doctest::Approx(truth[i]).epsilon(0.05));
      // Noise of 2 mm hides a number by so much; without noise little does.
      CHECK(found.standard_error(static_cast<Eigen::Index>(i)) < 0.1 * truth[i]);
      CHECK(std::abs(value - truth[i]) <
            0.01 * truth[i] + 4 * found.standard_error(static_cast<Eigen::Index>(i)));
    }
  };
  check(0);
  check(2e-3);
}

TEST_CASE("windows follow one another until there are enough states") {
  const TrajectorySet set = tosses(3, 50, 0);  // 51 frames
  const auto windows = windows_of(set, 20, 1000);
  REQUIRE(windows.size() == 9);
  const int first[] = {0, 0, 0, 20, 20, 20, 40, 40, 40};
  for (std::size_t k = 0; k < 9; ++k) {
    CHECK(windows[k].scene == static_cast<int>(k % 3));
    CHECK(windows[k].first == first[k]);
    CHECK(windows[k].frames == (k < 6 ? 20 : 10));
  }
  CHECK(windows_of(set, 20, 70).size() == 4);
  CHECK(windows_of(set, 30, 1000).size() == 6);
  CHECK(windows_of(set, 42, 1000).size() == 3);  // eight frames are less than half of it
}

TEST_CASE("what cannot be identified is refused") {
  const TrajectorySet set = tosses(3, 4, 0);
  CHECK(error_of([&] { identify(set); }) ==
        "windows to fit to: expected at least 6, one more than numbers, found 3");
  CHECK(error_of([&] { identify(set, {.unknowns = {}}); }) ==
        "numbers to fit: expected at least one, found none");
  CHECK(error_of([&] {
          identify(set, {.unknowns = {Unknown::size, Unknown::size}});
        }) == "unknowns: expected each once, found size");
  CHECK(error_of([&] { identify(set, {.step = {.steps = 0}}); }) ==
        "steps in a frame: expected 1 or more, found 0");
  CHECK(error_of([&] { identify(set, {.window = 0}); }) == "frames of a window: expected 1 or more, found 0");
  CHECK(error_of([&] { identify(set, {.most_states = 0}); }) ==
        "states to fit to: expected 1 or more, found 0");
  CHECK(error_of([&] { identify(set, {.fit = {.tolerance = 0}}); }) ==
        "fit tolerance: expected a number in (0, 1), found 0");
  const TrajectorySet floating(frame_time, {}, {}, {set.begin(), set.end()});
  CHECK(error_of([&] { identify(floating); }) ==
        "unknowns: expected no gravity in a set without it, found gravity");
}
