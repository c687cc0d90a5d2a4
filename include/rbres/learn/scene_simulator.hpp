#pragma once

#include <array>
#include <concepts>
#include <optional>
#include <rbres/learn/scene_forces.hpp>
#include <rbres/learn/scene_step.hpp>
#include <rbres/learn/scene_system.hpp>
#include <rbres/sim/discrete_contact.hpp>
#include <rbres/sim/options.hpp>

namespace rbres::RBRES_ABI {

/// What of a world may be unknown.
enum class Unknown {
  restitution,  ///< of every contact, in [0, 1]
  friction,     ///< Coulomb coefficient of every contact
  gravity,      ///< m/s^2, along the set's own gravity
  damping,      ///< rate at which velocity and spin decay, 1/s
  mass,         ///< factor on every mass; inertia stays
  inertia,      ///< factor on every moment of inertia
  size,         ///< factor on every length of every shape; inertia stays
  offset,       ///< added to every plane's offset, m
};
/// As command lines name them, in their order.
inline constexpr std::array unknown_names{"restitution", "friction", "gravity", "damping",
                                          "mass",        "inertia",  "size",    "offset"};
/// As command lines name it.
inline const char* name(Unknown u) { return unknown_names[static_cast<std::size_t>(u)]; }

/// Numbers that stand in for those of a trajectory set; where there is none, the set's own holds.
class WorldNumbers {
 public:
  /// The number; none where the set's own holds.
  /// @{
  std::optional<double>& operator[](Unknown u) { return number_[static_cast<std::size_t>(u)]; }
  const std::optional<double>& operator[](Unknown u) const { return number_[static_cast<std::size_t>(u)]; }
  /// @}

  /// A scene's bodies, and the set's planes.
  SceneSystem system(const TrajectorySet& set, const Trajectory& scene) const {
    return {bodies(scene), planes(set)};
  }
  /// What acts on a scene's bodies between their contacts.
  SceneForces forces(const TrajectorySet& set, const Trajectory& scene) const {
    return {{gravity(set)}, resistance(set), {scene.wrenches()}};
  }
  /// The same trajectories in the world of these numbers, to learn in.
  TrajectorySet world_of(const TrajectorySet& set) const {
    std::vector<Trajectory> scenes;
    for (const Trajectory& scene : set) scenes.emplace_back(bodies(scene), scene.states(), scene.wrenches());
    return {set.frame_time(), gravity(set), planes(set), std::move(scenes), resistance(set)};
  }

 private:
  std::vector<Body<double>> bodies(const Trajectory& scene) const {
    std::vector<Body<double>> all;
    for (int i = 0; i < scene.bodies(); ++i) all.push_back(body(scene.body(i)));
    return all;
  }
  std::vector<Plane<double>> planes(const TrajectorySet& set) const {
    std::vector<Plane<double>> all = set.planes();
    for (Plane<double>& plane : all) {
      plane.material = material(plane.material);
      plane.offset += (*this)[Unknown::offset].value_or(0);
    }
    return all;
  }
  Vec3<double> gravity(const TrajectorySet& set) const {
    const Vec3<double>& g = set.gravity();
    if (const auto& strength = (*this)[Unknown::gravity]) return (*strength / norm(g)) * g;
    return g;
  }
  Resistance resistance(const TrajectorySet& set) const {
    Resistance all = set.resistance();
    if (const auto& rate = (*this)[Unknown::damping]) all.damping = {*rate, *rate};
    return all;
  }
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

/// Takes the bodies of one scene from frame to frame, with discrete contacts. Not copied: its parts know one
/// another's places.
class SceneSimulator {
 public:
  /// What is not in `numbers` is as in the set, of which the scene is one. Throws Error for numbers that no
  /// world has.
  SceneSimulator(const TrajectorySet& set, const Trajectory& scene, const WorldNumbers& numbers,
                 const SceneStep& step)
      : system_(numbers.system(set, scene)),
        forces_(numbers.forces(set, scene)),
        step_(step),
        h_(set.frame_time() / step.steps),
        contacts_(system_) {
    before_.body.reserve(static_cast<std::size_t>(scene.bodies()));
  }
  SceneSimulator(const SceneSimulator&) = delete;
  SceneSimulator& operator=(const SceneSimulator&) = delete;

  /// One frame on. Allocates nothing. A template, so that only programs that call it compile the contacts.
  template <std::same_as<SceneState> State>
  void operator()(State& state) {
    // The mean over the last step of a frame is ahead of that over the whole frame by what gravity adds.
    const Vec3<double> ahead = step_.velocity == SceneStep::Velocity::mean
                                   ? (0.5 * h_ * (step_.steps - 1)) * forces_.gravity.g
                                   : Vec3<double>{};
    add_velocity(state, ahead);
    for (int k = 0; k < step_.steps; ++k) {
      before_ = state;
      detail::fly_on(step_.velocity, system_, forces_, state, h_);
      contacts_.resolve(before_, state, h_, SimulationOptions{}.rest_speed, tally_);
    }
    add_velocity(state, -ahead);
  }

 private:
  void add_velocity(SceneState& state, const Vec3<double>& change) const {
    if (step_.steps == 1) return;
    for (int i = 0; i < system_.size(); ++i)
      if (!system_[i].is_kinematic()) state[i].velocity += change;
  }

  SceneSystem system_;
  SceneForces forces_;
  SceneStep step_;
  double h_;  ///< s
  detail::DiscreteContact<SceneSystem> contacts_;
  SceneState before_;
  ContactTally<double> tally_;
};

}  // namespace rbres::RBRES_ABI
