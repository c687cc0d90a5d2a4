#pragma once

#include <array>
#include <optional>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/learn/scene_system.hpp>
#include <rbres/sim/discrete_contact.hpp>
#include <rbres/sim/options.hpp>

namespace rbres {

/// What of a world may be unknown.
enum class Unknown {
  restitution,  ///< of every contact, in [0, 1]
  friction,     ///< Coulomb coefficient of every contact
  gravity,      ///< m/s^2, along the set's own gravity
  damping,      ///< rate at which velocity and spin decay, 1/s
  mass,         ///< factor on every mass; inertia stays
  inertia,      ///< factor on every moment of inertia
  size,         ///< factor on every length of every shape; inertia stays
};
inline constexpr std::array unknown_names{"restitution", "friction", "gravity", "damping",
                                          "mass",        "inertia",  "size"};
inline const char* name(Unknown u) { return unknown_names[static_cast<std::size_t>(u)]; }

/// Numbers that stand in for those of a trajectory set; where there is none, the set's own holds.
class WorldNumbers {
 public:
  std::optional<double>& operator[](Unknown u) { return number_[static_cast<std::size_t>(u)]; }
  const std::optional<double>& operator[](Unknown u) const { return number_[static_cast<std::size_t>(u)]; }

  /// A scene's bodies, and the set's planes.
  SceneSystem system(const TrajectorySet& set, const Trajectory& scene) const {
    std::vector<Body<double>> bodies;
    for (int i = 0; i < scene.bodies(); ++i) bodies.push_back(body(scene.body(i)));
    std::vector<Plane<double>> planes = set.planes();
    for (Plane<double>& plane : planes) plane.material = material(plane.material);
    return {std::move(bodies), std::move(planes)};
  }
  Forces<Gravity<double>, Damping<double>> forces(const TrajectorySet& set) const {
    Vec3<double> g = set.gravity();
    if (const auto& strength = (*this)[Unknown::gravity]) g = (*strength / norm(g)) * g;
    const double damping = (*this)[Unknown::damping].value_or(0);
    return {Gravity{g}, Damping{damping, damping}};
  }

 private:
  Body<double> body(const Body<double>& nominal) const {
    const auto factor = [&](Unknown u) { return (*this)[u].value_or(1); };
    return nominal.scaled(factor(Unknown::size), factor(Unknown::mass), factor(Unknown::inertia),
                          material(nominal.material()));
  }
  Material<double> material(Material<double> m) const {
    if (const auto& e = (*this)[Unknown::restitution]) m.restitution = *e;
    if (const auto& mu = (*this)[Unknown::friction]) m.friction = *mu;
    return m;
  }

  std::array<std::optional<double>, unknown_names.size()> number_;
};

/// How a scene is simulated: by discrete contacts, in equal steps from frame to frame.
struct SceneStep {
  int steps = 1;  ///< in a frame
  /// What a frame's velocity is: at its time, or the mean since the frame before (position after = position
  /// before + frame time * velocity after), as differences of measured positions are.
  enum class Velocity { instant, mean } velocity = Velocity::instant;
};

/// Takes the bodies of one scene from frame to frame. Not copied: its parts know one another's places.
class SceneSimulator {
 public:
  /// What is not in `numbers` is as in the set, of which the scene is one. Throws Error for numbers that no
  /// world has.
  SceneSimulator(const TrajectorySet& set, const Trajectory& scene, const WorldNumbers& numbers,
                 const SceneStep& step)
      : system_(numbers.system(set, scene)),
        forces_(numbers.forces(set)),
        step_(step),
        h_(set.frame_time() / step.steps),
        contacts_(system_) {
    before_.body.reserve(static_cast<std::size_t>(scene.bodies()));
  }
  SceneSimulator(const SceneSimulator&) = delete;
  SceneSimulator& operator=(const SceneSimulator&) = delete;

  /// One frame on. Allocates nothing.
  void operator()(SceneState& state) {
    for (int k = 0; k < step_.steps; ++k) {
      before_ = state;
      if (step_.velocity == SceneStep::Velocity::mean) {
        fly_on(system_, forces_, SemiImplicitEuler{}, state, 0.0, h_);
      } else {
        fly_on(system_, forces_, Rk4{}, state, 0.0, h_);
      }
      contacts_.resolve(before_, state, h_, SimulationOptions{}.rest_speed, tally_);
    }
  }

 private:
  SceneSystem system_;
  Forces<Gravity<double>, Damping<double>> forces_;
  SceneStep step_;
  double h_;  ///< s
  detail::DiscreteContact<SceneSystem> contacts_;
  SceneState before_;
  ContactTally<double> tally_;
};

}  // namespace rbres
