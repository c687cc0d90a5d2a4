#pragma once

#include <rbres/body/mechanics.hpp>
#include <rbres/contact/impulse.hpp>

namespace rbres::RBRES_ABI::detail {

/// Gives a pair back the angular momentum that it lost when its second body was moved by `shift` relative to
/// the first, where `moved`: its motion is a rigid turn, which carries the angular momentum, and a remainder
/// without any. The turn is set right, and the remainder shrinks where kinetic energy would rise above what
/// it was less `excess` (J). The total momentum stays. `a` and `b` have their new positions.
template <class S>
void restore_angular_momentum(const Vec3<S>& shift, const MaskOf<S>& moved, const S& excess, Motion<S>& a,
                              Motion<S>& b) {
  const S share = a.inverse_mass / (a.inverse_mass + b.inverse_mass);
  const S mass = S(1) / (a.inverse_mass + b.inverse_mass);  // reduced
  const Vec3<S> r = b.position - a.position, v = b.velocity - a.velocity;
  const Mat3<S> ia = symmetric_inverse(a.inverse_inertia), ib = symmetric_inverse(b.inverse_inertia);
  const Vec3<S> spin = ia * a.angular_velocity + ib * b.angular_velocity;
  const Vec3<S> after = spin + mass * cross(r, v), before = after - mass * cross(shift, v);
  const S r2 = squared_norm(r);
  const auto column = [&](const Vec3<S>& p, const Vec3<S>& q, const Vec3<S>& unit, const S& along) {
    return p + q + mass * (r2 * unit - along * r);
  };
  const Mat3<S> inverse = symmetric_inverse(Mat3<S>{column(ia.x, ib.x, {S(1), S(0), S(0)}, r.x),
                                                    column(ia.y, ib.y, {S(0), S(1), S(0)}, r.y),
                                                    column(ia.z, ib.z, {S(0), S(0), S(1)}, r.z)});
  const Vec3<S> turn = inverse * before, turned = inverse * after;
  const S energy = mass * squared_norm(v) + dot(a.angular_velocity, ia * a.angular_velocity) +
                   dot(b.angular_velocity, ib * b.angular_velocity);
  const S remainder = energy - dot(after, turned), allowed = energy - dot(before, turn) - S(2) * excess;
  const MaskOf<S> shrinks = remainder > allowed;
  const S factor = select(shrinks, root(maximum(S(allowed / select(shrinks, remainder, S(1))), S(0))), S(1));
  const Vec3<S> change = cross(turn, r) + factor * (v - cross(turned, r)) - v;
  const S moves = select(moved, S(1), S(0));
  b.velocity += ((S(1) - share) * moves) * change;
  a.velocity -= (share * moves) * change;
  for (Motion<S>* m : {&a, &b}) {
    const Vec3<S> w = turn + factor * (m->angular_velocity - turned);
    m->angular_velocity += moves * (w - m->angular_velocity);
  }
}

/// Moves a body out of a plane along its normal by `depth` (m), which costs `cost` (J) against the forces on
/// it. What an impact has not spent of the energy `before` (J) it pays from its motion along the normal, then
/// from its rotation, up to half of each; where that is too little it moves less far.
template <class S, class Shape>
void push_out(const Body<S, Shape>& body, const Vec3<S>& normal, const S& depth, const S& cost,
              const S& before, RigidState<S>& state) {
  const S now = kinetic_energy(body, state), along = dot(normal, state.velocity);
  const S linear = as<S>(0.25) * body.mass() * square(along);
  const S spin = as<S>(0.25) * dot(state.angular_velocity, scale(body.inertia(), state.angular_velocity));
  const S most = maximum(S(before - now), S(0)) + linear + spin;
  const S share = select(cost > most, S(most / select(cost > most, cost, S(1))), S(1));
  state.position += (share * depth) * normal;
  const S excess = clamp(S(now + share * cost - before), S(0), S(linear + spin));
  const auto slower = [](const S& energy, const S& less) {
    const MaskOf<S> some = energy > S(0);
    return root(S(S(1) - S(0.5) * less / select(some, energy, S(1))));
  };
  const S taken = minimum(excess, linear);
  state.velocity -= ((S(1) - slower(linear, taken)) * along) * normal;
  state.angular_velocity = slower(spin, S(excess - taken)) * state.angular_velocity;
}

/// What a step's forces did to a body before contacts.
template <class S>
struct Gain {
  Vec3<S> velocity;      ///< m/s
  Vec3<S> acceleration;  ///< mean, m/s^2
  S lost;                ///< energy that the integrator lost, as those of first order do, J
};

/// After the impact of a body and a kinematic one, `partner`, with the velocities of `motion` where `hit`:
/// what a plane does that moves with the partner's surface. `normal` and `depth` (m, 0 where they do not
/// overlap) lead the body out.
template <class S, class Shape>
void resolve_kinematic(const RigidState<S>& partner, const Body<S, Shape>& body, const Vec3<S>& normal,
                       const S& depth, const Gain<S>& gain, const MaskOf<S>& hit, const Motion<S>& motion,
                       RigidState<S>& state) {
  const Vec3<S> turn = partner.angular_velocity_world(), turned = rotate_back(state.orientation, turn);
  const Vec3<S> carried = partner.velocity + cross(turn, state.position - partner.position);
  const auto relative = [&] {
    RigidState<S> y = state;
    y.velocity -= carried;
    y.angular_velocity -= turned;
    return y;
  };
  const S before = kinetic_energy(body, relative()) + gain.lost;
  set_velocities_where(hit, state, motion);
  RigidState<S> out = relative();
  push_out(body, normal, depth, S(-depth * body.mass() * dot(gain.acceleration, normal)), before, out);
  out.velocity += carried;
  out.angular_velocity += turned;
  state = select(depth > S(0), out, state);
}

}  // namespace rbres::RBRES_ABI::detail
