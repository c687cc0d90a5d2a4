// Islands that have come to rest sleep: a step leaves them as they are, and costs one flight, until something
// about them changes.
#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <rbres/rbres.hpp>

using namespace rbres;

namespace {

constexpr double step = 2e-3;
constexpr Material<double> rough{.restitution = 0.2, .friction = 0.5};
using Boxes = System<double, 4, Box<double>>;

/// Gravity, a push along x from a time on, and how often it was asked for.
struct Push {
  long* calls;
  double from = 1e9, acceleration = 0;

  Wrench<double> operator()(const Body<double, Box<double>>& body, const RigidState<double>&, int i,
                            double t) const {
    ++*calls;
    return {{i == 3 && t >= from ? acceleration * body.mass() : 0.0, 0, -9.81 * body.mass()}, {}};
  }
};
/// The same for all bodies at once: such forces let no body sleep.
struct Awake {
  Push push;

  void operator()(const Boxes& system, const SystemState<double, 4>& y, double t,
                  std::span<Wrench<double>> wrenches) const {
    for (int i = 0; i < 4; ++i) wrenches[static_cast<std::size_t>(i)] = push(system[i], y[i], i, t);
  }
};

/// A stack of three boxes, and one beside it.
Boxes boxes(const Material<double>& material = rough) {
  return Boxes::of(Body(Box{0.2, 0.2, 0.1}, 1.0, material), {floor_plane(material)});
}
SystemState<double, 4> at_rest() {
  SystemState<double, 4> y;
  for (int i = 0; i < 3; ++i) y[i].position = {0.01 * i, 0, 0.1 + 0.2 * i};
  y[3].position = {2, 0, 0.1};
  return y;
}

double distance(const SystemState<double, 4>& a, const SystemState<double, 4>& b) {
  double most = 0;
  for (int i = 0; i < 4; ++i) most = std::max(most, norm(a[i].position - b[i].position));
  return most;
}

/// A run of the same bodies twice: with forces that let them sleep, and with forces that do not.
template <class Change>
void compare(double seconds, const Push& push, double bound, const Change& change) {
  const Boxes system = boxes();
  long ignored = 0;
  Push same = push;
  same.calls = &ignored;
  Stepper<Boxes, Push, Rk4> sleeps(system, push, Rk4{}, {.step = step});
  Stepper<Boxes, Awake, Rk4> awake(system, Awake{same}, Rk4{}, {.step = step});
  SystemState<double, 4> y = at_rest(), truth = y;
  for (int k = 0; k * step < seconds; ++k) {
    change(k * step, y);
    change(k * step, truth);
    sleeps.step(y, k * step, step);
    awake.step(truth, k * step, step);
  }
  CHECK(distance(y, truth) < bound);
}
const auto nothing = [](double, SystemState<double, 4>&) {};

}  // namespace

TEST_CASE("bodies at rest sleep: a step is one flight of each, and where they are is where they would be") {
  long calls = 0;
  const Boxes system = boxes();
  Stepper<Boxes, Push, Rk4> stepper(system, Push{&calls}, Rk4{}, {.step = step});
  SystemState<double, 4> y = at_rest();
  for (int k = 0; k < 500; ++k) stepper.step(y, k * step, step);
  calls = 0;
  const SystemState<double, 4> before = y;
  for (int k = 500; k < 1000; ++k) stepper.step(y, k * step, step);
  CHECK(calls == 500 * 4 * 4);  // Runge and Kutta's four looks at each body
  CHECK(y == before);
  compare(4, Push{&calls}, 1e-12, nothing);

  // A step of another length is another step: they wake, and sleep again.
  stepper.step(y, 2, 0.5 * step);
  calls = 0;
  for (int k = 0; k < 500; ++k) stepper.step(y, 2 + k * step, step);
  CHECK(calls > 500 * 4 * 4);
  CHECK(distance(y, before) < 1e-12);
}

TEST_CASE("bodies come to rest in a fluid, whose drag of a fall is not that of a body that is held") {
  struct Drag {
    double linear, quadratic;  // 1/s; kg/m
    long* calls;

    Wrench<double> operator()(const Body<double, Box<double>>& body, const RigidState<double>& y, int,
                              double) const {
      ++*calls;
      return {(-linear * body.mass() - quadratic * norm(y.velocity)) * y.velocity +
                  Vec3<double>{0, 0, -9.81 * body.mass()},
              -0.01 * linear * y.angular_velocity};
    }
  };
  // A stack, and some that slide and fall.
  const auto rests = [](const auto& system, auto y, double linear, double quadratic, double h) {
    CAPTURE(system.size());
    CAPTURE(linear);
    CAPTURE(quadratic);
    CAPTURE(h);
    for (int i = 0; i < system.size(); ++i)
      y[i].position = {i < 3 ? 0.01 * i : i, 0, i < 3 ? 0.1 + 0.2 * i : 0.11};
    y[3].velocity.x = 0.5;
    long calls = 0;
    double apart = 0;
    Stepper stepper(system, Drag{linear, quadratic, &calls}, Rk4{}, {.step = h});
    for (int k = 0; k * h < 2.4 || k < 500; ++k) {
      auto anew = y;
      calls = 0;
      stepper.step(y, k * h, h);
      if (system.size() > 4 || k % 10 != 0) continue;
      // What the steps before have taught says only where the solver starts.
      const long taken = calls;
      Stepper(system, Drag{linear, quadratic, &calls}, Rk4{}, {.step = h}).step(anew, k * h, h);
      for (int i = 0; i < system.size(); ++i) apart = std::max(apart, norm(y[i].velocity - anew[i].velocity));
      calls = taken;
    }
    CHECK(apart < 1e-10);
    CHECK(calls == 4 * system.size());  // all sleep
    CHECK(std::abs(y[2].position.z - 0.5) < 1e-8);
  };
  const Boxes few = boxes();
  const System<double, dynamic, Box<double>> many{std::vector(14, Body(Box{0.2, 0.2, 0.1}, 1.0, rough)),
                                                  {floor_plane(rough)}};
  SystemState<double, dynamic> at_origin;
  at_origin.body.resize(14);
  for (const double h : {5e-4, 2e-3, 1e-2}) {
    rests(few, SystemState<double, 4>{}, 0, 0.1, h);
    rests(few, SystemState<double, 4>{}, 0.1, 0, h);
    rests(few, SystemState<double, 4>{}, 0, 30, h);
    rests(few, SystemState<double, 4>{}, 2, 0, h);
  }
  rests(few, SystemState<double, 4>{}, 200, 0, 2e-3);
  rests(many, at_origin, 0, 0.1, 2e-3);
  rests(many, at_origin, 2, 0, 2e-3);
}

TEST_CASE("in a damper, however stiff, a body on a slope sticks, or slides as fast as its velocity says") {
  using World = System<double, 1, Box<double>>;
  const Material<double> material{.restitution = 0, .friction = 0.3};
  const World system{{Body(Box{0.1, 0.1, 0.03}, 1.0, material)}, {floor_plane(material)}};
  for (const double step : {1e-3, 1e-2}) {
    for (const double damping : {0.1 / step, 0.8 / step, 1.5 / step, 1.0}) {
      for (const double beyond : {-1e-3, 1e-6}) {  // the angle of friction
        CAPTURE(step);
        CAPTURE(damping);
        CAPTURE(beyond);
        const double angle = std::atan(0.3) + beyond;
        const auto force = [&](const auto& body, const auto& y, int, double) {
          return Wrench<double>{body.mass() * (9.81 * Vec3<double>{std::sin(angle), 0, -std::cos(angle)} -
                                               damping * y.velocity),
                                {}};
        };
        SystemState<double, 1> y;
        y[0].position.z = 0.03;
        Stepper stepper(system, force, Rk4{}, {.step = step});
        const int steps = static_cast<int>(4 / step);
        double from = 0;
        for (int k = 0; k < steps; ++k) {
          if (k == steps - 1) from = y[0].position.x;
          stepper.step(y, k * step, step);
        }
        CHECK(std::abs(y[0].position.z - 0.03) < 1e-11);
        const double speed = (y[0].position.x - from) / step;
        if (beyond < 0) CHECK(std::abs(y[0].position.x) < 1e-6);
        CHECK(std::abs(y[0].velocity.x - speed) < 1e-2 * std::abs(speed) + 1e-12);
      }
    }
  }
}

TEST_CASE_TEMPLATE("a box stands still under one of any mass, and both sleep", Sys,
                   System<double, 2, Box<double>>, System<double, dynamic, Box<double>>) {
  constexpr Material<double> dead{.restitution = 0, .friction = 0.5};
  for (const double ratio : {1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8}) {
    CAPTURE(ratio);
    const std::array bodies{Body(Box{0.2, 0.2, 0.1}, 1.0, dead), Body(Box{0.2, 0.2, 0.1}, ratio, dead)};
    const auto system = [&] {
      if constexpr (Sys::bodies == dynamic) {
        return Sys({bodies.begin(), bodies.end()}, {floor_plane(dead)});
      } else {
        return Sys(bodies, {floor_plane(dead)});
      }
    }();
    typename Sys::State y;
    if constexpr (Sys::bodies == dynamic) y.body.resize(2);
    y[0].position = {0, 0, 0.1};
    y[1].position = {0.01, 0, 0.3001};
    const auto report = simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 2});
    CHECK(report.overruns == 0);
    for (int i = 0; i < 2; ++i) {
      CHECK(norm(y[i].position - Vec3<double>{0.01 * i, 0, 0.1 + 0.2 * i}) < 1e-8);
      CHECK(norm(y[i].velocity) == 0);
      CHECK(norm(y[i].angular_velocity) == 0);
    }
  }
}

TEST_CASE("a force that sets in wakes a body at once") {
  long calls = 0;
  const double fast = 8, slow = 1e-6;
  compare(1.5, Push{&calls, 1.0, fast}, 1e-9, nothing);
  // On smooth ground the least force moves a body, whatever the tolerance of its contacts.
  const Boxes system = boxes({.restitution = 0.2, .friction = 0});
  for (const double from : {0.0, 1.0}) {
    Stepper<Boxes, Push, Rk4> stepper(system, Push{&calls, from, slow}, Rk4{}, {.step = step});
    SystemState<double, 4> y = at_rest();
    for (int k = 0; k < 2000; ++k) stepper.step(y, k * step, step);
    const double t = 4 - from;
    CHECK(std::abs(y[3].position.x - 2 - 0.5 * slow * t * t) < 1e-2 * slow * t * t);
  }
}

TEST_CASE("a body that is pushed or moved by the program wakes its island alone") {
  long calls = 0;
  compare(2, Push{&calls}, 1e-8, [](double t, SystemState<double, 4>& y) {
    if (std::abs(t - 1) < 0.5 * step) y[0].velocity.x = 0.3;
  });
  compare(2, Push{&calls}, 1e-8, [](double t, SystemState<double, 4>& y) {
    if (std::abs(t - 1) < 0.5 * step) y[1].position.x += 5;  // what lay on it falls
  });

  const Boxes system = boxes();
  Stepper<Boxes, Push, Rk4> stepper(system, Push{&calls}, Rk4{}, {.step = step});
  SystemState<double, 4> y = at_rest();
  for (int k = 0; k < 500; ++k) stepper.step(y, k * step, step);
  y[3].velocity.x = 1;
  const SystemState<double, 4> before = y;
  for (int k = 500; k < 600; ++k) stepper.step(y, k * step, step);
  CHECK(y[3].position.x > 2.01);
  for (int i = 0; i < 3; ++i) CHECK(y[i] == before[i]);
}

TEST_CASE("a body that comes near wakes an island before it hits") {
  long calls = 0;
  compare(2, Push{&calls}, 1e-8, [](double t, SystemState<double, 4>& y) {
    if (std::abs(t - 1) < 0.5 * step) y[3].velocity = {-6, 0, 1.5};
  });
}

TEST_CASE("a body that passes near an island does not wake it") {
  const Boxes system = boxes();
  const auto calls_of_pass = [&](double gap) {
    long calls = 0;
    Stepper<Boxes, Push, Rk4> stepper(system, Push{&calls}, Rk4{}, {.step = step});
    SystemState<double, 4> y = at_rest();
    for (int k = 0; k < 500; ++k) stepper.step(y, k * step, step);
    // Up, along the stack's side, and down again: its flight could meet the stack at any time.
    y[3].position = {0.4 + 0.02 + gap, 0, 0.3};
    y[3].velocity = {0, 0, 1};
    const SystemState<double, 4> before = y;
    calls = 0;
    for (int k = 500; k < 590; ++k) stepper.step(y, k * step, step);
    for (int i = 0; i < 3; ++i) CHECK(y[i] == before[i]);
    return calls;
  };
  const long near = calls_of_pass(1e-4), far = calls_of_pass(1);
  CHECK(near == far);
}

TEST_CASE("a heap sleeps, though a ball in it spins a little: nothing would ever stop that") {
  using Shape = std::variant<Box<double>, Sphere<double>>;
  using Crowd = System<double, dynamic, Shape>;
  std::vector<Body<double, Shape>> bodies(15, Body<double, Shape>(Box{0.2, 0.2, 0.1}, 1.0, rough));
  bodies.emplace_back(Sphere{0.1}, 1.0, rough);
  const Crowd system{bodies, {floor_plane(rough)}};
  Crowd::State y;
  y.body.resize(16);
  int next = 0;
  for (int row = 0; row < 5; ++row) {  // a pyramid
    for (int i = 0; i < 5 - row; ++i) y[next++].position = {0.42 * i + 0.21 * row, 0, 0.1 + 0.2 * row};
  }
  y[15].position = {0.84, 0, 1.1};
  const auto rests_after = [&](double spin) {
    Crowd::State state = y;
    state[15].angular_velocity = {0, 0, spin};
    Stepper stepper(system, Gravity{}, Rk4{}, {.step = step});
    for (int k = 0; k < 1000; ++k) stepper.step(state, k * step, step);
    return std::all_of(state.body.begin(), state.body.end(), [](const RigidState<double>& body) {
      return squared_norm(body.velocity) + squared_norm(body.angular_velocity) == 0;
    });
  };
  CHECK(rests_after(2e-7));
  CHECK_FALSE(rests_after(1e-5));
}

TEST_CASE("what they rest on may go away, and move") {
  using World = System<double, 2, Box<double>>;
  const World system{{Body<double, Box<double>>::kinematic(Box{1.0, 1.0, 0.1}, rough),
                      Body(Box{0.2, 0.2, 0.1}, 1.0, rough)}};
  for (const bool moves : {false, true}) {
    SystemState<double, 2> y;
    y[1].position.z = 0.2;
    Stepper<World, Gravity<double>, Rk4> stepper(system, Gravity{}, Rk4{}, {.step = step});
    for (int k = 0; k < 500; ++k) stepper.step(y, k * step, step);
    CHECK(y[1].velocity == Vec3<double>{});
    if (moves) {
      y[0].velocity.x = 0.1;
    } else {
      y[0].position.x = 10;
    }
    for (int k = 500; k < 700; ++k) stepper.step(y, k * step, step);
    if (moves) {
      CHECK(std::abs(y[1].velocity.x - 0.1) < 1e-9);  // friction takes it along
    } else {
      CHECK(std::abs(y[1].position.z - 0.2 + 0.5 * 9.81 * 0.4 * 0.4) < 1e-9);
    }
  }
}

TEST_CASE("a copy of a stepper whose bodies sleep goes on to the same bits") {
  long calls = 0;
  const Boxes system = boxes();
  Stepper<Boxes, Push, Rk4> stepper(system, Push{&calls, 1.2, 8}, Rk4{}, {.step = step});
  SystemState<double, 4> y = at_rest();
  for (int k = 0; k < 500; ++k) stepper.step(y, k * step, step);
  auto copy = stepper;
  SystemState<double, 4> other = y;
  for (int k = 500; k < 800; ++k) {
    stepper.step(y, k * step, step);
    copy.step(other, k * step, step);
  }
  CHECK(y == other);
  CHECK(y[3].position.x > 2.01);
}

TEST_CASE("in a crowd one island wakes, and the others sleep on") {
  using Crowd = System<double, dynamic, Box<double>>;
  const Crowd system{std::vector(40, Body(Box{0.2, 0.2, 0.1}, 1.0, rough)), {floor_plane(rough)}};
  long calls = 0;
  const auto gravity = [&calls](const Body<double, Box<double>>& body, const RigidState<double>&, int,
                                double) {
    ++calls;
    return Wrench<double>{{0, 0, -9.81 * body.mass()}, {}};
  };
  Stepper<Crowd, decltype(gravity), Rk4> stepper(system, gravity, Rk4{}, {.step = step});
  Crowd::State y;
  y.body.resize(40);
  for (int i = 0; i < 40; ++i) y[i].position = {1.0 * (i % 8), 1.0 * (i / 8), 0.1};
  y[1].position = {0.02, 0, 0.3};  // on the first
  for (int k = 0; k < 500; ++k) stepper.step(y, k * step, step);
  calls = 0;
  for (int k = 500; k < 600; ++k) stepper.step(y, k * step, step);
  CHECK(calls == 100 * 40 * 4);
  y[1].velocity.x = 0.5;
  const Crowd::State before = y;
  for (int k = 600; k < 900; ++k) stepper.step(y, k * step, step);
  CHECK(y[1].position.x > 0.03);
  for (int i = 2; i < 40; ++i) CHECK(y[i] == before[i]);
}

TEST_CASE("a hit on the top of a sleeping stack wakes all of it within the step") {
  constexpr int boxes = 14;
  using Crowd = System<double, dynamic, Box<double>>;
  const Crowd system{std::vector(boxes + 1, Body(Box{0.2, 0.2, 0.1}, 1.0, rough)), {floor_plane(rough)}};
  // Forces on all bodies at once let none sleep.
  const auto awake = [](const Crowd& bodies, const Crowd::State& y, double,
                        std::span<Wrench<double>> wrenches) {
    for (int i = 0; i < y.size(); ++i)
      wrenches[static_cast<std::size_t>(i)].force = {0, 0, -9.81 * bodies[i].mass()};
  };
  Crowd::State start;
  start.body.resize(boxes + 1);
  for (int i = 0; i < boxes; ++i) start[i].position = {0, 0, 0.1 + 0.2 * i};
  start[boxes].position = {0, 0, 0.2 * boxes + 0.1 + 0.5};
  start[boxes].velocity.z = 2;  // up first: meanwhile the stack falls asleep
  const auto run = [&](const auto& forces) {
    Stepper<Crowd, std::decay_t<decltype(forces)>, Rk4> stepper(system, forces, Rk4{}, {.step = step});
    std::vector<Crowd::State> states{start};
    for (int k = 0; k < 300; ++k) {
      states.push_back(states.back());
      stepper.step(states.back(), k * step, step);
    }
    return states;
  };
  const auto sleeps = run(Gravity{}), truth = run(awake);
  double most = 0;
  bool hit = false;
  for (std::size_t k = 0; k < truth.size(); ++k) {
    hit = hit || truth[k][boxes].velocity.z > truth[k - (k > 0)][boxes].velocity.z;
    for (int i = 0; i < boxes; ++i) most = std::max(most, norm(sleeps[k][i].position - truth[k][i].position));
  }
  CHECK(hit);
  CHECK(sleeps[250][0] == sleeps[200][0]);  // asleep until then
  CHECK(most < 1e-8);
}

TEST_CASE("a kinematic body that the program puts into a sleeping one pushes it out") {
  using World = System<double, 2, Box<double>>;
  const World system{
      {Body<double, Box<double>>::kinematic(Box{0.1, 0.1, 0.1}, rough), Body(Box{0.1, 0.1, 0.1}, 1.0, rough)},
      {floor_plane(rough)}};
  const auto pushed = [&](const auto& forces) {
    SystemState<double, 2> y;
    y[0].position = {-1, 0, 0.3};
    y[1].position = {0, 0, 0.1};
    Stepper<World, std::decay_t<decltype(forces)>, Rk4> stepper(system, forces, Rk4{}, {.step = step});
    for (int k = 0; k < 500; ++k) {
      if (k >= 300) y[0].position = {-0.21 + 5e-4 * (k - 300), 0, 0.1};
      stepper.step(y, k * step, step);
    }
    return y[1].position.x;
  };
  const auto awake = [](const World& bodies, const SystemState<double, 2>&, double,
                        std::span<Wrench<double>> wrenches) {
    for (int i = 0; i < 2; ++i)
      wrenches[static_cast<std::size_t>(i)].force = {0, 0, -9.81 * bodies[i].mass()};
  };
  const double x = pushed(Gravity{});
  CHECK(x > 0.02);
  CHECK(std::abs(x - pushed(awake)) < 1e-6);
}

TEST_CASE("a body that begins to turn does not pass through a sleeping one") {
  using World = System<double, 2, AnyShape<double>>;
  const auto turn = [](const Body<double>& body, const RigidState<double>&, int i, double t) {
    const bool turns = i == 1 && t >= 1;
    return Wrench<double>{{0, 0, i == 0 ? -9.81 * body.mass() : 0.0}, {0, 0, turns ? 300.0 : 0.0}};
  };
  const World system{
      {Body<double>(Sphere{0.005}, 0.01, rough), Body<double>(Box{1.0, 0.003, 0.003}, 0.1, rough)},
      {floor_plane(rough)}};
  SystemState<double, 2> y;
  y[0].position = {0.9, 0.009, 0.005};
  y[1].position = {0, 0, 0.006};
  Stepper<World, decltype(turn), Rk4> stepper(system, turn, Rk4{}, {.step = step});
  for (int k = 0; k < 505; ++k) stepper.step(y, k * step, step);
  CHECK(y[0].position.y > 0.02);
}

TEST_CASE("a push that sets in at any step about falling asleep moves a body") {
  for (int from = 60; from < 160; ++from) {
    long calls = 0;
    const Boxes system = boxes();
    Stepper<Boxes, Push, Rk4> stepper(system, Push{&calls, from * step, 8}, Rk4{}, {.step = step});
    SystemState<double, 4> y = at_rest();
    for (int k = 0; k < from + 50; ++k) stepper.step(y, k * step, step);
    CHECK(y[3].position.x > 2.01);
  }
}

TEST_CASE("a plank that leans on a round bar rests") {
  using World = System<double, 2>;
  constexpr double thick = 0.006, from = 0.11, length = 0.084, round = 0.01;
  const double slope = 2 * std::atan(round / from);
  for (const double wide : {0.006, 0.03}) {
    for (const double h : {1e-2, 1e-3}) {
      CAPTURE(wide);
      CAPTURE(h);
      const World system{{Body<double>::kinematic(Capsule{round, 0.08}, rough),
                          Body<double>(Box{length, wide, thick}, 1.0, rough)},
                         {floor_plane(rough)}};
      SystemState<double, 2> y;
      y[0].position.z = round;
      y[0].orientation = quaternion_exp(Vec3<double>{std::numbers::pi / 2, 0, 0});
      y[1].orientation = quaternion_exp(Vec3<double>{0, -slope, 0});
      y[1].position = {-from + length * std::cos(slope) - thick * std::sin(slope), 0,
                       length * std::sin(slope) + thick * std::cos(slope) + 1e-5};
      Stepper stepper(system, Gravity{}, Rk4{}, SimulationOptions{.step = h});
      double time = 0;
      for (; time < 2; time += h) stepper.step(y, time, h);
      const auto before = y;
      for (; time < 3; time += h) stepper.step(y, time, h);
      CHECK(y == before);
    }
  }
}
