#include <doctest/doctest.h>

#include <numbers>
#include <rbres/rbres.hpp>

#include "../examples/common/count_allocations.hpp"

using namespace rbres;

namespace {

const Material<double> dull{0.1, 0.5}, lively{0.8, 0.3};
constexpr auto nothing = [](const auto&, const auto&) { return Wrench<double>{}; };

/// A sphere, a box and a capsule above a floor.
System<double, 3> mixed(const Material<double>& m) {
  return {{Body{Sphere{0.1}, 1.0, m}, Body{Box{0.2, 0.1, 0.1}, 2.0, m}, Body{Capsule{0.1, 0.2}, 1.5, m}},
          {floor_plane(m)}};
}
SystemState<double, 3> falling() {
  SystemState<double, 3> y;
  for (int i = 0; i < 3; ++i) {
    y[i].position = {0.1 * i, 0.05 * i, 0.4 + 0.5 * i};
    y[i].orientation = normalized(Quat<double>{0.1, 0.3, -0.2, 0.9});
    y[i].angular_velocity = {1, 2, -1};
  }
  return y;
}
std::string refusal_of(const System<double, 3>& system, SystemState<double, 3> y,
                       const SimulationOptions& options = {}) {
  try {
    simulate(system, y, Gravity{}, Rk4{}, options);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("bad states and options are refused, and the message names them") {
  const auto system = mixed(dull);
  auto y = falling();
  CHECK(refusal_of(system, y, {.duration = 0.01}) == "");
  y[1].velocity.y = NAN;
  CHECK(refusal_of(system, y) == "body 1, velocity y: expected a finite number, found nan");
  y = falling();
  y[2].position.x = INFINITY;
  CHECK(refusal_of(system, y) == "body 2, position x: expected a finite number, found inf");
  y = falling();
  y[2].orientation = {0, 0, 0, 0};
  CHECK(refusal_of(system, y) == "body 2, orientation: expected a unit quaternion, found one of length 0");
  y = falling();
  y[1].position = y[0].position;
  CHECK(refusal_of(system, y).starts_with(
      "body 1 and body 0: expected surfaces apart or touching, found an overlap of "));
  y = falling();
  y[0].position.z = 0;
  CHECK(refusal_of(system, y) ==
        "body 0 and plane 0: expected surfaces apart or touching, found an overlap of 0.1 m");
  y = falling();
  CHECK(refusal_of(system, y, {.step = -1}) == "step: expected a positive time in s, found -1");
  CHECK(refusal_of(system, y, {.duration = -1}) == "duration: expected a time of 0 s or more, found -1");
  CHECK(refusal_of(system, y, {.sample_rate = -1}) ==
        "sample rate: expected a frequency of 0 Hz or more, found -1");
  CHECK(refusal_of(system, y, {.sample_rate = 1e-310}).starts_with("sample rate: "));  // no finite period
  CHECK(refusal_of(system, y, {.step = 1e-310, .duration = 0}).starts_with("step: "));
  CHECK(refusal_of(system, y, {.rest_speed = -1}) == "rest speed: expected 0 m/s or more, found -1");
  CHECK(refusal_of(system, y, {.max_events = 0}) == "max events: expected 1 or more, found 0");
}

TEST_CASE("a number that is not finite stops the run and leaves the last good state") {
  const System<double, 2, Sphere<double>> system{{Body{Sphere{0.1}, 1.0}, Body{Sphere{0.1}, 1.0}}};
  SystemState<double, 2> y;
  y[1].position.x = 1;
  const auto burst = [](const auto&, const auto&, int index, double t) {
    return Wrench<double>{{index == 1 && t > 0.05 ? NAN : 1.0, 0, 0}, {}};
  };
  const auto report = simulate(system, y, burst, Rk4{}, {.step = 0.01, .duration = 1});
  CHECK(report.status == SimulationStatus::non_finite);
  CHECK(report.bad_body == 1);
  CHECK(report.steps == 5);
  CHECK(report.time == doctest::Approx(0.05));
  CHECK(y[0].velocity.x == doctest::Approx(0.05));
  CHECK(y[1].velocity.x == doctest::Approx(0.05));
}

TEST_CASE("samples come at their times, and an observer changes no bit and may stop the run") {
  const auto system = mixed(lively);
  auto plain = falling(), watched = falling(), stopped = falling();
  const SimulationOptions options{.step = 3e-3, .duration = 1, .sample_rate = 50};
  simulate(system, plain, Gravity{}, Rk4{}, options);
  int samples = 0;
  const auto report = simulate(system, watched, Gravity{}, Rk4{}, options, [&](double time, const auto&) {
    CHECK(time == doctest::Approx(samples / 50.0));
    ++samples;
  });
  CHECK(samples == 51);
  CHECK(report.steps == 350);
  CHECK(plain == watched);
  auto unwatched = falling();
  const double step = whole_step(options);
  Stepper stepper(system, Gravity{}, Rk4{}, options);
  for (long k = 0; k < report.steps; ++k) stepper.step(unwatched, static_cast<double>(k) * step, step);
  CHECK(unwatched == watched);
  const auto early = simulate(system, stopped, Gravity{}, Rk4{}, options,
                              [](double time, const auto&) { return time < 0.5; });
  CHECK(early.status == SimulationStatus::stopped);
  CHECK(early.time == doctest::Approx(0.5));
}

TEST_CASE("a step allocates nothing") {
  for (const auto mode : {ContactMode::continuous, ContactMode::discrete}) {
    const auto system = mixed(lively);
    auto y = falling();
    Stepper stepper(system, Gravity{}, Rk4{}, SimulationOptions{.contacts = mode});
    const long before = allocations;
    for (int i = 0; i < 2000; ++i) stepper.step(y, 1e-3 * i, 1e-3);
    CHECK(allocations == before);
    CHECK(stepper.tally().impacts > 0);
  }
}

TEST_CASE("everything comes to rest on the floor and on one another, and stays") {
  const auto system = mixed(dull);
  auto y = falling();
  y[1] = {{0, 0, 0.1}, {}, {}, {}};                                      // a box on the floor,
  y[2] = {{0, 0, 0.3}, {0, std::sqrt(0.5), 0, std::sqrt(0.5)}, {}, {}};  // a capsule lying on it
  y[0].position = {2, 0, 0.1};
  y[0].angular_velocity = {};
  const auto start = y;
  const auto report = simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 2});
  CHECK(report.overruns == 0);
  for (int i = 0; i < 3; ++i) CHECK(norm(y[i].position - start[i].position) < 1e-8);
}

TEST_CASE("a tumbling box settles on the floor without losing itself in events") {
  const System<double, 1, Box<double>> system{{Body{Box{0.2, 0.1, 0.1}, 2.0, Material<double>{0.9, 0.3}}},
                                              {floor_plane(Material<double>{0.9, 0.3})}};
  for (std::uint64_t i = 0; i < 10; ++i) {
    Random r(1, i);
    SystemState<double, 1> y;
    y[0].position.z = 1;
    y[0].velocity = {r.normal(), r.normal(), r.normal()};
    y[0].angular_velocity = {3 * r.normal(), 3 * r.normal(), 3 * r.normal()};
    const auto report = simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 8});
    CHECK(report.overruns == 0);
    CHECK(norm(y[0].velocity) < 1e-9);
    CHECK(std::min(std::abs(y[0].position.z - 0.1), std::abs(y[0].position.z - 0.2)) < 1e-8);
  }
}

TEST_CASE("a stack of boxes stands") {
  constexpr int N = 10;
  const auto system =
      System<double, N, Box<double>>::of(Body{Box{0.1, 0.1, 0.1}, 1.0, dull}, {floor_plane(dull)});
  SystemState<double, N> y;
  for (int i = 0; i < N; ++i) y[i].position = {0.01 * (i % 2), 0.005 * (i % 3), 0.1 + 0.2 * i};
  const auto start = y;
  simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 0.5});
  for (int i = 0; i < N; ++i) CHECK(norm(y[i].position - start[i].position) < 1e-8);
}

TEST_CASE("spheres rest in the corner of a room") {
  const auto system =
      System<double, 2, Sphere<double>>::of(Body{Sphere{0.1}, 1.0, dull}, room(0.25, 2.0, dull));
  SystemState<double, 2> y;
  y[0].position = {0.15, 0.15, 0.1};
  y[1].position = {-0.05, 0.15, 0.1};
  const auto start = y;
  const auto report = simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 2});
  CHECK(report.overruns == 0);
  for (int i = 0; i < 2; ++i) CHECK(norm(y[i].position - start[i].position) < 1e-9);
}

TEST_CASE("nothing tunnels: shots at a thin plate and at a ball, in one step") {
  const System<double, 2> plate{{Body{Box{0.005, 1.0, 1.0}, 1.0, dull}, Body{Sphere{0.01}, 0.1, dull}}};
  const auto balls = System<double, 2, Sphere<double>>::of(Body{Sphere{0.01}, 1.0, dull});
  for (std::uint64_t i = 0; i < 200; ++i) {
    CAPTURE(i);
    Random r(9, i);
    SystemState<double, 2> y;
    y[0].angular_velocity.x = r.uniform(-1, 1);
    y[1].position = {-5 - r.uniform(), r.uniform(-0.7, 0.7), r.uniform(-0.7, 0.7)};
    y[1].velocity = {1000, r.uniform(-20, 20), r.uniform(-20, 20)};
    CHECK(simulate(plate, y, nothing, Rk4{}, {.step = 0.01, .duration = 0.01}).impacts > 0);
    SystemState<double, 2> z;
    z[1].position = {-5 - r.uniform(), r.uniform(0, 0.0199), 0};
    z[1].velocity = {1000, 0, 0};
    CHECK(simulate(balls, z, nothing, Rk4{}, {.step = 0.01, .duration = 0.01}).impacts == 1);
  }
}

TEST_CASE(
    "nothing tunnels: a blade that sweeps through a ball, a drop in one long step, a ball pushed by "
    "another") {
  const System<double, 2> blade{{Body{Box{1.0, 2e-4, 0.1}, 1e3}, Body{Sphere{2e-4}, 1e-3}}};
  SystemState<double, 2> y;
  y[0].angular_velocity = {0, 0, 100};
  y[1].position = {0.02, 9e-4, 0};
  CHECK(simulate(blade, y, nothing, Rk4{}, {.step = 1e-3, .duration = 0.01}).impacts > 0);

  const System<double, 1, Sphere<double>> drop{{Body{Sphere{0.1}, 1.0}}, {floor_plane<double>()}};
  SystemState<double, 1> z;
  z[0].position.z = 0.2;
  simulate(drop, z, Gravity{}, Rk4{}, {.step = 10, .duration = 10});
  CHECK(z[0].position.z > 0.0999);

  const Material<double> smooth{0, 0};
  const System<double, 3, Sphere<double>> row{
      {Body{Sphere{0.1}, 1.0, smooth}, Body{Sphere{0.002}, 1e-4, smooth}, Body{Sphere{0.002}, 1e-4, smooth}}};
  SystemState<double, 3> w;
  w[1].position.x = 0.102;
  w[2].position.x = 0.1061;
  const auto push = [](const auto&, const auto&, int index, double) {
    return Wrench<double>{{index == 0 ? 1000.0 : 0.0, 0, 0}, {}};
  };
  simulate(row, w, push, Rk4{}, {.step = 5e-3, .duration = 0.1});
  CHECK(w[2].position.x - w[1].position.x > 0.004 * 0.999);
}

TEST_CASE("a run ends at its duration, however it is sampled") {
  const System<double, 1, Sphere<double>> system{{Body{Sphere{0.1}, 1.0}}};
  for (const double rate : {0.0, 1e-11, 1.0, 7.0, 300.0, 5000.0}) {
    CAPTURE(rate);
    SystemState<double, 1> y;
    const auto report =
        simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 0.4321, .sample_rate = rate});
    CHECK(report.time == 0.4321);
    CHECK(y[0].velocity.z == doctest::Approx(-9.81 * 0.4321).epsilon(1e-12));
  }
}

TEST_CASE("a normal that is nearly unit makes no energy") {
  const Material<double> elastic{1, 0};
  const System<double, 1, Sphere<double>> system{{Body{Sphere{0.1}, 1.0, elastic}},
                                                 {Plane<double>{{0, 0, 1 + 9e-6}, 0, elastic}}};
  SystemState<double, 1> y;
  y[0].position.z = 0.2;
  simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 5});
  CHECK(energy(system, y, {0, 0, -9.81}) == doctest::Approx(9.81 * 0.2).epsilon(1e-12));
}

TEST_CASE("a row of touching balls hands a blow to the last") {
  constexpr int N = 20;
  const auto system = System<double, N, Sphere<double>>::of(Body{Sphere{0.1}, 1.0, Material<double>{1, 0}});
  SystemState<double, N> y;
  for (int i = 1; i < N; ++i) y[i].position.x = 0.2 * i;
  y[0].position.x = -0.3;
  y[0].velocity.x = 1;
  simulate(system, y, nothing, Rk4{}, {.step = 1e-3, .duration = 0.5});
  CHECK(y[N - 1].velocity.x == doctest::Approx(1).epsilon(1e-9));
  for (int i = 0; i < N - 1; ++i) CHECK(std::abs(y[i].velocity.x) < 1e-9);
}

TEST_CASE("continuous contact: free flight and impacts do not depend on the step") {
  const auto run = [](double step) {
    auto y = falling();
    for (int i = 0; i < 3; ++i) y[i].position.x = i;
    simulate(mixed(lively), y, Gravity{}, Rk4{}, {.step = step, .duration = 0.6});
    return y;
  };
  const auto coarse = run(2e-3), fine = run(2.5e-4);
  for (int i = 0; i < 3; ++i) CHECK(norm(coarse[i].position - fine[i].position) < 1e-6);
}

TEST_CASE("a step past its event cap is finished discretely, and counted") {
  const System<double, 1, Sphere<double>> system{{Body{Sphere{0.1}, 1.0, lively}}, {floor_plane(lively)}};
  SystemState<double, 1> y;
  y[0].position.z = 0.15;
  y[0].velocity.z = -1;
  const auto report = simulate(system, y, nothing, Rk4{}, {.step = 0.1, .duration = 0.1, .max_events = 1});
  CHECK(report.overruns == 1);
  CHECK(y[0].velocity.z == doctest::Approx(0.8).epsilon(1e-12));
  CHECK(std::abs(y[0].position.z - 0.14) < 0.8 * 0.05 / 15);  // it bounces at the floor, in parts of a step
}

TEST_CASE("an elastic contact bounces however slow it is") {
  const Material<double> elastic{1, 0};
  const System<double, 1, Sphere<double>> system{{Body{Sphere{0.1}, 1.0, elastic}}, {floor_plane(elastic)}};
  SystemState<double, 1> y;
  y[0].position.z = 0.1001;
  y[0].velocity.z = -1e-3;
  simulate(system, y, nothing, Rk4{}, {.step = 0.01, .duration = 0.2});
  CHECK(y[0].velocity.z == doctest::Approx(1e-3).epsilon(1e-12));
}

TEST_CASE("a ball rolls down a slope at 5/7 of the pull") {
  const double s = std::sin(0.3), c = std::cos(0.3);
  const System<double, 1, Sphere<double>> system{{Body{Sphere{0.1}, 1.0, lively}},
                                                 {Plane<double>{{s, 0, c}, 0, lively}}};
  SystemState<double, 1> y;
  y[0].position = {0.1 * s, 0, 0.1 * c};
  simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 2});
  CHECK(norm(y[0].velocity) == doctest::Approx(5.0 / 7 * 9.81 * s * 2).epsilon(1e-9));
}

TEST_CASE("a rod that tips over: energy is kept on a smooth floor, its end stays on a rough one") {
  const auto tip = [](double friction, double step) {
    const Material<double> m{0, friction};
    const System<double, 1, Capsule<double>> system{{Body{Capsule{0.1, 0.5}, 1.0, m}}, {floor_plane(m)}};
    SystemState<double, 1> y;
    y[0].orientation = {0, std::sin(0.25), 0, std::cos(0.25)};
    y[0].position.z = 0.1 + 0.5 * std::cos(0.5);
    y[0].angular_velocity = {0.3, 0, 0.5};
    const double before = energy(system, y, {0, 0, -9.81});
    simulate(system, y, Gravity{}, Rk4{}, {.step = step, .duration = 0.4});
    return std::pair{y[0], energy(system, y, {0, 0, -9.81}) - before};
  };
  CHECK(std::abs(tip(0, 1e-3).second) < 5e-6);
  CHECK(norm(tip(1, 2e-3).first.position - tip(1, 5e-4).first.position) < 5e-5);
}

TEST_CASE("an impact whose friction is too strong to be solved makes no energy") {
  // A capsule that meets a slope and another capsule at once. Without a third body, which is far away, the
  // impulses of Newton's method went to 1e28 N s and back.
  for (const double friction : {0.3, 1.0, 10.0, 100.0, 200.0, 300.0, 500.0, 900.0, 1000.0, 2000.0, 9000.0}) {
    CAPTURE(friction);
    const Material<double> rough{0, friction};
    const double a = 0.14190175856343074, b = 0.070386231530792598;
    const System<double, 3> system{
        {Body{Capsule{a * 0.43176560318863616, a}, 1.0, rough},
         Body{Capsule{b * 0.79746058195249314, b}, 1.0, rough}, Body{Sphere{0.1}, 1.0, rough}},
        {{{0.94553114479551448, 0, 0.32553164857150801}, 0, rough}}};
    SystemState<double, 3> y;
    y[0].position = {-0.076599687979968231, -0.24289009474342096, 0.47124149530517445};
    y[0].orientation = {-0.90058853308887088, -0.16868154251193354, -0.14118131266470982,
                        -0.37490621259042944};
    y[0].velocity = {0.35820644117493533, -0.14656997315519837, -2.4035089498981659};
    y[0].angular_velocity = {9.3854602419407094, 1.2765079323389905, -3.4919275262651235};
    y[1].position = {-0.1364854011085003, -0.034355158440042194, 0.69520109122335461};
    y[1].orientation = {-0.71147506536248029, 0.54883472772415132, -0.42696517321705302,
                        -0.10141209923447542};
    y[1].velocity = {0.66912507458889414, -0.3921481980145039, -2.1292243996973861};
    y[1].angular_velocity = {-1.3639199614055464, 5.9158418295791559, -16.607979827059232};
    y[2].position = {10, 0, 0};
    const double before = kinetic_energy(system, y);
    Stepper stepper(system, Gravity{Vec3<double>{}}, Rk4{}, SimulationOptions{});
    for (int i = 0; i < 5; ++i) CHECK(stepper.step(y, 0.0, 1e-3) == -1);
    CHECK(kinetic_energy(system, y) <= before * (1 + 1e-12));
    CHECK(stepper.tally().impacts > 0);
  }
}

TEST_CASE("a capsule that turns fast on its side on a smooth floor keeps its energy") {
  const Material<double> smooth{0, 0};
  const System<double, 1, Capsule<double>> system{{Body{Capsule{0.1, 0.2}, 1.0, smooth}},
                                                  {floor_plane(smooth)}};
  SystemState<double, 1> y;
  y[0].position.z = 0.1;
  y[0].orientation = {0, std::sqrt(0.5), 0, std::sqrt(0.5)};
  y[0].angular_velocity = {14, 0, 14};  // rad/s about its own axis and the vertical
  const double before = kinetic_energy(system, y);
  simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 5});
  CHECK(kinetic_energy(system, y) == doctest::Approx(before).epsilon(1e-11));
}

TEST_CASE("what a stepper knows of the step before changes no motion") {
  const Material<double> rough{0, 0.3};
  const System<double, 1, Capsule<double>> system{{Body{Capsule<double>{0.1, 0.2}, 1.0, rough}},
                                                  {floor_plane(rough)}};
  SystemState<double, 1> y;
  y[0].position.z = 0.1;
  y[0].orientation = {0, std::sqrt(0.5), 0, std::sqrt(0.5)};
  y[0].velocity = {1, 0.5, 0};
  y[0].angular_velocity = {14, 0, 5};
  auto other = y;
  Stepper stepper(system, Gravity{}, Rk4{}, SimulationOptions{});
  for (int k = 0; k < 200; ++k) {
    stepper.step(y, 1e-3 * k, 1e-3);
    Stepper anew(system, Gravity{}, Rk4{}, SimulationOptions{});
    anew.step(other, 1e-3 * k, 1e-3);
  }
  CHECK(norm(y[0].position - other[0].position) < 1e-12);
  CHECK(norm(y[0].angular_velocity - other[0].angular_velocity) < 1e-10);
}

TEST_CASE("a box that spins flat on a smooth floor with its axes turned does not lean, nor gain energy") {
  // Its principal axes want to wobble: the floor's torque turns with it.
  const Material<double> smooth{0, 0};
  const Eigen::Matrix3d turn = Eigen::Quaterniond(0.9, 0.2, -0.3, 0.1).normalized().toRotationMatrix();
  const Eigen::Matrix3d tensor = turn * Eigen::Vector3d(0.010, 0.014, 0.02).asDiagonal() * turn.transpose();
  const Body<double, Box<double>> body(Box<double>{0.2, 0.15, 0.1}, 1.0,
                                       Eigen::Matrix3d(0.5 * (tensor + tensor.transpose())), smooth);
  const System<double, 1, Box<double>> system{{body}, {floor_plane(smooth)}};
  const Vec3<double> gravity{0, 0, -9.81};
  SystemState<double, 1> y;
  y[0].position.z = 0.1;
  y[0].orientation = body.shape_rotation().conjugate();
  y[0].angular_velocity = rotate_back(y[0].orientation, Vec3<double>{0, 0, 10});
  Stepper stepper(system, Gravity{gravity}, Rk4{}, SimulationOptions{});
  double least = energy(system, y, gravity), rise = 0, lean = 0;
  for (int k = 0; k < 1000; ++k) {
    stepper.step(y, 1e-3 * k, 1e-3);
    rise = std::max(rise, energy(system, y, gravity) - least);
    least = std::min(least, energy(system, y, gravity));
    for (const auto& contact : contacts(system, y)) lean = std::max(lean, std::abs(contact.gap));
  }
  CHECK(lean < 1e-9);   // m; 3e-7 where a constant torque holds it
  CHECK(rise < 1e-11);  // J
}

TEST_CASE("a ball with three different moments gains no energy by rolling") {
  const Material<double> rough{0, 0.5};
  const System<double, 1, Sphere<double>> system{
      {Body<double, Sphere<double>>{Sphere{0.1}, 1.0, Vec3<double>{0.003, 0.004, 0.005}, rough}},
      {floor_plane(rough)}};
  SystemState<double, 1> y;
  y[0].position.z = 0.1;
  y[0].orientation = normalized(Quat<double>{0.1, 0.2, 0.3, 0.9});
  const Vec3<double> spin{2, 40, 4};  // rad/s, world frame
  y[0].angular_velocity = rotate_back(y[0].orientation, spin);
  y[0].velocity = cross(spin, Vec3<double>{0, 0, 0.1});
  Stepper stepper(system, Gravity{}, Rk4{}, SimulationOptions{});
  const double start = kinetic_energy(system, y);
  double least = start, rise = 0;
  for (int k = 0; k < 1000; ++k) {
    stepper.step(y, 1e-3 * k, 1e-3);
    rise = std::max(rise, kinetic_energy(system, y) - least);
    least = std::min(least, kinetic_energy(system, y));
  }
  CHECK(rise < 1e-13 * start);
}

TEST_CASE_TEMPLATE("smooth bodies that slide over one another do not drag each other", S, double,
                   Pack<double, 4>) {
  const Material<double> smooth{0, 0};
  for (const double size : {0.1, 0.07}) {
    for (const double force : {1e-8, 1e-6, 1e-4, 1.0}) {
      for (const double step : {1e-3, 1e-2}) {
        CAPTURE(size);
        CAPTURE(force);
        CAPTURE(step);
        const System<double, 3, Box<double>> stack{
            {Body{Box{0.1, 0.1, 0.1}, 1.0, smooth}, Body{Box{0.1, 0.1, 0.1}, 1.0, smooth},
             Body{Box{size, size, 0.1}, 1.0, smooth}},
            {floor_plane(smooth)}};
        SystemState<S, 3> y;
        for (int i = 0; i < 3; ++i) y[i].position = {S(0), S(0), S(0.1 + 0.2 * i)};
        const auto push = [&](const auto&, const auto&, int i, const S&) {
          return Wrench<S>{{S(0), S(i == 2 ? force : 0), S(0)}, {}};
        };
        constexpr double seconds = 0.2;
        const auto system = stack.template cast<S>();
        const Forces forces{Gravity{}, push};
        Stepper stepper(system, forces, Rk4{}, SimulationOptions{});
        for (int k = 0; k < std::lround(seconds / step); ++k) stepper.step(y, S(step * k), S(step));
        const double given = force * seconds;
        for (int i = 0; i < 3; ++i) {
          const MaskOf<S> near = square(y[i].velocity.y - S(i == 2 ? given : 0)) < S(square(0.02 * given));
          CHECK(all(near));
        }
      }
    }
  }
}

TEST_CASE("what friction stops in a groove has not climbed higher than its motion takes it") {
  const Material<double> m{0.5, 0.3};
  const double c = std::sqrt(0.5);
  const System<double, 1, Box<double>> system{
      {Body{Box{0.1, 0.08, 0.05}, 1.0, m}},
      {Plane<double>{{c, 0, c}, 0, m}, Plane<double>{{-c, 0, c}, 0, m}}};
  SystemState<double, 1> y;
  y[0].position = {0.021204915411445438, 0.0014494844310219638, 0.091932169581847994};
  y[0].orientation = normalized(
      Quat<double>{0.27063633583469271, -0.27055976338275833, -0.65326562263273413, 0.65329733999956219});
  y[0].velocity = {-0.0024698500368139221, -0.0017474818964922493, 0.0024698499945170252};
  y[0].angular_velocity = {-1.0237610759133986e-10, 0.034931178886051413, -3.0988103402740386e-10};
  const double before = energy(system, y, {0, 0, -9.81});
  for (const double step : {1e-3, 2e-3}) {
    auto now = y;
    simulate(system, now, Gravity{}, Rk4{}, {.step = step, .duration = step});
    CHECK(energy(system, now, {0, 0, -9.81}) <= before + 1e-13);
  }
}

TEST_CASE("what overlaps the floor a little is pushed out, with friction or without") {
  for (const double friction : {0.0, 0.3}) {
    const Material<double> m{0.5, friction};
    const System<double, 1, Box<double>> system{{Body{Box{0.1, 0.1, 0.1}, 1.0, m}}, {floor_plane(m)}};
    for (const double depth : {5e-5, 1e-6, 1e-8}) {
      SystemState<double, 1> y;
      y[0].position.z = 0.1 - depth;
      simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 1});
      CHECK(std::abs(y[0].position.z - 0.1) < 1e-10);
    }
  }
}

TEST_CASE("an overlap opens slowly however short the step") {
  const Vec3<double> gravity{0, 0, -9.81};
  const auto check_gain = [&](const auto& body, double height) {
    const System<double, 1, std::decay_t<decltype(body.shape())>> system{{body},
                                                                         {floor_plane(body.material())}};
    for (const double depth : {1e-4, 1e-6}) {
      for (const double h : {1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 1e-30}) {
        CAPTURE(depth);
        CAPTURE(h);
        SystemState<double, 1> y;
        y[0].position.z = height - depth;
        const double before = energy(system, y, gravity);
        Stepper stepper(system, Gravity{}, Rk4{}, SimulationOptions{.step = 1e-3});
        for (int k = 0; k < 100; ++k) stepper.step(y, k * h, h);
        // What pushes it out of the overlap, and the speed at which it leaves.
        CHECK(energy(system, y, gravity) - before <= 9.81 * body.mass() * 1.1 * depth);
      }
    }
  };
  for (const double friction : {0.0, 0.5}) {
    const Material<double> m{0.1, friction};
    check_gain(Body(Box{0.1, 0.1, 0.07}, 1.0, m), 0.07);
    check_gain(Body(Sphere{0.1}, 1.0, m), 0.1);
    check_gain(Body(Box{10.0, 10.0, 7.0}, 1.0, m), 7.0);
  }
}

TEST_CASE("edges that slide deeper while their face's points leave cost no events") {
  const Material<double> smooth{0, 0};
  const System<double, 2, Box<double>> system{
      {Body{Box{0.8990125785, 0.5815346952, 0.4871734605}, 3.7, smooth},
       Body{Box{0.409997095, 0.687683536, 0.5102210245}, 3.6, smooth}}};
  for (const double side : {1.0, -1.0}) {
    CAPTURE(side);
    const auto mirrored = [&](RigidState<double> y) {
      y.position.y *= side;
      y.orientation.x *= side;
      y.orientation.z *= side;
      y.velocity.y *= side;
      y.angular_velocity.x *= side;
      y.angular_velocity.z *= side;
      return y;
    };
    SystemState<double, 2> y;
    y[0] =
        mirrored({{0.821741933397, -0.247420768234, -0.511784160918},
                  normalized(Quat<double>{0.0704733561104, -0.0866048819139, 0.943697302939, 0.311397657237}),
                  {-0.412493144789, -0.688656641974, -3.6402266386},
                  {-3.36334816813, 0.593162652311, 2.17410636443}});
    y[1] =
        mirrored({{-0.418100776215, 0.811801750053, -0.308807950851},
                  normalized(Quat<double>{-0.636147030775, -0.267057497107, -0.634135012911, 0.349098888391}),
                  {0.471755788719, -0.775472978882, -2.22390766311},
                  {4.40357291627, -0.505980668172, -1.78713869858}});
    const auto report = simulate(system, y, nothing, Rk4{}, {.step = 3.65e-4, .duration = 1.1e-3});
    CHECK(report.overruns == 0);
  }
}

TEST_CASE("discrete contact: bodies do not sink, a bounce keeps its restitution to the step") {
  const System<double, 1, Sphere<double>> system{{Body{Sphere{0.1}, 1.0, lively}}, {floor_plane(lively)}};
  SystemState<double, 1> y;
  y[0].position.z = 1.1;
  double top = 0;
  simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-4, .duration = 3, .contacts = ContactMode::discrete},
           [&](double time, const auto& now) {
             CHECK(now[0].position.z > 0.0999);
             if (time > 0.5 && time < 1.2) top = std::max(top, now[0].position.z - 0.1);
           });
  CHECK(top == doctest::Approx(0.64).epsilon(1e-2));
}

TEST_CASE("discrete contact: two balls part by what they overlap, about their centre of mass") {
  const System<double, 2, Sphere<double>> system{
      {Body{Sphere{0.1}, 1.0, lively}, Body{Sphere{0.1}, 3.0, lively}}};
  SystemState<double, 2> y;
  y[0].position.x = -0.105;
  y[1].position.x = 0.105;
  y[0].velocity.x = 1;
  y[1].velocity.x = -1;
  simulate(system, y, nothing, Rk4{}, {.step = 0.01, .duration = 0.01, .contacts = ContactMode::discrete});
  CHECK(y[1].position.x - y[0].position.x == doctest::Approx(0.2).epsilon(1e-14));
  CHECK(y[0].position.x + 3 * y[1].position.x == doctest::Approx(2 * 0.095).epsilon(1e-14));
  CHECK(y[1].velocity.x - y[0].velocity.x == doctest::Approx(2 * 0.8).epsilon(1e-14));
}

TEST_CASE("discrete contact: what lies on the floor does not bounce from a step's fall") {
  const System<double, 1, Sphere<double>> system{{Body{Sphere{0.1}, 1.0, lively}}, {floor_plane(lively)}};
  SystemState<double, 1> y;
  y[0].position.z = 0.1;
  simulate(system, y, Gravity{}, Rk4{}, {.step = 0.01, .duration = 1, .contacts = ContactMode::discrete},
           [](double, const auto& now) {
             CHECK(std::abs(now[0].velocity.z) < 1e-12);
             CHECK(now[0].position.z == doctest::Approx(0.1).epsilon(1e-12));
           });
}

TEST_CASE("discrete contact: what is pushed into two others meets the nearer one first, however numbered") {
  // Cube 1 flies into cube 0, which is pushed into cubes 2 and 3.
  const Body cube(Box<double>{0.1, 0.1, 0.1}, 1.0, dull);
  System<double, 4, Box<double>> cubes{{cube, cube, cube, cube}};
  const auto end = [&](int near, int far) {
    SystemState<double, 4> y;
    y[1].position = {-0.2, 0, 0};
    y[1].velocity = {50, 0, 0};
    y[near].position = {0.205, 0.11, 0};
    y[far].position = {0.215, -0.11, 0};
    simulate(cubes, y, nothing, Rk4{}, {.step = 1e-3, .duration = 1e-3, .contacts = ContactMode::discrete});
    return y;
  };
  const auto a = end(2, 3), b = end(3, 2);
  CHECK(norm(a[2].position - b[3].position) < 1e-15);
  CHECK(norm(a[3].position - b[2].position) < 1e-15);
}

TEST_CASE("a body that is slow at both ends of a step and fast between meets what is in its way") {
  const Material<double> material{0.5, 0.3};
  const double h = 1e-2;
  for (const double angle : {2.0, 2.5, 2.7, std::numbers::pi}) {
    const double rate = angle / h;
    const System<double, 2> system{
        {Body<double>(Sphere{0.1}, 1.0, material), Body<double>::kinematic(Sphere{0.1}, material)}, {}};
    SystemState<double, 2> y;
    y[0].position = {1, 0, 0};
    y[1].position = {std::cos(angle) - 0.15, 0, 0};
    const auto spring = [&](const auto& body, const auto& state) {
      return body.is_kinematic() ? Wrench<double>{}
                                 : Wrench<double>{-rate * rate * body.mass() * state.position, {}};
    };
    const auto report = simulate(system, y, spring, DormandPrince54{}, {.step = h, .duration = h});
    CHECK(report.impacts == 1);
    CHECK(norm(y[1].position - y[0].position) > 0.2 - 1e-6);
  }
}

TEST_CASE("thin rods that spin flat on a floor stay finite") {
  // What their turn changes about the contacts' impulses is up to 400 times what these are.
  const auto run = [](double thickness, double spin, double friction) {
    CAPTURE(thickness);
    CAPTURE(friction);
    const Material<double> material{0, friction};
    const System<double, 1, Box<double>> world{
        {Body<double, Box<double>>(Box<double>{0.2, thickness, thickness}, 1.0, material)},
        {floor_plane(material)}};
    SystemState<double, 1> y;
    y[0].position.z = thickness;
    y[0].angular_velocity = {0, 0, spin};
    const double before = kinetic_energy(world[0], y[0]);
    const auto report = simulate(world, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 0.5});
    CHECK(report.status == SimulationStatus::finished);
    CHECK(kinetic_energy(world[0], y[0]) <= (1 + 1e-9) * before);
    if (friction == 0) CHECK(std::hypot(y[0].angular_velocity.x, y[0].angular_velocity.y) < 1e-3 * spin);
  };
  for (const double friction : {0.0, 0.3}) {
    run(0.01, 200, friction);
    run(0.001, 20, friction);
    run(0.0001, 5, friction);
  }
}

TEST_CASE("a step whose inverse is no number moves nothing and loses nothing") {
  const Material<double> material{0.3, 0.5};
  const System<double, 1, Box<double>> world{{Body(Box<double>{0.1, 0.1, 0.1}, 1.0, material)},
                                             {floor_plane(material)}};
  SystemState<double, 1> y;
  y[0].position.z = 0.1;
  y[0].velocity.x = 1;
  Stepper stepper(world, Gravity{}, Rk4{}, {.step = 1e-3});
  stepper.step(y, 0.0, 1e-3);
  const auto before = y;
  CHECK(stepper.step(y, 0.0, 1e-320) == -1);
  CHECK(y == before);
}
