#pragma once

#include <limits>
#include <rbres/dynamics/dormand_prince.hpp>

#include "follow.hpp"

namespace validate {

/// Faults while the adaptive integrator looks for a step that is good enough, which it must not do for ever:
/// runs that do not end with the last good state.
inline Figure adaptive_faults() {
  Figure worst;
  double wrong = 0;
  const auto system = World<Sphere<double>>::of(Body{Sphere{0.1}, 1.0});
  using Limits = std::numeric_limits<double>;
  for (const double amount : {Limits::quiet_NaN(), Limits::infinity(), 1e308}) {
    for (const auto kind : {Fault::force, Fault::torque}) {
      States y;
      for (int k = 0; k < bodies; ++k) y[k].position.x = k;
      long asked = 0;
      const double step = 0.01, time = 0.055;
      const Loads loads{{0, 0, -9.81}, &asked, {kind, amount, time, 1, 0, step}};
      const auto report = simulate(system, y, loads, DormandPrince54{}, {.step = step, .duration = 0.1});
      const bool good = report.status == SimulationStatus::non_finite && report.time < time && asked < 100000;
      if (!good)
        worst(++wrong, 0,
              rbres::detail::text("fault ", static_cast<int>(kind), " of ", amount, ", ", asked,
                                  " evaluations"));
    }
  }
  return worst;
}

}  // namespace validate
