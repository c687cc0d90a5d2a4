#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <rbres/contact/contact_row.hpp>

namespace rbres::RBRES_ABI::detail {

/// Sweeps to and fro over the points of an island, each time going on along the way so far: nonlinear
/// conjugate gradients over projected Gauss-Seidel (Silcowitz-Hansen, Niebe, Erleben 2010), to `tolerance`
/// (m/s). Ends with a sweep, so that every cone holds. Returns the lanes in which laws are still off.
///
/// `points` has size(); relax(k, friction, where), which answers the law of point k and returns how far it
/// was off; start() of the way and start_round(); squared_change() of the impulses in this round;
/// go_on(share), which goes that share of the way on; and gives_up, whether it also ends where six rounds
/// have brought nothing.
template <class S, class Points>
MaskOf<S> sweep(Points& points, const MaskOf<S>& where, bool friction, const S& tolerance, int rounds) {
  constexpr int patience = 12;
  [[maybe_unused]] constexpr int glance = 6;
  MaskOf<S> working = where, open(false);
  S last_length(0), mark(std::numeric_limits<typename Constants<S>::Real>::max());
  [[maybe_unused]] S seen = mark;
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
    if constexpr (Points::gives_up) {
      if (round % glance == 0) {
        if (worst > as<S>(0.998) * seen) break;
        seen = worst;
      }
    }
    const S length = points.squared_change();
    const MaskOf<S> onward = working & (length < last_length);
    const S share = select(onward, S(length / select(onward, last_length, S(1))), S(0));
    last_length = length;
    points.go_on(share);
  }
  return open | working;
}

/// Contact rows (ContactRows::Row) as sweep() takes them.
template <class Rows, class Motions>
struct RowPoints {
  using S = typename Rows::value_type::Scalar;
  static constexpr bool gives_up = false;
  Rows& rows;
  Motions& motion;

  std::size_t size() const { return rows.size(); }
  void start() {
    for (auto& row : rows) row.way = {S(0), S(0), S(0)};
  }
  void start_round() {
    for (auto& row : rows) row.before = row.impulse();
  }
  S relax(std::size_t k, bool friction, const MaskOf<S>& where) {
    auto& row = rows[k];
    const MaskOf<S> active = row.active & where;
    S fault(0);
    with_point(row, motion, [&](auto& point, auto& a, auto& b) {
      fault = friction ? point.relax(row.target, row.friction, active, a, b)
                       : point.relax_normal(row.target, active, a, b);
    });
    return fault;
  }
  S squared_change() const {
    S sum(0);
    for (const auto& row : rows) {
      for (std::size_t d = 0; d < 3; ++d) sum += square(S(row.impulse()[d] - row.before[d]));
    }
    return sum;
  }
  void go_on(const S& share) {
    for (auto& row : rows) {
      std::array<S, 3> further;
      for (std::size_t d = 0; d < 3; ++d) {
        further[d] = share * row.way[d];
        row.way[d] = further[d] + (row.impulse()[d] - row.before[d]);
      }
      with_point(row, motion, [&](auto& point, auto& a, auto& b) { point.add(further, a, b); });
    }
  }
};

}  // namespace rbres::RBRES_ABI::detail
