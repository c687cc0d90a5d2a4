// Trains and measures one unit of the plan.
#pragma once

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

inline std::string clock_text(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%d:%02d", static_cast<int>(seconds) / 60, static_cast<int>(seconds) % 60);
  return text;
}

/// Trains by the unit's protocol, with a checkpoint after every epoch, saves the predictor, and measures it.
template <Architecture A, BodySet Set>
Json train_unit(const Unit& unit, const Bench<Set>& bench) {
  const std::string part = name(unit, bench.plan);
  PredictorOf<A> predictor{typename NetworkOf<A>::type(unit.seed), {}, {}, free_flow<Set>(), unit.target};
  const Eigen::Index n = unit.protocol.scenarios, tenth = n / 10;
  const TrainingSet<PredictorOf<A>> set(predictor, bench.data, unit.horizon, 2 * tenth, n);
  Trainer trainer(predictor.network, set.samples(2 * tenth, n - 2 * tenth), set.samples(tenth, tenth),
                  {.epochs = unit.protocol.epochs, .seed = unit.seed});
  const auto checkpoint = bench.store.folder() / "parts" / (part + ".checkpoint");
  const Metadata made_from{{"unit", part}, {"scenarios", std::string(scenario_version)}};
  if (std::filesystem::exists(checkpoint)) load_checkpoint(checkpoint, trainer, made_from);

  Json curve = Json::array();
  const auto start = std::chrono::steady_clock::now();
  trainer.train([&](const EpochReport& r) {
    curve.push_back({r.epoch, r.train_loss, r.validation_loss});
    std::printf(
        "\r  epoch %3d/%d   training loss %8.4f   validation loss %8.4f (best %8.4f)   %6.0f samples/s   %s "
        "left ",
        static_cast<int>(r.epoch), r.epochs, r.train_loss, r.validation_loss, r.best_loss,
        r.samples_per_second, clock_text(r.seconds_left).c_str());
    std::fflush(stdout);
    if (unit.protocol.epochs > 50) save_checkpoint(checkpoint, trainer, made_from);
    return true;
  });
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  predictor.network = trainer.best();
  save(bench.store.model(part), predictor,
       {{"world", std::string(rbres::name(unit.world))},
        {"set", std::string(rbres::name(Set))},
        {"scenarios", std::string(scenario_version)}});
  Json found = bench.method(unit.horizon, [&](const auto& state, const auto& wrench, int present) {
    return predictor.predict(state, wrench, present);
  });
  found["horizon"] = bench.plan.horizons[unit.horizon];
  found["best_validation_loss"] = trainer.state().progress.best_loss;
  found["epochs"] = trainer.state().progress.epoch;
  found["seconds"] = seconds;
  found["curve"] = curve;
  std::filesystem::remove(checkpoint);
  std::printf("\n  position %.3g m^2   orientation %.3g   velocity %.3g   angular velocity %.3g   %.0f us\n",
              found["position"].get<double>(), found["orientation"].get<double>(),
              found["velocity"].get<double>(), found["angular_velocity"].get<double>(),
              found["us_per_scenario"].get<double>());
  return found;
}

template <BodySet Set>
Json train_unit(const Unit& unit, const Bench<Set>& bench) {
  switch (unit.architecture) {
    case Architecture::residual10:
      return train_unit<Architecture::residual10>(unit, bench);
    case Architecture::residual4:
      return train_unit<Architecture::residual4>(unit, bench);
    case Architecture::forward4:
      return train_unit<Architecture::forward4>(unit, bench);
    default:
      return train_unit<Architecture::shallow>(unit, bench);
  }
}

}  // namespace paper
