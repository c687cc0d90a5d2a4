#pragma once

#include <rbres/core/denormals.hpp>
#include <rbres/nn/backpropagation.hpp>
#include <rbres/nn/evaluation.hpp>
#include <rbres/nn/optimizer.hpp>
#include <rbres/nn/schedule.hpp>

#include <chrono>
#include <concepts>
#include <cstdint>
#include <functional>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

namespace rbres {

/// How to train; the defaults are those of arXiv 2407.18798, section 3. Plain numbers.
struct TrainingOptions {
  int epochs = 200;
  int batch_size = 64;
  Schedule schedule{};
  double l2 = 1e-4;      ///< λ: the loss that is minimised has + λ Σ w² over all weights, not over biases
  double dropout = 0.2;  ///< rate of every Dropout layer
  int patience = 20;     ///< epochs without a better loss before the run stops; 0: never stops early
  std::uint64_t seed = 0;  ///< of shuffling and dropout
  int threads = 0;         ///< 0: default_threads(); changes no bit of the result
};

enum class TrainingStatus : std::uint32_t {
  running,
  finished,       ///< all epochs done
  early_stopped,  ///< no better loss for `patience` epochs
  stopped,        ///< by the callback
  diverged        ///< a loss was not finite; the best weights are those of before
};

/// Where a run stands. Shuffling and dropout are functions of seed, epoch and step, so these are the
/// generator's state too.
struct TrainingProgress {
  std::uint64_t epoch = 0;       ///< epochs done
  std::uint64_t step = 0;        ///< optimiser steps done
  std::uint64_t best_epoch = 0;  ///< epochs done when the best loss was found; 0: none yet
  double best_loss = std::numeric_limits<double>::infinity();
  TrainingStatus status = TrainingStatus::running;
};

/// Everything that a run needs to go on with the same bits, beside its data, options, optimiser and loss.
template <class Net>
struct TrainingState {
  Net network;  ///< the newest weights
  Net best;     ///< those with the lowest validation loss, or training loss where there are no validation
                ///< samples
  AlignedBuffer<typename Net::Scalar> moments;  ///< Optimizer::moment_count blocks of Net::block_size
  TrainingProgress progress{};
};

/// What a callback hears after each epoch.
struct EpochReport {
  std::uint64_t epoch = 0;  ///< epochs done
  int epochs = 0;
  double train_loss = 0;       ///< mean over the epoch, with dropout, without the L2 term
  double validation_loss = 0;  ///< without dropout and the L2 term; NaN where there are no validation samples
  double best_loss = 0;
  double learning_rate = 0;
  double samples_per_second = 0;
  double seconds_left = 0;  ///< if all epochs are run
  TrainingStatus status = TrainingStatus::running;
};

/// Trains a network. The samples must outlive the trainer.
template <class Net, class Optimizer = Adam>
class Trainer {
 public:
  using Scalar = typename Net::Scalar;
  using Callback = std::function<bool(const EpochReport&)>;

  /// Throws Error where a size does not fit, an option is out of its range, or a number in the samples is not
  /// finite. Without validation samples the training loss decides which weights are the best.
  Trainer(Net network, const Samples<Scalar>& train, const Samples<Scalar>& validation,
          const TrainingOptions& options = {}, const Optimizer& optimizer = {}, Loss<Scalar> loss = {})
      : options_(options),
        optimizer_(optimizer),
        loss_(std::move(loss)),
        train_(train),
        validation_(validation),
        state_{network,
               std::move(network),
               AlignedBuffer<Scalar>(Optimizer::moment_count * Net::block_size),
               {}},
        gradients_(checked(options, train)),
        evaluation_(options.threads),
        order_(static_cast<std::size_t>(train.count())) {
    detail::expect_samples("Trainer: training samples", train_, Net::input_size, Net::output_size);
    if (validation_.count() != 0)
      detail::expect_samples("Trainer: validation samples", validation_, Net::input_size, Net::output_size);
    if (!loss_.output_weights.empty() && loss_.output_weights.size() != Net::output_size)
      detail::refuse("Trainer: output weights", detail::text(Net::output_size, " numbers or none"),
                     loss_.output_weights.size());
  }

  const TrainingOptions& options() const noexcept { return options_; }
  const TrainingState<Net>& state() const noexcept { return state_; }
  /// The newest weights, and the best ones so far.
  const Net& network() const noexcept { return state_.network; }
  const Net& best() const noexcept { return state_.best; }

  /// Goes on from a state that a trainer with the same samples, options, optimiser and loss had between two
  /// epochs. write(state) puts it in the place of this trainer's, so that memory never holds a second one.
  template <std::invocable<TrainingState<Net>&> Write>
  void restore(const Write& write) {
    write(state_);
    if (state_.moments.size() != Optimizer::moment_count * Net::block_size)
      detail::refuse("Trainer::restore: moments",
                     detail::text(Optimizer::moment_count * Net::block_size, " numbers"),
                     state_.moments.size());
  }

  /// One pass over the training samples in a new order, and one over the validation samples. Does nothing
  /// once the status is no longer `running`.
  EpochReport run_epoch() {
    TrainingProgress& progress = state_.progress;
    EpochReport report;
    report.epochs = options_.epochs;
    if (progress.status == TrainingStatus::running) {
      const auto start = std::chrono::steady_clock::now();
      report.learning_rate = options_.schedule.rate(static_cast<int>(progress.epoch), options_.epochs);
      report.train_loss = descend(report.learning_rate);
      const bool validated = validation_.count() != 0;
      report.validation_loss = validated ? evaluation_.mean_loss(state_.network, validation_, loss_)
                                         : std::numeric_limits<double>::quiet_NaN();
      judge(validated ? report.validation_loss : report.train_loss);
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      report.samples_per_second = static_cast<double>(train_.count()) / seconds;
      report.seconds_left = seconds * (options_.epochs - static_cast<double>(progress.epoch));
    }
    report.epoch = progress.epoch;
    report.best_loss = progress.best_loss;
    report.status = progress.status;
    return report;
  }

  /// Epochs until the run is over or the callback returns false.
  TrainingStatus train(const Callback& callback = {}) {
    while (state_.progress.status == TrainingStatus::running) {
      const EpochReport report = run_epoch();
      if (callback && !callback(report) && state_.progress.status == TrainingStatus::running)
        state_.progress.status = TrainingStatus::stopped;
    }
    return state_.progress.status;
  }

 private:
  static Eigen::Index checked(const TrainingOptions& o, const Samples<Scalar>& train) {
    const auto expect = [](bool fits, const char* what, const char* expected, double found) {
      if (!fits) detail::refuse(detail::text("TrainingOptions::", what), expected, found);
    };
    expect(o.epochs >= 0, "epochs", "at least 0", o.epochs);
    expect(o.batch_size >= 1, "batch_size", "at least 1", o.batch_size);
    expect(o.schedule.initial > 0 && std::isfinite(o.schedule.initial), "schedule.initial", "above 0",
           o.schedule.initial);
    expect(o.l2 >= 0, "l2", "at least 0", o.l2);
    expect(o.dropout >= 0 && o.dropout < 1, "dropout", "in [0, 1)", o.dropout);
    expect(o.patience >= 0, "patience", "at least 0", o.patience);
    if (train.count() == 0) detail::refuse("Trainer: training samples", "at least one", 0);
    return std::min<Eigen::Index>(o.batch_size, train.count());
  }

  /// Fisher-Yates shuffle (Durstenfeld 1964) of all samples, a function of seed and epoch.
  void shuffle() {
    std::iota(order_.begin(), order_.end(), 0u);
    Random random(options_.seed, std::uint64_t{1} << 32 | state_.progress.epoch);
    for (std::size_t i = order_.size(); i > 1; --i)
      std::swap(order_[i - 1], order_[random.below(static_cast<std::uint32_t>(i))]);
  }

  /// All batches once; the mean of their losses. Stops before an update that comes from a loss that is not
  /// finite. One team for the whole epoch: a step is too short to start threads in.
  double descend(double rate) {
    shuffle();
    const auto batch = static_cast<std::size_t>(options_.batch_size);
    const std::uint64_t steps_before = state_.progress.step;
    double mean = 0;
    parallel_team(useful_threads(), [&](const Team& team) {
      const detail::FlushDenormals flush;
      std::uint64_t step = steps_before;
      double sum = 0;
      for (std::size_t first = 0; first < order_.size(); first += batch) {
        const auto order = std::span(order_).subspan(first, std::min(order_.size() - first, batch));
        const double loss = gradients_.run(state_.network, train_, loss_, order,
                                           {options_.dropout, options_.seed, step}, team);
        sum += loss * static_cast<double>(order.size());
        if (!std::isfinite(loss)) break;
        update(team, rate, ++step);
      }
      if (team.index() > 0) return;
      state_.progress.step = step;
      mean = sum / static_cast<double>(order_.size());
    });
    return mean;
  }

  /// As many threads as are asked for, but no more than have something to do in a step: at least 8 samples
  /// each, for which they read all weights, and some 20 microseconds, beside which waiting counts little.
  int useful_threads() const {
    constexpr std::size_t products = 1 << 18;
    const auto batch = std::min(order_.size(), static_cast<std::size_t>(options_.batch_size));
    const std::size_t most = std::min((batch + 7) / 8, batch * Net::parameter_count / products);
    const auto asked = static_cast<std::size_t>(options_.threads > 0 ? options_.threads : default_threads());
    return static_cast<int>(std::clamp(asked, std::size_t{1}, std::max(most, std::size_t{1})));
  }

  void update(const Team& team, double rate, std::uint64_t step) {
    const auto rule = optimizer_.template rule<Scalar>(rate, step);
    const auto l2 = static_cast<Scalar>(2 * options_.l2);
    Scalar* parameters = state_.network.parameters().data();
    Scalar* moments = state_.moments.data();
    gradients_.parameter_gradient(team, [=](std::size_t at, detail::Simd<Scalar> g, bool is_weight) {
      // What is updated next is on its way from memory while its gradient is summed.
      constexpr std::size_t next = detail::gradient_rows<Scalar> * detail::lanes<Scalar>;
      __builtin_prefetch(parameters + at + next, 1);
      for (std::size_t i = 0; i < Optimizer::moment_count; ++i)
        __builtin_prefetch(moments + i * Net::block_size + at + next, 1);
      auto w = detail::load(parameters + at);
      detail::Simd<Scalar> m[Optimizer::moment_count];
      for (std::size_t i = 0; i < Optimizer::moment_count; ++i)
        m[i] = detail::load(moments + i * Net::block_size + at);
      if (is_weight) g += l2 * w;
      detail::store(parameters + at, rule(w, g, m, is_weight));
      for (std::size_t i = 0; i < Optimizer::moment_count; ++i)
        detail::store(moments + i * Net::block_size + at, m[i]);
    });
  }

  void judge(double loss) {
    TrainingProgress& progress = state_.progress;
    if (!std::isfinite(loss)) {
      progress.status = TrainingStatus::diverged;
      return;
    }
    ++progress.epoch;
    if (loss < progress.best_loss) {
      progress.best_loss = loss;
      progress.best_epoch = progress.epoch;
      std::copy_n(state_.network.parameters().data(), Net::block_size, state_.best.parameters().data());
    }
    if (progress.epoch >= static_cast<std::uint64_t>(options_.epochs))
      progress.status = TrainingStatus::finished;
    else if (options_.patience > 0 &&
             progress.epoch - progress.best_epoch >= static_cast<std::uint64_t>(options_.patience))
      progress.status = TrainingStatus::early_stopped;
  }

  TrainingOptions options_;
  Optimizer optimizer_;
  Loss<Scalar> loss_;
  Samples<Scalar> train_, validation_;
  TrainingState<Net> state_;
  Backpropagation<Net> gradients_;
  Evaluation<Net> evaluation_;
  std::vector<std::uint32_t> order_;
};

}  // namespace rbres
