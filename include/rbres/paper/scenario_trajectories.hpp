#pragma once

#include <rbres/learn/trajectory.hpp>
#include <rbres/paper/scenario_transitions.hpp>

#include <cmath>
#include <span>
#include <vector>

namespace rbres::RBRES_ABI {

/// Truth of scenarios first ... first + count - 1 of a sampler as trajectories with their wrenches, in the
/// sampler's world, for contact laws to learn from: a frame each `frame_time` (s), a whole number of truth's
/// steps, for `duration` (s). Throws Error as generate() does.
template <BodySet Set>
TrajectorySet scenario_trajectories(const ScenarioSampler<Set>& sampler, std::uint64_t first,
                                    Eigen::Index count, double frame_time, double duration,
                                    TruthOptions options = {}) {
  options.sample_rate = 1 / frame_time;
  std::vector<double> times;
  for (long k = 1; k <= std::lround(duration / frame_time); ++k)
    times.push_back(static_cast<double>(k) * frame_time);
  const ScenarioData data = generate(sampler, first, count, times, options);
  const Body<double, ShapeOf<Set>> own = scenario_body<Set>();
  const Body<double> body(own.shape(), own.mass(), own.inertia(), own.material());
  std::vector<Trajectory> scenes;
  for (Eigen::Index c = 0; c < data.count(); ++c) {
    const auto present = static_cast<std::size_t>(data.body_count[static_cast<std::size_t>(c)]);
    std::vector<RigidState<double>> states;
    const auto add = [&](const auto& columns) {
      const auto all = state_of(columns, c, static_cast<int>(present));
      states.insert(states.end(), all.body.begin(), all.body.begin() + static_cast<long>(present));
    };
    add(data.initial);
    for (const auto& columns : data.states) add(columns);
    const auto wrenches = wrench_of(data, c);
    scenes.emplace_back(std::vector(present, body), std::move(states),
                        std::vector(wrenches.begin(), wrenches.begin() + static_cast<long>(present)));
  }
  const auto [gravity, friction, damping] = scenario_forces<Set>().models;
  return {frame_time, gravity.g, scenario_system<Set, 1>(sampler.world()).planes(), std::move(scenes),
          Resistance{friction, damping}};
}

}  // namespace rbres::RBRES_ABI
