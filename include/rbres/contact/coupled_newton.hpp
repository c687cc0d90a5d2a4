#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <rbres/contact/body_points.hpp>
#include <rbres/contact/island_equations.hpp>
#include <rbres/contact/island_points.hpp>
#include <rbres/contact/point_equations.hpp>
#include <type_traits>

namespace rbres::RBRES_ABI::detail {

/// Newton's method for the contact laws of an island, normals and friction cones at once: as PairNewton, of
/// any number of bodies and normals. It finds the impulses in a few steps where it starts near enough to
/// them, and need not find them elsewhere. `S`: the system's plain scalar, or that of one of its lanes.
template <class System, class S>
class CoupledNewton {
 public:
  CoupledNewton(const System& system, std::size_t most_rows)
      : points_(system, most_rows), island_(system, most_rows) {}

  /// Changes the impulses of `rows` (ContactRows) and the velocities in `motion`, to the best that it finds:
  /// until no law is off by more than `tolerance` (m/s), or none gets better. Starts once more from there
  /// where one is off by more than `coarse`. True where none is then, or of a single body by more than
  /// `rough`.
  template <class Rows, class Motions>
  bool solve(Rows& rows, Motions& motion, bool friction, const S& tolerance, const S& coarse,
             const S& rough) {
    const auto approached = [&](auto& points) {
      const S off = approach(points, tolerance);
      points.give(rows, motion);
      return off;
    };
    const auto solved = [&](auto& points, const S& enough) {
      if (approached(points) <= coarse) return true;
      return points.take_up(rows, motion, friction) && approached(points) <= enough;
    };
    if constexpr (single) {
      if (body_.take_up(rows, motion, friction)) return solved(body_, rough);
      if (points_.take_up(rows, motion, friction)) return solved(points_, coarse);
    }
    return island_.take_up(rows, motion, friction) && solved(island_, coarse);
  }

 private:
  /// Goes steps until no law is off by more than `tolerance`, or none gets better. Returns by how much the
  /// worst is off at best, m/s.
  template <class Points>
  static S approach(Points& points, const S& tolerance) {
    constexpr int most_steps = 30, patience = 8;
    constexpr bool is_float = std::is_same_v<typename Constants<S>::Real, float>;
    double least_soft = is_float ? 1e-3 : 1e-5;
    // Equations that are softer than the heaviest body let it creep to its velocity.
    if constexpr (!is_float && requires { points.stiffness(); }) {
      while (least_soft > 1e-9 && as<S>(10 * least_soft) * points.stiffness() > S(1)) least_soft *= 0.1;
    }
    double soft = 1;
    int since = 0;  // steps since it got better by half
    S last(std::numeric_limits<typename Constants<S>::Real>::max()), best = last, mark = last;
    for (int step = 0;; ++step) {
      const S worst = points.read();
      // Soft at first, or points of one face whose targets differ would take turns.
      soft = worst < last ? std::max(0.1 * soft, least_soft) : std::min(10 * soft, 0.1);
      last = worst;
      since = worst < as<S>(0.5) * mark ? 0 : since + 1;
      if (since == 0) mark = worst;
      if (worst < best) {
        best = worst;
        points.keep();
      }
      if (best <= tolerance || step == most_steps || since == patience) return best;
      points.advance(soft);
    }
  }

  /// Dual numbers do not fit registers.
  static constexpr bool single = std::is_floating_point_v<S>;
  struct NoBody {};
  struct NoPoints {
    NoPoints(const System&, std::size_t) {}
  };

  [[no_unique_address]] std::conditional_t<single, BodyPoints<S>, NoBody> body_;
  [[no_unique_address]] std::conditional_t<single, IslandPoints<System, PointEquations<System, S>, S>,
                                           NoPoints>
      points_;
  IslandPoints<System, IslandEquations<System, false, S>, S> island_;
};

/// The contact points of one lane, as ContactRows has those of all.
template <class System>
class LaneRows {
  using S = typename System::Scalar;
  using Lanes = ScalarTraits<S>;
  using T = typename Lanes::Value;

 public:
  /// Of all bodies.
  using Motions = PerBody<Motion<T>, System::bodies>;

  LaneRows(const System& system, std::size_t most_rows) : motion_(per_body<Motion<T>>(system)) {
    rows_.reserve(most_rows);
  }

  Motions& motion() { return motion_; }
  std::size_t size() const { return rows_.size(); }

  /// Takes up those of the rows that are active in a lane, and its motions.
  template <class Rows, class AllMotions>
  void take(Rows& rows, AllMotions& motion, int lane) {
    const auto of_lane = [&](const S& x) { return Lanes::lane(x, lane); };
    for (std::size_t i = 0; i < motion_.size(); ++i) {
      const Motion<S>& m = motion[i];
      const auto& [x, y, z] = m.inverse_inertia;
      motion_[i] = {mapped(m.position, of_lane),
                    mapped(m.velocity, of_lane),
                    mapped(m.angular_velocity, of_lane),
                    of_lane(m.inverse_mass),
                    {mapped(x, of_lane), mapped(y, of_lane), mapped(z, of_lane)}};
    }
    rows_.clear();
    rows.each(motion, [&](auto& row, auto& point, auto&, auto&) {
      if (!row.active[lane]) return;
      ContactRow<T>& r = rows_.emplace_back();
      r.who = row.who;
      r.moved = row.moved;
      r.active = true;
      r.target = of_lane(row.target);
      r.friction = of_lane(row.friction);
      if (row.plane()) {
        if constexpr (requires { point.drift(); }) r.at.template emplace<0>(point, of_lane);
      } else {
        if constexpr (!requires { point.drift(); }) r.at.template emplace<1>(point, of_lane);
      }
    });
  }
  /// Gives the lane of `rows` and `motion` the impulses and velocities here.
  template <class Rows, class AllMotions>
  void give(Rows& rows, AllMotions& motion, int lane) const {
    std::size_t k = 0;
    rows.each(motion, [&](auto& row, auto& point, auto&, auto&) {
      if (!row.active[lane]) return;
      const Triple<T>& here = rows_[k++].impulse();
      Triple<S> impulse = point.impulse();
      for (std::size_t d = 0; d < 3; ++d) Lanes::set_lane(impulse[d], lane, here[d]);
      point.restore(impulse);
    });
    const auto set = [&](Vec3<S>& to, const Vec3<T>& from) {
      Lanes::set_lane(to.x, lane, from.x);
      Lanes::set_lane(to.y, lane, from.y);
      Lanes::set_lane(to.z, lane, from.z);
    };
    for (std::size_t i = 0; i < motion_.size(); ++i) {
      set(motion[i].velocity, motion_[i].velocity);
      set(motion[i].angular_velocity, motion_[i].angular_velocity);
    }
  }

  /// As ContactRows::each.
  template <class F>
  void each(Motions& motion, const F& f) {
    for (ContactRow<T>& row : rows_)
      with_point(row, motion, [&](auto& point, auto& a, auto& b) { f(row, point, a, b); });
  }

 private:
  Reserved<ContactRow<T>, row_room<System>> rows_;
  Motions motion_;
};

/// CoupledNewton for a system's numbers: in lanes one by one, since each takes its own steps.
template <class System>
class IslandCoupling {
  using S = typename System::Scalar;
  using Lanes = ScalarTraits<S>;
  using Value = typename Lanes::Value;

 public:
  IslandCoupling(const System& system, std::size_t most_rows)
      : newton_(system, most_rows), lane_(system, most_rows) {}

  /// As CoupledNewton::solve, in the lanes `where`. Returns those in which laws are still off.
  template <class Rows, class Motions>
  MaskOf<S> solve(Rows& rows, Motions& motion, const MaskOf<S>& where, bool friction, const S& tolerance,
                  const S& coarse, const S& rough) {
    if constexpr (!Packed<S>) {
      return where && !newton_.solve(rows, motion, friction, tolerance, coarse, rough);
    } else {
      S open(0);
      for (int l = 0; l < Lanes::lanes; ++l) {
        if (!where[l]) continue;
        lane_.take(rows, motion, l);
        if (!newton_.solve(lane_, lane_.motion(), friction, Lanes::lane(tolerance, l), Lanes::lane(coarse, l),
                           Lanes::lane(rough, l)))
          Lanes::set_lane(open, l, Value(1));
        lane_.give(rows, motion, l);
      }
      return open > S(0);
    }
  }

 private:
  struct NoLanes {
    NoLanes(const System&, std::size_t) {}
  };
  CoupledNewton<System, Value> newton_;
  std::conditional_t<Packed<S>, LaneRows<System>, NoLanes> lane_;
};

}  // namespace rbres::RBRES_ABI::detail
