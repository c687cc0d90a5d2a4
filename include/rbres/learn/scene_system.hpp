#pragma once

#include <rbres/learn/trajectory.hpp>

namespace rbres::RBRES_ABI {

/// The bodies of a scene and its planes, and where they are: as many bodies as it has.
/// @{
using SceneSystem = System<double, dynamic>;
using SceneState = SystemState<double, dynamic>;
/// @}

/// The bodies of a scene of a set, and the set's planes.
inline SceneSystem scene_system(const TrajectorySet& set, const Trajectory& scene) {
  std::vector<Body<double>> bodies;
  for (int i = 0; i < scene.bodies(); ++i) bodies.push_back(scene.body(i));
  return {std::move(bodies), set.planes()};
}

}  // namespace rbres::RBRES_ABI
