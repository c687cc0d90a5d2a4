#pragma once

#include <array>
#include <cstddef>
#include <rbres/contact/cone_point.hpp>
#include <rbres/contact/contact_row.hpp>
#include <rbres/contact/near_pairs.hpp>
#include <rbres/contact/point_jacobian.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI::detail {

/// The contact points of an island as CoupledNewton sees them. `Equations`: of a step of Newton's method,
/// IslandEquations or PointEquations. `S`: the system's plain scalar, or that of one of its lanes.
template <class System, class Equations, class S>
class IslandPoints {
 public:
  IslandPoints(const System& system, std::size_t most_rows) : equations_(system) { rows_.reserve(most_rows); }

  /// Takes up the rows of an island (ContactRows) and the motions of its bodies. False where it is too large.
  template <class Rows, class Motions>
  bool take_up(Rows& rows, Motions& motion, bool friction) {
    if (!equations_.take_up(rows, motion)) return false;
    rows_.clear();
    S largest_response(0), heaviest(0);
    rows.each(motion, [&](auto& row, auto& point, auto& first, auto& second) {
      RowState& r = rows_.emplace_back();
      r.take(point, row.active);
      largest_response = maximum(largest_response, r.response[0]);
      for (const auto* body : {&first, &second}) {
        if (body->inverse_mass > S(0)) heaviest = maximum(heaviest, S(S(1) / body->inverse_mass));
      }
      r.jacobian = equations_.jacobian(row, point);
      r.friction = friction ? row.friction : S(0);
      r.start = r.impulse;
      r.left = {point.velocity(0, first, second) - row.target, point.velocity(1, first, second),
                point.velocity(2, first, second)};
    });
    stiffness_ = largest_response * heaviest;
    return true;
  }
  /// How much more easily a point moves than the heaviest body.
  const S& stiffness() const { return stiffness_; }
  /// Gives them the best impulses, and their bodies the velocities that these leave.
  template <class Rows, class Motions>
  void give(Rows& rows, Motions& motion) const {
    std::size_t k = 0;
    rows.each(motion, [&](auto&, auto& point, auto& first, auto& second) {
      const RowState& r = rows_[k++];
      if (!r.active) return;
      const auto& [normal, u, v] = r.result(r.friction);
      point.add({normal - r.start.x, u - r.start.y, v - r.start.z}, first, second);
    });
  }

  /// Returns by how much the worst law is off, m/s. Velocities follow from the impulses anew: those that have
  /// been huge on the way leave no rounding errors behind.
  S read() {
    equations_.stay();
    for (const RowState& r : rows_) {
      const Vec3<S> p = r.impulse - r.start;
      equations_.push(r.jacobian, {p.x, p.y, p.z});
    }
    equations_.respond();
    S worst(0);
    for (RowState& r : rows_) {
      const Triple<S> moved = equations_.moved(r.jacobian);
      worst = r.read(r.left + Vec3<S>{moved[0], moved[1], moved[2]}, r.friction, worst);
    }
    return worst;
  }
  void keep() {
    for (RowState& r : rows_) r.keep(true);
  }
  /// Goes a step. `soft` as in ConePoint.
  void advance(double soft) {
    equations_.start();
    for (RowState& r : rows_) {
      r.linearise(r.friction, soft);
      const auto& [x, y, z] = r.slope;
      equations_.add(r.jacobian, {{{x.x, y.x, z.x}, {x.y, y.y, z.y}, {x.z, y.z, z.z}}},
                     {r.push.x, r.push.y, r.push.z});
    }
    equations_.solve();
    for (RowState& r : rows_) {
      const Triple<S> change = equations_.change(r.jacobian);
      r.advance({change[0], change[1], change[2]}, r.active);
    }
  }

 private:
  struct RowState : ConePoint<S> {
    typename Equations::Jacobian jacobian;
    S friction;
    Vec3<S> start;  ///< impulse before the first step, N s
    Vec3<S> left;   ///< fault that it leaves, m/s
  };

  Reserved<RowState, row_room<System>> rows_;
  Equations equations_;
  S stiffness_{0};
};

}  // namespace rbres::RBRES_ABI::detail
