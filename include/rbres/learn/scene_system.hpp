#pragma once

#include <rbres/learn/trajectory.hpp>

namespace rbres::RBRES_ABI {

/// Where the bodies of a scene are, as many as it has.
template <class S>
struct BasicSceneState {
  /// Body by body.
  std::vector<RigidState<S>> body;

  /// The state of body i.
  /// @{
  RigidState<S>& operator[](int i) { return body[static_cast<std::size_t>(i)]; }
  const RigidState<S>& operator[](int i) const { return body[static_cast<std::size_t>(i)]; }
  /// @}
};
/// In double.
using SceneState = BasicSceneState<double>;

/// A System whose number of bodies is known when the program runs: for flight, detection and discrete
/// contacts.
template <class S>
class BasicSceneSystem {
 public:
  /// Its numbers.
  using Scalar = S;
  /// Of its bodies.
  using Shape = AnyShape<S>;
  /// A body of it.
  using BodyType = Body<S>;
  /// Where its bodies are.
  using State = BasicSceneState<S>;
  static constexpr int bodies = -1;  ///< see bodies_of

  /// Throws Error where a plane's normal is not a unit vector.
  BasicSceneSystem(std::vector<BodyType> all, std::vector<Plane<S>> planes)
      : bodies_(std::move(all)), planes_(detail::checked_planes(std::move(planes))) {}

  /// How many bodies there are.
  int size() const { return static_cast<int>(bodies_.size()); }
  /// Body i, from 0.
  const BodyType& operator[](int i) const { return bodies_[static_cast<std::size_t>(i)]; }
  /// The planes around them.
  const std::vector<Plane<S>>& planes() const { return planes_; }
  /// As System::collides.
  bool collides(int first, int second) const noexcept { return detail::one_moves(bodies_, first, second); }

 private:
  std::vector<BodyType> bodies_;
  std::vector<Plane<S>> planes_;
};
/// In double.
using SceneSystem = BasicSceneSystem<double>;

/// The bodies of a scene of a set, and the set's planes.
inline SceneSystem scene_system(const TrajectorySet& set, const Trajectory& scene) {
  std::vector<Body<double>> bodies;
  for (int i = 0; i < scene.bodies(); ++i) bodies.push_back(scene.body(i));
  return {std::move(bodies), set.planes()};
}

}  // namespace rbres::RBRES_ABI
