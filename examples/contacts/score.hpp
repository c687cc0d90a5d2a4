// How far a predictor is from the scenes of a set, and how long it takes.
#pragma once

#include <chrono>
#include <rbres/core/lie.hpp>
#include <string>
#include <vector>

#include "../common/scenes.hpp"

namespace rbres::contacts_program {

/// Mean errors over scenes and bodies, so many frames after the first.
struct Row {
  std::string predictor;
  int frames = 0;
  double seconds_ahead = 0;
  double position = 0;  ///< m
  double rotation = 0;  ///< rad
  double us_per_frame = 0;
};

inline std::vector<int> horizons(const TrajectorySet& set) {
  int longest = 0;
  for (const Trajectory& scene : set) longest = std::max(longest, scene.frames() - 1);
  std::vector<int> all;
  for (const int frames : {5, 10, 25, 50, 100, 150})
    if (frames <= longest) all.push_back(frames);
  return all;
}

/// Sums of errors at the horizons over a scene's bodies; false where a state is not finite.
template <class Step>
bool add_scene(const Trajectory& scene, Step&& step, const std::vector<int>& frames, std::vector<Row>& sums) {
  const auto start = scene.frame(0);
  SceneState state{{start.begin(), start.end()}};
  std::vector<Row> own(frames.size());
  for (int t = 1; t <= std::min(frames.back(), scene.frames() - 1); ++t) {
    step(state);
    for (const auto& body : state.body)
      if (!body.vector().allFinite()) return false;
    for (std::size_t k = 0; k < frames.size(); ++k) {
      if (frames[k] != t) continue;
      for (int i = 0; i < scene.bodies(); ++i) {
        const auto &found = state[i], &truth = scene.state(t, i);
        own[k].position += norm(found.position - truth.position);
        own[k].rotation += norm(quaternion_log(truth.orientation.conjugate() * found.orientation));
      }
    }
  }
  for (std::size_t k = 0; k < frames.size(); ++k) {
    sums[k].position += own[k].position;
    sums[k].rotation += own[k].rotation;
  }
  return true;
}

/// One row for each horizon that the set has. `make(scene)` gives what takes a state from frame to frame. A
/// scene that it refuses, or that it takes to states that are not finite, counts as free flight; `failed` is
/// how many.
template <class Make>
std::vector<Row> score(const std::string& name, const TrajectorySet& set, const Make& make, int& failed) {
  const std::vector<int> frames = horizons(set);
  std::vector<Row> rows(frames.size());
  std::vector<long> bodies(frames.size(), 0);
  failed = 0;
  long stepped = 0;
  double seconds = 0;
  for (const Trajectory& scene : set) {
    const auto begin = std::chrono::steady_clock::now();
    bool good = false;
    try {
      good = frames.empty() || add_scene(scene, make(scene), frames, rows);
    } catch (const Error&) {
    }
    seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (!good) {
      ++failed;
      add_scene(scene, FreeFlight(set, scene, SceneStep::Velocity::instant), frames, rows);
    }
    for (std::size_t k = 0; k < frames.size(); ++k)
      if (frames[k] < scene.frames()) bodies[k] += scene.bodies();
    stepped += frames.empty() ? 0 : std::min(frames.back(), scene.frames() - 1);
  }
  for (std::size_t k = 0; k < frames.size(); ++k) {
    rows[k].predictor = name;
    rows[k].frames = frames[k];
    rows[k].seconds_ahead = frames[k] * set.frame_time();
    rows[k].position /= static_cast<double>(bodies[k]);
    rows[k].rotation /= static_cast<double>(bodies[k]);
    rows[k].us_per_frame = 1e6 * seconds / static_cast<double>(stepped);
  }
  return rows;
}

/// The mean position error of some rows, m.
inline double mean_position(const std::vector<Row>& rows) {
  double sum = 0;
  for (const Row& row : rows) sum += row.position;
  return sum / static_cast<double>(rows.size());
}

}  // namespace rbres::contacts_program
