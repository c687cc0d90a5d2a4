#pragma once

#include <array>
#include <cstddef>
#include <rbres/contact/impulse.hpp>
#include <type_traits>
#include <variant>

namespace rbres::RBRES_ABI::detail {

/// How impulses between two bodies change their relative motion, and back: the velocity V of the second
/// body relative to the first at the second's centre of mass, m/s, and the relative angular velocity W,
/// rad/s. Vectors have the components of a contact's normal and tangents. `Fixed`: the first is a plane.
template <class S, bool Fixed>
class PairInertia {
 public:
  /// Six linear equations for a change of V and W; the seventh column is their right side.
  using Equations = std::array<std::array<S, 7>, 6>;

  PairInertia(const Mat3<S>& frame, const Motion<S>& first, const Motion<S>& second) {
    response_ = second.inverse_mass;
    second_ = turned(frame, second.inverse_inertia);
    if constexpr (Fixed) {
      const S mass = inverse(response_);
      linear_ = {{mass, S(0), S(0)}, {S(0), mass, S(0)}, {S(0), S(0), mass}};
      angular_ = symmetric_inverse(second_);
    } else {
      response_ += first.inverse_mass;
      first_ = turned(frame, first.inverse_inertia);
      between_ = frame.transposed_times(second.position - first.position);
      // The inverse of ((moves, mixes), (mixes^T, turns^-1)), by blocks.
      const auto moved = [&](const Vec3<S>& unit) {
        return response_ * unit + cross(first_ * cross(between_, unit), between_);
      };
      const Mat3<S> mixes{cross(first_.x, between_), cross(first_.y, between_), cross(first_.z, between_)};
      const Mat3<S> turns = symmetric_inverse(sum(first_, second_));
      const Mat3<S> share = product(turns, transposed(mixes)), taken = product(mixes, share);
      linear_ =
          symmetric_inverse(Mat3<S>{moved({S(1), S(0), S(0)}) - taken.x, moved({S(0), S(1), S(0)}) - taken.y,
                                    moved({S(0), S(0), S(1)}) - taken.z});
      const Mat3<S> back = product(share, linear_);
      coupling_ = {-back.x, -back.y, -back.z};
      angular_ = sum(turns, product(back, transposed(share)));
    }
  }

  /// Adds what an impulse (N s) and its moment about the second body's centre of mass (N m s) change.
  void respond(const Vec3<S>& impulse, const Vec3<S>& moment, Vec3<S>& v, Vec3<S>& w) const {
    v += response_ * impulse;
    w += second_ * moment;
    if constexpr (!Fixed) {
      const Vec3<S> spin = first_ * (moment + cross(between_, impulse));
      v += cross(spin, between_);
      w += spin;
    }
  }

  /// Mass and inertia in the places of V and W, the right side zero.
  Equations equations() const {
    const Mat3<S>&l = linear_, &a = angular_;
    Equations e{{{l.x.x, l.y.x, l.z.x, S(0), S(0), S(0), S(0)},
                 {l.x.y, l.y.y, l.z.y, S(0), S(0), S(0), S(0)},
                 {l.x.z, l.y.z, l.z.z, S(0), S(0), S(0), S(0)},
                 {S(0), S(0), S(0), a.x.x, a.y.x, a.z.x, S(0)},
                 {S(0), S(0), S(0), a.x.y, a.y.y, a.z.y, S(0)},
                 {S(0), S(0), S(0), a.x.z, a.y.z, a.z.z, S(0)}}};
    if constexpr (!Fixed) {
      const std::array<Vec3<S>, 3> c{coupling_.x, coupling_.y, coupling_.z};
      for (std::size_t j = 0; j < 3; ++j) {
        e[3][j] = e[j][3] = c[j].x;
        e[4][j] = e[j][4] = c[j].y;
        e[5][j] = e[j][5] = c[j].z;
      }
    }
    return e;
  }

 private:
  static Mat3<S> sum(const Mat3<S>& a, const Mat3<S>& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  static Mat3<S> product(const Mat3<S>& a, const Mat3<S>& b) { return {a * b.x, a * b.y, a * b.z}; }
  static Mat3<S> transposed(const Mat3<S>& m) {
    return {{m.x.x, m.y.x, m.z.x}, {m.x.y, m.y.y, m.z.y}, {m.x.z, m.y.z, m.z.z}};
  }
  /// A symmetric matrix of the world frame in `frame`.
  static Mat3<S> turned(const Mat3<S>& frame, const Mat3<S>& m) {
    const auto column = [&](const Vec3<S>& axis) { return frame.transposed_times(m * axis); };
    return {column(frame.x), column(frame.y), column(frame.z)};
  }

  S response_;
  Mat3<S> second_, linear_, angular_;
  std::conditional_t<Fixed, std::monostate, Mat3<S>> first_, coupling_;
  std::conditional_t<Fixed, std::monostate, Vec3<S>> between_;
};

}  // namespace rbres::RBRES_ABI::detail
