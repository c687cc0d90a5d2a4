#pragma once

#include "symmetry.hpp"

namespace validate {

/// Lanes against runs of their own.
struct LaneFigures {
  Figure difference;  ///< at the end, over size and speed
  Figure resting;     ///< the same of bodies that do not bounce (e = 0)
  Figure neighbours;  ///< difference that a fault in another lane makes
  Figure unreported;  ///< lanes whose fault was not reported, or was in another
};

template <class S, class Shape>
LaneFigures lanes(const Cases& cases) {
  using T = typename ScalarTraits<S>::Value;
  constexpr std::size_t count = ScalarTraits<S>::lanes;
  LaneFigures worst;
  double wrong = 0;
  each_case(cases, [&](long i, Random& r) {
    const Cell cell(i);
    const auto crowd = any_crowd<Shape>(r, cell);
    std::array<States, count> starts;
    for (auto& start : starts) {
      start = crowd.start;
      for (auto& body : start.body) body.velocity += normal_vector(r, 0.1 * crowd.speed);
    }
    const auto run = [&](const Fault& fault) {
      auto runner =
          std::make_unique<Runner<S, Shape>>(crowd.system, crowd.gravity, crowd.step, cell.mode, fault);
      for (std::size_t l = 0; l < count; ++l) runner->start(l, starts[l]);
      runner->advance(crowd.steps);
      return runner;
    };
    const auto together = run({});
    const int bad = static_cast<int>(r.below(count));
    const double time = crowd.step * static_cast<double>(crowd.steps) * r.uniform();
    const auto faulty = run({Fault::force, NAN, time, cell.index, bad, crowd.step});
    for (std::size_t l = 0; l < count; ++l) {
      Runner<T, Shape> alone(crowd.system, crowd.gravity, crowd.step, cell.mode);
      alone.start(0, starts[l]);
      alone.advance(crowd.steps);
      const bool rests = cell.restitution == 0;
      const auto where = detail::text(cell.text(), ", lane ", l);
      (rests ? worst.resting : worst.difference)(apart(crowd, alone.state(0), together->state(l)), i, where);
      if (faulty->finite(l) == (static_cast<int>(l) == bad)) worst.unreported(++wrong, i, where);
      if (static_cast<int>(l) != bad)
        (rests ? worst.resting : worst.neighbours)(apart(crowd, faulty->state(l), together->state(l)), i,
                                                   where);
    }
  });
  return worst;
}

}  // namespace validate
