#pragma once

#include "symmetry.hpp"

namespace validate {

/// Runs that go on to other bits.
struct CopyFigures {
  Figure copied;    ///< after the stepper was copied
  Figure restored;  ///< after stepper and state were set back to what was saved of them
};

/// In the middle of a run a stepper is copied; at its end it is set back to that copy.
template <class Shape>
CopyFigures copies(const Cases& cases) {
  CopyFigures worst;
  each_case(cases, [&](long i, Random& r) {
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
    Run copy(run);
    const Run saved(run);
    States y_copy = y, y_restored = y;
    advance(copy, y_copy, middle, total);
    advance(run, y, middle, total);
    run = saved;
    advance(run, y_restored, middle, total);
    const auto where = rbres::detail::text(cell.text(), ", after ", middle, " of ", total, " steps");
    if (y != y_copy) worst.copied(worst.copied.value() + 1, i, where);
    if (y != y_restored) worst.restored(worst.restored.value() + 1, i, where);
  });
  return worst;
}

}  // namespace validate
