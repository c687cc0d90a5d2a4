#include <doctest/doctest.h>

#include <rbres/rbres.hpp>

using namespace rbres;

namespace {

const System<double, 1, Box<double>> top{{Body{Box{0.2, 0.1, 0.05}, 2.0}}};

SystemState<double, 1> spinning() {
  SystemState<double, 1> y;
  y[0].velocity = {1, 2, 3};
  y[0].angular_velocity = {5, 1, 1};
  return y;
}
const Forces forces{Gravity{}, Damping{0.5, 0.3}};

SystemState<double, 1> reference() {
  return fly(top, forces, DormandPrince54{1e-14, 1e-15}, spinning(), 0.0, 1.0);
}

template <class Integrator>
double error(const Integrator& integrator, int steps) {
  auto y = spinning();
  for (int i = 0; i < steps; ++i) y = fly(top, forces, integrator, y, double(i) / steps, 1.0 / steps);
  return (y.vector() - reference().vector()).norm();
}

template <class Integrator>
void check_order(const Integrator& integrator, int steps) {
  const double slope = std::log2(error(integrator, steps) / error(integrator, 2 * steps));
  CHECK(std::abs(slope - Integrator::order) < 0.1);
}

}  // namespace

TEST_CASE("each method converges with its order") {
  check_order(ExplicitEuler{}, 1000);
  check_order(SemiImplicitEuler{}, 1000);
  check_order(Rk4{}, 64);
  check_order(DormandPrince54{1e9, 1e9}, 32);  // tolerances that every step meets
}

TEST_CASE("a body flies the same whether it is known to keep its spin or not") {
  // Nothing is known of a lambda's torque.
  const auto difference = [](const auto& body, const auto& model, const auto& integrator) {
    const System<double, 1, std::decay_t<decltype(body.shape())>> system{{body}};
    const auto unknown = [&](const auto& b, const RigidState<double>& y) {
      return detail::local_wrench(model, b, y, 0, 0.0);
    };
    auto y = spinning(), z = y;
    for (int i = 0; i < 100; ++i) {
      y = fly(system, model, integrator, y, 0.0, 0.01);
      z = fly(system, unknown, integrator, z, 0.0, 0.01);
    }
    return (y.vector() - z.vector()).norm();
  };
  const Body ball{Sphere{0.1}, 2.0}, uneven{Sphere{0.1}, 2.0, Vec3<double>{0.02, 0.03, 0.04}};
  const Forces pushing{Gravity{}, FluidFriction{1.2, 0.5, 0.0}, Damping{0.5, 0.0}};
  const Forces dragging{Gravity{}, FluidFriction{1.2, 0.5, 10.0}};
  const Forces damping{Gravity{}, Damping{0.0, 0.3}};
  const auto check = [&](const auto& integrator) {
    CHECK(difference(ball, pushing, integrator) < 1e-12);
    CHECK(difference(ball, dragging, integrator) < 1e-12);
    CHECK(difference(ball, damping, integrator) < 1e-12);
    CHECK(difference(uneven, pushing, integrator) < 1e-12);
  };
  check(ExplicitEuler{});
  check(SemiImplicitEuler{});
  check(Rk4{});
}

TEST_CASE("explicit Euler moves with the old velocities, semi-implicit with the new") {
  const double h = 0.01;
  const auto y = spinning();
  const auto check_moves = [&](const RigidState<double>& to, const RigidState<double>& by) {
    CHECK(norm(to.position - h * by.velocity) < 1e-15);
    CHECK(norm((1 / to.orientation.w) * to.orientation.imaginary() - 0.5 * h * by.angular_velocity) < 1e-15);
  };
  check_moves(fly(top, forces, ExplicitEuler{}, y, 0.0, h)[0], y[0]);
  const auto next = fly(top, forces, SemiImplicitEuler{}, y, 0.0, h);
  check_moves(next[0], next[0]);
  CHECK(next[0].velocity.z == doctest::Approx(3 - h * (9.81 + 0.5 * 3)).epsilon(1e-15));
}

TEST_CASE("the quaternion stays unit") {
  auto y = spinning();
  for (int i = 0; i < 100; ++i) y = fly(top, forces, ExplicitEuler{}, y, 0.0, 0.01);
  CHECK(squared_norm(y[0].orientation) == doctest::Approx(1).epsilon(1e-15));
}

TEST_CASE("the adaptive method keeps its tolerance") {
  const auto loose = fly(top, forces, DormandPrince54{1e-6, 1e-6}, spinning(), 0.0, 1.0);
  const double off = (loose.vector() - reference().vector()).norm();
  CHECK(off < 1e-4);
  CHECK(off > 1e-12);
}

TEST_CASE("dense output is of fourth order") {
  const auto rate = [](double t, const RigidState<double>& y) {
    RigidRate<double> k;
    set_kinematics(k, y);
    set_dynamics(k, top[0], y, detail::local_wrench(forces, top[0], y, 0, t));
    return k;
  };
  const auto middle_error = [&](double h) {
    double worst = 0;
    DormandPrince54{1e9, 1e9}.integrate(rate, spinning()[0], 0.0, h, [&](const auto& dense) {
      for (const double x : {0.2, 0.4, 0.7}) {
        const auto exact = fly(top, forces, DormandPrince54{1e-14, 1e-15}, spinning(), 0.0, x * h);
        worst = std::max(worst, (dense(x * h).vector() - exact[0].vector()).norm());
      }
    });
    return worst;
  };
  // One step's error falls with the fifth power of its length.
  CHECK(std::log2(middle_error(0.05) / middle_error(0.025)) == doctest::Approx(5).epsilon(0.06));
}

TEST_CASE("no step depends on how the world is turned, however large") {
  const Vec3<double> torque{0.3, -0.2, 0.1};
  const auto pushed = [&](const Vec3<double>& moment) {
    return [moment](const auto&, const RigidState<double>& y) {
      return Wrench<double>{{}, rotate_back(y.orientation, moment)};
    };
  };
  const Quat<double> turn = normalized(Quat<double>{0.5, -0.7, 0.2, 0.1});
  auto turned = spinning();
  turned[0].orientation = turn;
  turned[0].velocity = rotate(turn, turned[0].velocity);
  const auto end = fly(top, pushed(torque), Rk4{}, spinning(), 0.0, 0.2),
             other = fly(top, pushed(rotate(turn, torque)), Rk4{}, turned, 0.0, 0.2);
  CHECK(norm(end[0].angular_velocity - other[0].angular_velocity) < 1e-13);
}
