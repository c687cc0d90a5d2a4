#pragma once

#include <rbres/learn/hybrid_law.hpp>
#include <rbres/learn/scene_forces.hpp>
#include <rbres/learn/scene_step.hpp>
#include <rbres/learn/scene_system.hpp>

#include <utility>

namespace rbres::RBRES_ABI {

/// Takes the bodies of one scene from frame to frame by a learned contact law, alone or as a correction. Not
/// copied: it points into itself.
template <class Law>
class ContactLawSimulator {
 public:
  /// `velocity` says what the velocities of the set are, of which the scene is one. The law must outlive the
  /// simulator. Throws Error where its frame time is not the set's.
  ContactLawSimulator(const TrajectorySet& set, const Trajectory& scene, const Law& law,
                      SceneStep::Velocity velocity = SceneStep::Velocity::instant)
      : ContactLawSimulator(scene_system(set, scene), scene_forces(set, scene), law, velocity,
                            set.frame_time()) {}
  /// The same for bodies of no set, by the law's own frame time.
  ContactLawSimulator(SceneSystem system, SceneForces forces, const Law& law,
                      SceneStep::Velocity velocity = SceneStep::Velocity::instant)
      : ContactLawSimulator(std::move(system), std::move(forces), law, velocity, law.scales.frame_time) {}
  ContactLawSimulator(const ContactLawSimulator&) = delete;
  ContactLawSimulator& operator=(const ContactLawSimulator&) = delete;

  /// One frame on. Allocates nothing.
  void operator()(SceneState& state) noexcept {
    if (velocity_ == SceneStep::Velocity::mean) {
      step_.step(forces_, SemiImplicitEuler{}, state, 0.0, h_, none_, tally_);
    } else {
      step_.step(forces_, Rk4{}, state, 0.0, h_, none_, tally_);
    }
  }

 private:
  struct NoObserver {};

  ContactLawSimulator(SceneSystem system, SceneForces forces, const Law& law, SceneStep::Velocity velocity,
                      double frame_time)
      : system_(std::move(system)),
        forces_(std::move(forces)),
        velocity_(velocity),
        h_(frame_time),
        step_(law, system_, {.step = h_}) {}

  SceneSystem system_;
  SceneForces forces_;
  SceneStep::Velocity velocity_;
  double h_;  ///< s
  typename Law::template Step<SceneSystem> step_;
  NoObserver none_;
  ContactTally<double> tally_;
};

}  // namespace rbres::RBRES_ABI
