#pragma once

#include "closed_forms.hpp"

namespace validate {

struct CapsuleFigures {
  Figure top, floor_top;  ///< precession
  Figure rolls, tips, lies;
};

/// The moment of gravity about a pivot, for a body that stands at it with its moments about it: a heavy top.
struct HeavyTop {
  double weight, arm;  ///< N; m, along the body's z axis

  template <class S, class Shape>
  Wrench<S> operator()(const Body<S, Shape>&, const RigidState<S>& y) const {
    return {{},
            cross(Vec3<S>{S(0), S(0), S(arm)}, rotate_back(y.orientation, Vec3<S>{S(0), S(0), S(-weight)}))};
  }
};

/// The slow regular precession of a symmetric top of moments a (across) and c (along its axis) that spins
/// with n about its axis, leaning by `lean` against a moment m sin(lean): a cos(lean) W^2 - c n W + m = 0
/// (Goldstein, Classical Mechanics, 5.7). Gives its rate W.
inline double regular_precession(double a, double c, double n, double lean, double m) {
  const double p = a * std::cos(lean), q = c * n;
  return 2 * m / (q + std::sqrt(q * q - 4 * p * m));
}
/// Sets a body at its start of that precession.
inline void set_precession(RigidState<double>& y, double n, double lean, double rate) {
  y.orientation = {0, std::sin(lean / 2), 0, std::cos(lean / 2)};
  const Vector up = rotate_back(y.orientation, Vector{0, 0, 1});
  y.angular_velocity = rate * up;
  y.angular_velocity.z = n;
}
/// How far its axis is from where it belongs, rad.
inline double precession_error(const RigidState<double>& y, double lean, double angle) {
  const Vector axis{std::sin(lean) * std::cos(angle), std::sin(lean) * std::sin(angle), std::cos(lean)};
  return norm(rotate(y.orientation, Vector{0, 0, 1}) - axis);
}

inline void tops(CapsuleFigures& worst) {
  const double g = 9.81, lean = 0.3, radius = 0.02, arm = 0.1, mass = 1;
  {
    const double across = 0.012, along = 4e-4, spin = 1000;
    const System<double, 1, Capsule<double>> top{
        {Body{Capsule{radius, arm}, mass, Vector{across, across, along}}}};
    const double rate = regular_precession(across, along, spin, lean, mass * g * arm);
    SystemState<double, 1> y;
    set_precession(y[0], spin, lean, rate);
    for (long k = 0; k < 100000; ++k) {
      y = fly(top, HeavyTop{mass * g, arm}, Rk4{}, y, 0.0, 2e-5);
      worst.top(precession_error(y[0], lean, rate * 2e-5 * static_cast<double>(k + 1)), 0);
    }
  }
  // The same by contact: its end slides on a smooth floor, whose force has the moment of the weight.
  const Material<double> smooth{0, 0};
  OnPlane<Capsule<double>> top(Body{Capsule{radius, arm}, mass, smooth}, floor_plane(smooth));
  const Vector& moments = top.system[1].inertia();
  const double spin = 2000, rate = regular_precession(moments.x, moments.z, spin, lean, mass * g * arm);
  set_precession(top.body(), spin, lean, rate);
  top.body().position.z = radius + arm * std::cos(lean);
  top.run({.step = 1e-4, .duration = 1},
          [&](double time, const auto& y) { worst.floor_top(precession_error(y, lean, rate * time), 0); });
}

/// A capsule that lies on an incline rolls with g sin a / (1 + I / (m r^2)).
inline void rolling_capsule(CapsuleFigures& worst) {
  const Incline slope{0.3};
  const double r = 0.1, time = 2;
  const Material<double> rough{0, 0.5};
  OnPlane<Capsule<double>> capsule(Body{Capsule{r, 0.2}, 1.0, rough}, slope.plane(rough));
  capsule.body().position = r * slope.normal;
  capsule.body().orientation = {std::sqrt(0.5), 0, 0, std::sqrt(0.5)};  // along y
  capsule.run({.step = 1e-3, .duration = time});
  const double along = 9.81 * std::sin(slope.angle) / (1 + capsule.system[1].inertia().z / (r * r));
  worst.rolls(relative_error(dot(capsule.body().position, slope.down), along * time * time / 2), 0);
  worst.rolls(relative_error(capsule.body().angular_velocity_world().y, along * time / r), 0);
}

/// A capsule that stands on its end falls over. With x the lean, I the moment across and l half its length:
/// without friction its middle falls straight down, (I + m l^2 sin^2 x) x'^2 = 2 m g l (cos x0 - cos x);
/// where it rolls on its end, I + m (r^2 + l^2 + 2 r l cos x) stands in the brackets. Then it lies.
inline void falling_capsule(CapsuleFigures& worst) {
  const double g = 9.81, r = 0.05, l = 0.3, m = 1, start = 0.1;
  for (const double friction : {0.0, 1.0}) {
    const Material<double> material{0, friction};
    OnPlane<Capsule<double>> capsule(Body{Capsule{r, l}, m, material}, floor_plane(material));
    capsule.body().orientation = {0, std::sin(start / 2), 0, std::cos(start / 2)};
    capsule.body().position.z = r + l * std::cos(start);
    const double across = capsule.system[1].inertia().x;
    const double last = friction == 0 ? 1.5 : 1;  // beyond, even friction of 1 slips
    const auto where = rbres::detail::text("friction ", friction);
    capsule.run({.step = 1e-4, .duration = 4}, [&](double time, const RigidState<double>& y) {
      const Vector axis = rotate(y.orientation, Vector{0, 0, 1});
      const double lean = std::atan2(axis.x, axis.z);
      if (time == 0 || lean > last || lean < start + 0.05) return;
      const double inertia = friction == 0 ? across + m * l * l * std::sin(lean) * std::sin(lean)
                                           : across + m * (r * r + l * l + 2 * r * l * std::cos(lean));
      const double rate = std::sqrt(2 * m * g * l * (std::cos(start) - std::cos(lean)) / inertia);
      worst.tips(relative_error(y.angular_velocity.y, rate), 0, where);
    });
    worst.lies(std::abs(capsule.body().position.z / r - 1), 0, where);
    worst.lies(std::abs(rotate(capsule.body().orientation, Vector{0, 0, 1}).z), 0, where);
  }
}

inline CapsuleFigures capsule_forms() {
  CapsuleFigures worst;
  tops(worst);
  rolling_capsule(worst);
  falling_capsule(worst);
  return worst;
}

}  // namespace validate
