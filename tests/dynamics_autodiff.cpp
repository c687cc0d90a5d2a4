#include <doctest/doctest.h>

#include <rbres/rbres.hpp>
#include <unsupported/Eigen/AutoDiff>

using namespace rbres;

namespace {

/// The Jacobian of f (numbers to numbers, any scalar) by dual numbers against central differences.
template <int Inputs, class F>
double jacobian_error(const F& f, const Eigen::Matrix<double, Inputs, 1>& at) {
  using Dual = Eigen::AutoDiffScalar<Eigen::Matrix<double, Inputs, 1>>;
  Eigen::Matrix<Dual, Inputs, 1> x;
  for (int i = 0; i < Inputs; ++i) x(i) = Dual(at(i), Inputs, i);
  const auto y = f(x);
  double worst = 0;
  for (int i = 0; i < Inputs; ++i) {
    const double h = 1e-6;
    auto more = at, less = at;
    more(i) += h;
    less(i) -= h;
    const auto up = f(more), down = f(less);
    for (int k = 0; k < y.size(); ++k) {
      const double difference = (up(k) - down(k)) / (2 * h);
      worst = std::max(worst, std::abs(y(k).derivatives()(i) - difference) / (1 + std::abs(difference)));
    }
  }
  return worst;
}

template <class S, int N>
SystemState<S, N> as_state(const Eigen::Matrix<S, 13 * N, 1>& x) {
  SystemState<S, N> y;
  y.vector() = x;
  return y;
}

Eigen::Matrix<double, 13, 1> moving_body() {
  Eigen::Matrix<double, 13, 1> x;
  x << 0.1, -0.2, 0.3, 0.1, 0.2, 0.3, 0.9, 1, -2, 0.5, 3, -1, 2;
  x.segment<4>(3).normalize();
  return x;
}

const auto brick = System<double, 1, Box<double>>{{Body{Box{0.2, 0.1, 0.05}, 2.0}}};

}  // namespace

TEST_CASE("the equations of motion have the derivatives of central differences") {
  const auto rate = [](const auto& x) {
    using S = typename std::decay_t<decltype(x)>::Scalar;
    const auto system = brick.cast<S>();
    const auto y = as_state<S, 1>(x);
    RigidRate<S> k;
    set_kinematics(k, y[0]);
    set_dynamics(k, system[0], y[0],
                 detail::local_wrench(Forces{Gravity{}, Damping{0.3, 0.2}}, system[0], y[0], 0, S(0)));
    Eigen::Matrix<S, 13, 1> numbers;
    numbers << k.velocity.x, k.velocity.y, k.velocity.z, k.orientation.x, k.orientation.y, k.orientation.z,
        k.orientation.w, k.acceleration.x, k.acceleration.y, k.acceleration.z, k.angular.x, k.angular.y,
        k.angular.z;
    return numbers;
  };
  CHECK(jacobian_error<13>(rate, moving_body()) < 1e-8);
}

TEST_CASE("a Runge-Kutta step has the derivatives of central differences") {
  const auto step = [](const auto& x) {
    using S = typename std::decay_t<decltype(x)>::Scalar;
    const auto system = brick.cast<S>();
    const auto y = fly(system, Forces{Gravity{}, FluidFriction{}, Damping{0.3, 0.2}}, Rk4{},
                       as_state<S, 1>(x), S(0), S(0.01));
    return Eigen::Matrix<S, 13, 1>(y.vector());
  };
  CHECK(jacobian_error<13>(step, moving_body()) < 1e-8);
}

TEST_CASE("an impulse between two spheres has the derivatives of central differences") {
  const auto impact = [](const auto& x) {
    using S = typename std::decay_t<decltype(x)>::Scalar;
    const Material<double> material{0.7, 0.1};
    const auto system = System<double, 2, Sphere<double>>{
        {Body{Sphere{0.3}, 1.5, material},
         Body{Sphere{0.2}, 0.4,
              material}}}.template cast<S>();
    auto y = as_state<S, 2>(x);
    detail::with_manifold(system, y, 0, 1, [&](const auto& manifold, auto) {
      Motion<S> a = motion_of(system[0], y[0]), b = motion_of(system[1], y[1]);
      REQUIRE(resolve_impact<false>(manifold, {true}, detail::surface_of(system, 0, 1), S(0), S(0), a, b));
      set_velocities(y[0], a);
      set_velocities(y[1], b);
    });
    return Eigen::Matrix<S, 26, 1>(y.vector());
  };
  Eigen::Matrix<double, 26, 1> x;
  x << moving_body(), moving_body();
  x.segment<3>(13) += Eigen::Vector3d(0.3, 0.3, 0.2);
  x.segment<3>(20) = Eigen::Vector3d(-1, -2, 0.3);
  CHECK(jacobian_error<26>(impact, x) < 1e-8);
}
