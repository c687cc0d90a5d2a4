// One training: its model, and how good it is.
#pragma once

#include <cmath>
#include <limits>
#include <optional>

#include "data.hpp"
#include "log.hpp"
#include "outputs.hpp"

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
  const TrainingSet<PredictorOf<A>> set(predictor, data, 0, 2 * tenth, n, o.training.threads,
                                        o.start.empty() ? Normalization::fit : Normalization::keep);
  Clipped<ChosenOptimizer> optimizer;
  optimizer.method = o.method;
  optimizer.adam.weight_decay = o.method == Method::adamw ? o.weight_decay : 0;
  optimizer.sgd.momentum = o.momentum;
  optimizer.largest_norm = o.clip > 0 ? o.clip : std::numeric_limits<double>::infinity();
  Trainer trainer(predictor.network, set.samples(2 * tenth, n - 2 * tenth), set.samples(tenth, tenth),
                  o.training, optimizer);
  if (o.warm_up > 0) trainer.set_schedule(WarmUp{o.training.schedule, static_cast<std::uint64_t>(o.warm_up)});
  Metadata made_from = metadata(o);
  made_from["data"] = Json{{"scenarios", n},
                           {"horizon", o.horizon},
                           {"target", o.target == Target::state ? "state" : "residual"},
                           {"truth_step", TruthOptions{}.step}}
                          .dump();
  if (o.resume) load_checkpoint(o.checkpoint, trainer, made_from);

  std::printf("%s, %s, %g s ahead: %ld scenarios to train on, %ld to validate, %ld to test\n",
              paper::name(A).c_str(), paper::name(o.target).c_str(), o.horizon,
              static_cast<long>(n - 2 * tenth), static_cast<long>(tenth), static_cast<long>(tenth));
  if (o.resume) std::printf("  resumed after epoch %d\n", static_cast<int>(trainer.state().progress.epoch));
  std::optional<LossLog> log;
  if (!o.log.empty()) log.emplace(o.log, o.resume);
  Retried log_file, checkpoint_file;
  const auto write = [&] {
    if (log) log_file([&] { log->write(trainer.state().history); });
    if (!o.checkpoint.empty()) checkpoint_file([&] { save_checkpoint(o.checkpoint, trainer, made_from); });
  };
  write();
  const TrainingStatus status = trainer.train([&](const EpochReport& r) {
    print_progress(r);
    write();
    return true;
  });
  const TrainingProgress& done = trainer.state().progress;
  predictor.network = trainer.best();
  if (done.best_epoch > 0) save_model(files.model, predictor, metadata(o));
  if (status == TrainingStatus::diverged)
    throw Error(detail::text(
        "after epoch ", done.epoch, " the loss was no number; a smaller --learning-rate may help; ",
        done.best_epoch > 0 ? detail::text("the model is that of epoch ", done.best_epoch)
                            : "no model is saved"));
  std::printf("\n  %s after epoch %d; the best was epoch %d\n\n",
              status == TrainingStatus::early_stopped ? "stopped early" : "done",
              static_cast<int>(done.epoch), static_cast<int>(done.best_epoch));

  const auto body = scenario_body<Set>();
  const auto error = [&](const auto& predict) {
    return measure(data, 0, 0, predict_all(data, 0, tenth, predict, o.training.threads), body.inertia(),
                   body.mass());
  };
  const Metrics model = error([&](const auto& state, const auto& wrench, int present) {
    return predictor.predict(state, wrench, present);
  });
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
  print_row("contact-free flow", flow);
  if (files.table) {
    const Json found{{"model", paper::to_json(model)}, {"contact-free flow", paper::to_json(flow)},
                     {"test_scenarios", tenth},        {"epochs", done.epoch},
                     {"best_epoch", done.best_epoch},  {"best_validation_loss", done.best_loss}};
    const std::string text = found.dump(1) + "\n";
    files.table->write(text.data(), text.size());
    files.table->commit_new();
  }
  for (const Retried* file : {&log_file, &checkpoint_file})
    if (!file->problem().empty()) throw Error(file->problem() + "; the model is " + o.out);
  std::printf("\nThe model: %s\n", o.out.c_str());
}

template <BodySet Set>
void run(const Options& o, Outputs& files) {
  paper::with_architecture(o.architecture, [&](auto a) {
    constexpr std::size_t metadata_bytes = 1 << 20;
    files.model.reserve(paper::NetworkOf<a()>::type::parameter_count * sizeof(float) + metadata_bytes);
    auto predictor = first_predictor<a(), Set>(o);
    train<a(), Set>(o, std::move(predictor), data_of<Set>(o), files);
  });
}

}  // namespace train
