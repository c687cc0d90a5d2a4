#include <doctest/doctest.h>

#include <rbres/core/pack.hpp>
#include <rbres/core/philox.hpp>
#include <rbres/sim/simulate.hpp>

using namespace rbres;

using Doubles = Pack<double, native_lanes<double>>;
using Floats = Pack<float, native_lanes<float>>;

namespace {

constexpr int bodies = 3;
constexpr double step = 2e-3;

/// Bodies that fall on the floor and into each other.
SystemState<double, bodies> start(int scenario) {
  Random random(11, static_cast<std::uint64_t>(scenario));
  SystemState<double, bodies> y;
  for (int i = 0; i < bodies; ++i) {
    y[i].position = {0.7 * i - 0.7 + random.uniform(-0.05, 0.05), random.uniform(-0.05, 0.05),
                     0.5 + 0.1 * i + random.uniform(-0.05, 0.05)};
    y[i].orientation = normalized(Quat<double>{random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0),
                                               random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0)});
    y[i].velocity = {0.8 * (1 - i), random.uniform(-0.3, 0.3), random.uniform(-1.0, 1.0)};
    y[i].angular_velocity = {random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0)};
  }
  return y;
}

/// The largest difference, over the lanes and the 13 numbers of each body, between a run in lanes and the
/// runs of the same scenarios one by one; and how many impacts they met.
template <class P, class System>
std::pair<double, double> difference(const System& system, ContactMode mode, int steps) {
  using T = typename ScalarTraits<P>::Value;
  constexpr int lanes = ScalarTraits<P>::lanes;
  const Forces forces{Gravity{}, FluidFriction{}};
  const SimulationOptions options{.step = step, .contacts = mode};

  const auto one_by_one = [&] {
    if constexpr (std::is_same_v<T, double>)
      return system;
    else
      return system.template cast<T>();
  }();
  const auto packed = system.template cast<P>();
  SystemState<P, bodies> together;
  std::array<SystemState<T, bodies>, std::size_t(lanes)> alone;
  for (int l = 0; l < lanes; ++l) {
    auto& y = alone[static_cast<std::size_t>(l)];
    const auto from = start(l);
    for (int k = 0; k < from.size; ++k) y.vector()(k) = T(from.vector()(k));
    set_lane(together, l, y);
  }
  Stepper stepper(packed, forces, Rk4{}, options);
  for (int i = 0; i < steps; ++i) stepper.step(together, P(T(i * step)), P(T(step)));

  double worst = 0, impacts = 0;
  for (int l = 0; l < lanes; ++l) {
    auto& y = alone[static_cast<std::size_t>(l)];
    Stepper single(one_by_one, forces, Rk4{}, options);
    for (int i = 0; i < steps; ++i) single.step(y, T(i * step), T(step));
    const auto in_lane = lane(together, l);
    worst = std::max(worst, double((in_lane.vector() - y.vector()).cwiseAbs().maxCoeff()));
    CHECK(stepper.tally().impacts[l] == single.tally().impacts);
    impacts += double(single.tally().impacts);
  }
  return {worst, impacts};
}

constexpr Material<double> material{0.6, 0.3};
const auto spheres =
    System<double, bodies, Sphere<double>>::of(Body{Sphere{0.25}, 1.0, material}, {floor_plane(material)});
const auto boxes = System<double, bodies, Box<double>>::of(Body{Box{0.30, 0.22, 0.15}, 1.0, material},
                                                           {floor_plane(material)});
/// Their shapes stand turned in the frame of their principal axes.
const auto turned_boxes = System<double, bodies, Box<double>>::of(
    Body<double, Box<double>>(
        Box{0.30, 0.22, 0.15}, 1.0,
        Eigen::Matrix3d{{0.03, 0.006, -0.004}, {0.006, 0.05, 0.01}, {-0.004, 0.01, 0.06}}, material),
    {floor_plane(material)});

}  // namespace

TEST_CASE("lanes give what single runs give") {
  for (const ContactMode mode : {ContactMode::discrete, ContactMode::continuous}) {
    const auto check = [&](const std::pair<double, double>& found, double bound) {
      CAPTURE(static_cast<int>(mode));
      CHECK(found.first < bound);
      CHECK(found.second > 16);  // or it would prove little
    };
    check(difference<Doubles>(spheres, mode, 500), 1e-9);
    // Resting boxes are solved to 1e-11 m/s in each step, by a sweep more or less where rounding decides;
    // impacts multiply what that leaves.
    check(difference<Doubles>(boxes, mode, 300), mode == ContactMode::discrete ? 1e-9 : 1e-8);
    check(difference<Doubles>(turned_boxes, mode, 300), mode == ContactMode::discrete ? 1e-9 : 1e-8);
    // Impacts multiply rounding by about ten each.
    check(difference<Floats>(spheres, mode, 250), 5e-4);
    check(difference<Floats>(boxes, mode, 150), 5e-4);
  }
}

TEST_CASE("a discrete impact changes velocities in its own lane only, to the bit") {
  using P = Pack<double, 2>;
  const auto system = spheres.template cast<P>();
  SystemState<P, bodies> y;
  for (int i = 0; i < bodies; ++i) {
    y[i].position = {P(i), P(0), P(1)};
    y[i].orientation = {P(0.1), P(0.5), P(-0.7), P(0.5)};
    y[i].angular_velocity = {P(0.3), P(-0.7), P(1.1)};
  }
  y[1].position.z = select(LaneMask<double, 2>(typename LaneMask<double, 2>::Vector{-1, 0}), P(0.2), P(1));
  y[1].velocity.z = P(-1);
  const auto before = y;
  ContactTally<P> tally;
  detail::DiscreteContact(system).resolve(before, y, P(1e-3), P(5e-3), tally);
  CHECK(tally.impacts[0] == 1);
  CHECK(tally.impacts[1] == 0);
  CHECK(lane(y, 0)[1].velocity.z > 0);
  CHECK(lane(y, 1) == lane(before, 1));
}

TEST_CASE("pairs that are near in another lane alone are not met in a discrete step") {
  const System<double, 2> plain{{Body{Sphere{0.1}, 1.0}, Body{Sphere{0.1}, 1.0}},
                                {floor_plane(Material<double>{0, 0})}};
  const auto packed = plain.cast<Doubles>();
  // In lane 0 the lower ball ends within the floor, which pushes it up into the other; in lane 1 the balls
  // overlap at the end of the step.
  const auto falling = [](double above) {
    SystemState<double, 2> y;
    y[0].position = {0, 0, 0.11};
    y[0].velocity = {0, 0, -5};
    y[1].position = {0, 0, 0.06 + above};
    return y;
  };
  SystemState<Doubles, 2> together;
  for (int l = 0; l < native_lanes<double>; ++l) set_lane(together, l, falling(l == 0 ? 0.21 : 0.19));
  const SimulationOptions options{.step = 0.01, .contacts = ContactMode::discrete};
  Stepper stepper(packed, Gravity{Vec3<double>{}}, Rk4{}, options);
  stepper.step(together, Doubles(0), Doubles(0.01));
  for (const int l : {0, 1}) {
    auto alone = falling(l == 0 ? 0.21 : 0.19);
    Stepper single(plain, Gravity{Vec3<double>{}}, Rk4{}, options);
    single.step(alone, 0, 0.01);
    CHECK((lane(together, l).vector() - alone.vector()).cwiseAbs().maxCoeff() < 1e-15);
    CHECK((alone[1].velocity.z > 0) == (l == 1));
  }
}
