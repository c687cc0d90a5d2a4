#pragma once

#include "impacts.hpp"

namespace validate {

/// Runs a scene and returns the root mean square over time of its energy's error over the initial energy.
/// `expected` is the energy that the closed form has at a time (J).
template <class System, class Expected>
double energy_error(const System& system, typename System::State y, double g,
                    const SimulationOptions& options, const Expected& expected) {
  const Vec3<double> gravity{0, 0, -g};
  const double start = energy(system, y, gravity);
  double sum = 0;
  long samples = 0;
  const auto report =
      simulate(system, y, Gravity{gravity}, Rk4{}, options, [&](double time, const auto& now) {
        const double error = (energy(system, now, gravity) - expected(time, start)) / start;
        sum += error * error;
        ++samples;
      });
  return report.impacts > 0 && report.overruns == 0 ? std::sqrt(sum / static_cast<double>(samples)) : NAN;
}

/// SimBenchmark's "elastic 666".
inline void elastic_666(Rows& rows) {
  const Material<double> material{1, 0};
  const auto system =
      System<double, 216, Sphere<double>>::of(Body{Sphere{0.1}, 10.0, material}, {floor_plane(material)});
  SystemState<double, 216> y;
  Random random(666);
  for (int i = 0; i < 216; ++i) {
    y[i].position = {0.21 * (i % 6) + random.uniform(0, 1e-3), 0.21 * (i / 6 % 6) + random.uniform(0, 1e-3),
                     1.101 + 0.21 * (i / 36) + random.uniform(0, 1e-3)};
  }
  const double error = energy_error(system, y, 9.81, {.step = 1e-3, .duration = 10},
                                    [](double, double start) { return start; });
  rows.push_back(
      {"elastic_666", error, 1e-9, "relative",
       "SimBenchmark, energy RMS, 1 ms, 10 s (RaiSim 8.4e-5, ODE 3.1e-4, Bullet 5.9e-3, DART 1.7e-2); "
       "g = 9.81, offsets drawn uniformly from Philox, seed 666; heights from the floor"});
}

/// SimBenchmark's "bouncing".
inline void bouncing_49(Rows& rows) {
  constexpr double g = 9.81, radius = 0.1, centre = 5;
  const auto run = [&](double e, const auto& expected) {
    const Material<double> material{e, 0};
    const auto system =
        System<double, 49, Sphere<double>>::of(Body{Sphere{radius}, 10.0, material}, {floor_plane(material)});
    SystemState<double, 49> y;
    for (int i = 0; i < 49; ++i) y[i].position = {2.0 * (i % 7), 2.0 * (i / 7), centre};
    return energy_error(system, y, g, {.step = 1e-3, .duration = 20, .rest_speed = 1e-4}, expected);
  };
  rows.push_back(
      {"bouncing_49", run(1, [](double, double start) { return start; }), 1e-10, "relative",
       "SimBenchmark, energy RMS, 1 ms, 20 s (RaiSim 5.7e-6, ODE 5.7e-4, DART 1.1e-2, Bullet 1.1e-2); "
       "g = 9.81, rest_speed 1e-4 m/s"});
  const double e = 0.8;
  const double error = run(e, [&](double time, double start) {
    const double rest = radius / centre;
    double share = 1 - rest, impact = std::sqrt(2 * (centre - radius) / g), flight = 2 * impact * e;
    while (time > impact && share > 1e-12) {
      share *= e * e;
      impact += flight;
      flight *= e;
    }
    return start * (rest + (share > 1e-12 ? share : 0));
  });
  rows.push_back({"bouncing_49_e0.8", error, 1e-10, "relative",
                  "the same with e = 0.8 against the closed form, to rest; rest_speed 1e-4 m/s instead of "
                  "5e-3, which would end "
                  "the bouncing early"});
}

inline void scenes(Rows& rows) {
  elastic_666(rows);
  bouncing_49(rows);
}

}  // namespace validate
