#pragma once

#include <rbres/body/mechanics.hpp>
#include <rbres/learn/contact_features.hpp>

#include <algorithm>
#include <span>

namespace rbres::RBRES_ABI {

/// What a rollout costs where it breaks rules that hold whatever the trajectories say: terms of RolloutLoss.
/// With weights of 0, as here, they cost nothing. Soft contacts do overlap, and give back energy: where the
/// trajectories break a rule themselves, its term pulls away from them.
struct PhysicsTerms {
  double energy = 0;       ///< on what a scene gains in a frame, per kilogram of its bodies, kg/J
  double penetration = 0;  ///< on the overlap of each contact point where a frame begins, 1/m
  /// On normal impulses that pull, and on those that push across a gap, as shares of the margin: on speeds
  /// counted in ContactScales::speed.
  double complementarity = 0;

  /// Whether one of them costs anything.
  bool any() const { return energy > 0 || penetration > 0 || complementarity > 0; }
};

namespace detail {

/// What a contact costs, and its derivatives.
struct ContactCost {
  double value = 0, by_output = 0, by_presence = 0, by_gap_before = 0, by_gap_after = 0;
};

/// `output` is the normal impulse that the network gives, in units of speed.
inline ContactCost contact_cost(const PhysicsTerms& terms, const Contact& c, double output,
                                const ContactScales& scales) {
  ContactCost cost;
  if (c.gap_before < 0) {
    cost.value -= terms.penetration * c.gap_before;
    cost.by_gap_before -= terms.penetration;
  }
  const double w = terms.complementarity, gap = c.smallest_gap();
  if (output < 0) {
    cost.value -= w * c.presence * output;
    cost.by_output -= w * c.presence;
    cost.by_presence -= w * output;
  } else if (gap > 0) {
    const double share = gap / scales.margin;
    cost.value += w * c.presence * output * share;
    cost.by_output += w * c.presence * share;
    cost.by_presence += w * output * share;
    (c.gap_before < c.gap_after ? cost.by_gap_before : cost.by_gap_after) +=
        w * c.presence * output / scales.margin;
  }
  return cost;
}

/// Mechanical energy of bodies for each of their kilograms, J/kg. bodies[i] is a System of body i alone.
inline double specific_energy(std::span<const System<double, 1>* const> bodies,
                              std::span<const RigidState<double>> states, const Vec3<double>& gravity) {
  double energy = 0, mass = 0;
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const Body<double>& body = (*bodies[i])[0];
    energy += kinetic_energy(body, states[i]) - body.mass() * dot(gravity, states[i].position);
    mass += body.mass();
  }
  return energy / mass;
}

/// Adds its derivative by the states, `by_energy` times.
inline void add_specific_energy_gradient(std::span<const System<double, 1>* const> bodies,
                                         std::span<const RigidState<double>> states,
                                         const Vec3<double>& gravity, double by_energy,
                                         std::span<RigidState<double>> by_states) {
  double mass = 0;
  for (const auto* body : bodies) mass += (*body)[0].mass();
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const Body<double>& body = (*bodies[i])[0];
    const double share = by_energy / mass;
    by_states[i].position -= (share * body.mass()) * gravity;
    by_states[i].velocity += (share * body.mass()) * states[i].velocity;
    by_states[i].angular_velocity += share * scale(body.inertia(), states[i].angular_velocity);
  }
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI
