#include <doctest/doctest.h>

#include <rbres/rbres.hpp>

#include "../examples/common/count_allocations.hpp"

using namespace rbres;

namespace {

using Vector = Vec3<double>;
using Parts = Compound<double, 5>;
using PartsBody = Body<double, Parts>;
constexpr ContactMode modes[] = {ContactMode::continuous, ContactMode::discrete};
const Vector down{0, 0, -9.81};

/// A leg of 0.4 m with a foot of 0.2 m.
const Parts ell{{Box{0.02, 0.05, 0.2}, {0, 0, 0}}, {Box{0.1, 0.05, 0.02}, {0.12, 0, -0.18}}};
const Parts table{{Box{0.5, 0.5, 0.02}, {0, 0, 0.4}},
                  {Box{0.02, 0.02, 0.2}, {0.4, 0.4, 0.18}},
                  {Box{0.02, 0.02, 0.2}, {-0.4, 0.4, 0.18}},
                  {Box{0.02, 0.02, 0.2}, {0.4, -0.4, 0.18}},
                  {Box{0.02, 0.02, 0.2}, {-0.4, -0.4, 0.18}}};
/// A square frame around a hole of 0.2 m.
const Parts ring{{Box{0.15, 0.025, 0.02}, {0, 0.125, 0}},
                 {Box{0.15, 0.025, 0.02}, {0, -0.125, 0}},
                 {Box{0.1, 0.025, 0.02}, {0.125, 0, 0}, {0, 0, std::sqrt(0.5), std::sqrt(0.5)}},
                 {Box{0.025, 0.1, 0.02}, {-0.125, 0, 0}}};

/// The state of a body whose parts' frame stands there.
RigidState<double> placed(const PartsBody& body, const Vector& at, const Quat<double>& turn = {}) {
  RigidState<double> y;
  y.orientation = turn * body.shape_rotation().conjugate();
  y.position = at - rotate(y.orientation, body.shape_origin());
  return y;
}
/// The same, of the frame of a body's parts.
Vector origin_of(const PartsBody& body, const RigidState<double>& y) {
  return y.point_world(body.shape_origin());
}
/// The deepest overlap, m; of bodies that touch nothing 0.
template <class System>
double deepest(const System& system, const typename System::State& y) {
  double most = 0;
  for (const auto& contact : contacts(system, y)) most = std::max(most, -contact.gap);
  return most;
}
/// The deepest at the end of all steps of a run, m.
template <class System>
double deepest_in_run(const System& system, typename System::State& y, const Vector& gravity,
                      const SimulationOptions& options) {
  double most = 0;
  const auto report = simulate(system, y, Gravity{gravity}, Rk4{}, options,
                               [&](double, const auto& now) { most = std::max(most, deepest(system, now)); });
  CHECK(report.status == SimulationStatus::finished);
  CHECK(report.overruns == 0);
  return most;
}
Quat<double> random_turn(Random& r) {
  return normalized(Quat<double>{r.normal(), r.normal(), r.normal(), r.normal()});
}
template <class State>
double difference(const State& a, const State& b) {
  return (a.vector() - b.vector()).norm();
}

}  // namespace

TEST_CASE("a compound of one part moves as its shape does") {
  const Material<double> material{0.4, 0.3};
  const std::vector<Plane<double>> planes{floor_plane(material), {{1, 0, 0}, -0.3, material}};
  const std::vector<AnyShape<double>> shapes{Sphere{0.1}, Box{0.1, 0.08, 0.05}, Capsule{0.05, 0.1}};
  using Plain = System<double, 3>;
  using Wrapped = System<double, 3, Parts>;
  const auto plain_of = [&](std::size_t i) { return Plain::BodyType(shapes[i], 1.0 + double(i), material); };
  const auto wrapped_of = [&](std::size_t i) {
    return PartsBody(Parts(shapes[i]), 1.0 + double(i), material);
  };
  const Plain plain{{plain_of(0), plain_of(1), plain_of(2)}, planes};
  const Wrapped wrapped{{wrapped_of(0), wrapped_of(1), wrapped_of(2)}, planes};
  for (const ContactMode mode : modes) {
    SystemState<double, 3> y;
    for (int i = 0; i < 3; ++i) {
      Random r(1, std::uint64_t(i));
      y[i].position = {0.02 * i, 0.01 * i, 0.3 + 0.3 * i};
      y[i].velocity = {-1, 0.1, 0};
      y[i].orientation = random_turn(r);
      y[i].angular_velocity = {1, 2.0 * i, 1};
    }
    auto z = y;
    const SimulationOptions options{.step = 2e-3, .duration = 1.5, .contacts = mode};
    const auto a = simulate(plain, y, Gravity{}, Rk4{}, options);
    const auto b = simulate(wrapped, z, Gravity{}, Rk4{}, options);
    CHECK(a.impacts > 20);
    CHECK(a.impacts == b.impacts);
    CHECK(y == z);
  }
}

TEST_CASE("a box in two halves falls, bounces and rests as the whole box does") {
  const Material<double> material{0.5, 0.3};
  const Parts halves{{Box{0.05, 0.1, 0.06}, {-0.05, 0, 0}}, {Box{0.05, 0.1, 0.06}, {0.05, 0, 0}}};
  const System<double, 1, Parts> cut{{PartsBody(halves, 1.0, material)}, {floor_plane(material)}};
  const System<double, 1, Parts> whole{{PartsBody(Parts(Box{0.1, 0.1, 0.06}), 1.0, material)},
                                       {floor_plane(material)}};
  for (const ContactMode mode : modes) {
    SystemState<double, 1> y;
    y[0].position = {0, 0, 0.5};
    y[0].orientation = quaternion_exp(Vector{0.3, 0.2, 0.1});
    y[0].velocity = {0.3, 0, 0};
    y[0].angular_velocity = {1, 2, 3};
    auto z = y;
    for (int k = 0; k < 20; ++k) {
      const SimulationOptions options{.step = 1e-3, .duration = 0.1, .contacts = mode};
      const auto a = simulate(whole, y, Gravity{}, Rk4{}, options);
      const auto b = simulate(cut, z, Gravity{}, Rk4{}, options);
      CHECK(difference(y, z) < 1e-9);
      if (mode == ContactMode::discrete) CHECK(a.impacts == b.impacts);
    }
    CHECK(y[0].position.z == doctest::Approx(0.1).epsilon(1e-3));  // it lies
  }
}

TEST_CASE("the order of the parts changes nothing but rounding") {
  const Material<double> material{0.3, 0.4};
  auto reversed = std::vector<Parts::Part>(table.parts().begin(), table.parts().end());
  std::reverse(reversed.begin(), reversed.end());
  for (const ContactMode mode : modes) {
    SystemState<double, 2> end[2];
    for (int k = 0; k < 2; ++k) {
      const PartsBody body(k == 0 ? table : Parts(reversed), 5.0, material);
      const System<double, 2, Parts> system{{body, PartsBody(Parts(Sphere{0.1}), 1.0, material)},
                                            {floor_plane(material)}};
      end[k][0] = placed(body, {0, 0, 0.05}, quaternion_exp(Vector{0.02, 0.01, 0.5}));
      end[k][1].position = {0, 0, 0.1};
      end[k][1].velocity = {2, 1, 0};
      simulate(system, end[k], Gravity{}, Rk4{}, {.step = 1e-3, .duration = 0.4, .contacts = mode});
    }
    // Both bodies have the same frame, but for which way the axes of equal moments point.
    CHECK(norm(end[0][0].position - end[1][0].position) < 1e-7);
    CHECK(norm(end[0][1].position - end[1][1].position) < 1e-7);
  }
}

TEST_CASE("a hook hangs in a hook") {
  const Material<double> material{0.3, 0.5};
  const System<double, 2, Parts> hooks{{PartsBody::kinematic(ell, material), PartsBody(ell, 1.0, material)}};
  for (const ContactMode mode : modes) {
    SystemState<double, 2> y;
    y[0] = placed(hooks[0], {});
    // Upside down, its foot over the other's foot.
    y[1] = placed(hooks[1], {0.27, 0, -0.3}, quaternion_exp(Vector{0, std::numbers::pi, 0}));
    const double deep = deepest_in_run(hooks, y, down, {.step = 2e-3, .duration = 3, .contacts = mode});
    CHECK(deep < (mode == ContactMode::continuous ? 1e-5 : 2e-3));
    CHECK(y[1].position.z > -0.27);  // without contact it would be 44 m below
    CHECK(norm(y[1].velocity) < 0.1);
  }
}

TEST_CASE("a ring falls over a peg, and a peg through it is caught") {
  const Material<double> material{0.2, 0.2};
  const Parts peg{{Box{0.05, 0.05, 0.2}, {0, 0, 0.2}}, {Box{0.3, 0.3, 0.02}, {0, 0, -0.02}}};
  const System<double, 2, Parts> system{
      {PartsBody::kinematic(peg, material), PartsBody(ring, 1.0, material)}};
  for (const ContactMode mode : modes) {
    SystemState<double, 2> y;
    y[0] = placed(system[0], {});
    y[1] = placed(system[1], {0.01, 0.02, 0.45}, quaternion_exp(Vector{0, 0, 0.3}));
    y[1].velocity = {0.1, 0, 0};
    double deep = deepest_in_run(system, y, down, {.step = 1e-3, .duration = 1, .contacts = mode});
    CHECK(y[1].position.z == doctest::Approx(0.02).epsilon(1e-3));  // it lies around the peg
    // Shoved, it stops at the peg.
    y[1].velocity = {3, 0, 0};
    deep = std::max(deep, deepest_in_run(system, y, down, {.step = 1e-3, .duration = 0.3, .contacts = mode}));
    CHECK(deep < (mode == ContactMode::continuous ? 1e-5 : 5e-3));
    CHECK(std::abs(y[1].position.x) < 0.1);
    CHECK(y[1].position.z < 0.1);
  }
}

TEST_CASE("a ball stays between the legs of a table") {
  const Material<double> material{0.9, 0.0};
  const System<double, 2, Parts> system{
      {PartsBody(table, 10.0, material), PartsBody(Parts(Box{0.36, 0.1, 0.1}), 1.0, material)},
      {floor_plane(material)}};
  for (const ContactMode mode : modes) {
    SystemState<double, 2> y;
    y[0] = placed(system[0], {0, 0, 0.02});
    y[1].position = {0, 0, 0.1};
    y[1].angular_velocity = {0, 0, 3};
    const double before = energy(system, y, down);
    const double deep = deepest_in_run(system, y, down, {.step = 1e-3, .duration = 2, .contacts = mode});
    CHECK(deep < (mode == ContactMode::continuous ? 2e-5 : 5e-3));
    CHECK(energy(system, y, down) < before + 1e-9);
    const Vector apart = rotate_back(y[0].orientation, y[1].position - y[0].position);
    CHECK(std::max(std::abs(apart.x), std::abs(apart.y)) < 0.4);
  }
}

TEST_CASE("what comes to an inner corner stays out of it") {
  const Material<double> material{0.0, 0.0};
  // A floor z = 0 and a wall x = 0.
  const Parts corner{{Box{0.5, 2.0, 0.1}, {0.4, 0, -0.1}}, {Box{0.1, 2.0, 0.5}, {-0.1, 0, 0.3}}};
  for (const ContactMode mode : modes) {
    for (int trial = 0; trial < 60; ++trial) {
      CAPTURE(trial);
      Random r(7, std::uint64_t(trial));
      const bool on_edge =
          trial == 0;  // an edge falls exactly into the corner, where it is in floor and wall
      const Parts falls = trial % 2 == 0 ? Parts(Box{0.1, 0.05, on_edge ? 0.1 : 0.07}) : ell;
      const System<double, 2, Parts> system{
          {PartsBody::kinematic(corner, material), PartsBody(falls, 1.0, material)}};
      SystemState<double, 2> y;
      y[0] = placed(system[0], {});
      y[1].position = {0.35, 0.02 * r.normal(), on_edge ? 0.35 : 0.4};
      y[1].orientation = on_edge ? quaternion_exp(Vector{0, std::numbers::pi / 4, 0}) : random_turn(r);
      double deep = 0;  // of the corners of its boxes, below the floor or behind the wall, m
      simulate(system, y, Gravity{Vector{-5, 0, on_edge ? -5.0 : -8.0}}, Rk4{},
               {.step = 1e-3, .duration = 1, .contacts = mode}, [&](double, const auto& now) {
                 const auto pose = shape_pose(system[1], now[1]);
                 for (std::size_t k = 0; k < falls.parts().size(); ++k) {
                   const auto at = part_pose(pose, falls.placed()[k]);
                   const auto& half = std::get<Box<double>>(falls.parts()[k].shape).half;
                   for (int i = 0; i < 8; ++i) {
                     const Vector p =
                         at.position + at.axes * Vector{i & 1 ? half.x : -half.x, i & 2 ? half.y : -half.y,
                                                        i & 4 ? half.z : -half.z};
                     deep = std::max({deep, -p.z, -p.x});
                   }
                 }
               });
      CHECK(deep < (mode == ContactMode::continuous ? 1e-5 : 1e-2));
      CHECK(y[1].position.z < 0.3);
    }
  }
}

TEST_CASE("what slides and rolls over the seams of a floor does not feel them") {
  const Material<double> material{0.5, 0.0};
  std::vector<Parts::Part> boards;
  for (int i = 0; i < 5; ++i) boards.push_back({Box{0.25, 0.5, 0.1}, {0.5 * i, 0, -0.1}});
  const Parts floor(boards);
  const Quat<double> lying{std::sqrt(0.5), 0, 0, std::sqrt(0.5)};
  const Parts sliders[] = {Parts(Box{0.1, 0.1, 0.05}),
                           Parts(Sphere{0.05}),
                           {{Capsule{0.05, 0.1}, {}, lying}},
                           {{Box{0.05, 0.1, 0.05}, {-0.05, 0, 0}}, {Box{0.05, 0.1, 0.05}, {0.05, 0, 0}}}};
  for (const Parts& slider : sliders) {
    const System<double, 2, Parts> system{
        {PartsBody::kinematic(floor, material), PartsBody(slider, 1.0, material)}};
    for (int k = 0; k < 60; ++k) {  // so that steps end at all distances from the seams
      const double speed = k == 0 ? 3 : 2 + 0.0229 * k;
      SystemState<double, 2> y;
      y[0] = placed(system[0], {});
      y[1] = placed(system[1], {0.01, 0.003, 0.05});
      y[1].velocity = {speed, 0.1, 0};
      const auto report = simulate(system, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 0.6});
      CHECK(report.impacts == 0);
      CHECK(norm(y[1].position - Vector{0.01 + 0.6 * speed, 0.063, 0.05}) < 1e-9);
      CHECK(norm(y[1].velocity - Vector{speed, 0.1, 0}) < 1e-9);
    }
  }
}

TEST_CASE("a part that turns far in a step misses nothing in its way") {
  const Material<double> material{1.0, 0.0};
  const Parts dumbbell{{Sphere{0.02}, {0.5, 0, 0}}, {Sphere{0.02}, {-0.5, 0, 0}}};
  const System<double, 2, Parts> system{
      {PartsBody(dumbbell, 1.0, material), PartsBody(Parts(Sphere{0.02}), 1.0, material)}};
  SystemState<double, 2> y;
  y[0] = placed(system[0], {});
  y[0].angular_velocity = rotate(system[0].shape_rotation(), Vector{0, 0, 80});  // 0.8 rad in a step
  y[1].position = {0.5 * std::cos(0.4), 0.5 * std::sin(0.4), 0};
  const auto report = simulate(system, y, Forces{}, Rk4{}, {.step = 0.01, .duration = 0.01});
  CHECK(report.impacts == 1);
  CHECK(norm(y[1].velocity) > 1);
}

TEST_CASE("compounds at rest stay") {
  const Material<double> material{0.3, 0.5};
  const System<double, 3, Parts> system{
      {PartsBody(table, 10.0, material), PartsBody(ell, 1.0, material), PartsBody(ring, 1.0, material)},
      {floor_plane(material)}};
  SystemState<double, 3> y;
  y[0] = placed(system[0], {0, 0, 0.02});
  y[1] = placed(system[1], {0.1, 0, 0.64});    // on the table, on its foot
  y[2] = placed(system[2], {0.1, 0.2, 0.02});  // under it
  simulate(system, y, Gravity{}, Rk4{}, {.step = 5e-3, .duration = 1});
  const auto settled = y;
  const auto report = simulate(system, y, Gravity{}, Rk4{}, {.step = 5e-3, .duration = 20});
  CHECK(report.overruns == 0);
  for (int i = 0; i < 3; ++i) {
    CHECK(norm(y[i].position - settled[i].position) < 1e-9);
    CHECK(norm(y[i].velocity) < 1e-9);
    CHECK(norm(y[i].angular_velocity) < 1e-9);
  }
  CHECK(origin_of(system[0], y[0]).z == doctest::Approx(0.02).epsilon(1e-6));
}

TEST_CASE("contacts say which parts touch") {
  const System<double, 2, Parts> system{{PartsBody::kinematic(table), PartsBody(Parts(Sphere{0.1}), 1.0)},
                                        {floor_plane<double>()}};
  SystemState<double, 2> y;
  y[0] = placed(system[0], {});
  y[1].position = {0.49, 0.4, 0.0999};  // in a leg's side, and in the floor
  int with_leg = 0, with_floor = 0;
  for (const auto& contact : contacts(system, y)) {
    if (contact.with_plane()) {
      ++with_floor;
      CHECK(contact.second == 1);
      CHECK(contact.second_part == 0);
    } else {
      ++with_leg;
      CHECK(contact.first == 0);
      CHECK(contact.first_part == 1);
      CHECK(norm(contact.normal - Vector{1, 0, 0}) < 1e-12);
      CHECK(contact.gap == doctest::Approx(-0.03));
    }
  }
  CHECK(with_floor == 1);
  CHECK(with_leg == 1);
}

TEST_CASE("an observer hears the impulses of all parts, which are the change of momentum") {
  const Material<double> material{0.6, 0.3};
  const System<double, 2, Parts> system{{PartsBody(table, 4.0, material), PartsBody(ell, 1.0, material)}};
  SystemState<double, 2> y;
  y[0] = placed(system[0], {});
  y[1] = placed(system[1], {0.1, 0.05, 0.9}, quaternion_exp(Vector{0.3, 0.4, 0}));
  y[1].velocity = {0, 0, -2};
  struct {
    Vector sum{};
    int count = 0;
    void impact(const Impact<double>& impact) {
      CHECK(impact.first == 0);
      CHECK(impact.second == 1);
      sum += impact.impulse;
      ++count;
    }
  } heard;
  const Vector before = linear_momentum(system[1], y[1]), angular = angular_momentum(system, y),
               linear = linear_momentum(system, y);
  simulate(system, y, Forces{}, Rk4{}, {.step = 1e-3, .duration = 0.6}, heard);
  CHECK(heard.count > 0);
  CHECK(norm(linear_momentum(system[1], y[1]) - before - heard.sum) < 1e-12);
  CHECK(norm(linear_momentum(system, y) - linear) < 1e-12);
  CHECK(norm(angular_momentum(system, y) - angular) < 1e-9);
}

TEST_CASE("fixed sizes and dynamic ones move to the same bits, and steps take nothing from the heap") {
  const Material<double> material{0.3, 0.4};
  const PartsBody bodies[] = {PartsBody(table, 5.0, material), PartsBody(ell, 1.0, material),
                              PartsBody(ring, 0.5, material)};
  const System<double, 3, Parts> fixed{{bodies[0], bodies[1], bodies[2]}, {floor_plane(material)}};
  const System<double, dynamic, Parts> free{{bodies[0], bodies[1], bodies[2]}, {floor_plane(material)}};
  const System<double, 3, Parts, 1> small{{bodies[0], bodies[1], bodies[2]}, {floor_plane(material)}};
  for (const ContactMode mode : modes) {
    SystemState<double, 3> y;
    y[0] = placed(fixed[0], {0, 0, 0.05}, quaternion_exp(Vector{0.1, 0.05, 0}));
    y[1] = placed(fixed[1], {0.05, 0, 0.75}, quaternion_exp(Vector{0.3, 0.4, 0}));
    y[2] = placed(fixed[2], {0, 0.05, 0.55}, quaternion_exp(Vector{0, 0.05, 0.4}));
    SystemState<double, dynamic> z{{y[0], y[1], y[2]}};
    auto x = y;
    const SimulationOptions options{.step = 2e-3, .contacts = mode};
    Stepper a(fixed, Gravity{}, Rk4{}, options);
    Stepper b(free, Gravity{}, Rk4{}, options);
    Stepper c(small, Gravity{}, Rk4{}, options);
    const long before = allocations;
    for (int k = 0; k < 300; ++k) {
      a.step(y, 2e-3 * k, 2e-3);
      b.step(z, 2e-3 * k, 2e-3);
      c.step(x, 2e-3 * k, 2e-3);
    }
    CHECK(allocations == before);
    CHECK(a.tally().impacts > 5);
    CHECK(x == y);
    for (int i = 0; i < 3; ++i) CHECK(y[i] == z[i]);
  }
}

TEST_CASE("a crowd of compounds keeps its energy and falls into no body") {
  const Material<double> material{0.3, 0.4};
  std::vector<PartsBody> bodies;
  for (int i = 0; i < 36; ++i) bodies.push_back(PartsBody(i % 2 == 0 ? ell : ring, 1.0, material));
  const System<double, dynamic, Parts> system(bodies, {floor_plane(material)});
  SystemState<double, dynamic> y;
  y.body.resize(36);
  for (int i = 0; i < 36; ++i) {
    Random r(5, std::uint64_t(i));
    y[i].position = {0.55 * (i % 3), 0.55 * (i / 3 % 3), 0.4 + 0.55 * (i / 9)};
    y[i].orientation = random_turn(r);
  }
  double energy_before = energy(system, y, down), rise = 0, deep = 0;
  const auto report =
      simulate(system, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 0.8}, [&](double, const auto& now) {
        const double e = energy(system, now, down);
        rise = std::max(rise, e - energy_before);
        energy_before = e;
        deep = std::max(deep, deepest(system, now));
      });
  CHECK(report.status == SimulationStatus::finished);
  CHECK(report.impacts > 100);
  CHECK(rise < 1e-9);
  CHECK(deep < 1e-4);
}
