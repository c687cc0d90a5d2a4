#include <doctest/doctest.h>

#include <rbres/body/mechanics.hpp>
#include <rbres/core/pack.hpp>
#include <rbres/core/philox.hpp>
#include <unsupported/Eigen/AutoDiff>

using namespace rbres;

namespace {

constexpr int N = 3;

Vec3<double> drawn(Random& r) { return {r.normal(), r.normal(), r.normal()}; }

System<double, N> bodies() {
  return {{Body{Sphere{0.1}, 1.0}, Body{Box{0.2, 0.1, 0.3}, 2.0}, Body{Capsule{0.1, 0.2}, 1.5}}};
}
SystemState<double, N> moving(std::uint64_t stream) {
  Random r(4, stream);
  SystemState<double, N> y;
  for (auto& body : y.body) {
    body.position = drawn(r);
    body.orientation = normalized(Quat<double>{r.normal(), r.normal(), r.normal(), r.normal()});
    body.velocity = drawn(r);
    body.angular_velocity = drawn(r);
  }
  return y;
}
double distance(const Vec3<double>& a, const Vec3<double>& b) { return norm(a - b); }

}  // namespace

TEST_CASE("energy and momentum of one body are those of the textbook") {
  const Body ball{Sphere{0.5}, 2.0};  // its moments are 0.4 m r^2 = 0.2 kg m^2
  const RigidState<double> y{{1, 2, 3}, {0, 0, std::sqrt(0.5), std::sqrt(0.5)}, {3, 0, -4}, {1, 0, 0}};
  CHECK(kinetic_energy(ball, y) == doctest::Approx(0.5 * 2 * 25 + 0.5 * 0.2));
  CHECK(distance(linear_momentum(ball, y), {6, 0, -8}) < 1e-15);
  // A quarter turn about z takes the body's x axis to the world's y axis.
  CHECK(distance(spin_angular_momentum(ball, y), {0, 0.2, 0}) < 1e-15);
  CHECK(distance(angular_momentum(ball, y), {-16, 26.2, -12}) < 1e-14);

  const Body box{Box{0.2, 0.1, 0.3}, 2.0, Vec3<double>{1, 2, 2.5}};
  CHECK(kinetic_energy(box, {{}, {}, {}, {1, 2, 3}}) == doctest::Approx(0.5 * (1 + 8 + 22.5)));
}

TEST_CASE("a rigid turn of all bodies about the origin has energy L . Omega / 2") {
  const auto system = bodies();
  for (std::uint64_t i = 0; i < 20; ++i) {
    auto y = moving(i);
    Random r(5, i);
    const Vec3<double> turn = drawn(r);
    for (auto& body : y.body) {
      body.velocity = cross(turn, body.position);
      body.angular_velocity = rotate_back(body.orientation, turn);
    }
    CHECK(kinetic_energy(system, y) ==
          doctest::Approx(0.5 * dot(angular_momentum(system, y), turn)).epsilon(1e-14));
  }
}

TEST_CASE("another origin or a moving observer changes momentum and energy as it should") {
  const auto system = bodies();
  const double mass = 1 + 2 + 1.5;
  const Vec3<double> g{0.5, -1, -9.81};
  for (std::uint64_t i = 0; i < 20; ++i) {
    const auto y = moving(i);
    Random r(6, i);
    const Vec3<double> away = drawn(r), speed = drawn(r);
    auto moved = y, faster = y;
    for (auto& body : moved.body) body.position += away;
    for (auto& body : faster.body) body.velocity += speed;
    const Vec3<double> p = linear_momentum(system, y);
    CHECK(distance(angular_momentum(system, moved), angular_momentum(system, y) + cross(away, p)) < 1e-13);
    CHECK(potential_energy(system, moved, g) ==
          doctest::Approx(potential_energy(system, y, g) - mass * dot(g, away)).epsilon(1e-13));
    CHECK(distance(linear_momentum(system, faster), p + mass * speed) < 1e-13);
    CHECK(energy(system, faster, g) ==
          doctest::Approx(energy(system, y, g) + dot(p, speed) + 0.5 * mass * squared_norm(speed))
              .epsilon(1e-13));
  }
}

TEST_CASE("packs give each lane what it gives alone") {
  using P = Pack<double, 4>;
  const auto system = bodies();
  const auto lanes = system.cast<P>();
  const Vec3<double> g{0.5, -1, -9.81};
  SystemState<P, N> together;
  for (int l = 0; l < 4; ++l) set_lane(together, l, moving(static_cast<std::uint64_t>(l)));
  const P found = energy(lanes, together, g);
  const auto linear = linear_momentum(lanes, together), angular = angular_momentum(lanes, together);
  for (int l = 0; l < 4; ++l) {
    const auto y = moving(static_cast<std::uint64_t>(l));
    CHECK(found[l] == doctest::Approx(energy(system, y, g)).epsilon(1e-14));
    CHECK(distance({linear.x[l], linear.y[l], linear.z[l]}, linear_momentum(system, y)) < 1e-14);
    CHECK(distance({angular.x[l], angular.y[l], angular.z[l]}, angular_momentum(system, y)) < 1e-14);
  }
}

TEST_CASE("the derivatives of the energy are momentum and weight") {
  using Dual = Eigen::AutoDiffScalar<Eigen::Matrix<double, 6, 1>>;
  const auto system = bodies();
  const auto duals = system.cast<Dual>();
  const auto y = moving(1);
  const Vec3<double> g{0.5, -1, -9.81};
  SystemState<Dual, N> z;
  for (int k = 0; k < z.size; ++k) z.vector()(k) = Dual(y.vector()(k));
  z[1].velocity.x = Dual(y[1].velocity.x, 6, 0);
  z[1].angular_velocity.y = Dual(y[1].angular_velocity.y, 6, 1);
  z[2].position.z = Dual(y[2].position.z, 6, 2);
  const Dual found = energy(duals, z, g);
  CHECK(found.value() == doctest::Approx(energy(system, y, g)).epsilon(1e-14));
  CHECK(found.derivatives()(0) == doctest::Approx(linear_momentum(system[1], y[1]).x).epsilon(1e-14));
  CHECK(found.derivatives()(1) ==
        doctest::Approx(system[1].inertia().y * y[1].angular_velocity.y).epsilon(1e-14));
  CHECK(found.derivatives()(2) == doctest::Approx(-1.5 * g.z).epsilon(1e-14));
}
