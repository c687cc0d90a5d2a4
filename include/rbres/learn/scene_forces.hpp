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
using SceneForces = Forces<Gravity<double>, FluidFriction<double>, Damping<double>, SceneWrenches>;

/// Those of a scene of a set.
inline SceneForces scene_forces(const TrajectorySet& set, const Trajectory& scene) {
  const Resistance& resistance = set.resistance();
  return {Gravity{set.gravity()}, resistance.friction, resistance.damping, SceneWrenches{scene.wrenches()}};
}

namespace detail {
/// Those on body i of a scene taken alone.
inline SceneForces body_forces(const TrajectorySet& set, const Trajectory& scene, int i) {
  const Resistance& resistance = set.resistance();
  return {
      Gravity{set.gravity()}, resistance.friction, resistance.damping,
      SceneWrenches{scene.wrenches().empty() ? std::vector<Wrench<double>>{}
                                             : std::vector{scene.wrenches()[static_cast<std::size_t>(i)]}}};
}
}  // namespace detail
}  // namespace rbres::RBRES_ABI
