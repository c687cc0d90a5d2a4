// Trains and measures one unit of the plan.
#pragma once

#include <rbres/io/contact_law.hpp>

#include "../common/progress.hpp"
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

/// Trains by the unit's protocol, saves the predictor, and measures it. A checkpoint every few seconds; with
/// it goes the curve so far, which may be an epoch ahead.
template <Architecture A, BodySet Set>
Json train_unit(const Unit& unit, const Bench<Set>& bench) {
  using Clock = std::chrono::steady_clock;
  const auto since = [](Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
  };
  const std::string part = name(unit, bench.plan);
  PredictorOf<A> predictor{typename NetworkOf<A>::type(unit.seed), {}, {}, free_flow<Set>(), unit.target};
  const Eigen::Index n = unit.protocol.scenarios, tenth = n / 10;
  const TrainingSet<PredictorOf<A>> set(predictor, ScenarioTransitions(bench.data, unit.horizon), 2 * tenth,
                                        n);
  Trainer trainer(predictor.network, set.samples(2 * tenth, n - 2 * tenth), set.samples(tenth, tenth),
                  {.epochs = unit.protocol.epochs, .seed = unit.seed});
  const auto checkpoint = bench.store.beside(part, ".checkpoint");
  const auto curve_file = bench.store.beside(part, ".curve");
  const Metadata made_from{{"unit", part}, {"made_from", bench.made_from().dump()}};
  Json curve = Json::array();  // [epoch, training loss, validation loss, seconds so far] of each epoch
  if (std::filesystem::exists(checkpoint)) {
    load_checkpoint(checkpoint, trainer, made_from);
    curve = Store::read(curve_file);
    while (curve.size() > trainer.state().progress.epoch) curve.erase(curve.size() - 1);
  }

  const double before = curve.empty() ? 0.0 : curve.back()[3].get<double>();
  const auto start = Clock::now();
  auto saved = start;
  ProgressLine line;
  trainer.train([&](const EpochReport& r) {
    curve.push_back({r.epoch, r.train_loss, r.validation_loss, before + since(start)});
    print_progress(line, r);
    if (since(saved) > 4) {
      write_text(curve_file, curve.dump());
      save_checkpoint(checkpoint, trainer, made_from);
      saved = Clock::now();
    }
    return true;
  });
  line.end();
  if (trainer.state().progress.status == TrainingStatus::diverged)
    std::printf("  the loss became infinite: the weights before that are kept\n");
  predictor.network = trainer.best();
  save(bench.store.model(part), predictor,
       {{"world", std::string(rbres::name(unit.world))},
        {"set", std::string(rbres::name(Set))},
        {"scenarios", std::string(scenario_version)}});
  const Eigen::MatrixXd predicted =
      predict_all(ScenarioTransitions(bench.data, unit.horizon), 0, bench.tests, predictor);
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
Json learn_contacts_of(const Bench<Set>& bench, const LawUnit& unit) {
  const auto start = std::chrono::steady_clock::now();
  const std::string part = name(unit);
  const LawProtocol& protocol = bench.plan.law;
  std::printf("\n%s: %s, seed %d, from %d scenarios of 2 s\n", bench.label().c_str(), name(Kind).c_str(),
              static_cast<int>(unit.seed), protocol.scenarios);
  ProgressLine line;
  const auto say = [&](const ContactLearningReport& r) {
    const double done = r.share_done;
    const double so_far = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    char text[200];
    std::snprintf(text, sizeof text,
                  "stage %d of 3, epoch %2d/%d   training loss %7.4f   validation loss %7.4f   %s left",
                  r.stage + 1, static_cast<int>(r.epoch.epoch), r.epoch.epochs, r.epoch.train_loss,
                  r.epoch.validation_loss, clock_text(so_far * (1 / done - 1)).c_str());
    line.print(done, text);
  };
  const auto law = LawScenario<Kind, Set>::learn(bench.world, protocol, unit.seed,
                                                 bench.store.beside(part, ".checkpoint"), say);
  line.end();
  save(bench.store.model(part), law,
       {{"world", std::string(rbres::name(bench.world))},
        {"set", std::string(rbres::name(Set))},
        {"scenarios", std::string(scenario_version)}});
  Json found;
  for (std::size_t h = 0; h < bench.plan.horizons.size(); ++h) {
    const LawScenario<Kind, Set> predict{bench.world, &law, bench.plan.horizons[h]};
    found[std::to_string(h)] = bench.method(h, predict);
  }
  found["seconds"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return found;
}
template <BodySet Set>
Json learn_contacts_of(const Bench<Set>& bench, const LawUnit& unit) {
  return with_law(unit.kind, [&](auto kind) { return learn_contacts_of<kind()>(bench, unit); });
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

template <BodySet Set>
Json train_unit(const Unit& unit, const Bench<Set>& bench) {
  return with_architecture(unit.architecture, [&](auto a) { return train_unit<a()>(unit, bench); });
}

}  // namespace paper
