#pragma once

#include "impacts.hpp"

namespace validate {

/// A sphere set sliding ends rolling; a box set sliding stops.
inline void rolling(Rows& rows) {
  constexpr double g = 9.81, speed = 3;
  {
    const Material<double> material{0.5, 0.3};
    const System<double, 1, Sphere<double>> system{{Body{Sphere{0.1}, 1.0, material}},
                                                   {floor_plane(material)}};
    SystemState<double, 1> y;
    y[0].position.z = 0.1;
    y[0].velocity.x = speed;
    simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 2});
    Worst worst;
    worst(relative(y[0].velocity.x, 5.0 / 7 * speed));
    worst(relative(y[0].angular_velocity_world().y * 0.1, 5.0 / 7 * speed));
    rows.push_back(
        {"rolling_sphere", worst.value(), 1e-6, "relative", "slides, then rolls at 5/7 of its speed"});
  }
  {
    const double mu = 0.4;
    const Material<double> material{0.5, mu};
    const System<double, 1, Box<double>> system{{Body{Box{0.2, 0.2, 0.05}, 1.0, material}},
                                                {floor_plane(material)}};
    SystemState<double, 1> y;
    y[0].position.z = 0.05;
    y[0].velocity.x = speed;
    simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 2});
    rows.push_back({"rolling_box", relative(y[0].position.x, speed * speed / (2 * mu * g)), 1e-4, "relative",
                    "slides and stops after v^2 / (2 mu g)"});
  }
}

/// Boxes and spheres dropped on a floor come to rest and stay.
inline void resting(Rows& rows) {
  constexpr int N = 6;
  const Material<double> material{0.1, 0.5};
  const Body<double> box = Body{Box{0.2, 0.15, 0.1}, 3.0, material}, ball = Body{Sphere{0.1}, 2.0, material};
  const System<double, N> system{{box, box, box, ball, ball, ball}, {floor_plane(material)}};
  SystemState<double, N> y;
  Random random(7);
  for (int i = 0; i < N; ++i) {
    y[i].position = {0.8 * i, 0, 0.5 + 0.1 * i};
    if (i < 3) {  // a ball that spins would roll for ever
      y[i].orientation =
          normalized(Quat<double>{random.normal(), random.normal(), random.normal(), random.normal()});
      y[i].angular_velocity = {random.normal(), random.normal(), random.normal()};
    }
  }
  y[2] = {{0, 0, 0.9}, {}, {}, {}};  // one box falls on another
  simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 5});
  const auto start = y;
  Worst drift, depth;
  simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 10}, [&](double, const auto& now) {
    for (int i = 0; i < N; ++i) {
      drift(difference(now[i].position, start[i].position));
      const Quat<double> turned = start[i].orientation.conjugate() * now[i].orientation;
      drift(2 * norm(turned.imaginary()) * system[i].bounding_radius());
    }
    for (const auto& contact : contacts(system, now)) depth(-contact.gap);
  });
  rows.push_back(
      {"resting_drift", drift.value(), 1e-6, "m",
       "boxes and spheres dropped with e = 0.1, one box on another; over 10 s from the fifth second"});
  rows.push_back({"resting_penetration", depth.value(), 1e-5, "m", "the same"});
}

inline void rest(Rows& rows) {
  rolling(rows);
  resting(rows);
}

}  // namespace validate
