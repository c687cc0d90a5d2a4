// Times every method of one world and set side by side.
#pragma once

#include <memory>

#include "training.hpp"

namespace paper {

/// Predicts for `count` scenarios, those of the data over and over, as one batch through the network.
template <class P>
TimedCall as_batch(const ScenarioTransitions& data, std::shared_ptr<const P> predictor, Eigen::Index count) {
  using Columns = typename P::Network::Columns;
  struct Scratch {
    Columns inputs, outputs;
    typename P::Network::Workspace workspace;
  };
  auto scratch = std::make_shared<Scratch>();
  scratch->inputs.resize(P::Code::inputs, count);
  scratch->outputs.resize(P::Code::outputs, count);
  const auto run = [&data, predictor, count, scratch] {
    const auto each = [&](const auto& act) {
      for (Eigen::Index c = 0; c < count; ++c) {
        const Eigen::Index from = c % data.count();
        act(c, data.start(from), data.wrench(from), data.present(from));
      }
    };
    each([&](Eigen::Index c, const auto& state, const auto& wrench, int present) {
      scratch->inputs.col(c) = predictor->encode(state, wrench, present);
    });
    predictor->network.forward(scratch->inputs, scratch->outputs, scratch->workspace);
    double sum = 0;
    each([&](Eigen::Index c, const auto& state, const auto& wrench, int present) {
      sum += predictor->decode(state, wrench, scratch->outputs.col(c), present)[0].position.x;
    });
    volatile double keep = sum;  // or the work might be left out
    static_cast<void>(keep);
  };
  return {run, static_cast<double>(count)};
}

/// Microseconds per scenario on one thread of every method at every horizon: one scenario at a time ("us"),
/// and many at a time ("batch_us"): networks 256, RK4 one in each lane of a register. Measured in this run,
/// after all accuracy.
template <BodySet Set>
Json time_methods(const Bench<Set>& bench) {
  const Plan& plan = bench.plan;
  const ScenarioData data = generate(bench.sampler(), 0, plan.timed_scenarios, {plan.horizons.front()});
  const ScenarioTransitions transitions(data, 0);
  std::vector<Scenario> scenarios;
  for (int i = 0; i < plan.timed_scenarios; ++i)
    scenarios.push_back(bench.sampler()(static_cast<std::uint64_t>(i)));
  Json all;
  ProgressLine line;
  for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
    line.print(static_cast<double>(h) / static_cast<double>(plan.horizons.size()),
               detail::text(bench.label(), ": timing every method at ", plan.horizons[h], " s"));
    std::vector<std::pair<std::string, std::string>> names;  // method, kind
    std::vector<TimedCall> calls;
    bench.baselines_at(h, [&](const std::string& method, const auto& predict) {
      names.emplace_back(method, "us");
      calls.push_back(one_by_one(transitions, data.count(), predict));
      if constexpr (std::is_same_v<decltype(predict), const SimulatedScenario<Set>&>) {
        SimulationOptions options = predict.options;
        options.sample_rate = 1 / options.duration;  // only the end is looked at
        names.emplace_back(method, "batch_us");
        calls.push_back({[&, options] {
                           volatile double keep = simulate_in_lanes<Set>(bench.world, scenarios, options);
                           static_cast<void>(keep);
                         },
                         static_cast<double>(scenarios.size())});
      }
    });
    for_laws(plan, bench.world, Set, 1, [&](const LawUnit& unit) {
      with_law(unit.kind, [&](auto kind) {
        using Law = LawOf<kind()>;
        const auto law = std::make_shared<const Law>(load<Law>(bench.store.model(name(unit))));
        names.emplace_back(name(unit.kind), "us");
        calls.push_back(one_by_one(transitions, data.count(),
                                   [&, h, law](const auto& state, const auto& wrench, int present) {
                                     return LawScenario<kind(), Set>{
                                         bench.world, law.get(), plan.horizons[h]}(state, wrench, present);
                                   }));
      });
    });
    for (const Unit& unit : plan.units) {
      const bool here = unit.world == bench.world && unit.set == Set && unit.horizon == h && unit.seed == 1;
      if (!here) continue;
      with_architecture(unit.architecture, [&](auto a) {
        using P = PredictorOf<a()>;
        const auto predictor = std::make_shared<const P>(load<P>(bench.store.model(name(unit, plan))));
        names.emplace_back(method_of(unit), "us");
        calls.push_back(one_by_one(transitions, data.count(),
                                   [predictor](const auto& state, const auto& wrench, int present) {
                                     return predictor->predict(state, wrench, present);
                                   }));
        names.emplace_back(method_of(unit), "batch_us");
        calls.push_back(as_batch(transitions, predictor, 256));
      });
    }
    const std::vector<Spread> spreads = time_side_by_side(calls, plan.timing_rounds);
    for (std::size_t i = 0; i < calls.size(); ++i) {
      all[std::to_string(h)][names[i].first][names[i].second] = {
          {"median", spreads[i].median}, {"low", spreads[i].low}, {"high", spreads[i].high}};
    }
  }
  line.end();
  return all;
}

}  // namespace paper
