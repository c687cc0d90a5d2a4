// What a contact law keeps whatever its network says, and how it stands in the simulator.
#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <iterator>
#include <rbres/body/mechanics.hpp>
#include <rbres/contact/contact_query.hpp>
#include <rbres/learn/contact_law.hpp>
#include <rbres/sim/batch.hpp>

#include "../examples/common/count_allocations.hpp"
#include "learn_support.hpp"

using namespace rbres;
using namespace learn_support;

namespace {

using Law = ContactLaw<16, 3, double>;
const Gravity<double> weightless{{0, 0, 0}};

}  // namespace

TEST_CASE("linear and angular momentum are kept, whatever the network says") {
  const auto system = heap();
  const double moved = check_momentum(
      system,
      // Free flight keeps the angular momentum but for the integrator's error.
      [&](const auto& y) { return fly(system, weightless, Rk4{}, y, 0.0, 0.01); },
      [&](std::uint64_t seed, const auto& y) {
        return one_frame(system, y, law_of_some_moment<Law>(seed, 0.05), weightless);
      });
  CHECK(moved > 1);
}

TEST_CASE("a law prefers no direction: it turns with the world") {
  Random r(5);
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const auto law = law_of_some_moment<Law>(seed, 0.05);
    const Quat<double> turn = random_orientation(r);
    const Vec3<double> shift = random_vector(r, 2), up{0, 0, 1};
    const Gravity<double> gravity{{0.5, 0, -9.81}};
    const auto system = heap({{up, 0.02, {}}});
    const Vec3<double> normal = rotate(turn, up);
    const auto turned_system = heap({{normal, 0.02 + dot(normal, shift), {}}});
    const auto y = close_together(seed);
    auto expected = one_frame(system, y, law, gravity);
    double moved = 0;
    for (int i = 0; i < 4; ++i) moved += distance(expected[i], one_frame(system, y, Law{}, gravity)[i]);
    CHECK(moved > 0.03);
    expected = turned(expected, turn, shift);
    const auto found =
        one_frame(turned_system, turned(y, turn, shift), law, Gravity<double>{rotate(turn, gravity.g)});
    for (int i = 0; i < 4; ++i) CHECK(distance(found[i], expected[i]) < 1e-10);
  }
}

TEST_CASE("a law is the same in a mirror") {
  const System<double, 3> balls{
      {Body<double>{Sphere{0.1}, 1.0}, Body<double>{Sphere{0.12}, 2.0}, Body<double>{Sphere{0.08}, 0.5}},
      {floor_plane<double>()}};
  const auto mirrored = [](SystemState<double, 3> y) {
    for (int i = 0; i < 3; ++i) {
      y[i].position.x *= -1, y[i].velocity.x *= -1;
      y[i].angular_velocity.y *= -1, y[i].angular_velocity.z *= -1;
      y[i].orientation.y *= -1, y[i].orientation.z *= -1;
    }
    return y;
  };
  Random r(6);
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const auto law = law_of_some_moment<Law>(seed, 0.05);
    SystemState<double, 3> y;
    for (int i = 0; i < 3; ++i)
      y[i] = {Vec3<double>{0.16 * i, 0, 0.1} + random_vector(r, 0.02), random_orientation(r),
              random_vector(r, 0.5), random_vector(r, 5)};
    const auto expected = mirrored(one_frame(balls, y, law)), found = one_frame(balls, mirrored(y), law);
    for (int i = 0; i < 3; ++i) CHECK(distance(found[i], expected[i]) < 1e-11);
  }
}

TEST_CASE("a law does not know how bodies are numbered") {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const auto law = law_of_some_moment<Law>(seed, 0.05);
    const auto system = heap({floor_plane<double>()});
    const System<double, 4> other({system[2], system[0], system[3], system[1]}, system.planes());
    const auto y = close_together(seed);
    const SystemState<double, 4> moved{{y[2], y[0], y[3], y[1]}};
    const auto expected = one_frame(system, y, law), found = one_frame(other, moved, law);
    const int place[4] = {2, 0, 3, 1};
    for (int i = 0; i < 4; ++i) CHECK(distance(found[i], expected[place[i]]) < 1e-10);
  }
}

TEST_CASE("bodies that do not touch fly as if alone, and what another pair does is none of theirs") {
  const auto law = law_of_some_moment<Law>(1, 2e-3);
  const auto system = heap({floor_plane<double>()});
  auto y = close_together(2);
  const auto near = one_frame(system, y, law);
  auto lone = y;
  lone[0].position.x += 50;
  const auto apart = one_frame(system, lone, law);
  lone[0].position.z += 50;
  const auto above = one_frame(system, lone, law);
  CHECK(norm(above[0].velocity - (y[0].velocity - Vec3<double>{0, 0, 0.0981})) < 1e-12);
  for (int i = 1; i < 4; ++i) CHECK(distance(above[i], apart[i]) < 1e-12);
  double differs = 0;
  for (int i = 1; i < 4; ++i) differs += distance(near[i], apart[i]);
  CHECK(differs > 1e-3);
}

TEST_CASE("kinematic bodies keep their velocities, and push others") {
  const auto law = law_of_some_moment<Law>(3, 0.05);
  const auto bodies = heap();
  for (int place = 0; place < 4; ++place) {
    const auto body = [&](int i) {
      return i == place ? Body<double>::kinematic(bodies[i].shape()) : bodies[i];
    };
    const System<double, 4> system({body(0), body(1), body(2), body(3)});
    const auto y = close_together(4);
    const auto after = one_frame(system, y, law), free = one_frame(system, y, Law{});
    CHECK(after[place].velocity == y[place].velocity);
    CHECK(after[place].angular_velocity == y[place].angular_velocity);
    CHECK(distance(after[place], free[place]) == 0);
    double moved = 0;
    for (int i = 0; i < 4; ++i) moved += distance(after[i], free[i]);
    CHECK(moved > 1e-3);
  }
  const System<double, 4> apart({bodies[0], bodies[1], bodies[2], bodies[3]}, {}, {{0, 1}});
  CHECK_THROWS_WITH_AS(one_frame(apart, close_together(4), law),
                       "pairs without contact: expected none, for a learned contact law, found 1", Error);
}

TEST_CASE("a law stands where the analytic contacts stand") {
  const auto law = law_of_some_moment<Law>(3, 0.02);
  const auto system = heap({floor_plane<double>()});
  const SimulationOptions options{.step = 0.01, .duration = 0.05};
  const auto start = [](std::ptrdiff_t i) { return close_together(static_cast<std::uint64_t>(i)); };
  std::vector<SystemState<double, 4>> expected(6), found(6);
  for (std::ptrdiff_t i = 0; i < 6; ++i) {
    auto& y = expected[static_cast<std::size_t>(i)] = start(i);
    const auto report = simulate(system, y, Gravity{}, Rk4{}, law, options);
    CHECK(report.steps == 5);
    CHECK(report.touching > 0);
    auto stepped = start(i);
    Stepper stepper(system, Gravity{}, Rk4{}, law, options);
    const long before = allocations;
    for (int k = 0; k < 5; ++k) stepper.step(stepped, 0.01 * k, 0.01);
    CHECK(allocations == before);
    CHECK(stepped == y);
    CHECK(stepper.tally().touching == report.touching);
  }
  for (const int threads : {1, 3}) {
    simulate_batch<double>(
        system, 6, start, [](const auto&) { return Gravity{}; }, Rk4{}, law, options,
        [&](const auto& sample) { found[static_cast<std::size_t>(sample.scenario)] = sample.state; },
        threads);
    CHECK(found == expected);
  }
}

TEST_CASE("a step other than the law's frame time is refused") {
  const auto law = law_of_some_moment<Law>(3, 0.02);
  const auto system = heap();
  auto y = close_together(1);
  const auto before = y;
  const auto refused = [&](const SimulationOptions& options) {
    std::string message;
    try {
      simulate(system, y, Gravity{}, Rk4{}, law, options);
    } catch (const Error& error) {
      message = error.what();
    }
    return message;
  };
  CHECK(refused({.step = 0.005, .duration = 0.1}) ==
        "step of a learned contact law: expected its frame time, 0.01 s (durations and samples are whole "
        "frames), found 0.005");
  // The last step would be shorter.
  CHECK(refused({.step = 0.01, .duration = 0.105, .sample_rate = 10}) ==
        "step of a learned contact law: expected its frame time, 0.01 s (durations and samples are whole "
        "frames), found 0.005");
  CHECK(y == before);
  Stepper stepper(system, Gravity{}, Rk4{}, law, {.step = 0.01});
  CHECK_THROWS_AS(stepper.step(y, 0.0, 0.02), Error);
  CHECK(stepper.step(y, 0.0, 0.0) == -1);
  CHECK(stepper.step(y, 0.0, -0.01) == 0);
  CHECK(y == before);
}

TEST_CASE("one law serves any number of bodies") {
  const auto law = law_of_some_moment<ContactLaw<>>(4, 0.02);
  const std::vector<Plane<double>> planes{floor_plane<double>()};
  for (const std::size_t n : {1u, 3u, 24u, 200u}) {
    std::vector<Body<double>> bodies;
    std::vector<RigidState<double>> start(n), states;
    for (std::size_t i = 0; i < n; ++i) {
      bodies.push_back({shapes[i % 3], 1.0});
      start[i].position = {0.4 * static_cast<double>(i), 0, 0.069};
    }
    states = start;
    ContactLaw<>::Workspace workspace(n, 1);
    const std::span<const Body<double>> view(bodies);
    const long before = allocations;
    const long contacts =
        law.respond(view, std::span<const Plane<double>>(planes), std::span<const RigidState<double>>(start),
                    std::span<RigidState<double>>(states), workspace);
    CHECK(allocations == before);
    CHECK(contacts >= static_cast<long>(n));
    // They are too far from one another to touch.
    for (std::size_t i = 3; i < n; ++i) CHECK(norm(states[i].velocity - states[i - 3].velocity) < 1e-5);
  }
}

namespace {

/// Answers every impact with this output along its normal, 1 + restitution, and nothing else.
Law bouncing_law(double output) {
  Law law;
  law.network.parameters()[Law::Network::tensors().back().index(0, 0)] = output;
  // All speeds are above this by far, so that speeds of approach are counted as they are.
  law.scales = {.frame_time = 0.02, .speed = 1e-7, .margin = 1e-3, .moment = ContactMoment::impact};
  return law;
}

}  // namespace

TEST_CASE("impacts of a frame that follow from one another are answered in their order") {
  // Equal balls in a row: the first hits the second after 1 ms, the second the third 2 ms later.
  const double radius = 0.1, gap = 1e-3;
  const System<double, 3> row({Body<double>{Sphere{radius}, 2.0}, Body<double>{Sphere{radius}, 2.0},
                               Body<double>{Sphere{radius}, 2.0}});
  for (const auto& number : {std::array{0, 1, 2}, std::array{2, 0, 1}}) {
    SystemState<double, 3> y;
    y[number[1]].position.x = 2 * radius + gap;
    y[number[2]].position.x = 4 * radius + 3 * gap;
    y[number[0]].velocity.x = 1;
    y = one_frame(row, y, bouncing_law(2), {Vec3<double>{}});
    CHECK(y[number[0]].position.x == doctest::Approx(gap).epsilon(1e-9));
    CHECK(y[number[1]].position.x == doctest::Approx(2 * radius + 3 * gap).epsilon(1e-9));
    CHECK(y[number[2]].position.x == doctest::Approx(4 * radius + 3 * gap + (0.02 - 3 * gap)).epsilon(1e-9));
    CHECK(std::abs(y[number[0]].velocity.x) < 1e-9);
    CHECK(std::abs(y[number[1]].velocity.x) < 1e-9);
    CHECK(y[number[2]].velocity.x == doctest::Approx(1).epsilon(1e-9));
  }
}

TEST_CASE("a ball that falls meets the floor when it does") {
  const double radius = 0.1, restitution = 0.8, g = 9.81;
  const System<double, 1> ball({Body<double>{Sphere{radius}, 2.0}}, {floor_plane<double>()});
  for (const double share : {0.05, 0.4, 0.99}) {
    // Falls with 2 m/s where it meets the floor.
    const double time = 0.02 * share, left = 0.02 - time, up = 2 * restitution;
    SystemState<double, 1> y;
    y[0].position.z = radius + 2 * time - g * time * time / 2;
    y[0].velocity.z = -2 + g * time;
    y = one_frame(ball, y, bouncing_law(1 + restitution));
    CHECK(y[0].position.z == doctest::Approx(radius + up * left - g * left * left / 2).epsilon(1e-12));
    CHECK(y[0].velocity.z == doctest::Approx(up - g * left).epsilon(1e-12));
  }
}

TEST_CASE("a box that turns meets the floor with its corner when it does") {
  // As in the continuous simulation, which gives the corner the same restitution.
  const Material<double> smooth{0.5, 0};
  const System<double, 1> box({Body<double>{Box{0.1, 0.15, 0.2}, 2.0, smooth}}, {floor_plane(smooth)});
  double most = 0;
  for (int k = 0; k < 40; ++k) {
    Random r(static_cast<std::uint64_t>(k));
    SystemState<double, 1> y;
    y[0].orientation = random_orientation(r);
    y[0].velocity = {0.3, 0.1, -2};
    y[0].angular_velocity = random_vector(r, 1);
    y[0].position.z = 0.28;
    const auto touches = [&] { return contacts(box, y).begin() != std::default_sentinel; };
    while (touches()) y[0].position.z += 1e-3;
    auto truth = y;
    simulate(box, truth, Gravity{}, Rk4{}, {.step = 1e-4, .duration = 0.02});
    y = one_frame(box, y, bouncing_law(1.5));
    most = std::max(most, distance(y[0], truth[0]));
  }
  // The inertia by which the law measures impulses is that of halfway: a degree or two off.
  CHECK(most > 0);
  CHECK(most < 0.05);
}
