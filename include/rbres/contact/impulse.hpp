#pragma once

#include <limits>
#include <rbres/contact/manifold.hpp>

namespace rbres::RBRES_ABI {

/// A body as impulses see it.
template <class S>
struct Motion {
  Vec3<S> position;          ///< centre of mass, world frame, m
  Vec3<S> velocity;          ///< world frame, m/s
  Vec3<S> angular_velocity;  ///< world frame, rad/s
  S inverse_mass;            ///< 1/kg
  Mat3<S> inverse_inertia;   ///< world frame, 1/(kg m^2)
};

/// A body's mass and motion.
template <class S, class Shape>
Motion<S> motion_of(const Body<S, Shape>& body, const RigidState<S>& state) {
  const Mat3<S> axes = rotation_matrix(state.orientation);
  return {in_registers(state.position), in_registers(state.velocity), axes * state.angular_velocity,
          body.inverse_mass(), rotated_diagonal(axes, body.inverse_inertia())};
}
/// Writes the velocities back.
template <class S>
void set_velocities(RigidState<S>& state, const Motion<S>& motion) {
  state.velocity = motion.velocity;
  state.angular_velocity = rotate_back(state.orientation, motion.angular_velocity);
}

namespace detail {

/// The worse of `worst` and, where `active`, of a law's fault, m/s. A fault that is no number is worse than
/// all that are.
template <class S>
S worse_of(const S& worst, const MaskOf<S>& active, const S& fault) {
  const S unknown(std::numeric_limits<typename Constants<S>::Real>::max());
  const MaskOf<S> known = fault < unknown;
  return maximum(worst, select(active, select(known, fault, unknown), S(0)));
}

/// Writes velocities back where `changed`; other lanes keep their bits.
template <class S>
void set_velocities_where(const MaskOf<S>& changed, RigidState<S>& state, const Motion<S>& motion) {
  RigidState<S> next = state;
  set_velocities(next, motion);
  state.velocity = select(changed, next.velocity, state.velocity);
  state.angular_velocity = select(changed, next.angular_velocity, state.angular_velocity);
}

/// A vector whose numbers are f(those of another).
template <class S, class F>
auto mapped(const Vec3<S>& v, const F& f) {
  return Vec3<decltype(f(v.x))>{f(v.x), f(v.y), f(v.z)};
}

/// The motions of all bodies of a system.
template <class System>
using MotionsOf = PerBody<Motion<typename System::Scalar>, System::bodies>;

template <class System>
void set_motions(const System& system, const BodyIndices<System::bodies>& bodies,
                 const typename System::State& y, MotionsOf<System>& motion) {
  for (const int i : bodies) motion[static_cast<std::size_t>(i)] = motion_of(system[i], y[i]);
}
/// Gives a state the velocities of `motion` in those of `bodies` and lanes that are changed(i).
template <class Bodies, class State, class Motions, class Changed>
void take_velocities(const Bodies& bodies, const Changed& changed, State& y, const Motions& motion) {
  for (const int i : bodies) set_velocities_where(changed(i), y[i], motion[static_cast<std::size_t>(i)]);
}

}  // namespace detail

/// One point of contact between two bodies, or between a plane (first) and a body: its three directions, what
/// a unit impulse along each does, and the impulse so far. Velocities are v_r = v_2 + w_2 x r_2 - v_1 - w_1 x
/// r_1 (the paper's equation 5), impulses +p on the second body and -p on the first. `Central` as in
/// Manifold.
template <class S, bool Fixed, bool Central = false>
class ContactPoint {
  template <class, bool, bool>
  friend class ContactPoint;
  static constexpr std::size_t arms_from = Central ? 1 : 0;  ///< of the directions that turn a body

 public:
  ContactPoint() = default;

  /// `first` is not read where it is a plane.
  ContactPoint(const Vec3<S>& normal, const Vec3<S>& point, const Motion<S>& first, const Motion<S>& second)
      : direction_(directions(normal)), second_(lever(point, second)) {
    if constexpr (!Fixed) first_ = lever(point, first);
    if constexpr (Fixed) drift_ = {S(0), S(0), S(0)};
    normal_response_ = response(0, 0, first, second);
    normal_mass_ = inverse(normal_response_);
    const S uu = response(1, 1, first, second), vv = response(2, 2, first, second),
            uv = response(1, 2, first, second);
    const S over_determinant = inverse(S(uu * vv - uv * uv));
    mass_uu_ = vv * over_determinant;
    mass_vv_ = uu * over_determinant;
    mass_uv_ = -uv * over_determinant;
    tangent_response_ = S(0.5) * (uu + vv) +
                        positive_root(S(square(S(S(0.5) * (uu - vv))) + square(uv) + S(Constants<S>::tiny)));
    slip_mass_ = inverse(tangent_response_);
  }

  /// The same point of other numbers, each of which is f(a number of `other`).
  template <class Other, class F>
  ContactPoint(const ContactPoint<Other, Fixed, Central>& other, const F& f)
      : normal_response_(f(other.normal_response_)),
        normal_mass_(f(other.normal_mass_)),
        mass_uu_(f(other.mass_uu_)),
        mass_uv_(f(other.mass_uv_)),
        mass_vv_(f(other.mass_vv_)),
        tangent_response_(f(other.tangent_response_)),
        slip_mass_(f(other.slip_mass_)) {
    for (std::size_t d = 0; d < 3; ++d) {
      direction_[d] = detail::mapped(other.direction_[d], f);
      second_.arm[d] = detail::mapped(other.second_.arm[d], f);
      second_.spin[d] = detail::mapped(other.second_.spin[d], f);
      if constexpr (Fixed) {
        drift_[d] = f(other.drift_[d]);
      } else {
        first_.arm[d] = detail::mapped(other.first_.arm[d], f);
        first_.spin[d] = detail::mapped(other.first_.spin[d], f);
      }
      impulse_[d] = f(other.impulse_[d]);
    }
  }

  /// Velocity of the second surface relative to the first along direction d: 0 the normal, 1 and 2 the
  /// tangents, m/s.
  S velocity(std::size_t d, const Motion<S>& first, const Motion<S>& second) const {
    S v = dot(direction_[d], second.velocity);
    if constexpr (!Fixed) v -= dot(direction_[d], first.velocity);
    if (d < arms_from) return v;
    if constexpr (Fixed) v += drift_[d];
    v += dot(second_.arm[d], second.angular_velocity);
    if constexpr (!Fixed) v -= dot(first_.arm[d], first.angular_velocity);
    return v;
  }

  /// A velocity (m/s, world frame) that the point has besides what its motions give it.
  void set_drift(const Vec3<S>& drift) requires Fixed {
    for (std::size_t d = arms_from; d < 3; ++d) drift_[d] = dot(direction_[d], drift);
  }
  /// The same along the three directions, m/s.
  const std::array<S, 3>& drift() const requires Fixed { return drift_; }

  /// Brings the point along its normal towards the speed `target`, the others held, or no impulse where it
  /// leaves faster. Only where `active`. Returns how far the speed was off (m/s).
  S relax_normal(const S& target, const MaskOf<S>& active, Motion<S>& first, Motion<S>& second) {
    using std::abs;
    const S fault = target - velocity(0, first, second);
    const S pushed = select(active, maximum(S(impulse_[0] + normal_mass_ * fault), S(0)), impulse_[0]);
    const S change = pushed - impulse_[0];
    impulse_[0] = pushed;
    push(0, change, first, second);
    return normal_response_ * abs(change);
  }

  /// Brings the point towards its law, the others held: along the normal towards the speed `target`, or no
  /// impulse where it leaves faster; along the surface towards sticking where friction times the normal
  /// impulse suffices, else towards that much against the slip (the paper's equations 6 to 8, with the
  /// impulse's sign such that bodies part). Only where `active`. A `rate` below 1 goes only that part of the
  /// way along the surface, for points that would chase one another. Returns how far the velocity was off
  /// (m/s).
  S relax(const S& target, const S& friction, const MaskOf<S>& active, Motion<S>& first, Motion<S>& second,
          const S& rate = S(1)) {
    using std::abs;
    const S off = relax_normal(target, active, first, second);
    const S& pushed = impulse_[0];

    const S u = velocity(1, first, second), v = velocity(2, first, second);
    const S stick_u = impulse_[1] - (mass_uu_ * u + mass_uv_ * v),
            stick_v = impulse_[2] - (mass_uv_ * u + mass_vv_ * v);
    const S most = friction * pushed;
    const MaskOf<S> slides = square(stick_u) + square(stick_v) > square(most);
    // Against the slip itself: the sticking impulse of a corner points elsewhere.
    const S slip_u = impulse_[1] - slip_mass_ * u, slip_v = impulse_[2] - slip_mass_ * v;
    const S length2 = square(slip_u) + square(slip_v);
    const MaskOf<S> beyond = length2 > square(most);
    const S share = select(beyond, S(most * inverse_root(select(beyond, length2, S(1)))), S(1));
    const S pu = select(active, select(slides, S(share * slip_u), stick_u), impulse_[1]);
    const S pv = select(active, select(slides, S(share * slip_v), stick_v), impulse_[2]);
    const S off_u = pu - impulse_[1], off_v = pv - impulse_[2];
    const S change_u = rate * off_u, change_v = rate * off_v;
    push(1, change_u, first, second);
    push(2, change_v, first, second);
    impulse_[1] += change_u;
    impulse_[2] += change_v;
    return maximum(off, S(tangent_response_ * (abs(off_u) + abs(off_v))));
  }

  /// Takes an impulse (N s) for the one so far; moves nothing.
  void restore(const std::array<S, 3>& impulse) { impulse_ = impulse; }
  /// Adds an impulse that is guessed (N s).
  void add(const std::array<S, 3>& impulse, Motion<S>& first, Motion<S>& second) {
    for (std::size_t d = 0; d < 3; ++d) {
      impulse_[d] += impulse[d];
      push(d, impulse[d], first, second);
    }
  }
  /// The unit vector of direction d, world frame.
  const Vec3<S>& direction(std::size_t d) const { return direction_[d]; }
  /// The normal and the two tangents, world frame.
  Mat3<S> frame() const { return {direction_[0], direction_[1], direction_[2]}; }
  /// r x direction(d) of either body, m.
  Vec3<S> first_arm(std::size_t d) const requires(!Fixed) { return first_.arm[d]; }
  /// The same of the second body, m.
  const Vec3<S>& second_arm(std::size_t d) const { return second_.arm[d]; }
  /// What a unit impulse changes: the velocity along the normal, and at most that along the surface, 1/kg.
  const S& normal_response() const { return normal_response_; }
  /// The most that a unit impulse along the surface changes of the velocity along it, 1/kg.
  const S& tangent_response() const { return tangent_response_; }
  /// Impulse along the normal and the two tangents, N s.
  const std::array<S, 3>& impulse() const { return impulse_; }

 private:
  /// How impulses along the directions turn a body: r x d, and the change of its angular velocity.
  struct Lever {
    std::array<Vec3<S>, 3> arm, spin;
  };
  Lever lever(const Vec3<S>& point, const Motion<S>& body) const {
    const auto arm = [&](std::size_t d) {
      return d < arms_from ? Vec3<S>{} : cross(point - body.position, direction_[d]);
    };
    const Vec3<S> n = arm(0), u = arm(1), v = arm(2);
    return {{in_registers(n), in_registers(u), in_registers(v)},
            {body.inverse_inertia * n, body.inverse_inertia * u, body.inverse_inertia * v}};
  }
  /// The normal and two tangents, without a branch on the normal's direction (Duff et al. 2017).
  static std::array<Vec3<S>, 3> directions(const Vec3<S>& normal) {
    const S sign = select(normal.z < S(0), S(-1), S(1));
    const S a = -inverse(S(sign + normal.z)), b = normal.x * normal.y * a;
    return {in_registers(normal),
            {S(1) + sign * normal.x * normal.x * a, sign * b, -sign * normal.x},
            {b, sign + normal.y * normal.y * a, -normal.y}};
  }

  S response(std::size_t d, std::size_t e, const Motion<S>& first, const Motion<S>& second) const {
    S k(0);
    if (d == e) {
      k = second.inverse_mass;
      if constexpr (!Fixed) k += first.inverse_mass;
    }
    if (d < arms_from) return k;
    k += dot(second_.arm[d], second_.spin[e]);
    if constexpr (!Fixed) k += dot(first_.arm[d], first_.spin[e]);
    return k;
  }
  /// An impulse along direction d, N s.
  void push(std::size_t d, const S& p, Motion<S>& first, Motion<S>& second) const {
    second.velocity += (second.inverse_mass * p) * direction_[d];
    if constexpr (!Fixed) first.velocity -= (first.inverse_mass * p) * direction_[d];
    if (d < arms_from) return;
    second.angular_velocity += p * second_.spin[d];
    if constexpr (!Fixed) first.angular_velocity -= p * first_.spin[d];
  }

  std::array<Vec3<S>, 3> direction_;
  Lever second_;
  std::conditional_t<Fixed, std::monostate, Lever> first_;
  std::conditional_t<Fixed, std::array<S, 3>, std::monostate> drift_;
  S normal_response_, normal_mass_, mass_uu_, mass_uv_, mass_vv_, tangent_response_, slip_mass_;
  std::array<S, 3> impulse_{S(0), S(0), S(0)};
};

}  // namespace rbres::RBRES_ABI
