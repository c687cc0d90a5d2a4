#pragma once

#include <rbres/contact/contact_pair.hpp>

namespace rbres {

/// What happened during some steps, lane by lane.
template <class S>
struct ContactTally {
  CountOf<S> impacts{};   ///< impacts resolved: pairs whose approach was answered by an impulse
  CountOf<S> touching{};  ///< discrete contacts: pairs found touching, summed over steps
  CountOf<S> overruns{};  ///< steps that met the event cap and were finished discretely
};

namespace detail {

/// Writes velocities back where `changed`; other lanes keep their bits.
template <class S>
void set_velocities_where(const MaskOf<S>& changed, RigidState<S>& state, const Motion<S>& motion) {
  RigidState<S> next = state;
  set_velocities(next, motion);
  state.velocity = select(changed, next.velocity, state.velocity);
  state.angular_velocity = select(changed, next.angular_velocity, state.angular_velocity);
}

/// Gives a pair back the angular momentum that it lost when its second body was moved by `shift` relative to
/// the first, where `moved`: its motion is a rigid turn, which carries the angular momentum, and a remainder
/// without any. The turn is set right, and the remainder shrinks where kinetic energy would rise. The total
/// momentum stays. `a` and `b` have their new positions.
template <class S>
void restore_angular_momentum(const Vec3<S>& shift, const MaskOf<S>& moved, Motion<S>& a, Motion<S>& b) {
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
  const S remainder = energy - dot(after, turned), allowed = energy - dot(before, turn);
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

/// One pair at the end of a step: impulse where it overlaps and approaches, and the overlap taken away along
/// the normal, shared by inverse mass. What the step's forces alone can have given in two steps is rest, not
/// approach.
template <class System>
void meet(const System& system, const typename System::State& before, typename System::State& y, int first,
          int second, const typename System::Scalar& rest, ContactTally<typename System::Scalar>& tally) {
  using S = typename System::Scalar;
  with_manifold(system, y, first, second, [&](auto manifold, auto is_plane) {
    constexpr bool fixed = decltype(is_plane)::value;
    constexpr std::size_t points = std::decay_t<decltype(manifold)>::points;
    std::array<MaskOf<S>, points> touching;
    MaskOf<S> overlaps(false);
    S depth(0);
    for (std::size_t i = 0; i < points; ++i) {
      touching[i] = manifold.gap[i] < S(0);
      overlaps = overlaps | touching[i];
      depth = maximum(depth, S(-manifold.gap[i]));
    }
    if (!any(overlaps)) return;
    if constexpr (Packed<S>) gather(manifold, touching);
    tally.touching += overlaps;

    Motion<S> b = motion_of(system[second], y[second]);
    Motion<S> a = [&] {
      if constexpr (fixed) {
        return Motion<S>{};
      } else {
        return motion_of(system[first], y[first]);
      }
    }();
    Vec3<S> change = y[second].velocity - before[second].velocity;
    S share(0), size = system[second].bounding_radius();
    if constexpr (!fixed) {
      change -= y[first].velocity - before[first].velocity;
      share = a.inverse_mass / (a.inverse_mass + b.inverse_mass);
      size = minimum(size, system[first].bounding_radius());
    }
    const S rest_speed = rest * speed_scale(size);
    const S fallen = maximum(S(S(-2) * dot(manifold.normal, change)), S(0));
    const MaskOf<S> hit = resolve_impact<fixed>(manifold, touching, surface_of(system, first, second),
                                                maximum(rest_speed, fallen), S(0), a, b);
    tally.impacts += hit;
    const Vec3<S> shift = select(overlaps, depth, S(0)) * manifold.normal;
    y[second].position += (S(1) - share) * shift;
    MaskOf<S> changed = hit;
    if constexpr (!fixed) {
      y[first].position -= share * shift;
      a.position = y[first].position;
      b.position = y[second].position;
      restore_angular_momentum(shift, overlaps, a, b);
      changed = hit | overlaps;
      set_velocities_where(changed, y[first], a);
    }
    set_velocities_where(changed, y[second], b);
  });
}
/// The same in one piece, which is faster: not for dual numbers, with which g++ 12 fails on it.
template <class System>
[[gnu::noinline, gnu::flatten]] void meet_flat(const System& system, const typename System::State& before,
                                               typename System::State& y, int first, int second,
                                               const typename System::Scalar& rest,
                                               ContactTally<typename System::Scalar>& tally) {
  meet(system, before, y, first, second, rest, tally);
}

/// All contacts at the end of a step from `before` to y, each pair once, planes first.
template <class System>
void meet_all(const System& system, const typename System::State& before, typename System::State& y,
              const typename System::Scalar& rest_speed, ContactTally<typename System::Scalar>& tally) {
  const auto meet_pair = [&](int first, int second) {
    if constexpr (std::is_floating_point_v<typename ScalarTraits<typename System::Scalar>::Value>) {
      meet_flat(system, before, y, first, second, rest_speed, tally);
    } else {
      meet(system, before, y, first, second, rest_speed, tally);
    }
  };
  const auto& planes = system.planes();
  for (std::size_t p = 0; p < planes.size(); ++p) {
    for (int i = 0; i < System::bodies; ++i) {
      if (any(dot(planes[p].normal, y[i].position) - planes[p].offset < system[i].bounding_radius())) {
        meet_pair(-1 - static_cast<int>(p), i);
      }
    }
  }
  for (int i = 0; i < System::bodies; ++i) {
    for (int j = i + 1; j < System::bodies; ++j) {
      const auto r = system[i].bounding_radius() + system[j].bounding_radius();
      if (any(squared_norm(y[i].position - y[j].position) < r * r)) meet_pair(i, j);
    }
  }
}

}  // namespace detail
}  // namespace rbres
