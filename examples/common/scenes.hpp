// What programs that learn from the scenes of a trajectory set share.
#pragma once

#include <algorithm>
#include <cstdio>
#include <limits>
#include <rbres/learn/identify.hpp>
#include <rbres/learn/scene_step.hpp>
#include <rbres/learn/scene_system.hpp>
#include <utility>

namespace rbres {

/// Free flight from frame to frame: contacts do nothing.
class FreeFlight {
 public:
  FreeFlight(const TrajectorySet& set, const Trajectory& scene, SceneStep::Velocity velocity)
      : system_(scene_system(set, scene)),
        forces_(scene_forces(set, scene)),
        velocity_(velocity),
        h_(set.frame_time()) {}
  void operator()(SceneState& state) { detail::fly_on(velocity_, system_, forces_, state, h_); }

 private:
  SceneSystem system_;
  SceneForces forces_;
  SceneStep::Velocity velocity_;
  double h_;
};

/// The scenes to learn from, and those that decide which model is the best: one in ten, the last.
struct Parts {
  TrajectorySet fit, choose;
  explicit Parts(const TrajectorySet& all)
      : fit(all.subset(0, all.size() - std::max(1, all.size() / 10))),
        choose(all.subset(fit.size(), all.size() - fit.size())) {}
};

/// Prints to stderr what was found, with its standard errors.
inline void print_numbers(const Identification& found) {
  for (std::size_t i = 0; i < found.unknowns.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    std::fprintf(stderr, "  %-12s %9.4f +- %.4f\n", name(found.unknowns[i]), found.value(k),
                 found.standard_error(k));
  }
}

/// The weight of a hybrid's correction with which `error(law)`, on scenes that it was not learned from, is
/// least.
template <class Law, class Error>
double best_weight(Law law, const Error& error) {
  double best = 0, least = std::numeric_limits<double>::infinity();
  for (const double weight : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    law.weight = weight;
    const double found = error(std::as_const(law));
    std::fprintf(stderr, "hybrid: correction %.2f times as strong: %.5f m\n", weight, found);
    if (!(found < least)) continue;
    best = weight;
    least = found;
  }
  return best;
}

}  // namespace rbres
