// One training: its model, and how good it is.
#pragma once

#include <cmath>

#include "data.hpp"
#include "own_run.hpp"
#include "training.hpp"

namespace train {

inline void print_row(const char* method, const Metrics& m) {
  std::printf("  %-18s %12.4g %12.4g %12.4g %12.4g %10.3f %8.3f\n", method, m.position, m.orientation,
              m.velocity, m.angular_velocity, m.angle, 100 * m.energy);
}

template <Architecture A, BodySet Set>
PredictorOf<A> first_predictor(const Options& o) {
  using Network = typename paper::NetworkOf<A>::type;
  if (o.start.empty()) return {Network(o.training.seed), {}, {}, free_flow<Set>(), o.target};
  auto predictor = load<PredictorOf<A>>(o.start);
  if (predictor.target != o.target)
    detail::refuse("--start: " + o.start, "a model of the --target that is asked for", "the other");
  return predictor;
}

template <Architecture A, BodySet Set>
void train(const Options& o, PredictorOf<A> predictor, const ScenarioData& data, Outputs& files) {
  // Scenarios 0 ... tenth - 1 are the test set, those up to 2 tenth validate.
  const Eigen::Index n = data.count(), tenth = n / 10;
  const TrainingSet<PredictorOf<A>> set(predictor, ScenarioTransitions(data, 0), 2 * tenth, n,
                                        o.training.threads,
                                        o.start.empty() ? Normalization::fit : Normalization::keep);
  Metadata made_from = metadata(o);
  made_from["data"] = Json{{"scenarios", n},
                           {"horizon", o.horizon},
                           {"target", o.target == Target::state ? "state" : "residual"},
                           {"truth_step", TruthOptions{}.step}}
                          .dump();
  std::printf("%s, %s, %g s ahead: %ld scenarios to train on, %ld to validate, %ld to test\n",
              paper::name(A).c_str(), paper::name(o.target).c_str(), o.horizon,
              static_cast<long>(n - 2 * tenth), static_cast<long>(tenth), static_cast<long>(tenth));
  auto trained = train_network(o, std::move(predictor.network), set.samples(2 * tenth, n - 2 * tenth),
                               set.samples(tenth, tenth), made_from);
  predictor.network = std::move(trained.network);
  if (trained.progress.best_epoch > 0) save_model(files.model, predictor, metadata(o));
  say_end(trained.progress);

  const auto error = [&](const auto& predict) {
    const ScenarioTransitions transitions(data, 0);
    return measure(transitions, 0, predict_all(transitions, 0, tenth, predict, o.training.threads),
                   scenario_system<Set, 5>(o.world));
  };
  const Metrics model = error(predictor);
  using Whole = typename PredictorOf<A>::Network;
  using Half = Network<float, typename Whole::Architecture, bfloat16>;
  const Metrics half = error(Predictor<Half, 5>{Half(predictor.network), predictor.input, predictor.output,
                                                predictor.flow, predictor.target, predictor.horizon});
  const Metrics flow = error(ContactFree{free_flow<Set>(), o.horizon});
  for (const double x :
       {model.position, model.orientation, model.velocity, model.angular_velocity, model.angle, model.energy})
    if (!std::isfinite(x))
      throw Error("the model " + o.out + " predicts numbers that are not finite for the test scenarios");
  std::printf("%g s ahead, %ld test scenarios, mean square errors per component\n", o.horizon,
              static_cast<long>(tenth));
  std::printf("  %-18s %12s %12s %12s %12s %10s %8s\n", "", "position", "orientation", "velocity",
              "ang. vel.", "angle deg", "ECE %");
  print_row("model", model);
  print_row("model, bfloat16", half);
  print_row("contact-free flow", flow);
  finish(o, files,
         {{"model", paper::to_json(model)},
          {"model, bfloat16", paper::to_json(half)},
          {"contact-free flow", paper::to_json(flow)},
          {"test_scenarios", tenth}},
         trained);
}

template <BodySet Set, Architecture A>
void run_scenarios(const Options& o, Outputs& files) {
  auto predictor = first_predictor<A, Set>(o);
  train<A, Set>(o, std::move(predictor), data_of<Set>(o), files);
}

inline void run(const Options& o) {
  Outputs files = open_files(o);
  paper::with_architecture(o.architecture, [&](auto a) {
    using Network = typename paper::NetworkOf<a()>::type;
    constexpr std::size_t metadata_bytes = 1 << 20;
    files.model.reserve(Network::parameter_count * sizeof(float) + metadata_bytes);
    if (!o.inputs.empty())
      run_own<Network>(o, files);
    else if (o.set == BodySet::standard)
      run_scenarios<BodySet::standard, a()>(o, files);
    else
      run_scenarios<BodySet::box, a()>(o, files);
  });
}

}  // namespace train
