// The simulations of the paper's scenarios, which rbres_scenarios compiles once for programs and tests.
#pragma once

#include <rbres/paper/paper.hpp>

namespace paper {

using namespace rbres;

/// Simulates those scenarios that have N bodies, one in each lane of a register, on one thread. Returns what
/// depends on all of them, so that no part of the work is left out.
template <BodySet Set, int N>
double simulate_in_lanes_of(World world, const std::vector<Scenario>& all, const SimulationOptions& options) {
  std::vector<Scenario> scenarios;
  std::ranges::copy_if(all, std::back_inserter(scenarios), [](const Scenario& s) { return s.bodies == N; });
  double sum = 0;
  detail::simulate_lanes<Set, N>(
      world, std::ssize(scenarios),
      [&](std::ptrdiff_t i) -> const Scenario& { return scenarios[static_cast<std::size_t>(i)]; }, options,
      [&](const auto& sample) { sum += sample.state[0].position.x; }, 1);
  return sum;
}

template <BodySet Set>
double simulate_in_lanes(World world, const std::vector<Scenario>& all, const SimulationOptions& options) {
  return simulate_in_lanes_of<Set, 3>(world, all, options) +
         simulate_in_lanes_of<Set, 4>(world, all, options) +
         simulate_in_lanes_of<Set, 5>(world, all, options);
}

extern template double simulate_in_lanes<BodySet::standard>(World, const std::vector<Scenario>&,
                                                            const SimulationOptions&);
extern template double simulate_in_lanes<BodySet::box>(World, const std::vector<Scenario>&,
                                                       const SimulationOptions&);

}  // namespace paper

namespace rbres {

extern template void detail::generate_piece(const ScenarioSampler<BodySet::standard>&, std::uint64_t,
                                            Eigen::Index, Eigen::Index, const TruthOptions&, ScenarioData&);
extern template struct SimulatedScenario<BodySet::standard>;
extern template void detail::generate_piece(const ScenarioSampler<BodySet::box>&, std::uint64_t, Eigen::Index,
                                            Eigen::Index, const TruthOptions&, ScenarioData&);
extern template struct SimulatedScenario<BodySet::box>;

}  // namespace rbres
