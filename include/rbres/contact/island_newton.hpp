#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <rbres/contact/contact_pair.hpp>
#include <rbres/contact/island_equations.hpp>

namespace rbres::RBRES_ABI::detail {

/// Solves the contact laws of one island: u_n >= target, complementary to p_n >= 0, and Coulomb's friction
/// with it. The fixed point p = projection of p - rho (u - target) (Alart and Curnier 1991) is found by the
/// method of multipliers: with the friction cones' radii held, a convex function of the bodies' velocities is
/// minimised by Newton's method, M dv = J^T (projected - p); then impulses and radii follow. Any number of
/// points may share a face, and any mass may rest on any other.
template <class System>
class IslandNewton {
  using S = typename System::Scalar;
  using Three = Triple<S>;

 public:
  IslandNewton(const System& system, std::size_t most_rows) : equations_(system) { rows_.reserve(most_rows); }

  /// Takes up the rows of an island. False where it is too large.
  template <class Rows, class Motions>
  bool take_up(Rows& rows, Motions& motion) {
    if (!equations_.take_up(rows, motion)) return false;
    rows_.clear();
    rows.each(motion, [&](auto& row, auto& point, auto&, auto&) {
      RowState& r = rows_.emplace_back();
      r.jacobian = equations_.jacobian(row, point);
      r.active = row.active;
      r.start = point.impulse();
    });
    return true;
  }

  /// Changes the impulses of `rows` (ContactRows), which have been taken up, and the velocities in `motion`
  /// in the lanes `where`, until no law is off by more than `tolerance` (m/s), or none gets better. Returns
  /// where some still are: there impulses may lie outside their cones.
  template <class Rows, class Motions>
  MaskOf<S> solve(Rows& rows, Motions& motion, const MaskOf<S>& where, bool friction, const S& tolerance) {
    constexpr int rounds = 60, patience = 8, newton_steps = 30;
    MaskOf<S> working = where;
    double stiffness = 10;
    S pace(1);  // at which cones follow their normal impulses
    S mark(std::numeric_limits<typename Constants<S>::Real>::max());
    best_ = mark;
    for (int round = 1; round <= rounds; ++round) {
      // Soft at first, or Newton's method would hunt for the points that touch.
      stiffness = std::min(hardest, 10 * stiffness);
      stiffness_ = as<S>(stiffness);
      const S worst = read(rows, motion, friction, round == 1 ? S(1) : pace);
      keep_best(worst);
      working = working & (worst > tolerance);
      if (round % patience == 0) {
        // Cones and normal impulses that chase one another agree sooner when they go slower.
        const MaskOf<S> better = worst < as<S>(0.5) * mark;
        pace = select(better, pace, S(as<S>(0.3) * pace));
        working = working & (pace > as<S>(0.02));
        mark = worst;
      }
      if (!any(working) || round == rounds) break;
      MaskOf<S> stepping = working;
      for (int step = 1;; ++step) {
        set_up();
        equations_.solve();
        S largest(0);
        for (RowState& r : rows_) {
          r.change = equations_.change(r.jacobian);
          for (std::size_t d = 0; d < 3; ++d)
            largest = maximum(largest, select(r.active, S(abs_of(r.change[d])), S(0)));
        }
        stepping = stepping & (largest > as<S>(0.1) * tolerance);
        if (step == newton_steps || !any(stepping)) break;
        advance(step_length(), stepping);
      }
      // Impulses by the linear model of the last step: they and the velocities agree to rounding.
      std::size_t k = 0;
      rows.each(motion, [&](auto&, auto& point, auto& first, auto& second) {
        const RowState& r = rows_[k++];
        std::array<S, 3> change;
        for (std::size_t d = 0; d < 3; ++d) {
          change[d] = r.projected[d] - r.impulse[d];
          for (std::size_t e = 0; e < 3; ++e) change[d] -= r.slope[d][e] * r.change[e];
          change[d] = select(working & r.active, change[d], S(0));
        }
        point.add(change, first, second);
      });
    }
    // From the start again: impulses that have been huge on the way leave their rounding errors behind.
    equations_.restart(motion);
    std::size_t k = 0;
    rows.each(motion, [&](auto&, auto& point, auto& first, auto& second) {
      const RowState& r = rows_[k++];
      Three change;
      for (std::size_t d = 0; d < 3; ++d) change[d] = select(where, S(r.best[d] - r.start[d]), S(0));
      point.restore(r.start);
      point.add(change, first, second);
    });
    return where & (best_ > tolerance);
  }

 private:
  /// The largest of stiffness_.
  static constexpr double hardest = std::is_same_v<typename Constants<S>::Real, float> ? 1e3 : 1e7;

  struct RowState {
    PointJacobian<S> jacobian;
    MaskOf<S> active;
    S rho, most;  ///< most: the friction cone's radius, N s
    Three start;  ///< impulse before the first round, N s
    Three best;   ///< impulse with the least fault, N s
    Three impulse,
        fault;        ///< of the round; fault: relative velocity less target, as Newton's method moves it
    Three projected;  ///< of impulse - rho fault
    std::array<Three, 3> slope;  ///< rho times the projection's derivative
    Three change;                ///< of the relative velocity by the step
  };

  void keep_best(const S& worst) {
    const MaskOf<S> better = worst < best_;
    best_ = select(better, worst, best_);
    for (RowState& r : rows_) {
      for (std::size_t d = 0; d < 3; ++d) r.best[d] = select(better, r.impulse[d], r.best[d]);
    }
  }
  static S abs_of(const S& x) {
    using std::abs;
    return abs(x);
  }

  /// Where a round starts; cones go the share `pace` of their way to the normal impulses. Returns by how much
  /// the worst law is off, m/s.
  template <class Rows, class Motions>
  S read(Rows& rows, Motions& motion, bool friction, const S& pace) {
    S worst(0);
    std::size_t k = 0;
    equations_.stay();
    rows.each(motion, [&](auto& row, auto& point, auto& first, auto& second) {
      RowState& r = rows_[k++];
      r.rho = stiffness_ / point.normal_response();
      r.impulse = point.impulse();
      for (std::size_t d = 0; d < 3; ++d) r.fault[d] = point.velocity(d, first, second);
      r.fault[0] -= row.target;
      const S most = friction ? S(row.friction * maximum(r.impulse[0], S(0))) : S(0);
      r.most = select(pace < S(1), S(r.most + pace * (most - r.most)), most);
      const S& g = point.normal_response();
      // The fault itself: of a huge impulse its difference from the projection would be nothing but rounding.
      const MaskOf<S> pushes = r.impulse[0] > r.fault[0] / g;
      const S off = select(pushes, abs_of(r.fault[0]), S(g * abs_of(r.impulse[0])));
      worst = worse_of<S>(worst, row.active, off);
      if (friction) {
        const S& gt = point.tangent_response();
        const S u = r.impulse[1] - r.fault[1] / gt, v = r.impulse[2] - r.fault[2] / gt;
        const S share = inside(u, v, most);
        const S slip = abs_of(S(r.impulse[1] - share * u)) + abs_of(S(r.impulse[2] - share * v));
        worst = worse_of<S>(worst, row.active, S(gt * slip));
      }
    });
    return worst;
  }

  /// The share of (u, v) that lies within a circle.
  static S inside(const S& u, const S& v, const S& radius) {
    const S length2 = square(u) + square(v);
    const MaskOf<S> outside = length2 >= square(radius);
    return select(outside, S(radius * inverse_root(S(length2 + S(Constants<S>::tiny)))), S(1));
  }

  /// The projection of impulse - rho (fault + length change).
  static Three project(const RowState& r, const S& length) {
    Three q;
    for (std::size_t d = 0; d < 3; ++d) q[d] = r.impulse[d] - r.rho * (r.fault[d] + length * r.change[d]);
    const S share = inside(q[1], q[2], r.most);
    return {maximum(q[0], S(0)), share * q[1], share * q[2]};
  }

  /// The equations of one step.
  void set_up() {
    equations_.start();
    for (RowState& r : rows_) {
      Three q;
      for (std::size_t d = 0; d < 3; ++d) q[d] = r.impulse[d] - r.rho * r.fault[d];
      const S share = inside(q[1], q[2], r.most);
      r.projected = {maximum(q[0], S(0)), share * q[1], share * q[2]};
      const MaskOf<S> pushes = r.active & (q[0] > S(0)), slides = share < S(1);
      const S along = select(slides, S(share / (square(q[1]) + square(q[2]) + S(Constants<S>::tiny))), S(0));
      const S rho = select(r.active, r.rho, S(0));
      for (auto& line : r.slope) line = {S(0), S(0), S(0)};
      r.slope[0][0] = select(pushes, r.rho, S(0));
      r.slope[1][1] = rho * (share - along * square(q[1]));
      r.slope[2][2] = rho * (share - along * square(q[2]));
      r.slope[1][2] = r.slope[2][1] = S(-rho * along * q[1] * q[2]);
      Three push;
      for (std::size_t d = 0; d < 3; ++d) push[d] = select(r.active, S(r.projected[d] - r.impulse[d]), S(0));
      equations_.add(r.jacobian, r.slope, push);
    }
  }

  /// How far to go along the step: all the way, or to where the function's slope is a fraction of what it
  /// was.
  S step_length() const {
    const auto [rise, bend] = equations_.kinetic_slope();
    const auto slope = [&, start = rise, change = bend](const S& length) {
      S sum = start + length * change;
      for (const RowState& r : rows_) {
        const Three p = project(r, length);
        for (std::size_t d = 0; d < 3; ++d)
          sum += select(r.active, S((r.impulse[d] - p[d]) * r.change[d]), S(0));
      }
      return sum;
    };
    S low(0), high(1), at_low = slope(low), at_high = slope(high);
    const S enough = as<S>(0.1) * abs_of(at_low);
    S length(1);
    MaskOf<S> searching = at_high > enough;
    for (int i = 0; i < 20 && any(searching); ++i) {
      // Illinois' method would do; halving now and then keeps kinks from stalling it.
      const S fall = at_high - at_low;
      const S secant = low - at_low * (high - low) / select(fall > S(0), fall, S(1));
      const S middle = S(0.5) * (low + high);
      const S next = select(searching, i % 3 == 2 ? middle : secant, length);
      const S found = slope(next);
      length = next;
      const MaskOf<S> above = found > S(0);
      high = select(above, next, high);
      at_high = select(above, found, at_high);
      low = select(above, low, next);
      at_low = select(above, at_low, found);
      searching = searching & (abs_of(found) > enough);
    }
    return length;
  }

  /// Goes along the step.
  void advance(const S& length, const MaskOf<S>& where) {
    const S way = select(where, length, S(0));
    equations_.advance(way);
    for (RowState& r : rows_) {
      for (std::size_t d = 0; d < 3; ++d) r.fault[d] += way * r.change[d];
    }
  }

  S stiffness_, best_;  ///< rho times a point's response; the least fault so far, m/s
  Reserved<RowState, row_room<System>> rows_;
  IslandEquations<System, true> equations_;
};

}  // namespace rbres::RBRES_ABI::detail
