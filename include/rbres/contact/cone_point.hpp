#pragma once

#include <array>
#include <limits>
#include <rbres/contact/impulse.hpp>
#include <type_traits>

namespace rbres::RBRES_ABI::detail {

/// A contact point in Newton's method for the contact laws. With the velocity u of the point and its target
/// its impulse p is the fixed point of p = projection of p - rho (u - target) onto the friction cone (Alart
/// and Curnier 1991). The impulses on a face are not unique: equations that are softened a little (a proximal
/// point method, Rockafellar 1976) pick some, and end where the true ones do.
template <class S>
struct ConePoint {
  MaskOf<S> active;
  std::array<S, 2> response;  ///< along the normal, and at most along the surface, 1/kg
  std::array<S, 2> rho;       ///< its inverse, kg
  Vec3<S> impulse;            ///< N s
  std::array<S, 3> best{};    ///< impulse of the best iterate so far, N s
  Vec3<S> fault;              ///< velocity less target, m/s
  Vec3<S> moved;              ///< impulse - rho fault, N s
  // A step changes the impulse by push - slope * change of velocity.
  Vec3<S> push;   ///< N s
  Mat3<S> slope;  ///< kg

  /// Starts from the impulse that a point has. `responses`: see response.
  void take(const std::array<S, 2>& responses, const std::array<S, 3>& start, const MaskOf<S>& where) {
    active = where;
    response = responses;
    rho = {inverse(response[0]), inverse(response[1])};
    const auto held = [&](const S& x) { return select(active, x, S(0)); };
    impulse = {held(start[0]), held(start[1]), held(start[2])};
  }
  template <class Point>
  void take(const Point& point, const MaskOf<S>& where) {
    take({point.normal_response(), point.tangent_response()}, point.impulse(), where);
  }

  /// Takes up the fault that the iterate leaves. Returns the worse of `worst` and by how much the laws are
  /// off, m/s.
  S read(const Vec3<S>& left, const S& friction, const S& worst) {
    using std::abs;
    fault = left;
    moved = impulse - Vec3<S>{rho[0] * fault.x, rho[1] * fault.y, rho[1] * fault.z};
    const S normal = maximum(moved.x, S(0));
    const S share = inside(moved.y, moved.z, friction * normal);
    // The fault itself: of a huge impulse its difference from the projection would be nothing but rounding.
    const S off = select(moved.x > S(0), S(abs(fault.x)), S(response[0] * abs(impulse.x)));
    const S slip = response[1] * (abs(share * moved.y - impulse.y) + abs(share * moved.z - impulse.z));
    return worse_of<S>(worse_of<S>(worst, active, off), active, slip);
  }
  void keep(const MaskOf<S>& better) {
    best[0] = select(better, impulse.x, best[0]);
    best[1] = select(better, impulse.y, best[1]);
    best[2] = select(better, impulse.z, best[2]);
  }

  /// Finds push and slope. `soft` stands for the zeros on the diagonal of the equations.
  void linearise(const S& friction, double soft) {
    const S hold = as<S>(1 / soft), theta = as<S>(1 - soft);
    const MaskOf<S> pushes = active & (moved.x > S(0));
    const S normal = select(pushes, S(hold * rho[0]), S(0));
    const S pushed = select(active, select(pushes, S(-normal * fault.x), S(-impulse.x)), S(0));
    // Sliding: against the slip friction times the normal impulse, across it what turns the slip.
    const S most = friction * maximum(moved.x, S(0));
    const S length2 = square(moved.y) + square(moved.z);
    const MaskOf<S> slides = length2 > square(most);
    const S over = inverse_root(select(slides, length2, S(1)));
    const S dy = over * moved.y, dz = over * moved.z, share = most * over;
    const S held = inverse(S(S(1) - theta * select(slides, share, S(1))));
    const S turn = rho[1] * held * select(slides, share, S(1));
    const S along = impulse.y * dy + impulse.z * dz, across = impulse.z * dy - impulse.y * dz;
    const S onward = most - along + friction * theta * pushed, back = across * held;
    const S lean = friction * (rho[0] + theta * normal);
    const auto chosen = [&](const S& slid, const S& stuck) {
      return select(active, select(pushes, select(slides, slid, stuck), S(0)), S(0));
    };
    const auto leads = [&](const S& slid, const S& stuck, const S& from) {
      return select(active, select(pushes, select(slides, slid, stuck), S(-from)), S(0));
    };
    push = {pushed, leads(onward * dy + back * dz, -turn * fault.y, impulse.y),
            leads(onward * dz - back * dy, -turn * fault.z, impulse.z)};
    const S mixed = chosen(-turn * dy * dz, S(0));
    slope = {{normal, chosen(lean * dy, S(0)), chosen(lean * dz, S(0))},
             {S(0), chosen(turn * dz * dz, turn), mixed},
             {S(0), mixed, chosen(turn * dy * dy, turn)}};
  }
  /// Goes a step, where `working`, in which the point's velocity changes by `change` (m/s).
  void advance(const Vec3<S>& change, const MaskOf<S>& working) {
    const Vec3<S> p = push - slope * change;
    impulse += {select(working, p.x, S(0)), select(working, p.y, S(0)), select(working, p.z, S(0))};
  }

  /// Gives the contact point that it stands for the best impulse so far.
  template <class Point>
  void apply(const S& friction, Point& point, Motion<S>& first, Motion<S>& second) const {
    std::array<S, 3> change = result(friction);
    for (std::size_t d = 0; d < 3; ++d) change[d] = select(active, S(change[d] - point.impulse()[d]), S(0));
    point.add(change, first, second);
  }
  /// The best impulse so far, within the friction cone.
  std::array<S, 3> result(const S& friction) const {
    const S normal = maximum(best[0], S(0)), share = inside(best[1], best[2], friction * normal);
    return {normal, share * best[1], share * best[2]};
  }

 private:
  /// The share of (u, v) that lies within a circle.
  static S inside(const S& u, const S& v, const S& radius) {
    const S length2 = square(u) + square(v);
    const MaskOf<S> beyond = length2 > square(radius);
    return select(beyond, S(radius * inverse_root(select(beyond, length2, S(1)))), S(1));
  }
};

/// How much the equations of few points are softened, see ConePoint.
template <class S>
inline constexpr double few_points_soft = std::is_same_v<typename Constants<S>::Real, float> ? 1e-4 : 1e-7;

/// Newton's method for few points to `tolerance` (m/s), or as near as it gets: read() says by how much the
/// worst law is off, keep(where) notes the best impulses, advance(where) goes a step. Returns the lanes in
/// which laws are off.
template <class S, class Read, class Keep, class Advance>
MaskOf<S> iterate_newton(const S& tolerance, const Read& read, const Keep& keep, const Advance& advance) {
  constexpr int most_steps = 16;
  MaskOf<S> working(true);
  S best(std::numeric_limits<typename Constants<S>::Real>::max());
  for (int step = 0;; ++step) {
    const S worst = read();
    const MaskOf<S> better = worst < best;
    best = select(better, worst, best);
    keep(better);
    working = working & !(worst <= tolerance);
    if (!any(working) || step == most_steps) return working;
    advance(working);
  }
}

}  // namespace rbres::RBRES_ABI::detail
