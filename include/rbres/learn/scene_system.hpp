#pragma once

#include <rbres/learn/trajectory.hpp>

namespace rbres {

/// Where the bodies of a scene are, as many as it has.
struct SceneState {
  std::vector<RigidState<double>> body;

  RigidState<double>& operator[](int i) { return body[static_cast<std::size_t>(i)]; }
  const RigidState<double>& operator[](int i) const { return body[static_cast<std::size_t>(i)]; }
};

/// A System whose number of bodies is known when the program runs: for flight, detection and discrete
/// contacts.
class SceneSystem {
 public:
  using Scalar = double;
  using Shape = AnyShape<double>;
  using BodyType = Body<double>;
  using State = SceneState;
  static constexpr int bodies = -1;  ///< see bodies_of

  SceneSystem(std::vector<BodyType> all, std::vector<Plane<double>> planes)
      : bodies_(std::move(all)), planes_(detail::checked_planes(std::move(planes))) {}

  int size() const { return static_cast<int>(bodies_.size()); }
  const BodyType& operator[](int i) const { return bodies_[static_cast<std::size_t>(i)]; }
  const std::vector<Plane<double>>& planes() const { return planes_; }

 private:
  std::vector<BodyType> bodies_;
  std::vector<Plane<double>> planes_;
};

}  // namespace rbres
