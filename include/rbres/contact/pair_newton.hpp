#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <rbres/contact/cone_point.hpp>
#include <rbres/contact/pair_inertia.hpp>

namespace rbres::RBRES_ABI::detail {

/// Room for a T that is written before it is read: filling a box's contact points with zeros takes longer
/// than many a contact.
template <class T>
union Unset {
  T value;
  Unset() {}
};

/// Newton's method for the contact laws between two bodies at up to P points of one normal. All points
/// together change only the six numbers of the pair's relative motion, so that a step takes six equations.
template <class S, bool Fixed, std::size_t P>
class PairNewton {
 public:
  PairNewton(const Mat3<S>& frame, const Motion<S>& first, const Motion<S>& second)
      : inertia_(frame, first, second), frame_(frame) {
    velocity_ = second.velocity;
    spin_ = second.angular_velocity;
    if constexpr (!Fixed) {
      velocity_ -= first.velocity + cross(first.angular_velocity, second.position - first.position);
      spin_ -= first.angular_velocity;
    }
    velocity_ = frame.transposed_times(velocity_);
    spin_ = frame.transposed_times(spin_);
  }

  /// Takes up a point where it is `active`, to leave at the speed `target` (m/s) at least. Starts from the
  /// impulse that it has.
  template <class Point>
  void add(const Point& point, const S& target, const MaskOf<S>& active) {
    Row& r = *std::construct_at(&rows_[size_++].value);
    r.take(point, active);
    const auto held = [&](const S& x) { return select(active, x, S(0)); };
    r.arm = {held(dot(point.second_arm(1), frame_.z)), held(-dot(point.second_arm(0), frame_.z)),
             held(dot(point.second_arm(0), frame_.y))};
    r.target = {target, S(0), S(0)};
    if constexpr (Fixed) {
      const auto& [x, y, z] = point.drift();
      r.target -= Vec3<S>{x, y, z};
    }
    inertia_.respond(-r.impulse, -cross(r.arm, r.impulse), velocity_, spin_);
  }

  /// Finds the impulses to `tolerance` (m/s), or as near as it gets. Returns the lanes in which laws are off.
  MaskOf<S> solve(const S& friction, const S& tolerance) {
    return iterate_newton<S>(
        tolerance, [&] { return read(friction); },
        [&](const MaskOf<S>& better) {
          for (std::size_t i = 0; i < size_; ++i) rows_[i].value.keep(better);
        },
        [&](const MaskOf<S>& working) { advance(friction, working); });
  }

  /// Gives the i-th point that was added its impulse, within the friction cone.
  template <class Point>
  void apply(std::size_t i, const S& friction, Point& point, Motion<S>& first, Motion<S>& second) const {
    rows_[i].value.apply(friction, point, first, second);
  }

 private:
  struct Row : ConePoint<S> {
    Vec3<S> arm;     ///< from the second body's centre of mass to the point, m
    Vec3<S> target;  ///< m/s
  };

  /// What the iterate's impulses leave. Returns by how much the worst law is off, m/s.
  S read(const S& friction) {
    Vec3<S> impulse{S(0), S(0), S(0)}, moment = impulse;
    for (std::size_t i = 0; i < size_; ++i) {
      const Row& r = rows_[i].value;
      impulse += r.impulse;
      moment += cross(r.arm, r.impulse);
    }
    Vec3<S> v = velocity_, w = spin_;
    inertia_.respond(impulse, moment, v, w);
    S worst(0);
    for (std::size_t i = 0; i < size_; ++i) {
      Row& r = rows_[i].value;
      worst = r.read(v + cross(w, r.arm) - r.target, friction, worst);
    }
    return worst;
  }

  /// A step where `working`.
  void advance(const S& friction, const MaskOf<S>& working) {
    auto equations = inertia_.equations();
    for (std::size_t i = 0; i < size_; ++i) {
      Row& r = rows_[i].value;
      r.linearise(friction, few_points_soft<S>);
      add_to(equations, r);
    }
    const std::array<S, 6> change = solved(equations);
    const Vec3<S> v{change[0], change[1], change[2]}, w{change[3], change[4], change[5]};
    for (std::size_t i = 0; i < size_; ++i) {
      Row& r = rows_[i].value;
      r.advance(v + cross(w, r.arm), working);
    }
  }

  /// Adds J^T slope J and J^T push, with J = (1, -[arm]x).
  static void add_to(typename PairInertia<S, Fixed>::Equations& e, const Row& r) {
    const Mat3<S>& s = r.slope;
    const Vec3<S> tx = cross(r.arm, s.x), ty = cross(r.arm, s.y), tz = cross(r.arm, s.z);
    const Vec3<S> rx = cross(r.arm, {s.x.x, s.y.x, s.z.x}), ry = cross(r.arm, {s.x.y, s.y.y, s.z.y}),
                  rz = cross(r.arm, {s.x.z, s.y.z, s.z.z});
    const Vec3<S> wx = cross(r.arm, {rx.x, ry.x, rz.x}), wy = cross(r.arm, {rx.y, ry.y, rz.y}),
                  wz = cross(r.arm, {rx.z, ry.z, rz.z});
    const Vec3<S> moment = cross(r.arm, r.push);
    const auto add = [](auto& line, const S& a, const S& b, const S& c, const Vec3<S>& d, const S& f) {
      line[0] += a, line[1] += b, line[2] += c;
      line[3] += d.x, line[4] += d.y, line[5] += d.z;
      line[6] += f;
    };
    add(e[0], s.x.x, s.y.x, s.z.x, rx, r.push.x);
    add(e[1], s.x.y, s.y.y, s.z.y, ry, r.push.y);
    add(e[2], s.x.z, s.y.z, s.z.z, rz, r.push.z);
    add(e[3], tx.x, ty.x, tz.x, {wx.x, wy.x, wz.x}, moment.x);
    add(e[4], tx.y, ty.y, tz.y, {wx.y, wy.y, wz.y}, moment.y);
    add(e[5], tx.z, ty.z, tz.z, {wx.z, wy.z, wz.z}, moment.z);
  }

  /// Gaussian elimination. Mass and inertia keep its pivots from zero.
  static std::array<S, 6> solved(typename PairInertia<S, Fixed>::Equations& e) {
    std::array<S, 6> over;
    for (std::size_t k = 0; k < 6; ++k) {
      over[k] = inverse(e[k][k]);
      for (std::size_t i = k + 1; i < 6; ++i) {
        const S factor = e[i][k] * over[k];
        for (std::size_t j = k + 1; j < 7; ++j) e[i][j] -= factor * e[k][j];
      }
    }
    std::array<S, 6> x;
    for (std::size_t k = 6; k-- > 0;) {
      S sum = e[k][6];
      for (std::size_t j = k + 1; j < 6; ++j) sum -= e[k][j] * x[j];
      x[k] = sum * over[k];
    }
    return x;
  }

  PairInertia<S, Fixed> inertia_;
  Mat3<S> frame_;
  Vec3<S> velocity_, spin_;
  std::array<Unset<Row>, P> rows_;
  std::size_t size_ = 0;
};

}  // namespace rbres::RBRES_ABI::detail
