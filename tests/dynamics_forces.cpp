#include <doctest/doctest.h>

#include <rbres/rbres.hpp>
#include <span>

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
  const Body<double, Box<double>> turned(Box<double>{0.1, 0.2, 0.3}, 1.0, tensor);
  y.orientation = turned.shape_rotation().conjugate();
  CHECK(fluid(turned, y).force.x == doctest::Approx(-0.6 * (0.4 * 0.6) * 4).epsilon(1e-14));
}

TEST_CASE_TEMPLATE("the drag of a plate knows of the smallest turn of its principal axes", S, double, float) {
  // The rotation's w is rounded to one.
  const S small = std::is_same_v<S, float> ? S(4e-4) : S(1e-8);
  const Box<S> plate{S(0.5), S(0.5), S(2.5) * small};
  RigidState<S> state;
  state.velocity = {S(10), S(0), S(0)};
  const S expected = FluidFriction<S>{}(Body<S, Box<S>>{plate, S(1)}, state).force.x;
  bool rounded = false;
  for (const S angle : {-small, small}) {
    const Eigen::Matrix<S, 3, 3> axes =
        Eigen::AngleAxis<S>(angle, Eigen::Matrix<S, 3, 1>(S(0.48), S(0.6), S(0.64))).toRotationMatrix();
    const Eigen::Matrix<S, 3, 3> inertia =
        axes * Eigen::Matrix<S, 3, 1>(S(1), S(1.3), S(1.6)).asDiagonal() * axes.transpose();
    const Body<S, Box<S>> body{plate, S(1), Eigen::Matrix<S, 3, 3>(S(0.5) * (inertia + inertia.transpose()))};
    state.orientation = body.shape_rotation().conjugate();
    CHECK(std::abs(FluidFriction<S>{}(body, state).force.x / expected - 1) < 1e-3);
    rounded = rounded || body.shape_rotation().w == S(1);
  }
  CHECK(rounded);
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
  const auto at_once = [](const System<double, 2, Sphere<double>>&, const auto&, double t,
                          std::span<Wrench<double>> wrenches) {
    wrenches[0].force.z += t;
    wrenches[1].torque.x -= 2 * t;
  };
  const Forces all{Gravity{}, Damping{1.0, 0.0}, constant, in_time, spring, at_once};
  std::array<Wrench<double>, 2> sum{};
  detail::add_wrenches(all, system, y, 5.0, sum);
  CHECK(sum[0].force == Vec3<double>{1 - 10, 0, -19.62 + 5});
  CHECK(sum[0].torque == Vec3<double>{0, 0, 3});
  CHECK(sum[1].force == Vec3<double>{10, 5, -19.62});
  CHECK(sum[1].torque == Vec3<double>{-10, 0, 0});
}

TEST_CASE_TEMPLATE("a force on all bodies at once moves them as one on each does", S, double, float,
                   Pack<double, 4>) {
  const auto each = [](const auto& system, const auto& y, int i, const S&) requires requires {
    system.planes();
  }
  {
    Wrench<S> sum;
    for (int j = 0; j < system.size(); ++j) {
      if (j != i) sum.force += as<S>(3) * (y[j].position - y[i].position);
    }
    return sum;
  };
  const auto at_once = [](const auto& system, const auto& y, const S&, auto wrenches) requires requires {
    system.planes();
    wrenches[0].force;
  }
  {
    for (int i = 0; i < system.size(); ++i) {
      for (int j = 0; j < system.size(); ++j) {
        if (j != i) wrenches[std::size_t(i)].force += as<S>(3) * (y[j].position - y[i].position);
      }
    }
  };
  const auto check = [&](const auto& system, auto y) {
    auto other = y;
    Stepper by_each(system, Forces{Gravity{}, each}, Rk4{}, SimulationOptions{});
    Stepper by_all(system, Forces{Gravity{}, at_once}, Rk4{}, SimulationOptions{});
    for (int k = 0; k < 200; ++k) {
      by_each.step(y, as<S>(0), as<S>(2e-3));
      by_all.step(other, as<S>(0), as<S>(2e-3));
    }
    const auto* a = &y[0].position.x;
    const auto* b = &other[0].position.x;
    for (int k = 0; k < RigidState<S>::size * system.size(); ++k) CHECK(all(a[k] == b[k]));
    CHECK(all(y[0].position.z < as<S>(1)));
  };
  using Ball = Body<S, Sphere<S>>;
  const Ball small(Sphere<S>(as<S>(0.1)), as<S>(1)), large(Sphere<S>(as<S>(0.2)), as<S>(3));
  SystemState<S, 3> y;
  SystemState<S, dynamic> z;
  for (int i = 0; i < 3; ++i) {
    y[i].position = {as<S>(0.7 * i), as<S>(0.1 * i), as<S>(1)};
    z.body.push_back(y[i]);
  }
  check(System<S, 3, Sphere<S>>({{small, large, small}}, {floor_plane<S>()}), y);
  check(System<S, dynamic, Sphere<S>>({small, large, small}, {floor_plane<S>()}), z);
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
