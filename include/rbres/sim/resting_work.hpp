#pragma once

#include <cstddef>
#include <rbres/contact/contact_pair.hpp>
#include <rbres/core/lie.hpp>

namespace rbres::RBRES_ABI::detail {

/// What resting contacts do to a body over a part of a step, world frame. Where two bodies touch moves with
/// the lighter one, on one path for both, so that angular momentum is kept while they slide past one another.
template <class S>
struct RestingForce {
  Vec3<S> force;   ///< N
  Vec3<S> torque;  ///< about the centre of mass where the part begins, N m
  Vec3<S> paired;  ///< the share of the force that other bodies exert, N
  Vec3<S> drift;   ///< of that share's torque about that place, as the contacts move, N m/s
  Vec3<S> bend;    ///< half of the drift's own rate, N m/s^2

  /// About the centre of mass, a time (s) after the part began, when it has moved by `way` (m); N m.
  Vec3<S> torque_at(const S& time, const Vec3<S>& way) const {
    return torque + time * (drift + time * bend) - cross(way, paired);
  }
  /// The work that the torque does (J) on a body that goes from one state to another in `time` (s), to the
  /// fifth order in the time: Simpson's rule, with the integral of the angular velocity from the turn itself
  /// (Magnus's expansion; Iserles, Munthe-Kaas, Norsett, Zanna 2000, section 4).
  S turning_work(const RigidState<S>& from, const RigidState<S>& to, const S& time) const {
    const Vec3<S> way = to.position - from.position;
    const Vec3<S> halfway = as<S>(0.5) * way + S(as<S>(0.125) * time) * (from.velocity - to.velocity);
    const Vec3<S> w0 = from.angular_velocity_world(), w1 = to.angular_velocity_world();
    const Vec3<S> turn = quaternion_log(to.orientation * from.orientation.conjugate()) +
                         S(time * time / as<S>(12)) * cross(w0, w1);
    const Vec3<S> middle = torque_at(S(as<S>(0.5) * time), halfway);
    return dot(middle, turn) +
           time / as<S>(6) * (dot(torque - middle, w0) + dot(torque_at(time, way) - middle, w1));
  }
};

/// The force of a point whose impulse lasts for 1 / `rate` seconds, N, world frame.
template <class Row, class Point, class S>
Vec3<S> force_of(const Row& row, const Point& point, const S& rate) {
  Vec3<S> force;
  for (std::size_t d = 0; d < 3; ++d) force += (rate * row.impulse()[d]) * point.direction(d);
  return force;
}
/// Adds the force of a point between two bodies (impulse times `rate`), which moves from where y has it to
/// where `end` has it.
template <class Row, class Point, class State, class Motions, class Forces, class S>
void add_paired_force(const Row& row, const Point& point, const State& y, const Motions& end, const S& rate,
                      Forces& contact) {
  const auto index = [](int i) { return static_cast<std::size_t>(i); };
  const Vec3<S> force = force_of(row, point, rate);
  const auto first = index(row.moved.first), second = index(row.moved.second);
  const S &a = end[first].inverse_mass, &b = end[second].inverse_mass;
  const auto along = [&](const Vec3<S>& v, const Vec3<S>& w) { return (S(1) / (a + b)) * (a * v + b * w); };
  const Vec3<S> from = along(y[row.moved.first].velocity, y[row.moved.second].velocity);
  const Vec3<S> to = along(end[first].velocity, end[second].velocity);
  const Vec3<S> drift = cross(from, force), bend = as<S>(0.5) * rate * cross(to - from, force);
  contact[second].paired += force;
  contact[second].drift += drift;
  contact[second].bend += bend;
  contact[first].paired -= force;
  contact[first].drift -= drift;
  contact[first].bend -= bend;
}
/// The same of a point that goes `way` (m) from where `start` has it until halfway, where the torque of its
/// impulse was found.
template <class Row, class Point, class Motions, class Forces, class S>
void add_moving_force(const Row& row, const Point& point, const Vec3<S>& way, const Motions& start,
                      const S& rate, Forces& contact) {
  const auto add = [&](int body, const Vec3<S>& force) {
    const auto i = static_cast<std::size_t>(body);
    contact[i].paired += force;
    contact[i].drift += cross(S(as<S>(2.0) * rate) * way, force);
    contact[i].torque -= cross(way - S(as<S>(0.5) / rate) * start[i].velocity, force);
  };
  const Vec3<S> force = force_of(row, point, rate);
  add(row.moved.second, force);
  add(row.moved.first, -force);
}

}  // namespace rbres::RBRES_ABI::detail
