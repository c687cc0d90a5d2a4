#pragma once

#include <array>
#include <rbres/core/scalar.hpp>

namespace rbres::RBRES_ABI::detail {

/// What unit impulses at a contact point change of its relative velocity, along its normal and two tangents,
/// and how its law is answered with that.
template <class S>
struct PointResponse {
  S normal, normal_mass;        ///< of the velocity along the normal, 1/kg; its inverse
  S normal_to_u, normal_to_v;   ///< of the slip by an impulse along the normal, 1/kg
  S mass_uu, mass_uv, mass_vv;  ///< inverse of what impulses along the surface change of the slip, kg
  S tangent, slip_mass;         ///< the most that one changes, 1/kg; its inverse

  /// A change of the impulse, N s, and how far the velocity was off, m/s.
  struct Step {
    std::array<S, 3> change;
    S fault;
  };

  /// Towards the speed `target` along the normal, or no impulse where it leaves faster.
  S normal_change(const S& impulse, const S& speed, const S& target, const MaskOf<S>& active) const {
    const S pushed = maximum(S(impulse + normal_mass * (target - speed)), S(0));
    return select(active, S(pushed - impulse), S(0));
  }
  /// The same with Coulomb's law along the surface: towards sticking where friction times the normal impulse
  /// suffices, else towards that much against the slip.
  Step step(const std::array<S, 3>& impulse, const S& speed, const S& slip_u, const S& slip_v,
            const S& target, const S& friction, const MaskOf<S>& active) const {
    using std::abs;
    const S change = normal_change(impulse[0], speed, target, active);
    // What the normal impulse does to the slip, without moving the bodies twice.
    const S u = slip_u + normal_to_u * change, v = slip_v + normal_to_v * change;
    const S stick_u = impulse[1] - (mass_uu * u + mass_uv * v),
            stick_v = impulse[2] - (mass_uv * u + mass_vv * v);
    const S most = friction * (impulse[0] + change);
    const MaskOf<S> slides = square(stick_u) + square(stick_v) > square(most);
    S to_u = stick_u, to_v = stick_v;
    if (any(slides)) {
      // Against the slip itself: the sticking impulse of a corner points elsewhere.
      const S against_u = impulse[1] - slip_mass * u, against_v = impulse[2] - slip_mass * v;
      const S length2 = square(against_u) + square(against_v);
      const MaskOf<S> beyond = length2 > square(most);
      const S share = select(beyond, S(most * inverse_root(select(beyond, length2, S(1)))), S(1));
      to_u = select(slides, S(share * against_u), stick_u);
      to_v = select(slides, S(share * against_v), stick_v);
    }
    const S off_u = select(active, S(to_u - impulse[1]), S(0)),
            off_v = select(active, S(to_v - impulse[2]), S(0));
    return {{change, off_u, off_v}, maximum(S(normal * abs(change)), S(tangent * (abs(off_u) + abs(off_v))))};
  }
};

}  // namespace rbres::RBRES_ABI::detail
