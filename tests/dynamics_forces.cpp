#include <doctest/doctest.h>

#include <rbres/rbres.hpp>

using namespace rbres;

namespace {

RigidState<double> moving() {
  RigidState<double> y;
  y.orientation = normalized(Quat<double>{0.1, 0.2, 0.3, 0.9});
  y.velocity = {3, 0, 4};
  y.angular_velocity = {1, 2, -2};
  return y;
}
const Body ball{Sphere{0.1}, 2.0};

}  // namespace

TEST_CASE("gravity") {
  const auto w = Gravity{}(ball, moving());
  CHECK(w.force == Vec3<double>{0, 0, -19.62});
  CHECK(w.torque == Vec3<double>{});
}

TEST_CASE("fluid friction: 1/2 rho C_d A |v| v against v, and its rotational counterpart") {
  const auto w = FluidFriction{1.2, 0.5, 0.02}(ball, moving());
  const double force = 0.5 * 1.2 * 0.5 * std::numbers::pi * 0.01 * 25;
  CHECK(w.force.x == doctest::Approx(-force * 0.6).epsilon(1e-14));
  CHECK(w.force.z == doctest::Approx(-force * 0.8).epsilon(1e-14));
  const double torque = 0.5 * 1.2 * 0.02 * std::numbers::pi * 1e-5 * 9;
  CHECK(w.torque.y == doctest::Approx(-torque * 2 / 3).epsilon(1e-14));
}

TEST_CASE("a box meets the fluid with the area that it turns to it") {
  const Body box{Box{0.1, 0.2, 0.3}, 1.0};
  RigidState<double> y;
  y.velocity = {2, 0, 0};
  const FluidFriction fluid{1.2, 1.0, 0.0};
  CHECK(fluid(box, y).force.x == doctest::Approx(-0.6 * (0.4 * 0.6) * 4).epsilon(1e-14));
  y.orientation = {0, 0, std::sqrt(0.5), std::sqrt(0.5)};  // its y axis turned to the flow's
  CHECK(fluid(box, y).force.x == doctest::Approx(-0.6 * (0.2 * 0.6) * 4).epsilon(1e-14));

  // A body's frame is that of its inertia, in which its shape may stand turned.
  const Eigen::Quaterniond turn = Eigen::Quaterniond(0.9, 0.1, -0.3, 0.2).normalized();
  const Eigen::Matrix3d tensor = turn * Eigen::Vector3d(1, 2, 2.5).asDiagonal() * turn.conjugate();
  const Body<double, Box<double>> turned(Box{0.1, 0.2, 0.3}, 1.0, tensor);
  y.orientation = turned.shape_rotation().conjugate();
  CHECK(fluid(turned, y).force.x == doctest::Approx(-0.6 * (0.4 * 0.6) * 4).epsilon(1e-14));
}

TEST_CASE("damping: the rate times m v against v, and times I w against w") {
  const Body box{Box{0.1, 0.2, 0.3}, 12.0};
  const auto w = Damping{0.5, 0.25}(box, moving());
  CHECK(w.force == Vec3<double>{-0.5 * 12 * 3, 0, -0.5 * 12 * 4});
  CHECK(w.torque.x == doctest::Approx(-0.25 * box.inertia().x).epsilon(1e-15));
  CHECK(w.torque.y == doctest::Approx(-0.25 * box.inertia().y * 2).epsilon(1e-15));
  CHECK(w.torque.z == doctest::Approx(0.25 * box.inertia().z * 2).epsilon(1e-15));
}

TEST_CASE("forces add up, in any form of a model") {
  const System<double, 2, Sphere<double>> system{{ball, ball}};
  SystemState<double, 2> y;
  y[0].position = {1, 0, 0};
  const auto constant = ConstantWrench<double, 2>{{Wrench<double>{{1, 0, 0}, {0, 0, 3}}, Wrench<double>{}}};
  const auto in_time = [](const auto&, const auto&, int index, double t) {
    return Wrench<double>{{0, index * t, 0}, {}};
  };
  const auto spring = [](const System<double, 2, Sphere<double>>&, const auto& states, int i, double) {
    return Wrench<double>{10.0 * (states[1 - i].position - states[i].position), {}};
  };
  const Forces all{Gravity{}, Damping{1.0, 0.0}, constant, in_time, spring};
  const auto first = detail::wrench_on(all, system, y, 0, 5.0),
             second = detail::wrench_on(all, system, y, 1, 5.0);
  CHECK(first.force == Vec3<double>{1 - 10, 0, -19.62});
  CHECK(first.torque == Vec3<double>{0, 0, 3});
  CHECK(second.force == Vec3<double>{10, 5, -19.62});
}

TEST_CASE("the gyroscopic term: I w' = tau - w x (I w)") {
  const Body box{Box{0.1, 0.2, 0.3}, 12.0};
  RigidState<double> y = moving();
  RigidRate<double> k;
  set_dynamics(k, box, y, {{}, {1, 2, 3}});
  const Eigen::Vector3d i(box.inertia()), w(y.angular_velocity), tau(1, 2, 3);
  const Eigen::Vector3d expected = (tau - w.cross(i.cwiseProduct(w))).cwiseQuotient(i);
  CHECK((Eigen::Vector3d(k.angular) - expected).norm() < 1e-14);
}
