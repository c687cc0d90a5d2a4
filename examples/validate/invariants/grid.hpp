#pragma once

#include "follow.hpp"

namespace validate {

/// What the grid measures, for one shape and scalar: each its own figure over all cases.
struct GridFigures {
  Figure impact_plane, impact_pair;          ///< rise of the energy in one impact
  Figure run_plane, run_pair;                ///< and over a run
  Figure linear, angular, angular_discrete;  ///< change of momentum, of bodies among themselves
  Figure edge;                               ///< and along planes without friction
  Figure overlap, work, impacts_in_step;
  Figure run_resting, overlap_resting;  ///< of bodies that do not bounce (e = 0)
  long impacts = 0;
};

template <class S, class Shape>
GridFigures grid(const Cases& cases) {
  constexpr std::size_t lanes = ScalarTraits<S>::lanes;
  GridFigures worst;
  each_case(cases, [&](long i, Random& r) {
    const Cell cell(i);
    const auto system = any_system<Shape>(r, cell.material(), cell_planes(cell, r));
    std::array<States, lanes> starts;
    for (auto& start : starts) start = cell_start(system, cell, r);
    const double step = cell_step(system, cell, r);
    // Every other fall into a corner is one: then bodies come to rest.
    const double pull = cell.plane && r.below(2) == 1 ? 3 * system[cell.index].bounding_radius() : 0;
    const Vector gravity = pull > 0 ? -pull * system.planes()[0].normal : Vector{};
    const auto where = cell.text() + (pull > 0 ? ", gravity" : "");
    for (const Balance& b : follow<S>(system, cell, starts, gravity, step, std::lround(1.5 / step))) {
      (cell.plane ? worst.impact_plane : worst.impact_pair)(b.impact_rise, i, where);
      const bool rests = cell.restitution == 0;
      (rests ? worst.run_resting : cell.plane ? worst.run_plane : worst.run_pair)(b.rise, i, where);
      if (!cell.plane) {
        const bool continuous = cell.mode == ContactMode::continuous;
        worst.linear(b.linear, i, where);
        (continuous ? worst.angular : worst.angular_discrete)(b.angular, i, where);
      } else if (cell.friction == 0) {
        worst.edge(b.linear_along, i, where);
      }
      if (cell.mode == ContactMode::continuous)
        (rests ? worst.overlap_resting : worst.overlap)(b.overlap, i, where);
      worst.work(b.work, i, where);
      worst.impacts_in_step(static_cast<double>(b.impacts_in_step), i, where);
      worst.impacts += b.impacts;
    }
  });
  return worst;
}

}  // namespace validate
