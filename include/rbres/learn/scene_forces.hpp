#pragma once

#include <rbres/dynamics/forces.hpp>
#include <rbres/learn/trajectory.hpp>

#include <vector>

namespace rbres::RBRES_ABI {

/// The wrench of its own on each body of a scene, the same at all times.
struct SceneWrenches {
  /// Body by body: force in world frame, N; torque in body frame, N m. Empty: none.
  std::vector<Wrench<double>> wrench;

  /// Whether it exerts a torque.
  bool turns() const {
    for (const Wrench<double>& w : wrench)
      if (squared_norm(w.torque) > 0) return true;
    return false;
  }
  /// The wrench on body `index`.
  template <class S, class Shape>
  Wrench<S> operator()(const Body<S, Shape>&, const RigidState<S>&, int index, const S&) const {
    if (wrench.empty()) return {};
    const auto& [f, t] = wrench[static_cast<std::size_t>(index)];
    return {{as<S>(f.x), as<S>(f.y), as<S>(f.z)}, {as<S>(t.x), as<S>(t.y), as<S>(t.z)}};
  }
};

/// What acts on the bodies of a scene between their contacts.
struct SceneForces {
  /// What acts.
  /// @{
  Gravity<double> gravity;
  Resistance resistance;
  SceneWrenches wrenches;
  /// @}

  /// Whether they exert a torque.
  bool turns() const { return resistance.friction.turns() || resistance.damping.turns() || wrenches.turns(); }
  /// The wrench on body `index`. Not inlined into every stage of an integrator.
  template <class S, class Shape>
  [[gnu::noinline]] Wrench<S> operator()(const Body<S, Shape>& body, const RigidState<S>& state, int index,
                                         const S& time) const {
    const Wrench<S> weight = gravity(body, state), own = wrenches(body, state, index, time);
    if (!resistance.any()) return weight + own;
    // In the order of Forces{gravity, friction, damping, wrenches}, for the same bits.
    return weight + (resistance.friction(body, state) + (resistance.damping(body, state) + own));
  }
};

/// Those of a scene of a set.
inline SceneForces scene_forces(const TrajectorySet& set, const Trajectory& scene) {
  return {{set.gravity()}, set.resistance(), {scene.wrenches()}};
}

namespace detail {
/// Those on body i of a scene taken alone.
inline SceneForces body_forces(const TrajectorySet& set, const Trajectory& scene, int i) {
  const auto& all = scene.wrenches();
  return {
      {set.gravity()}, set.resistance(), {all.empty() ? all : std::vector{all[static_cast<std::size_t>(i)]}}};
}
}  // namespace detail
}  // namespace rbres::RBRES_ABI
