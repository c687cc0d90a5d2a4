#pragma once

#include <rbres/eval/baselines.hpp>
#include <rbres/paper/scenario_data.hpp>
#include <tuple>

namespace rbres::RBRES_ABI {

/// The paper's baseline: RK4 with contacts checked at the end of each step, or the continuous simulation, of
/// those bodies of a scenario that are present. Callable as a predictor is.
template <BodySet Set>
struct SimulatedScenario {
  /// Of all bodies, present or not.
  using State = SystemState<double, ScenarioData::bodies>;
  /// One for each body.
  using Wrenches = std::array<Wrench<double>, ScenarioData::bodies>;

  World world;                ///< what is around the bodies
  SimulationOptions options;  ///< options.duration is the horizon

  /// The state `horizon` after y. Absent bodies stay. Error unless 3 to 5 are present.
  State operator()(const State& y, const Wrenches& wrench, int present) const {
    std::array<State, 1> next;
    rollout(y, wrench, next, present);
    return next[0];
  }

  /// As Simulated::rollout.
  void rollout(const State& y, const Wrenches& wrench, std::span<State> states, int present) const;

 private:
  template <int N>
  void run(const State& y, const Wrenches& wrench, std::span<State> states) const {
    const Simulated simulated{scenario_system<Set, N>(world), scenario_forces<Set>(), options};
    SystemState<double, N> part;
    std::array<Wrench<double>, std::size_t(N)> own;
    std::copy_n(y.body.begin(), N, part.body.begin());
    std::copy_n(wrench.begin(), N, own.begin());
    std::vector<SystemState<double, N>> ends(states.size());
    simulated.rollout(part, own, ends);
    for (std::size_t i = 0; i < ends.size(); ++i) {
      states[i] = y;
      std::copy_n(ends[i].body.begin(), N, states[i].body.begin());
    }
  }
};

// Not inline, so that a program may compile it once.
template <BodySet Set>
void SimulatedScenario<Set>::rollout(const State& y, const Wrenches& wrench, std::span<State> states,
                                     int present) const {
  if (present < 3 || present > 5) detail::refuse("bodies of a scenario", "3 to 5", present);
  present == 3   ? run<3>(y, wrench, states)
  : present == 4 ? run<4>(y, wrench, states)
                 : run<5>(y, wrench, states);
}

/// The contact-free flow of a set's bodies.
template <BodySet Set>
FreeFlow<ScenarioData::bodies> free_flow() {
  const Body<double> body = scenario_body<Set>();
  FreeFlow<ScenarioData::bodies> flow{System<double, ScenarioData::bodies>::of(body)};
  std::tie(flow.gravity, flow.friction, flow.damping) = scenario_forces<Set>().models;
  return flow;
}

}  // namespace rbres::RBRES_ABI
