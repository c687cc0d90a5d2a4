#pragma once

#include <limits>
#include <rbres/contact/manifold.hpp>
#include <rbres/contact/point_response.hpp>

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
/// Writes the velocities back. Of the spin it is the change: there and back it would be off by as much as the
/// quaternion is from its length, to the same side in each step.
template <class S>
void set_velocities(RigidState<S>& state, const Motion<S>& motion) {
  state.velocity = motion.velocity;
  const Vec3<S> before = rotation_matrix(state.orientation) * state.angular_velocity;
  state.angular_velocity += rotate_back(state.orientation, motion.angular_velocity - before);
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
void set_motions(const System& system, const BodyIndices<System>& bodies, const typename System::State& y,
                 MotionsOf<System>& motion) {
  for (const int i : bodies) motion[static_cast<std::size_t>(i)] = motion_of(system[i], y[i]);
}
/// Gives a state the velocities of `motion` in those of `bodies` and lanes that are changed(i).
template <class Bodies, class State, class Motions, class Changed>
void take_velocities(const Bodies& bodies, const Changed& changed, State& y, const Motions& motion) {
  for (const int i : bodies) {
    if (const auto where = changed(i); any(where))
      set_velocities_where(where, y[i], motion[static_cast<std::size_t>(i)]);
  }
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
    detail::PointResponse<S>& r = response_;
    r.normal = response(0, 0, first, second);
    r.normal_mass = inverse(r.normal);
    r.normal_to_u = response(1, 0, first, second);
    r.normal_to_v = response(2, 0, first, second);
    const S uu = response(1, 1, first, second), vv = response(2, 2, first, second),
            uv = response(1, 2, first, second);
    const S over_determinant = inverse(S(uu * vv - uv * uv));
    r.mass_uu = vv * over_determinant;
    r.mass_vv = uu * over_determinant;
    r.mass_uv = -uv * over_determinant;
    r.tangent = S(0.5) * (uu + vv) +
                positive_root(S(square(S(S(0.5) * (uu - vv))) + square(uv) + S(Constants<S>::tiny)));
    r.slip_mass = inverse(r.tangent);
  }

  /// The same point of other numbers, each of which is f(a number of `other`).
  template <class Other, class F>
  ContactPoint(const ContactPoint<Other, Fixed, Central>& other, const F& f)
      : response_{
            f(other.response_.normal),      f(other.response_.normal_mass), f(other.response_.normal_to_u),
            f(other.response_.normal_to_v), f(other.response_.mass_uu),     f(other.response_.mass_uv),
            f(other.response_.mass_vv),     f(other.response_.tangent),     f(other.response_.slip_mass)} {
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
    const S change = response_.normal_change(impulse_[0], velocity(0, first, second), target, active);
    impulse_[0] += change;
    push_normal(change, second, second_);
    if constexpr (!Fixed) push_normal(S(-change), first, first_);
    return response_.normal * abs(change);
  }

  /// Brings the point towards its law, the others held: along the normal towards the speed `target`, or no
  /// impulse where it leaves faster; along the surface towards sticking where friction times the normal
  /// impulse suffices, else towards that much against the slip (the paper's equations 6 to 8, with the
  /// impulse's sign such that bodies part). Only where `active`. A `rate` below 1 goes only that part of the
  /// way along the surface, for points that would chase one another. Returns how far the velocity was off
  /// (m/s).
  S relax(const S& target, const S& friction, const MaskOf<S>& active, Motion<S>& first, Motion<S>& second,
          const S& rate = S(1)) {
    const auto [change, fault] =
        response_.step(impulse_, velocity(0, first, second), velocity(1, first, second),
                       velocity(2, first, second), target, friction, active);
    add({change[0], S(rate * change[1]), S(rate * change[2])}, first, second);
    return fault;
  }

  /// Takes an impulse (N s) for the one so far; moves nothing.
  void restore(const std::array<S, 3>& impulse) { impulse_ = impulse; }
  /// Adds an impulse that is guessed (N s).
  void add(const std::array<S, 3>& impulse, Motion<S>& first, Motion<S>& second) {
    const S &p = impulse[0], &u = impulse[1], &v = impulse[2];
    for (std::size_t d = 0; d < 3; ++d) impulse_[d] += impulse[d];
    const Vec3<S> all = p * direction_[0] + u * direction_[1] + v * direction_[2];
    const auto turn = [&](const Lever& lever) {
      const Vec3<S> along = u * lever.spin[1] + v * lever.spin[2];
      return Central ? along : p * lever.spin[0] + along;
    };
    second.velocity += second.inverse_mass * all;
    second.angular_velocity += turn(second_);
    if constexpr (!Fixed) {
      first.velocity -= first.inverse_mass * all;
      first.angular_velocity -= turn(first_);
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
  /// How a unit impulse along direction d changes either body's angular velocity, world frame, 1/(kg m).
  /// @{
  const Vec3<S>& first_spin(std::size_t d) const requires(!Fixed) { return first_.spin[d]; }
  const Vec3<S>& second_spin(std::size_t d) const { return second_.spin[d]; }
  /// @}
  /// What a unit impulse along direction e changes of the velocity along direction d, 1/kg.
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
  /// What unit impulses change of its velocities.
  const detail::PointResponse<S>& response() const { return response_; }
  /// What a unit impulse changes: the velocity along the normal, and at most that along the surface, 1/kg.
  const S& normal_response() const { return response_.normal; }
  /// The most that a unit impulse along the surface changes of the velocity along it, 1/kg.
  const S& tangent_response() const { return response_.tangent; }
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

  /// An impulse along the normal on one of the bodies, N s.
  void push_normal(const S& p, Motion<S>& body, const Lever& lever) const {
    body.velocity += (body.inverse_mass * p) * direction_[0];
    if constexpr (!Central) body.angular_velocity += p * lever.spin[0];
  }

  std::array<Vec3<S>, 3> direction_;
  Lever second_;
  std::conditional_t<Fixed, std::monostate, Lever> first_;
  std::conditional_t<Fixed, std::array<S, 3>, std::monostate> drift_;
  detail::PointResponse<S> response_;
  std::array<S, 3> impulse_{S(0), S(0), S(0)};
};

}  // namespace rbres::RBRES_ABI
