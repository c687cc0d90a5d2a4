#pragma once

#include <rbres/core/lie.hpp>
#include <rbres/learn/contact_response.hpp>

namespace rbres::RBRES_ABI::detail {

/// What a network's outputs mean for a contact: an impulse, an angular impulse about the normal, and when.
struct ContactImpulse {
  static constexpr int outputs = 5;
  using Outputs = std::array<double, outputs>;

  Vec3<double> linear;   ///< on the second body, world frame, N s
  Vec3<double> angular;  ///< on the second body, N m s
  double left;           ///< time from the impulse to the end of the frame, s
};

/// How much of the frame is left when it acts, from 0 to 1: for an output of 0 as much as at the contact's
/// moment.
inline double share_left(const Contact& c, double x) { return (1 - c.moment.share) * (1 + squash(x)); }

inline ContactImpulse impulse_of(const Contact& c, const ContactImpulse::Outputs& o,
                                 const ContactScales& scales) {
  const double speed = c.presence * c.unit;
  const Vec3<double>& n = c.at.normal;
  // Along the surface nothing else has a direction: one across the slip would turn round where bodies change
  // places.
  return {(speed * o[0] / c.normal_mobility) * n -
              (speed / c.tangent_mobility) * (o[1] * c.tangent + o[4] * c.side),
          (-speed * o[2] * c.twist_sign / (c.length * c.twist_mobility)) * n,
          scales.frame_time * share_left(c, o[3])};
}

/// The sums of what all contacts do to a body. With doubles this is also the layout of a derivative.
struct BodyImpulse {
  Vec3<double> linear;   ///< sum of the impulses, N s
  Vec3<double> way;      ///< sum of impulses times the time left, N s^2
  Vec3<double> angular;  ///< sum of their moments about where the free flight ends, N m s
  Vec3<double> turn;     ///< sum of their moments about the body, times the time left, N m s^2
  bool touched = false;

  /// Whether no impulse acts, or only some of no strength.
  bool nothing() const {
    return !touched ||
           squared_norm(linear) + squared_norm(way) + squared_norm(angular) + squared_norm(turn) == 0;
  }
  /// All impulses so many times as strong.
  BodyImpulse operator*(double factor) const {
    return {factor * linear, factor * way, factor * angular, factor * turn, touched};
  }
};

/// The velocity of the point at which a contact acts, the same for both bodies, m/s.
inline Vec3<double> point_velocity(const Contact& c, const FlightPair<const ContactFlight>& flight) {
  if (c.plane()) return flight[1]->mean_velocity;
  return 0.5 * (flight[0]->mean_velocity + flight[1]->mean_velocity);
}

/// Adds what a contact does to its bodies: equal and opposite at one common point.
inline void add_impulse(const Contact& c, const ContactImpulse& impulse,
                        const FlightPair<const ContactFlight>& flight, const ContactScales& scales,
                        const FlightPair<BodyImpulse>& sums) {
  const Vec3<double> point =
      c.at.point + ((1 - c.moment.share) * scales.frame_time - impulse.left) * point_velocity(c, flight);
  for (std::size_t b = c.plane() ? 1 : 0; b < 2; ++b) {
    const double sign = b == 1 ? 1 : -1;
    BodyImpulse& sum = *sums[b];
    const Vec3<double> linear = sign * impulse.linear, angular = sign * impulse.angular;
    sum.linear += linear;
    sum.way += impulse.left * linear;
    sum.angular += cross(point - flight[b]->end, linear) + angular;
    sum.turn += impulse.left * (cross(c.arm[b], linear) + angular);
    sum.touched = true;
  }
}

/// The way back through impulse_of() and add_impulse(): gives the derivatives by the outputs, and adds to
/// those by the contact and the flights.
inline ContactImpulse::Outputs add_impulse_gradient(const Contact& c, const ContactImpulse::Outputs& o,
                                                    const FlightPair<const ContactFlight>& flight,
                                                    const ContactScales& scales,
                                                    const FlightPair<const BodyImpulse>& by_sums,
                                                    ContactGradient& by,
                                                    const FlightPair<ContactFlight>& by_flight) {
  const ContactImpulse impulse = impulse_of(c, o, scales);
  const double since = (1 - c.moment.share) * scales.frame_time - impulse.left;
  const Vec3<double> velocity = point_velocity(c, flight), point = c.at.point + since * velocity;
  Vec3<double> by_linear, by_angular, by_point;
  double by_left = 0;
  for (std::size_t b = c.plane() ? 1 : 0; b < 2; ++b) {
    const double sign = b == 1 ? 1 : -1;
    const BodyImpulse& g = *by_sums[b];
    const Vec3<double> lever = point - flight[b]->end;
    by_linear += sign * (g.linear + impulse.left * g.way + cross(g.angular, lever) +
                         impulse.left * cross(g.turn, c.arm[b]));
    by_angular += sign * (g.angular + impulse.left * g.turn);
    by_left +=
        sign * (dot(impulse.linear, g.way) + dot(cross(c.arm[b], impulse.linear) + impulse.angular, g.turn));
    by.arm[b] += (sign * impulse.left) * cross(impulse.linear, g.turn);
    const Vec3<double> by_lever = sign * cross(impulse.linear, g.angular);
    by_point += by_lever;
    by_flight[b]->end -= by_lever;
  }
  by.at.point += by_point;
  by_left -= dot(velocity, by_point);
  by.share -= scales.frame_time * (dot(velocity, by_point) + (1 + squash(o[3])) * by_left);
  if (c.plane()) {
    by_flight[1]->mean_velocity += since * by_point;
  } else {
    by_flight[0]->mean_velocity += (0.5 * since) * by_point;
    by_flight[1]->mean_velocity += (0.5 * since) * by_point;
  }

  const double v = c.unit;
  const Vec3<double>& n = c.at.normal;
  ContactImpulse::Outputs by_o;

  const double by_normal = dot(n, by_linear), per_normal = v / c.normal_mobility;
  by.unit += c.presence / c.normal_mobility * o[0] * by_normal;
  by.at.normal += (c.presence * per_normal * o[0]) * by_linear;
  by_o[0] = c.presence * per_normal * by_normal;
  by.presence += per_normal * o[0] * by_normal;
  by.normal_mobility -= c.presence * per_normal * o[0] * by_normal / c.normal_mobility;

  const double per_tangent = -v / c.tangent_mobility, along = c.presence * per_tangent;
  by.tangent += (along * o[1]) * by_linear;
  by.side += (along * o[4]) * by_linear;
  by_o[1] = along * dot(c.tangent, by_linear);
  by_o[4] = along * dot(c.side, by_linear);
  const double by_along = dot(o[1] * c.tangent + o[4] * c.side, by_linear);
  by.presence += per_tangent * by_along;
  by.unit += along / v * by_along;
  by.tangent_mobility -= along * by_along / c.tangent_mobility;

  const double by_twist = dot(n, by_angular), per_twist = -v / (c.length * c.twist_mobility);
  const double twist = c.presence * per_twist * o[2] * c.twist_sign;
  by.at.normal += twist * by_angular;
  by_o[2] = c.presence * per_twist * c.twist_sign * by_twist;
  by.presence += per_twist * o[2] * c.twist_sign * by_twist;
  by.unit += twist / v * by_twist;
  by.twist_sign += c.presence * per_twist * o[2] * by_twist;
  by.length -= twist * by_twist / c.length;
  by.twist_mobility -= twist * by_twist / c.twist_mobility;

  by_o[3] = (1 - c.moment.share) * scales.frame_time * squash_slope(o[3]) * by_left;
  return by_o;
}

/// Orientation and spin after a frame, from those after the free flight, the change of spin's angular
/// momentum (N m s) and the sum of moments times the time left (N m s^2). Any scalar.
template <class S>
std::pair<Quat<S>, Vec3<S>> turned_by(const Vec3<S>& inertia, const Vec3<S>& inverse_inertia,
                                      const Quat<S>& orientation, const Vec3<S>& angular_velocity,
                                      const Vec3<S>& change, const Vec3<S>& turn) {
  // A moment turns the body, and the body's axes turn what it keeps of its angular momentum.
  const Vec3<S> angle = scale(inverse_inertia, rotate_back(orientation, turn));
  const Quat<S> after = normalized(orientation * quaternion_exp(angle));
  const Vec3<S> momentum = rotate(orientation, scale(inertia, angular_velocity)) + change;
  return {after, scale(inverse_inertia, rotate_back(after, momentum))};
}

/// What is left of the impulses' moments as a change of spin: the rest goes into the motion of the centre of
/// mass. So the angular momentum of all bodies is kept, whenever which impulse acts.
inline Vec3<double> spin_change(const BodyImpulse& sum, const Vec3<double>& velocity) {
  return sum.angular - cross(sum.way, velocity);
}

/// Newton and Euler: a body's state after the frame, from that after its free flight.
template <class Shape>
RigidState<double> pushed(const Body<double, Shape>& body, const RigidState<double>& flown,
                          const BodyImpulse& sum) {
  if (sum.nothing() || body.is_kinematic()) return flown;
  RigidState<double> after;
  after.position = flown.position + body.inverse_mass() * sum.way;
  after.velocity = flown.velocity + body.inverse_mass() * sum.linear;
  const auto [orientation, spin] =
      turned_by(body.inertia(), body.inverse_inertia(), flown.orientation, flown.angular_velocity,
                spin_change(sum, after.velocity), sum.turn);
  after.orientation = orientation;
  after.angular_velocity = spin;
  return after;
}

/// The way back: adds to the derivatives by the flown state and sets that by the sums.
template <class Shape>
BodyImpulse add_pushed_gradient(const Body<double, Shape>& body, const RigidState<double>& flown,
                                const BodyImpulse& sum, const RigidState<double>& by_after,
                                RigidState<double>& by_flown) {
  BodyImpulse by{};
  if (!sum.touched || body.is_kinematic()) {
    by_flown.vector() += by_after.vector();
    return by;
  }
  const Vec3<double> velocity = flown.velocity + body.inverse_mass() * sum.linear;
  const auto [q, w] =
      turned_by(constant_vector<13>(body.inertia()), constant_vector<13>(body.inverse_inertia()),
                dual_quaternion<13>(flown.orientation, 0), dual_vector<13>(flown.angular_velocity, 4),
                dual_vector<13>(spin_change(sum, velocity), 7), dual_vector<13>(sum.turn, 10));
  const Eigen::Matrix<double, 13, 1> g =
      pull_back<13>(by_after.orientation, q) + pull_back<13>(by_after.angular_velocity, w);
  by_flown.orientation = by_flown.orientation + Quat<double>{g[0], g[1], g[2], g[3]};
  by_flown.angular_velocity += Vec3<double>{g[4], g[5], g[6]};
  const Vec3<double> by_change{g[7], g[8], g[9]};
  by.turn = {g[10], g[11], g[12]};
  by.angular = by_change;
  const Vec3<double> by_velocity = by_after.velocity + cross(sum.way, by_change);
  by.way = body.inverse_mass() * by_after.position + cross(by_change, velocity);
  by.linear = body.inverse_mass() * by_velocity;
  by_flown.position += by_after.position;
  by_flown.velocity += by_velocity;
  return by;
}

}  // namespace rbres::RBRES_ABI::detail
