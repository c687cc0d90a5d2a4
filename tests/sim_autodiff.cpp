#include <doctest/doctest.h>

#include <rbres/rbres.hpp>
#include <unsupported/Eigen/AutoDiff>

using namespace rbres;

namespace {

/// What a run is differentiated by: the first body's velocity (m/s) and angular velocity (rad/s) at the
/// start, restitution, friction, and the first body's height at the start (m).
constexpr int inputs = 9;
template <class S>
using Inputs = Eigen::Matrix<S, inputs, 1>;
using Dual = Eigen::AutoDiffScalar<Inputs<double>>;

const Inputs<double> thrown = [] {
  Inputs<double> x;
  x << 0.8, -0.3, -2, 1.5, -2, 1, 0.6, 0.04, 0.4;
  return x;
}();

struct Scene {
  double duration;     ///< s
  double aside;        ///< of the second body from the first, m
  long least_impacts;  ///< that the run must have, or it shows nothing
};

/// Position, velocity and angular velocity of every body at the end of a run.
template <class S, int N>
struct End {
  Eigen::Matrix<S, 9 * N, 1> numbers;
  long impacts;
};

/// Throws the first body of make(material), a system in any scalar, at a floor.
template <class S, class Make>
auto run(const Make& make, const Scene& scene, ContactMode mode, const Inputs<S>& x) {
  const auto system = make(Material<S>{x(6), x(7)});
  using State = typename std::decay_t<decltype(system)>::State;
  constexpr int n = State::bodies;
  State y;
  for (int i = 0; i < n; ++i) {
    y[i].position = {S(scene.aside * i), S(0), i == 0 ? x(8) : S(0.13)};
    y[i].orientation = normalized(Quat<S>{S(0.1), S(0.3), S(-0.2), S(0.9)});
  }
  y[0].velocity = {x(0), x(1), x(2)};
  y[0].angular_velocity = {x(3), x(4), x(5)};
  const SimulationOptions options{.step = 5e-3, .duration = scene.duration, .contacts = mode};
  const auto report = simulate(system, y, Gravity{}, Rk4{}, options);
  CHECK(report.status == SimulationStatus::finished);
  End<S, n> end{{}, report.impacts};
  for (int i = 0; i < n; ++i) {
    end.numbers.template segment<3>(9 * i) = y[i].vector().template head<3>();
    end.numbers.template segment<6>(9 * i + 3) = y[i].vector().template tail<6>();
  }
  return end;
}

template <class Make>
void check_derivatives(const Make& make, const Scene& scene) {
  for (const ContactMode mode : {ContactMode::continuous, ContactMode::discrete}) {
    CAPTURE(mode == ContactMode::discrete);
    const auto at = [&](int input, double change) {
      return run<double>(make, scene, mode, thrown + change * Inputs<double>::Unit(input)).numbers;
    };
    Inputs<Dual> x;
    for (int i = 0; i < inputs; ++i) x(i) = Dual(thrown(i), inputs, i);
    const auto dual = run<Dual>(make, scene, mode, x);
    const auto plain = run<double>(make, scene, mode, thrown);
    CHECK(plain.impacts >= scene.least_impacts);
    CHECK(dual.impacts == plain.impacts);
    for (int k = 0; k < plain.numbers.size(); ++k)
      CHECK(std::abs(dual.numbers(k).value() - plain.numbers(k)) < 1e-12);
    for (int i = 0; i < inputs; ++i) {
      CAPTURE(i);
      // Central differences of fourth order: what comes after an impact bends sharply.
      const double h = 4e-6;
      const auto near = ((at(i, h) - at(i, -h)) / (2 * h)).eval();
      const auto far = ((at(i, 2 * h) - at(i, -2 * h)) / (4 * h)).eval();
      const auto difference = ((4 * near - far) / 3).eval();
      double worst = 0;
      for (int k = 0; k < difference.size(); ++k) {
        const double error = std::abs(dual.numbers(k).derivatives()(i) - difference(k));
        worst = std::max(worst, error / (1 + std::abs(difference(k))));
      }
      CHECK(worst < 1e-7);
    }
  }
}

/// Makes two bodies above a floor, of whichever shapes.
template <class First, class Second>
auto two_bodies(const First& first, const Second& second) {
  return [=](const auto& material) {
    using S = std::decay_t<decltype(material.friction)>;
    return System<S, 2>{
        {Body{first.template cast<S>(), S(2), material}, Body{second.template cast<S>(), S(1.5), material}},
        {floor_plane(material)}};
  };
}

}  // namespace

TEST_CASE("a sphere's bounce has the derivatives of central differences") {
  const auto sphere = [](const auto& material) {
    using S = std::decay_t<decltype(material.friction)>;
    return System<S, 1, Sphere<S>>{{Body{Sphere<S>{S(0.1)}, S(1), material}}, {floor_plane(material)}};
  };
  check_derivatives(sphere, {.duration = 0.25, .aside = 0, .least_impacts = 1});
}

TEST_CASE("bounces of a box and a capsule have the derivatives of central differences") {
  const Box box{0.15, 0.1, 0.08};
  const Capsule capsule{0.08, 0.12};
  check_derivatives(two_bodies(box, Sphere{0.05}), {.duration = 0.2, .aside = 2, .least_impacts = 2});
  check_derivatives(two_bodies(capsule, Sphere{0.05}), {.duration = 0.2, .aside = 2, .least_impacts = 2});
}

TEST_CASE("bodies of two shapes that collide have the derivatives of central differences") {
  const Box box{0.15, 0.1, 0.08};
  check_derivatives(two_bodies(box, Capsule{0.04, 0.08}),
                    {.duration = 0.12, .aside = 0.1, .least_impacts = 2});
}
