#pragma once

#include <algorithm>
#include <rbres/core/lie.hpp>
#include <rbres/core/parallel.hpp>
#include <rbres/learn/scene_system.hpp>
#include <vector>

namespace rbres::tosses {

/// Mean errors over the frames 1, ..., 80 and the tosses of a rollout from frame 0; a toss that ends earlier
/// counts with the frames it has.
struct Score {
  double position = 0;  ///< distance of the centres, m
  double rotation = 0;  ///< angle of the rotation between, rad
};

/// `make(toss)` gives what takes a state from frame to frame.
template <class Make>
Score score(const TrajectorySet& tosses, const Make& make) {
  constexpr int frames = 80;
  const auto place = [](std::ptrdiff_t i) { return static_cast<std::size_t>(i); };
  std::vector<Score> sums(place(tosses.size()));
  parallel_for(tosses.size(), 0, [&](std::ptrdiff_t task) {
    const Trajectory& toss = tosses[static_cast<int>(task)];
    auto step = make(toss);
    SceneState state{{toss.state(0, 0)}};
    for (int t = 1; t <= frames && t < toss.frames(); ++t) {
      step(state);
      const RigidState<double>& truth = toss.state(t, 0);
      sums[place(task)].position += norm(state[0].position - truth.position);
      sums[place(task)].rotation +=
          norm(quaternion_log(truth.orientation.conjugate() * state[0].orientation));
    }
  });
  Score mean;
  long count = 0;
  for (int i = 0; i < tosses.size(); ++i) {
    mean.position += sums[place(i)].position;
    mean.rotation += sums[place(i)].rotation;
    count += std::min(frames, tosses[i].frames() - 1);
  }
  return {mean.position / static_cast<double>(count), mean.rotation / static_cast<double>(count)};
}

}  // namespace rbres::tosses
