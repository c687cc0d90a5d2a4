#pragma once

#include <limits>

#include "symmetry.hpp"

namespace validate {

/// What a body does when the fault comes.
enum class Situation { flight, landing, resting, sliding, stacked, colliding, count };

/// Faults in the middle of a run: whatever the forces become, the run returns, says so, and leaves the last
/// good state. The figure counts runs that did not.
template <class Shape>
Figure faults(const Cases& cases) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN(),
                   inf = std::numeric_limits<double>::infinity();
  constexpr std::pair<Fault::Kind, double> kinds[] = {
      {Fault::force, nan},    {Fault::force, inf},    {Fault::force, -inf},      {Fault::force, 1e200},
      {Fault::force, 1e308},  {Fault::force, -1e200}, {Fault::torque, nan},      {Fault::torque, inf},
      {Fault::torque, 1e200}, {Fault::torque, 1e308}, {Fault::late_torque, nan}, {Fault::late_torque, 1e200},
      {Fault::spring, 1e6},   {Fault::spring, 1e9},   {Fault::cubic, 1e3},       {Fault::cubic, 1e9},
      {Fault::spin, 1e3},     {Fault::spin, 1e5},
  };
  constexpr long kind_count = std::size(kinds), situations = static_cast<long>(Situation::count);
  Figure worst;
  double wrong = 0;
  each_case(cases, [&](long i, Random& r) {
    const auto [kind, amount] = kinds[i % kind_count];
    const auto situation = static_cast<Situation>(i / kind_count % situations);
    Cell cell(i / (kind_count * situations) * 5 + i);
    const int a = cell.index, b = cell.partner();
    const auto system = any_system<Shape>(r, cell.material(), {floor_plane(cell.material())}, 1.2);
    const double ra = system[a].bounding_radius(), rb = system[b].bounding_radius();
    const double step = log_uniform(r, 1e-3, 1e-2) * std::sqrt(ra), fault_time = step * r.uniform(5, 30);
    States y = lying(system);
    const double g = 9.81;
    switch (situation) {
      case Situation::flight:
        y[a].position.z += 10 * ra;
        break;
      case Situation::landing: {  // at the time of the fault, one step in two
        const double fall = fault_time + step * r.uniform(-0.5, 1.5);
        y[a].position.z += 0.5 * g * fall * fall;
        y[a].angular_velocity = normal_vector(r, 0.1);
        break;
      }
      case Situation::resting:
        break;
      case Situation::sliding:
        y[a].velocity = {std::sqrt(g * ra), 0, 0};
        break;
      case Situation::stacked:
        put_on(system, y, b, a);
        break;
      case Situation::colliding: {
        y[b].position = y[a].position + Vector{0, 0, 3 * (ra + rb)};
        y[a].position.z += ra;
        y[b].velocity = {0, 0, -(2 * (ra + rb)) / fault_time};
        break;
      }
      case Situation::count:
        break;
    }
    const Loads loads{{0, 0, -g}, nullptr, {kind, amount, fault_time, a, 0, step}};
    States last = y;
    double last_time = 0;
    Ear<double, Shape> ear;
    ear.look = [&](double time, const States& now) {
      last = now;
      last_time = time;
    };
    const auto report =
        simulate(system, y, loads, Rk4{}, {.step = step, .duration = 60 * step, .contacts = cell.mode}, ear);
    const bool must = !(std::abs(amount) <= std::numeric_limits<double>::max());
    bool good = report.status != SimulationStatus::stopped;
    for (int k = 0; k < y.size; ++k) good = good && std::isfinite((&y[0].position.x)[k]);
    good = good && y == last && report.time == last_time;
    if (report.status == SimulationStatus::non_finite) {
      good = good && report.bad_body >= 0 && report.bad_body < bodies && report.time > fault_time - 2 * step;
    }
    if (must)
      good = good && report.status == SimulationStatus::non_finite && report.time < fault_time + 2 * step;
    if (!good) {
      worst(++wrong, i,
            detail::text(cell.text(), ", situation ", static_cast<int>(situation), ", fault ",
                         static_cast<int>(kind), " of ", amount, ": status ", static_cast<int>(report.status),
                         " at ", report.time / step, " steps, fault at ", fault_time / step));
    }
  });
  return worst;
}

}  // namespace validate
