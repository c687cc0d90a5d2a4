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

/// One pair at the end of a step: impulse where it overlaps and approaches, and the overlap taken away along
/// the normal, shared by inverse mass. What the step's forces alone can have given in two steps is rest, not
/// approach.
template <class System>
[[gnu::noinline, gnu::flatten]] void meet(const System& system, const typename System::State& before,
                                          typename System::State& y, int first, int second,
                                          const typename System::Scalar& rest_speed,
                                          ContactTally<typename System::Scalar>& tally) {
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
    S share(0);
    if constexpr (!fixed) {
      change -= y[first].velocity - before[first].velocity;
      share = a.inverse_mass / (a.inverse_mass + b.inverse_mass);
    }
    const S fallen = maximum(S(S(-2) * dot(manifold.normal, change)), S(0));
    const MaskOf<S> hit = resolve_impact<fixed>(manifold, touching, surface_of(system, first, second),
                                                maximum(rest_speed, fallen), S(0), a, b);
    tally.impacts += hit;
    set_velocities_where(hit, y[second], b);
    const S out = select(overlaps, depth, S(0));
    y[second].position += ((S(1) - share) * out) * manifold.normal;
    if constexpr (!fixed) {
      set_velocities_where(hit, y[first], a);
      y[first].position -= (share * out) * manifold.normal;
    }
  });
}

/// All contacts at the end of a step from `before` to y, each pair once, planes first.
template <class System>
void meet_all(const System& system, const typename System::State& before, typename System::State& y,
              const typename System::Scalar& rest_speed, ContactTally<typename System::Scalar>& tally) {
  const auto& planes = system.planes();
  for (std::size_t p = 0; p < planes.size(); ++p) {
    for (int i = 0; i < System::bodies; ++i) {
      if (any(dot(planes[p].normal, y[i].position) - planes[p].offset < system[i].bounding_radius())) {
        meet(system, before, y, -1 - static_cast<int>(p), i, rest_speed, tally);
      }
    }
  }
  for (int i = 0; i < System::bodies; ++i) {
    for (int j = i + 1; j < System::bodies; ++j) {
      const auto r = system[i].bounding_radius() + system[j].bounding_radius();
      if (any(squared_norm(y[i].position - y[j].position) < r * r))
        meet(system, before, y, i, j, rest_speed, tally);
    }
  }
}

}  // namespace detail
}  // namespace rbres
