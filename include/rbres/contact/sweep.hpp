#pragma once

#include <limits>
#include <rbres/core/scalar.hpp>

namespace rbres::RBRES_ABI::detail {

/// Sweeps to and fro over the points of an island, each time going on along the way so far: nonlinear
/// conjugate gradients over projected Gauss-Seidel (Silcowitz-Hansen, Niebe, Erleben 2010), to `tolerance`
/// (m/s). Ends with a sweep, so that every cone holds. Returns the lanes in which laws are still off.
///
/// `points` has size(); relax(k, friction, where), which answers the law of point k and returns how far it
/// was off; start() of the way and start_round(); squared_change() of the impulses in this round; and
/// go_on(share), which goes that share of the way on.
template <class S, class Points>
MaskOf<S> sweep(Points& points, const MaskOf<S>& where, bool friction, const S& tolerance, int rounds) {
  constexpr int patience = 12;
  MaskOf<S> working = where, open(false);
  S last_length(0), mark(std::numeric_limits<typename Constants<S>::Real>::max());
  points.start();
  for (int round = 1; round <= rounds; ++round) {
    points.start_round();
    S worst(0);
    for (const bool back : {false, true}) {
      for (std::size_t k = 0; k < points.size(); ++k)
        worst = maximum(worst, points.relax(back ? points.size() - 1 - k : k, friction, working));
      working = working & (worst > tolerance);
      if (!any(working)) return open;
    }
    // Points whose targets do not agree push against one another for ever: what is left then stays.
    if (round % patience == 0) {
      const MaskOf<S> better = worst < as<S>(0.8) * mark;
      open = open | (working & !better);
      working = working & better;
      mark = worst;
    }
    if (!any(working) || round == rounds) break;
    const S length = points.squared_change();
    const MaskOf<S> onward = working & (length < last_length);
    const S share = select(onward, S(length / select(onward, last_length, S(1))), S(0));
    last_length = length;
    points.go_on(share);
  }
  return open | working;
}

}  // namespace rbres::RBRES_ABI::detail
