#pragma once

#include <algorithm>
#include <limits>
#include <optional>
#include <rbres/contact/contact_pair.hpp>
#include <rbres/contact/coupled_newton.hpp>
#include <rbres/contact/island_newton.hpp>
#include <rbres/contact/pair_newton.hpp>
#include <rbres/contact/point_newton.hpp>
#include <rbres/contact/sweep.hpp>
#include <rbres/contact/swept_points.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI::detail {

/// The contact points of one island, and the solver that finds their impulses: each point leaves its normal
/// at a target speed or faster, and obeys Coulomb's law.
template <class System>
class ContactRows {
  using S = typename System::Scalar;
  using Pair = ContactPair<System>;
  using Motions = typename Pair::Motions;
  using FixedPoint = ContactPoint<S, true>;
  using FreePoint = ContactPoint<S, false>;

 public:
  struct Row : ContactRow<S> {
    std::size_t point;                   ///< see ContactPair::place
    std::array<S, 3> before, way;        ///< impulse before a round, and the way it has gone, N s
    std::optional<Vec3<S>> way_halfway;  ///< of a point taken up where it is halfway through a part, m

    /// See ContactPoint; of points with a plane only.
    void set_drift(const Vec3<S>& drift) { std::get_if<0>(&this->at)->set_drift(drift); }
  };

  explicit ContactRows(const System& system)
      : in_crowd_(is_crowd(system)),
        coupled_(system, rows_of(system)),
        newton_(system, rows_of(system)),
        swept_(system, rows_of(system)),
        used_(per_body<MaskOf<S>>(system)) {
    rows_.reserve(rows_of(system));
  }

  /// Begins a step.
  void start_step() { failures_ = S(0); }

  std::size_t capacity() const { return rows_.capacity(); }
  std::size_t size() const { return rows_.size(); }
  /// Whether there is no room for another pair: memory is never asked for.
  bool full() const { return rows_.size() + Pair::points > rows_.capacity(); }
  void clear() {
    rows_.clear();
    tolerance_ = S(std::numeric_limits<typename Constants<S>::Real>::max());
  }

  /// Takes up point i of a pair that touches as `contact` says, where `active`, to leave at `target` (m/s) at
  /// least.
  Row& add(const Pair& pair, const typename Pair::Contact& contact, std::size_t i, const MaskOf<S>& active,
           const S& target, const S& friction, Motions& motion) {
    Row& row = rows_.emplace_back();
    row.who = pair.who;
    row.moved = pair.moved;
    row.point = pair.place(i);
    row.active = active;
    row.target = target;
    row.friction = friction;
    const Vec3<S>&normal = contact.normal, &point = contact.point[i];
    Motion<S>& second = motion[static_cast<std::size_t>(pair.who.second)];
    if (pair.plane()) {
      row.at.template emplace<FixedPoint>(normal, point, second, second);
    } else {
      row.at.template emplace<FreePoint>(normal, point, motion[static_cast<std::size_t>(pair.who.first)],
                                         second);
    }
    const S tolerance = as<S>(Constants<S>::solved) * pair.speed_scale;
    tolerance_ = select(active, minimum(tolerance_, tolerance), tolerance_);
    return row;
  }

  /// Where no two pairs share a body that contacts move. Lanes have one island, in which many pairs may touch
  /// in other lanes alone.
  MaskOf<S> pairs_apart() {
    if constexpr (!Packed<S>) {
      return std::all_of(rows_.begin(), rows_.end(),
                         [&](const Row& row) { return same_pair(row, rows_[0]); });
    } else {
      used_.fill(MaskOf<S>(false));
      MaskOf<S> shared(false);
      for (std::size_t from = 0; from < rows_.size(); from = end_of_pair(from)) {
        MaskOf<S> active(false);
        for (std::size_t k = from; k < end_of_pair(from); ++k) active = active | rows_[k].active;
        for (const int body : {rows_[from].moved.first, rows_[from].moved.second}) {
          if (body < 0) continue;
          MaskOf<S>& u = used_[static_cast<std::size_t>(body)];
          shared = shared | (u & active);
          u = u | active;
        }
      }
      return !shared;
    }
  }

  /// Calls f(row, contact point, first motion, second motion) for each row.
  template <class F>
  void each(Motions& motion, const F& f) {
    for (Row& row : rows_)
      with_point(row, motion, [&](auto& point, auto& a, auto& b) { f(row, point, a, b); });
  }

  /// Changes the velocities in `motion` until every row obeys its laws, to the tolerance of the smallest
  /// bodies. Only in the lanes `where`. A large heap that is `moving` is swept less, from the forces of the
  /// step before.
  void solve(Motions& motion, const MaskOf<S>& where, bool moving = false) {
    // Of single bodies that Newton's method leaves off by less, the other methods solve next to none.
    constexpr double enough = std::is_same_v<typename Constants<S>::Real, float> ? 2e3 : 1e6;
    solve(motion, where, true, tolerance_, as<S>(enough) * tolerance_, moving);
  }
  /// The same, coarser and faster, for what lasts no longer than the step. It starts with friction, from the
  /// forces of the part before.
  void solve_within_step(Motions& motion, const MaskOf<S>& where) {
    constexpr int some = 12;
    if (all(pairs_apart())) return solve(motion, where);
    sweep(motion, where, true, as<S>(1e4) * tolerance_, some);
  }
  /// Coarser still, where forces that are found next take up what is left.
  void sweep_within_step(Motions& motion, const MaskOf<S>& where) {
    constexpr int some = 4;
    sweep(motion, where, true, as<S>(1e6) * tolerance_, some);
  }
  /// The same of what Newton's method does not solve.
  void correct_moving(Motions& motion, const MaskOf<S>& where) {
    if (any(solve_directly(motion, where, true, tolerance_, coarser(tolerance_))))
      sweep_within_step(motion, where);
  }

  /// The same to `tolerance` (m/s), with or without friction.
  void solve(Motions& motion, const MaskOf<S>& where, bool friction, const S& tolerance) {
    solve(motion, where, friction, tolerance, coarser(tolerance), false);
  }

 private:
  /// Newton's method solves most single pairs and most small islands; a few sweeps others, the method of
  /// multipliers what it leaves off, single bodies by more than `enough` (m/s). Large heaps and islands of a
  /// crowd in motion, for which that costs too much, are swept to a coarser tolerance and then on, those in
  /// motion where that is soon reached.
  void solve(Motions& motion, const MaskOf<S>& where, bool friction, const S& tolerance, const S& enough,
             bool moving) {
    constexpr int few = 12, fewer = 4, some = 20, many = 100;
    const MaskOf<S> left = solve_directly(motion, where, friction, tolerance, enough);
    if (!any(left)) return;
    // Where no forces obey all laws, as in a jam, it fails again and again, at the price of many sweeps.
    const MaskOf<S> hopeful = failures_ < as<S>(most_failures);
    if (!moving && any(left & hopeful) && newton_.take_up(*this, motion)) {
      const MaskOf<S> apart = pairs_apart();
      MaskOf<S> single = left & apart, joint = left & !apart;
      if (any(single)) single = sweep_rows(motion, single, friction, tolerance, few);
      // Friction comes second: what it answers before the normals agree only slows it down.
      if (any(joint)) {
        const MaskOf<S> off = sweep(motion, joint, false, tolerance, few);
        joint = friction ? sweep(motion, joint, true, tolerance, few) : off;
      }
      const MaskOf<S> open = single | joint;
      if (!any(open)) return;
      const MaskOf<S> off = newton_.solve(*this, motion, open & hopeful, friction, tolerance);
      failures_ += select(off, S(1), S(0));
      // Cones need not hold there.
      if (any(off)) sweep_rows(motion, off, friction, tolerance, few);
      return;
    }
    if (moving) {
      sweep(motion, where, true, as<S>(1e5) * tolerance, some);
      return;
    }
    const S coarse = coarser(tolerance);
    sweep(motion, left, false, coarse, many);
    if (friction) sweep(motion, where, true, coarse, many);
    // Crowds are solved from the forces of the step before: what is left off now is seen to then.
    sweep(motion, where, friction, tolerance, in_crowd_ ? fewer : few);
  }

  static constexpr double most_failures = 40;

  static bool same_pair(const Row& a, const Row& b) {
    return a.who.first == b.who.first && a.who.second == b.who.second &&
           (Pair::places == Pair::points || a.point / Pair::points == b.point / Pair::points);
  }
  /// The row after those of the pair whose first is this one.
  std::size_t end_of_pair(std::size_t from) const {
    std::size_t end = from + 1;
    while (end < rows_.size() && same_pair(rows_[end], rows_[from])) ++end;
    return end;
  }

  static S coarser(const S& tolerance) { return as<S>(2000.0) * tolerance; }

  /// Newton's methods, for pairs and for islands. Returns the lanes in which laws are off, of single bodies
  /// with several pairs by more than `enough` (m/s).
  MaskOf<S> solve_directly(Motions& motion, const MaskOf<S>& where, bool friction, const S& tolerance,
                           const S& enough) {
    const MaskOf<S> apart = pairs_apart(), single = where & apart;
    MaskOf<S> left = where & !apart;
    if (any(single)) {
      for (std::size_t from = 0; from < rows_.size(); from = end_of_pair(from)) {
        left =
            left | (rows_[from].plane() ? solve_pair<FixedPoint>(from, motion, single, friction, tolerance)
                                        : solve_pair<FreePoint>(from, motion, single, friction, tolerance));
      }
    }
    // Single pairs that have failed get a second try: it is slower, but surer.
    const S coarse = coarser(tolerance);
    if (any(left))
      left = coupled_.solve(*this, motion, left, friction, tolerance, coarse, select(apart, coarse, enough));
    return left;
  }

  /// Gives the points of the pair whose first row this is the impulses that Newton's method finds. Returns
  /// the lanes in which laws are off.
  template <class Point>
  MaskOf<S> solve_pair(std::size_t from, Motions& motion, const MaskOf<S>& where, bool friction,
                       const S& tolerance) {
    const auto at = [](auto& row) -> auto& { return *std::get_if<Point>(&row.at); };
    const std::size_t end = end_of_pair(from);
    const Row& some = rows_[from];
    Motion<S>& second = motion[static_cast<std::size_t>(some.who.second)];
    Motion<S>& first = some.plane() ? second : motion[static_cast<std::size_t>(some.who.first)];
    const S rubs = friction ? some.friction : S(0);
    if (end == from + 1) {
      PointNewton<S> newton(at(some), some.target, some.active & where, first, second);
      const MaskOf<S> open = newton.solve(rubs, tolerance);
      newton.apply(rubs, at(rows_[from]), first, second);
      return open & where;
    }
    PairNewton<S, std::is_same_v<Point, FixedPoint>, Pair::points> newton(at(some).frame(), first, second);
    for (std::size_t i = from; i < end; ++i)
      newton.add(at(rows_[i]), rows_[i].target, rows_[i].active & where);
    const MaskOf<S> open = newton.solve(rubs, tolerance);
    for (std::size_t i = from; i < end; ++i) newton.apply(i - from, rubs, at(rows_[i]), first, second);
    return open & where;
  }

  /// See detail::sweep().
  MaskOf<S> sweep(Motions& motion, const MaskOf<S>& where, bool friction, const S& tolerance, int rounds) {
    if constexpr (in_registers) {
      if (in_crowd_) {
        swept_.take(*this, motion);
        const bool open = detail::sweep<S>(swept_, where, friction, tolerance, rounds);
        swept_.give(*this, motion);
        return open;
      }
    }
    return sweep_rows(motion, where, friction, tolerance, rounds);
  }
  MaskOf<S> sweep_rows(Motions& motion, const MaskOf<S>& where, bool friction, const S& tolerance,
                       int rounds) {
    RowPoints<Reserved<Row, row_room<System>>, Motions> points{rows_, motion};
    return detail::sweep<S>(points, where, friction, tolerance, rounds);
  }

  static std::size_t rows_of(const System& system) {
    return most_rows<System>(parts_of(system), system.planes().size());
  }
  /// Dynamic systems alone may be crowds.
  static constexpr bool in_registers = System::bodies == dynamic && std::is_floating_point_v<S>;
  struct NotSwept {
    NotSwept(const System&, std::size_t) {}
  };

  bool in_crowd_;
  IslandCoupling<System> coupled_;
  IslandNewton<System> newton_;
  [[no_unique_address]] std::conditional_t<in_registers, SweptPoints<System>, NotSwept> swept_;
  Reserved<Row, row_room<System>> rows_;
  PerBody<MaskOf<S>, System::bodies> used_;  ///< by a pair
  S tolerance_{0};
  S failures_{0};  ///< of the method of multipliers in this step
};

}  // namespace rbres::RBRES_ABI::detail
