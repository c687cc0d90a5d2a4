// Trains and measures the units of the plan.
#pragma once

#include <rbres/io/contact_law.hpp>

#include "contact_law.hpp"
#include "measure.hpp"

namespace paper {

template <Architecture A>
struct NetworkOf;
template <>
struct NetworkOf<Architecture::residual10> {
  using type = ResidualNetwork<float, 95, 256, 10, 65>;
};
template <>
struct NetworkOf<Architecture::residual4> {
  using type = ResidualNetwork<float, 95, 256, 4, 65>;
};
template <>
struct NetworkOf<Architecture::forward4> {
  using type = FeedForwardNetwork<float, 95, 256, 4, 65>;
};
template <>
struct NetworkOf<Architecture::shallow> {
  using type = Network<float, Sequential<Linear<95, 256>, Relu, Linear<256, 256>, Relu, Linear<256, 65>>>;
};

template <Architecture A>
using PredictorOf = Predictor<typename NetworkOf<A>::type, 5>;

/// Trains by the unit's protocol, saves the predictor, and measures it. With a checkpoint goes the curve so
/// far, which may be an epoch ahead.
template <Architecture A, BodySet Set>
Json train_unit(const Unit& unit, const Bench<Set>& bench, const UnitRun& run) {
  using Clock = std::chrono::steady_clock;
  const std::string part = name(unit, bench.plan);
  PredictorOf<A> predictor{typename NetworkOf<A>::type(unit.seed), {}, {}, free_flow<Set>(), unit.target};
  const Eigen::Index n = unit.protocol.scenarios, tenth = n / 10;
  const ScenarioTransitions transitions(bench.data, unit.horizon);
  const TrainingSet<PredictorOf<A>> set(predictor, transitions, 2 * tenth, n, run.threads);
  Trainer trainer(predictor.network, set.samples(2 * tenth, n - 2 * tenth), set.samples(tenth, tenth),
                  {.epochs = unit.protocol.epochs, .seed = unit.seed, .threads = run.threads});
  const auto checkpoint = bench.store.beside(part, ".checkpoint");
  const auto curve_file = bench.store.beside(part, ".curve");
  const Metadata made_from{{"unit", part}, {"made_from", bench.made_from().dump()}};
  Json curve = Json::array();  // [epoch, training loss, validation loss, seconds so far] of each epoch
  if (std::filesystem::exists(checkpoint)) {
    load_checkpoint(checkpoint, trainer, made_from);
    curve = Store::read(curve_file);
    while (curve.size() > trainer.state().progress.epoch) curve.erase(curve.size() - 1);
  }
  const auto advance = [&](std::uint64_t epoch) {
    run.advance(static_cast<double>(epoch) / unit.protocol.epochs);
  };
  advance(trainer.state().progress.epoch);

  const double before = curve.empty() ? 0.0 : curve.back()[3].get<double>();
  const auto start = Clock::now();
  Every checkpoints(run.checkpoint_every);
  trainer.train([&](const EpochReport& r) {
    const double seconds = before + std::chrono::duration<double>(Clock::now() - start).count();
    curve.push_back({r.epoch, r.train_loss, r.validation_loss, seconds});
    if (checkpoints.due()) {
      write_text(curve_file, curve.dump());
      save_checkpoint(checkpoint, trainer, made_from);
    }
    advance(r.epoch);
    return true;
  });
  if (trainer.state().progress.status == TrainingStatus::diverged)
    run.progress.say(part + ": the loss became infinite: the weights before that are kept");
  predictor.network = trainer.best();
  save(bench.store.model(part), predictor,
       {{"world", std::string(rbres::name(unit.world))},
        {"set", std::string(rbres::name(Set))},
        {"scenarios", std::string(scenario_version)}});
  const Eigen::MatrixXd predicted = predict_all(transitions, 0, bench.tests, predictor, run.threads);
  Json found = bench.accuracy(unit.horizon, predicted);
  if (unit.horizon == bench.plan.figure_horizon)
    found["velocity_pairs"] = bench.velocity_pairs(unit.horizon, predicted);
  found["horizon"] = bench.plan.horizons[unit.horizon];
  found["best_validation_loss"] = trainer.state().progress.best_loss;
  found["epochs"] = trainer.state().progress.epoch;
  found["curve"] = curve;
  return found;
}

/// Learns a contact law and measures it at all horizons.
template <LawKind Kind, BodySet Set>
Json learn_contacts_of(const LawUnit& unit, const Bench<Set>& bench, const UnitRun& run) {
  const auto start = std::chrono::steady_clock::now();
  const std::string part = name(unit);
  const auto law = LawScenario<Kind, Set>::learn(bench.world, bench.plan.law, unit.seed,
                                                 bench.store.beside(part, ".checkpoint"), run);
  save(bench.store.model(part), law,
       {{"world", std::string(rbres::name(bench.world))},
        {"set", std::string(rbres::name(Set))},
        {"scenarios", std::string(scenario_version)}});
  Json found;
  for (std::size_t h = 0; h < bench.plan.horizons.size(); ++h) {
    const LawScenario<Kind, Set> predict{bench.world, &law, bench.plan.horizons[h]};
    found[std::to_string(h)] = bench.method(h, predict, run.threads);
  }
  found["seconds"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return found;
}

/// Checkpoint and curve of a unit that is finished.
inline void remove_checkpoint(const Store& store, const std::string& part) {
  std::filesystem::remove(store.beside(part, ".checkpoint"));
  std::filesystem::remove(store.beside(part, ".curve"));
}

/// Calls with(std::integral_constant<Architecture, A>).
template <class With>
auto with_architecture(Architecture a, const With& with) {
  using enum Architecture;
  switch (a) {
    case residual10:
      return with(std::integral_constant<Architecture, residual10>{});
    case residual4:
      return with(std::integral_constant<Architecture, residual4>{});
    case forward4:
      return with(std::integral_constant<Architecture, forward4>{});
    default:
      return with(std::integral_constant<Architecture, shallow>{});
  }
}

/// Trains and measures a network or a contact law.
/// @{
template <BodySet Set>
Json train(const Unit& unit, const Bench<Set>& bench, const UnitRun& run) {
  return with_architecture(unit.architecture, [&](auto a) { return train_unit<a()>(unit, bench, run); });
}
template <BodySet Set>
Json train(const LawUnit& unit, const Bench<Set>& bench, const UnitRun& run) {
  return with_law(unit.kind, [&](auto kind) { return learn_contacts_of<kind()>(unit, bench, run); });
}
/// @}

}  // namespace paper
