#pragma once

#include "symmetry.hpp"

namespace validate {

/// A stepper that is copied in the middle of a run, and one that is made anew from the state there, go on to
/// the same bits. The figure counts runs that do not.
template <class Shape>
Figure copies(const Cases& cases) {
  Figure worst;
  double wrong = 0;
  for (long i = cases.first; i < cases.first + cases.count; ++i) {
    Random r(cases.seed, static_cast<std::uint64_t>(i));
    const Cell cell(i);
    const auto crowd = any_crowd<Shape>(r, cell);
    const SimulationOptions options{.step = crowd.step, .contacts = cell.mode};
    using Run = Stepper<World<Shape>, Loads, Rk4>;
    Ear<double, Shape> ear;
    const auto advance = [&](Run& run, States& y, long from, long to) {
      for (long k = from; k < to; ++k) run.step(y, static_cast<double>(k) * crowd.step, crowd.step, ear);
    };
    const long total = 3 * crowd.steps,
               middle = static_cast<long>(r.below(static_cast<std::uint32_t>(total)));
    Run run(crowd.system, Loads{crowd.gravity}, Rk4{}, options);
    States y = crowd.start;
    advance(run, y, 0, middle);
    Run copy(run), anew(crowd.system, Loads{crowd.gravity}, Rk4{}, options);
    States y_copy = y, y_anew = y;
    advance(copy, y_copy, middle, total);
    advance(run, y, middle, total);
    advance(anew, y_anew, middle, total);
    if (y != y_copy)
      worst(++wrong, i, detail::text(cell.text(), ", copied after ", middle, " of ", total, " steps"));
    if (y != y_anew)
      worst(++wrong, i, detail::text(cell.text(), ", made anew after ", middle, " of ", total, " steps"));
  }
  return worst;
}

}  // namespace validate
