#pragma once

#include <rbres/contact/cone_point.hpp>

namespace rbres::RBRES_ABI::detail {

/// Newton's method for the contact laws at a single point: three equations for its velocity.
template <class S>
class PointNewton {
 public:
  /// The point leaves at the speed `target` (m/s) at least, where `active`. Starts from the impulse that it
  /// has, which `first` and `second` know.
  template <class Point>
  PointNewton(const Point& point, const S& target, const MaskOf<S>& active, const Motion<S>& first,
              const Motion<S>& second) {
    row_.take(point, active);
    start_ = row_.impulse;
    fault_ = {point.velocity(0, first, second) - target, point.velocity(1, first, second),
              point.velocity(2, first, second)};
    const auto responds = [&](std::size_t d, std::size_t e) { return point.response(d, e, first, second); };
    const S nu = responds(1, 0), nv = responds(2, 0), uv = responds(2, 1);
    response_ = {{responds(0, 0), nu, nv}, {nu, responds(1, 1), uv}, {nv, uv, responds(2, 2)}};
  }

  /// As PairNewton::solve().
  MaskOf<S> solve(const S& friction, const S& tolerance) {
    return iterate_newton<S>(
        tolerance, [&] { return row_.read(fault_ + response_ * (row_.impulse - start_), friction, S(0)); },
        [&](const MaskOf<S>& better) { row_.keep(better); },
        [&](const MaskOf<S>& working) { advance(friction, working); });
  }

  /// Gives the point its impulse, within the friction cone.
  template <class Point>
  void apply(const S& friction, Point& point, Motion<S>& first, Motion<S>& second) const {
    row_.apply(friction, point, first, second);
  }

 private:
  /// The change x of velocity obeys x = response (push - slope x).
  void advance(const S& friction, const MaskOf<S>& working) {
    row_.linearise(friction, few_points_soft<S>);
    const auto column = [&](const Vec3<S>& of_slope, const Vec3<S>& unit) {
      return unit + response_ * of_slope;
    };
    const Vec3<S> a = column(row_.slope.x, {S(1), S(0), S(0)}), b = column(row_.slope.y, {S(0), S(1), S(0)}),
                  c = column(row_.slope.z, {S(0), S(0), S(1)}), right = response_ * row_.push;
    const Vec3<S> bc = cross(b, c);
    const S over = inverse(dot(a, bc));
    row_.advance(over * Vec3<S>{dot(right, bc), dot(right, cross(c, a)), dot(right, cross(a, b))}, working);
  }

  ConePoint<S> row_;
  Vec3<S> start_;     ///< impulse, N s
  Vec3<S> fault_;     ///< velocity less target with it, m/s
  Mat3<S> response_;  ///< what impulses change of the velocity, 1/kg
};

}  // namespace rbres::RBRES_ABI::detail
