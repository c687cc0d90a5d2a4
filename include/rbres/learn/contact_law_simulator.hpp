#pragma once

#include <rbres/dynamics/free_flight.hpp>
#include <rbres/learn/contact_law.hpp>
#include <rbres/learn/scene_system.hpp>

#include <span>
#include <utility>
#include <vector>

namespace rbres {

/// Takes the bodies of one scene from frame to frame by a learned contact law, which must outlive it.
template <class Law>
class ContactLawSimulator {
 public:
  /// The scene is one of the set. Throws Error where the set's frame time is not the law's.
  ContactLawSimulator(const TrajectorySet& set, const Trajectory& scene, const Law& law)
      : law_(&law),
        bodies_(&scene.body(0), static_cast<std::size_t>(scene.bodies())),
        system_({bodies_.begin(), bodies_.end()}, set.planes()),
        gravity_{set.gravity()},
        workspace_(bodies_.size(), set.planes().size()) {
    law.check_step(set.frame_time());
    start_.reserve(bodies_.size());
  }

  /// One frame on. Allocates nothing.
  void operator()(SceneState& state) noexcept {
    start_.assign(state.body.begin(), state.body.end());
    fly_on(system_, gravity_, Rk4{}, state, 0.0, law_->scales.frame_time);
    law_->respond(bodies_, std::span<const Plane<double>>(system_.planes()),
                  std::span<const RigidState<double>>(start_), std::span<RigidState<double>>(state.body),
                  workspace_);
  }

 private:
  const Law* law_;
  std::span<const Body<double>> bodies_;
  SceneSystem system_;
  Gravity<double> gravity_;
  typename Law::Workspace workspace_;
  std::vector<RigidState<double>> start_;
};

}  // namespace rbres
