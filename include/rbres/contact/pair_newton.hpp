#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <memory>
#include <rbres/contact/pair_inertia.hpp>

namespace rbres::RBRES_ABI::detail {

/// Room for a T that is written before it is read: filling a box's contact points with zeros takes longer
/// than many a contact.
template <class T>
union Unset {
  T value;
  Unset() {}
};

/// Newton's method for the impulses p between two bodies at up to P points of one normal. With the velocity
/// u of a point and its target they are the fixed point of p = projection of p - rho (u - target) onto the
/// friction cone (Alart and Curnier 1991). The impulses on a face are not unique: equations that are softened
/// a little (a proximal point method, Rockafellar 1976) pick some, and end where the true ones do. All points
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
    r.active = active;
    const auto held = [&](const S& x) { return select(active, x, S(0)); };
    r.arm = {held(dot(point.second_arm(1), frame_.z)), held(-dot(point.second_arm(0), frame_.z)),
             held(dot(point.second_arm(0), frame_.y))};
    r.target = {target, S(0), S(0)};
    if constexpr (Fixed) {
      const auto& [x, y, z] = point.drift();
      r.target -= Vec3<S>{x, y, z};
    }
    r.response = {point.normal_response(), point.tangent_response()};
    r.rho = {inverse(r.response[0]), inverse(r.response[1])};
    const auto& [normal, u, v] = point.impulse();
    r.impulse = {held(normal), held(u), held(v)};
    inertia_.respond(-r.impulse, -cross(r.arm, r.impulse), velocity_, spin_);
  }

  /// Finds the impulses to `tolerance` (m/s), or as near as it gets.
  void solve(const S& friction, const S& tolerance) {
    constexpr int most_steps = 16;
    MaskOf<S> working(true);
    S best(std::numeric_limits<typename Constants<S>::Real>::max());
    for (int step = 0;; ++step) {
      const S worst = read(friction);
      const MaskOf<S> better = worst < best;
      best = select(better, worst, best);
      for (std::size_t i = 0; i < size_; ++i) {
        Row& r = rows_[i].value;
        r.best[0] = select(better, r.impulse.x, r.best[0]);
        r.best[1] = select(better, r.impulse.y, r.best[1]);
        r.best[2] = select(better, r.impulse.z, r.best[2]);
      }
      working = working & !(worst <= tolerance);
      if (!any(working) || step == most_steps) return;
      advance(friction, working);
    }
  }

  /// Gives the i-th point that was added its impulse, within the friction cone.
  template <class Point>
  void apply(std::size_t i, const S& friction, Point& point, Motion<S>& first, Motion<S>& second) const {
    const Row& r = rows_[i].value;
    const S normal = maximum(r.best[0], S(0)), share = inside(r.best[1], r.best[2], friction * normal);
    std::array<S, 3> change{normal, share * r.best[1], share * r.best[2]};
    for (std::size_t d = 0; d < 3; ++d) change[d] = select(r.active, S(change[d] - point.impulse()[d]), S(0));
    point.add(change, first, second);
  }

 private:
  /// What stands for the zeros on the diagonal of the equations.
  static constexpr double soft = std::is_same_v<typename Constants<S>::Real, float> ? 1e-4 : 1e-7;

  struct Row {
    MaskOf<S> active;
    Vec3<S> arm;                ///< from the second body's centre of mass to the point, m
    Vec3<S> target;             ///< m/s
    std::array<S, 2> response;  ///< along the normal, and at most along the surface, 1/kg
    std::array<S, 2> rho;       ///< its inverse, kg
    Vec3<S> impulse;            ///< N s
    std::array<S, 3> best{};    ///< impulse of the best iterate so far, N s
    Vec3<S> fault;              ///< velocity less target, m/s
    Vec3<S> moved;              ///< impulse - rho fault, N s
    // A step changes the impulse by push - slope * change of velocity.
    Vec3<S> push;   ///< N s
    Mat3<S> slope;  ///< kg
  };

  /// What the iterate's impulses leave. Returns by how much the worst law is off, m/s.
  S read(const S& friction) {
    using std::abs;
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
      r.fault = v + cross(w, r.arm) - r.target;
      r.moved = r.impulse - Vec3<S>{r.rho[0] * r.fault.x, r.rho[1] * r.fault.y, r.rho[1] * r.fault.z};
      const S normal = maximum(r.moved.x, S(0));
      const S share = inside(r.moved.y, r.moved.z, friction * normal);
      // The fault itself: of a huge impulse its difference from the projection would be nothing but rounding.
      const S off = select(r.moved.x > S(0), S(abs(r.fault.x)), S(r.response[0] * abs(r.impulse.x)));
      const S slip =
          r.response[1] * (abs(share * r.moved.y - r.impulse.y) + abs(share * r.moved.z - r.impulse.z));
      worst = worse_of<S>(worse_of<S>(worst, r.active, off), r.active, slip);
    }
    return worst;
  }

  /// The share of (u, v) that lies within a circle.
  static S inside(const S& u, const S& v, const S& radius) {
    const S length2 = square(u) + square(v);
    const MaskOf<S> beyond = length2 > square(radius);
    return select(beyond, S(radius * inverse_root(select(beyond, length2, S(1)))), S(1));
  }

  /// A step where `working`.
  void advance(const S& friction, const MaskOf<S>& working) {
    auto equations = inertia_.equations();
    for (std::size_t i = 0; i < size_; ++i) {
      Row& r = rows_[i].value;
      linearise(r, friction);
      add_to(equations, r);
    }
    const std::array<S, 6> change = solved(equations);
    const Vec3<S> v{change[0], change[1], change[2]}, w{change[3], change[4], change[5]};
    for (std::size_t i = 0; i < size_; ++i) {
      Row& r = rows_[i].value;
      const Vec3<S> p = r.push - r.slope * (v + cross(w, r.arm));
      r.impulse += {select(working, p.x, S(0)), select(working, p.y, S(0)), select(working, p.z, S(0))};
    }
  }

  /// Finds push and slope of a point.
  static void linearise(Row& r, const S& friction) {
    const S hold = as<S>(1 / soft), theta = as<S>(1 - soft);
    const MaskOf<S> pushes = r.active & (r.moved.x > S(0));
    const S normal = select(pushes, S(hold * r.rho[0]), S(0));
    const S push = select(r.active, select(pushes, S(-normal * r.fault.x), S(-r.impulse.x)), S(0));
    // Sliding: against the slip friction times the normal impulse, across it what turns the slip.
    const S most = friction * maximum(r.moved.x, S(0));
    const S length2 = square(r.moved.y) + square(r.moved.z);
    const MaskOf<S> slides = length2 > square(most);
    const S over = inverse_root(select(slides, length2, S(1)));
    const S dy = over * r.moved.y, dz = over * r.moved.z, share = most * over;
    const S held = inverse(S(S(1) - theta * select(slides, share, S(1))));
    const S turn = r.rho[1] * held * select(slides, share, S(1));
    const S along = r.impulse.y * dy + r.impulse.z * dz, across = r.impulse.z * dy - r.impulse.y * dz;
    const S onward = most - along + friction * theta * push, back = across * held;
    const S lean = friction * (r.rho[0] + theta * normal);
    const auto chosen = [&](const S& slid, const S& stuck) {
      return select(r.active, select(pushes, select(slides, slid, stuck), S(0)), S(0));
    };
    const auto pushed = [&](const S& slid, const S& stuck, const S& impulse) {
      return select(r.active, select(pushes, select(slides, slid, stuck), S(-impulse)), S(0));
    };
    r.push = {push, pushed(onward * dy + back * dz, -turn * r.fault.y, r.impulse.y),
              pushed(onward * dz - back * dy, -turn * r.fault.z, r.impulse.z)};
    const S mixed = chosen(-turn * dy * dz, S(0));
    r.slope = {{normal, chosen(lean * dy, S(0)), chosen(lean * dz, S(0))},
               {S(0), chosen(turn * dz * dz, turn), mixed},
               {S(0), mixed, chosen(turn * dy * dy, turn)}};
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
