// The training itself, whatever it is that the columns say.
#pragma once

#include <cmath>
#include <limits>
#include <optional>

#include "../common/progress.hpp"
#include "log.hpp"
#include "options.hpp"
#include "outputs.hpp"

namespace train {

template <class Net>
struct Trained {
  Net network;  ///< of the best epoch
  TrainingProgress progress;
  std::string problem;  ///< a log or checkpoint that could not be written in the end; empty: none
};

/// Trains by the options. Writes the log and the checkpoint after each epoch; where the options say so, goes
/// on from the checkpoint, which must be of a run with the same `made_from`.
template <class Net>
Trained<Net> train_network(const Options& o, Net network, const Samples<float>& training,
                           const Samples<float>& validation, const Metadata& made_from) {
  Clipped<ChosenOptimizer> optimizer;
  optimizer.method = o.method;
  optimizer.adam.weight_decay = o.method == Method::adamw ? o.weight_decay : 0;
  optimizer.sgd.momentum = o.momentum;
  optimizer.largest_norm = o.clip > 0 ? o.clip : std::numeric_limits<double>::infinity();
  Trainer trainer(std::move(network), training, validation, o.training, optimizer);
  if (o.warm_up > 0) trainer.set_schedule(WarmUp{o.training.schedule, static_cast<std::uint64_t>(o.warm_up)});
  if (o.resume) {
    load_checkpoint(o.checkpoint, trainer, made_from);
    std::printf("  resumed after epoch %d\n", static_cast<int>(trainer.state().progress.epoch));
  }
  std::optional<LossLog> log;
  if (!o.log.empty()) log.emplace(o.log, o.resume);
  Retried log_file, checkpoint_file;
  const auto write = [&] {
    if (log) log_file([&] { log->write(trainer.state().history); });
    if (!o.checkpoint.empty()) checkpoint_file([&] { save_checkpoint(o.checkpoint, trainer, made_from); });
  };
  write();
  ProgressLine line;
  trainer.train([&](const EpochReport& r) {
    print_progress(line, r);
    write();
    return true;
  });
  line.end();
  return {trainer.best(), trainer.state().progress,
          log_file.problem().empty() ? checkpoint_file.problem() : log_file.problem()};
}

/// Says how the run ended; Error where it diverged.
inline void say_end(const TrainingProgress& done) {
  if (done.status == TrainingStatus::diverged)
    throw Error(detail::text(
        "after epoch ", done.epoch, " the loss was no number; a smaller --learning-rate may help; ",
        done.best_epoch > 0 ? detail::text("the model is that of epoch ", done.best_epoch)
                            : "no model is saved"));
  std::printf("  %s after epoch %d; the best was epoch %d\n\n",
              done.status == TrainingStatus::early_stopped ? "stopped early" : "done",
              static_cast<int>(done.epoch), static_cast<int>(done.best_epoch));
}

/// Writes the table's figures, and says where the model is; Error where another file could not be written.
template <class Net>
void finish(const Options& o, Outputs& files, Json found, const Trained<Net>& trained) {
  if (files.table) {
    found["epochs"] = trained.progress.epoch;
    found["best_epoch"] = trained.progress.best_epoch;
    found["best_validation_loss"] = trained.progress.best_loss;
    const std::string text = found.dump(1) + "\n";
    files.table->write(text.data(), text.size());
    files.table->commit_new();
  }
  if (!trained.problem.empty()) throw Error(trained.problem + "; the model is " + o.out);
  std::printf("\nThe model: %s\n", o.out.c_str());
}

}  // namespace train
