// Rolls predictors out: predictions of predictions, beside the truth.
#pragma once

#include "training.hpp"

namespace paper {

/// The network that is rolled out: the residual one of plan.rollout_horizon.
inline const Unit& rolled_out(const Plan& plan, World world, BodySet set) {
  for (const Unit& unit : plan.units) {
    const bool fits = unit.world == world && unit.set == set && unit.horizon == plan.rollout_horizon &&
                      unit.target == Target::residual && unit.seed == 1;
    if (fits && unit.architecture == Architecture::residual4) return unit;
  }
  throw Error("the plan trains no network to roll out");
}

/// Mean square errors of position and velocity against time, of predictions of predictions by the trained
/// residual network, and of runs of the learned contacts, the contact-free flow and RK4 with discrete
/// contacts.
template <BodySet Set>
Json roll_out(const Bench<Set>& bench) {
  const Plan& plan = bench.plan;
  const double step = plan.horizons[plan.rollout_horizon];
  const int steps = static_cast<int>(std::lround(plan.rollout_seconds / step));
  const auto predictor = load<PredictorOf<Architecture::residual4>>(
      bench.store.model(name(rolled_out(plan, bench.world, Set), plan)));

  std::vector<double> times;
  for (int k = 1; k <= steps; ++k) times.push_back(std::round(k * step * 50) / 50);
  std::printf("\n%s: rolling %d scenarios out to %g s, %g s at a time\n", bench.label().c_str(),
              plan.rollouts, plan.rollout_seconds, step);
  const ScenarioData truth = generate(bench.sampler(), 0, plan.rollouts, times);
  Json found{{"time", times}};
  const auto system = scenario_system<Set, 5>(bench.world);
  const ScenarioTransitions starts(truth, 0);
  const auto follow = [&](const std::string& method, const auto& rollout) {
    std::vector<std::vector<SystemState<double, 5>>> all(static_cast<std::size_t>(plan.rollouts));
    parallel_for(plan.rollouts, 0, [&](std::ptrdiff_t c) {
      auto& states = all[static_cast<std::size_t>(c)];
      states.resize(times.size());
      rollout(starts.start(c), starts.wrench(c), states, starts.present(c));
    });
    Eigen::MatrixXd at(65, plan.rollouts);
    for (std::size_t k = 0; k < times.size(); ++k) {
      for (Eigen::Index c = 0; c < at.cols(); ++c) at.col(c) = all[static_cast<std::size_t>(c)][k].vector();
      const Metrics m = rbres::measure(ScenarioTransitions(truth, k), 0, at, system);
      found[method]["position"].push_back(m.position);
      found[method]["velocity"].push_back(m.velocity);
    }
  };
  follow("residual network", [&](const auto& y, const auto& wrench, auto& states, int present) {
    predictor.rollout(y, wrench, states, present);
  });
  for_laws(plan, bench.world, Set, 1, [&](const LawUnit& unit) {
    with_law(unit.kind, [&](auto kind) {
      const auto law = load<LawOf<kind()>>(bench.store.model(name(unit)));
      follow(name(unit.kind), [&](const auto& y, const auto& wrench, auto& states, int present) {
        LawScenario<kind(), Set>{bench.world, &law, step}.rollout(y, wrench, states, present);
      });
    });
  });
  follow("contact-free flow", [&](auto y, const auto& wrench, auto& states, int present) {
    const ContactFree flow{free_flow<Set>(), step};
    for (auto& next : states) next = y = flow(y, wrench, present);
  });
  for (const int ms : Bench<Set>::rk4_steps) {
    const SimulatedScenario<Set> simulated{
        bench.world, {.step = ms * 1e-3, .duration = step, .contacts = ContactMode::discrete}};
    follow(Bench<Set>::rk4_name(ms), [&](const auto& y, const auto& wrench, auto& states, int present) {
      simulated.rollout(y, wrench, states, present);
    });
  }
  return found;
}

}  // namespace paper
