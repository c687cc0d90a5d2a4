#pragma once

#include <rbres/nn/network.hpp>
#include <rbres/nn/schedule.hpp>

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace rbres::RBRES_ABI {

/// How to train; the defaults are those of arXiv 2407.18798, section 3. Plain numbers.
struct TrainingOptions {
  int epochs = 200;     ///< 0 trains nothing
  int batch_size = 64;  ///< items of a step
  /// The learning rate.
  Schedule schedule{};
  double l2 = 1e-4;  ///< λ: what is minimised has + λ Σ w² over the weights of all Linears, not over biases
  double dropout = 0.2;    ///< rate of every Dropout layer
  int patience = 20;       ///< epochs without a better loss before the run stops; 0: never stops early
  std::uint64_t seed = 0;  ///< of shuffling and dropout
  int threads = 0;         ///< 0: default_threads(), at most 4096; changes no bit of the result
  double min_delta = 0;    ///< for `patience` a loss is better only if it is lower by more than this

  /// Throws Error where a number is out of its range.
  void check() const {
    const auto expect = [](bool fits, const char* what, const char* expected, double found) {
      if (!fits) detail::refuse(detail::text("TrainingOptions::", what), expected, found);
    };
    expect(epochs >= 0, "epochs", "at least 0", epochs);
    expect(batch_size >= 1, "batch_size", "at least 1", batch_size);
    schedule.check();
    expect(l2 >= 0 && std::isfinite(l2), "l2", "at least 0", l2);
    expect(dropout >= 0 && dropout < 1, "dropout", "in [0, 1)", dropout);
    expect(patience >= 0, "patience", "at least 0", patience);
    expect(threads >= 0 && threads <= 4096, "threads", "0 to 4096", threads);
    expect(min_delta >= 0 && std::isfinite(min_delta), "min_delta", "at least 0", min_delta);
  }
};

/// How a run stands.
enum class TrainingStatus : std::uint32_t {
  running,
  finished,       ///< all epochs done
  early_stopped,  ///< no better loss for `patience` epochs
  stopped,        ///< by the callback; train() goes on
  diverged        ///< a loss was not finite, or the objective threw; the best weights are those of before
};

/// Where a run stands. Shuffling and dropout are functions of seed, epoch and step, so these are the
/// generator's state too.
struct TrainingProgress {
  std::uint64_t epoch = 0;       ///< epochs done
  std::uint64_t step = 0;        ///< optimiser steps done
  std::uint64_t best_epoch = 0;  ///< epochs done when the best loss was found; 0: none yet
  /// The lowest loss so far.
  double best_loss = std::numeric_limits<double>::infinity();
  /// How the run stands.
  TrainingStatus status = TrainingStatus::running;
};

/// Everything that a run needs to go on with the same bits, beside its objective, options, optimiser and
/// schedule.
template <class Net>
struct TrainingState {
  Net network;  ///< the newest weights
  Net best;     ///< those with the lowest validation loss, or training loss where there is no validation
  AlignedBuffer<typename Net::Scalar> moments;  ///< Optimizer::moment_count blocks of Net::block_size
  /// Where the run stands.
  TrainingProgress progress{};
  std::vector<EpochLosses> history{};  ///< of each epoch done
};

/// What a callback hears after each epoch.
struct EpochReport {
  std::uint64_t epoch = 0;  ///< epochs done
  /// That there are to be.
  int epochs = 0;
  double train_loss = 0;       ///< mean over the epoch, with dropout, without the L2 term
  double validation_loss = 0;  ///< without dropout and the L2 term; NaN where there are no validation items
  /// The lowest so far.
  double best_loss = 0;
  double learning_rate = 0;  ///< of the epoch's last step
  /// Items learned from in a second.
  double samples_per_second = 0;
  double seconds_left = 0;  ///< if all epochs are run
  /// How the run stands.
  TrainingStatus status = TrainingStatus::running;
};

namespace detail {

/// Refuses what no run can have come to, or none with these options can go on from.
inline void expect_state(const TrainingProgress& progress, const std::vector<EpochLosses>& history,
                         const TrainingOptions& options) {
  const char* what = "Trainer::restore";
  if (progress.epoch > static_cast<std::uint64_t>(options.epochs))
    refuse(text(what, ": epochs done"), text("0 to ", options.epochs), progress.epoch);
  if (progress.best_epoch > progress.epoch)
    refuse(text(what, ": best epoch"), text("0 to ", progress.epoch), progress.best_epoch);
  if (std::isnan(progress.best_loss)) refuse(text(what, ": best loss"), "a number", progress.best_loss);
  if (history.size() != progress.epoch)
    refuse(text(what, ": history"), text(progress.epoch, " epochs"), history.size());
  if (progress.status >= TrainingStatus::diverged)
    refuse(text(what, ": status"), "that of a run that can go on",
           progress.status == TrainingStatus::diverged
               ? "diverged"
               : std::to_string(static_cast<std::uint32_t>(progress.status)));
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI
