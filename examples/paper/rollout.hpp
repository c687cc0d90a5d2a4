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

/// Mean square errors of position and velocity against time, for the trained residual network, RK4 with
/// discrete contacts and the contact-free flow, each taken from its own last state.
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
  const auto body = scenario_body<Set>();
  const auto follow = [&](const std::string& method, const auto& predict) {
    ScenarioData now = truth;  // `initial` is where this method is
    for (std::size_t k = 0; k < times.size(); ++k) {
      const Eigen::MatrixXd next = predict_all(now, 0, plan.rollouts, predict);
      const Metrics m = rbres::measure(truth, k, 0, next, body.inertia(), body.mass());
      found[method]["position"].push_back(m.position);
      found[method]["velocity"].push_back(m.velocity);
      now.initial = next.cast<float>();
    }
  };
  follow("residual network",
         [&](const auto& s, const auto& w, int present) { return predictor.predict(s, w, present); });
  follow("contact-free flow", ContactFree{free_flow<Set>(), step});
  for (const int ms : Bench<Set>::rk4_steps) {
    follow(Bench<Set>::rk4_name(ms),
           Simulated<Set>{bench.world,
                          {.step = ms * 1e-3, .duration = step, .contacts = ContactMode::discrete}});
  }
  return found;
}

}  // namespace paper
