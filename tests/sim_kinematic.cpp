// Kinematic bodies, static ones among them, and pairs that do not collide.
#include <doctest/doctest.h>

#include <rbres/rbres.hpp>

#include "error_of.hpp"

using namespace rbres;

namespace {

const Gravity weightless{Vec3<double>{0, 0, 0}};
const ContactMode modes[] = {ContactMode::continuous, ContactMode::discrete};

template <class S>
std::array<AnyShape<S>, 3> shapes() {
  return {Sphere<S>{S(0.3)}, Box<S>{{S(0.5), S(0.4), S(0.2)}}, Capsule<S>{S(0.2), S(0.3)}};
}
template <class S>
RigidState<S> thrown(double x, double z, double speed) {
  RigidState<S> y;
  y.position = {as<S>(x), as<S>(0.03), as<S>(z)};
  y.orientation = normalized(Quat<S>{as<S>(0.1), as<S>(0.2), as<S>(-0.1), as<S>(1.0)});
  y.velocity = {as<S>(0.4), as<S>(-0.2), as<S>(speed)};
  y.angular_velocity = {as<S>(1.0), as<S>(-2.0), as<S>(0.5)};
  return y;
}

/// Three bodies, number `place` of them kinematic and between the two others, which are thrown at it.
template <class S>
System<S, 3> around(int place, const AnyShape<double>& shape, const AnyShape<double>& other,
                    const Material<double>& material, std::vector<Plane<S>> planes = {}) {
  const auto body = [&](int i) {
    return i == place ? Body<double>::kinematic(shape, material) : Body<double>(other, 0.5 + i, material);
  };
  return System<S, 3>({body(0).template cast<S>(), body(1).template cast<S>(), body(2).template cast<S>()},
                      std::move(planes));
}
template <class S>
SystemState<S, 3> thrown_at(int place) {
  SystemState<S, 3> y;
  double side = -1;
  for (int i = 0; i < 3; ++i) {
    if (i == place) continue;
    y[i] = thrown<S>(0.1 * side, side, -3 * side);
    side = 1;
  }
  return y;
}

/// A box as long as a floor, with its upper side at z = 0.
Body<double> table(const Material<double>& material) {
  return Body<double>::kinematic(Box{Vec3<double>{20, 20, 0.5}}, material);
}
RigidState<double> below() {
  RigidState<double> y;
  y.position.z = -0.5;
  return y;
}

/// Two bodies and a static one far away.
System<double, 3> with_third(const Body<double>& first, const Body<double>& second) {
  return System<double, 3>({first, second, Body<double>::kinematic(Sphere{0.1})});
}

}  // namespace

TEST_CASE("a kinematic body keeps its velocities to the bit, and has no energy, momentum or mass") {
  int impacts = 0;
  for (const auto& shape : shapes<double>()) {
    for (const auto& other : shapes<double>()) {
      for (const ContactMode mode : modes) {
        for (int place = 0; place < 3; ++place) {
          const auto system = around<double>(place, shape, other, {0.7, 0.4}, {floor_plane<double>()});
          auto y = thrown_at<double>(place);
          for (int i = 0; i < 3; ++i) y[i].position.z += 1.5;
          y[place].velocity = {0.05, 0.1, -0.02};
          y[place].angular_velocity = {0.3, -0.7, 1.1};
          const RigidState<double> start = y[place];
          const auto report =
              simulate(system, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 1, .contacts = mode});
          CHECK(report.status == SimulationStatus::finished);
          impacts += static_cast<int>(report.impacts);
          CHECK(y[place].velocity == start.velocity);
          CHECK(y[place].angular_velocity == start.angular_velocity);
          CHECK(norm(y[place].position - start.position - start.velocity) < 1e-12);
          CHECK(kinetic_energy(system[place], y[place]) == 0);
          CHECK(norm(angular_momentum(system[place], y[place])) == 0);
          CHECK(system[place].mass() == 0);
        }
      }
    }
  }
  CHECK(impacts > 200);
}

TEST_CASE("static bodies give no energy: every shape, material, mode and index") {
  double worst = 0;
  for (const auto& shape : shapes<double>()) {
    for (const auto& other : shapes<double>()) {
      for (const ContactMode mode : modes) {
        for (int place = 0; place < 3; ++place) {
          for (const double restitution : {0.0, 0.5, 1.0}) {
            for (const double friction : {0.0, 0.5}) {
              const auto system = around<double>(place, shape, other, {restitution, friction});
              auto y = thrown_at<double>(place);
              const double start = kinetic_energy(system, y);
              double last = start;
              simulate(system, y, weightless, Rk4{}, {.step = 1e-3, .duration = 0.6, .contacts = mode},
                       [&](double, const auto& now) {
                         const double energy = kinetic_energy(system, now);
                         worst = std::max(worst, (energy - last) / start);
                         last = energy;
                       });
              CHECK(last > 0);
              if (restitution < 1 && friction > 0) CHECK(last < 0.999 * start);
            }
          }
        }
      }
    }
  }
  CAPTURE(worst);
  CHECK(worst < 1e-10);  // of the integrator: a box that spins freely gains as much
}

TEST_CASE("on a static table bodies rest, slide and roll as on a plane") {
  constexpr double g = 9.81, mu = 0.4, speed = 2;
  for (const ContactMode mode : modes) {
    const SimulationOptions options{.step = 1e-3, .duration = 2, .contacts = mode};
    const System<double, 3> system(
        {Body<double>(Box{Vec3<double>{0.1, 0.15, 0.2}}, 3.0, Material<double>{0.2, mu}), table({0.2, mu}),
         Body<double>(Sphere{0.1}, 2.0, Material<double>{0.2, mu})});
    SystemState<double, 3> y;
    y[0].position = {0, 0, 0.2};
    y[0].velocity = {speed, 0, 0};
    y[1] = below();
    y[2].position = {0, 3, 0.1};
    y[2].velocity = {speed, 0, 0};
    CHECK(simulate(system, y, Gravity{}, Rk4{}, options).status == SimulationStatus::finished);
    // Sliding: v^2 / (2 mu g). Rolling: 5/7 of the speed, from the time when sliding ends.
    const double tolerance = mode == ContactMode::continuous ? 1e-6 : 5e-3;
    CHECK(y[0].position.x == doctest::Approx(speed * speed / (2 * mu * g)).epsilon(tolerance));
    CHECK(norm(y[0].velocity) < 1e-9);
    CHECK(y[2].velocity.x == doctest::Approx(5.0 / 7 * speed).epsilon(tolerance));
    CHECK(std::abs(y[0].position.z - 0.2) < 2e-5);
    CHECK(y[1] == below());
  }
}

TEST_CASE("a moving kinematic body drives others: paddle, conveyor, lift, turntable") {
  for (const ContactMode mode : modes) {
    const double tolerance = mode == ContactMode::continuous ? 1e-9 : 2e-3;
    const SimulationOptions options{.step = 1e-3, .duration = 1, .contacts = mode};
    {
      INFO("a paddle of speed u returns v as (1 + e) u + e v");
      for (const double restitution : {0.0, 0.6, 1.0}) {
        const auto system = with_third(Body<double>(Sphere{0.1}, 1.0, Material<double>{0, 0}),
                                       Body<double>::kinematic(Sphere{0.5}, {restitution, 0}));
        SystemState<double, 3> y;
        y[2].position.z = 100;
        y[0].position.z = 1;
        y[0].velocity.z = -2;
        y[1].velocity.z = 1;
        simulate(system, y, weightless, Rk4{}, options);
        CHECK(y[0].velocity.z == doctest::Approx((1 + restitution) * 1 + restitution * 2).epsilon(1e-9));
      }
    }
    {
      INFO("a conveyor speeds a box up by mu g until it moves along");
      const auto system = with_third(
          table({0, 0.5}), Body<double>(Box{Vec3<double>{0.1, 0.1, 0.05}}, 2.0, Material<double>{0, 0.5}));
      SystemState<double, 3> y;
      y[2].position.z = 100;
      y[0] = below();
      y[0].velocity.x = 1;
      y[1].position.z = 0.05;
      simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 0.1, .contacts = mode});
      CHECK(y[1].velocity.x == doctest::Approx(0.5 * 9.81 * 0.1).epsilon(tolerance));
      simulate(system, y, Gravity{}, Rk4{}, options);
      CHECK(y[1].velocity.x == doctest::Approx(1).epsilon(tolerance));
      CHECK(std::abs(y[1].position.z - 0.05) < 2e-5);
    }
    {
      INFO("a lift carries a box up");
      const auto system = with_third(
          Body<double>(Box{Vec3<double>{0.1, 0.1, 0.05}}, 2.0, Material<double>{0, 0.5}), table({0, 0.5}));
      SystemState<double, 3> y;
      y[2].position.z = 100;
      y[0].position.z = 0.05;
      y[1] = below();
      y[0].velocity.z = y[1].velocity.z = 0.3;
      simulate(system, y, Gravity{}, Rk4{}, options);
      CHECK(std::abs(y[0].position.z - 0.35) < 5e-5);
      CHECK(y[0].velocity.z == doctest::Approx(0.3).epsilon(tolerance + 0.05 * (mode == modes[1])));
    }
    {
      INFO("a turntable, its own x axis up, carries a box round");
      const auto system =
          with_third(Body<double>::kinematic(Box{Vec3<double>{0.5, 20, 20}}, {0, 0.8}),
                     Body<double>(Box{Vec3<double>{0.1, 0.1, 0.05}}, 2.0, Material<double>{0, 0.8}));
      SystemState<double, 3> y;
      y[2].position.z = 100;
      y[0] = below();
      y[0].orientation = normalized(Quat<double>{0, -1, 0, 1});
      const Vec3<double> spin = y[0].angular_velocity = rotate_back(y[0].orientation, {0.0, 0.0, 1.0});
      y[1].angular_velocity.z = 1;
      y[1].position = {0.5, 0, 0.05};
      y[1].velocity = {0, 0.5, 0};
      simulate(system, y, Gravity{}, Rk4{}, options);
      CHECK(y[0].angular_velocity == spin);
      const Vec3<double> expected{0.5 * std::cos(1.0), 0.5 * std::sin(1.0), 0.05};
      CHECK(norm(y[1].position - expected) < 2e-3);
      CHECK(norm(y[1].velocity) == doctest::Approx(0.5).epsilon(2e-3));
    }
  }
}

TEST_CASE_TEMPLATE("a box at the centre of a turntable takes up its spin", S, double, Pack<double, 4>) {
  for (const ContactMode mode : modes) {
    for (const double step : {1e-3, 2e-3, 1e-2}) {
      for (const double friction : {0.2, 0.6, 5.0}) {
        for (const double spin : {2.0, -0.5}) {
          CAPTURE(mode == modes[1]);
          CAPTURE(step);
          CAPTURE(friction);
          CAPTURE(spin);
          const Material<double> material{0, friction};
          const Body<double, Box<double>> on_it(Box{Vec3<double>{0.1, 0.1, 0.05}}, 1.0, material);
          const auto turntable = Body<double, Box<double>>::kinematic(Box{Vec3<double>{1, 1, 0.1}}, material);
          const System<S, 2, Box<S>> system({turntable.template cast<S>(), on_it.template cast<S>()});
          SystemState<S, 2> y;
          y[0].position.z = as<S>(-0.1);
          y[0].angular_velocity.z = as<S>(spin);
          y[1].position.z = as<S>(0.05);
          Stepper stepper(system, Gravity{}, Rk4{}, {.step = step, .contacts = mode});
          for (int i = 0; i * step < 1; ++i) stepper.step(y, S(0), as<S>(step));
          const S off = y[1].angular_velocity.z - as<S>(spin), fell = y[1].position.z - as<S>(0.05);
          CHECK(all(square(off) < as<S>(1e-12)));
          CHECK(all(square(fell) < as<S>(1e-8)));
        }
      }
    }
  }
}

TEST_CASE("a heavy box on a light one on a table, whatever the table's index") {
  const Body<double> light(Box<double>{Vec3<double>{0.2, 0.2, 0.1}}, 1.0, Material<double>{0, 0.5});
  const Body<double> heavy(Box<double>{Vec3<double>{0.15, 0.1, 0.1}}, 1000.0, Material<double>{0, 0.5});
  RigidState<double> first;
  for (int place = 0; place < 3; ++place) {
    const int lower = place == 0 ? 1 : 0, upper = 3 - place - lower;
    const auto body = [&](int i) { return i == place ? table({0, 0.5}) : i == lower ? light : heavy; };
    const System<double, 3> system({body(0), body(1), body(2)});
    SystemState<double, 3> y;
    y[place] = below();
    y[lower].position.z = 0.1;
    y[lower].velocity.x = 1;
    y[upper].position = {0.03, 0.02, 0.3};
    const auto report = simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 0.5});
    CHECK(report.overruns == 0);
    CHECK(std::abs(y[upper].position.z - 0.3) < 1e-6);
    CHECK(norm(y[upper].velocity) < 1e-6);
    if (place == 0) first = y[upper];
    CHECK(norm(y[upper].position - first.position) < 1e-9);
  }
}

TEST_CASE("what a press squeezes costs a bounded number of impacts, and is counted") {
  const double height[] = {0.6, 0.4, 1.0};
  for (std::size_t k = 0; k < 3; ++k) {
    const System<double, 3> system = with_third(Body<double>(shapes<double>()[k], 1.0), table({0.5, 0.3}));
    const System<double, 3> pressed({system[0], system[1], system[2]}, {floor_plane<double>({0.5, 0.3})});
    SystemState<double, 3> y;
    y[0].position.z = height[k] / 2;
    y[1].position.z = height[k] + 0.505;
    y[1].velocity.z = -0.5;
    y[2].position.z = 100;
    const auto report = simulate(pressed, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 0.02});
    CHECK(report.status == SimulationStatus::finished);
    CHECK(report.overruns > 0);
    CHECK(report.impacts < 1000 * report.steps);
  }
}

TEST_CASE("lanes and float do the same") {
  using Lanes = Pack<double, 4>;
  for (const auto& shape : shapes<double>()) {
    for (const ContactMode mode : modes) {
      for (int place = 0; place < 3; ++place) {
        const SimulationOptions options{.step = 1e-3, .duration = 0.5, .contacts = mode};
        const auto system = around<double>(place, shape, Sphere{0.3}, {0.5, 0.4});
        auto single = thrown_at<double>(place);
        single[place].angular_velocity.z = 0.5;
        auto in_float = thrown_at<float>(place);
        in_float[place].angular_velocity.z = 0.5f;
        auto lanes = thrown_at<Lanes>(place);
        lanes[place].angular_velocity.z = Lanes(0.5);
        const auto lanes_system = system.cast<Lanes>();
        Stepper stepper(lanes_system, weightless, Rk4{}, options);
        for (int k = 0; k < 500; ++k) CHECK(stepper.step(lanes, Lanes(1e-3 * k), Lanes(1e-3)) == -1);
        simulate(system, single, weightless, Rk4{}, options);
        simulate(system.cast<float>(), in_float, weightless, Rk4{}, options);
        for (int i = 0; i < 3; ++i) {
          CHECK(std::abs(lanes[i].position.z[3] - single[i].position.z) < 1e-6);
          CHECK(std::abs(in_float[i].position.z - single[i].position.z) < 2e-2);
        }
        CHECK(lanes[place].angular_velocity.z[0] == 0.5);
      }
    }
  }
}

TEST_CASE("pairs without contact pass through one another, and only they") {
  const Body<double> ball(Sphere<double>{0.1}, 1.0, {1, 0});
  for (const ContactMode mode : modes) {
    const SimulationOptions options{.step = 1e-3, .duration = 1, .contacts = mode};
    // Ball 0 meets 2 and then 1 on its way along x; the floor lets ball 1 through.
    const System<double, 3> system({ball, ball, ball}, {floor_plane<double>({1, 0})}, {{2, 0}, {1, -1}});
    SystemState<double, 3> y;
    y[0].position = {0, 0, 1};
    y[2].position = {0.5, 0, 1};
    y[1].position = {1, 0, 1};
    y[0].velocity.x = 1.2;
    simulate(system, y, weightless, Rk4{}, options);
    CHECK(y[2].position.x == 0.5);
    CHECK(y[0].position.x == doctest::Approx(0.8).epsilon(1e-3));
    CHECK(y[1].velocity.x == doctest::Approx(1.2));
    y[0].velocity = y[1].velocity = {0, 0, -2};
    simulate(system, y, weightless, Rk4{}, options);
    CHECK(y[0].velocity.z == doctest::Approx(2));
    CHECK(y[1].position.z == doctest::Approx(-1));
    CHECK(contacts(system, y).begin() == std::default_sentinel);
    CHECK(!system.collides(-1, 1));
    CHECK(!system.cast<float>().collides(0, 2));
    CHECK(system.collides(0, 1));
  }
}

TEST_CASE("what does not move may overlap what does not move") {
  const Body<double> block = Body<double>::kinematic(Box{Vec3<double>{1, 1, 1}});
  const System<double, 3> system({block, Body<double>(Sphere{0.1}, 1.0), block}, {floor_plane<double>()});
  SystemState<double, 3> y;
  y[1].position.z = 3;
  y[2].position.x = 0.5;
  for (const ContactMode mode : modes) {
    auto end = y;
    CHECK(simulate(system, end, Gravity{}, Rk4{}, {.duration = 0.1, .contacts = mode}).impacts == 0);
    CHECK(end[0] == y[0]);
  }
  y[1].position.z = 1.05;
  CHECK(error_of([&] { simulate(system, y, Gravity{}, Rk4{}, {}); }).find("overlap") != std::string::npos);
}

TEST_CASE("many bodies on one table: sort and sweep leaves out what does not collide") {
  constexpr int N = 30, place = 20;
  const auto body = [](int i) {
    return i == place ? table({0.3, 0.3}) : Body<double>(Sphere{0.1}, 1.0, Material<double>{0.3, 0.3});
  };
  const auto system = [&]<int... I>(std::integer_sequence<int, I...>) {
    return System<double, N>({body(I)...}, {floor_plane<double>()}, {{1, 2}});
  }
  (std::make_integer_sequence<int, N>{});
  SystemState<double, N> y;
  for (int i = 0; i < N; ++i) y[i].position = {0.5 * i, 0, 0.11};
  y[2].position = y[1].position;
  y[place] = below();
  CHECK(simulate(system, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 0.5}).status ==
        SimulationStatus::finished);
  CHECK(y[2] == y[1]);
  for (int i = 0; i < N; ++i) CHECK((i == place || std::abs(y[i].position.z - 0.1) < 1e-5));
}

TEST_CASE("kinematic bodies and pairs that cannot be are refused") {
  CHECK(error_of([] { Body<double>::kinematic(Sphere{-1.0}); }) ==
        "body (sphere of radius -1 m, kinematic), sphere radius: expected a positive length, found -1");
  CHECK(error_of([] {
          Body<double>::kinematic(Sphere{1.0}, {2, 0});
        }).find("restitution") != std::string::npos);
  const auto body = Body<double>(Sphere{0.1}, 1.0);
  const std::vector<Plane<double>> planes{floor_plane<double>()};
  for (const PairWithoutContact& pair : std::vector<PairWithoutContact>{{0, 2}, {-2, 0}, {1, 1}, {-1, -1}}) {
    CHECK(error_of([&] {
            System<double, 2>({body, body}, planes, {pair});
          }).find("pair without contact") != std::string::npos);
  }
}
