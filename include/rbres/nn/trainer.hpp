#pragma once

#include <rbres/core/denormals.hpp>
#include <rbres/nn/evaluation.hpp>
#include <rbres/nn/gradient_source.hpp>
#include <rbres/nn/training.hpp>
#include <rbres/nn/update.hpp>

#include <algorithm>
#include <chrono>
#include <concepts>
#include <cstdint>
#include <functional>
#include <numeric>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

namespace rbres::RBRES_ABI {

/// Trains a network on an objective: by default columns with targets, which must outlive the trainer. A move
/// is a copy.
template <class Net, class Optimizer = Adam, Objective<Net> O = ColumnsObjective<Net>>
class Trainer {
  using MaybeO = std::optional<O>;
  static_assert(
      std::same_as<typename Net::Weight, typename Net::Scalar>,
      "Trainer: weights of half the size have no room for small steps: train a network of whole ones, "
      "then convert it");

 public:
  /// The network's numbers.
  using Scalar = typename Net::Scalar;
  /// Hears of an epoch; false stops.
  using Callback = std::function<bool(const EpochReport&)>;
  /// A schedule.
  using LearningRate = std::function<double(const TrainingTime&)>;

  /// Throws Error where a size does not fit, an option is out of its range, or a number in the samples is not
  /// finite. Without validation samples the training loss decides which weights are the best.
  Trainer(Net network, const Samples<Scalar>& train, const Samples<Scalar>& validation,
          const TrainingOptions& options = {}, const Optimizer& optimizer = {},
          Loss<Scalar> loss = {}) requires(std::same_as<O, ColumnsObjective<Net>>)
      : Trainer(std::move(network), O(train, loss, "Trainer: training samples"),
                MaybeO(O(validation, loss, "Trainer: validation samples")), options, optimizer) {}

  /// The same for any objective, and another of its type to validate on.
  Trainer(Net network, O objective, std::type_identity_t<std::optional<O>> validation = {},
          const TrainingOptions& options = {}, const Optimizer& optimizer = {})
      : options_(checked(options, objective)),
        update_(optimizer),
        rate_(options.schedule),
        rate_text_(detail::schedule_text(options.schedule, options.epochs)),
        objective_(std::move(objective)),
        validation_(std::move(validation)),
        state_{network, std::move(network), AlignedBuffer<Scalar>(moments_size), {}, {}},
        items_(detail::all_items(objective_.count())),
        gradients_(objective_, batch(), asked_threads()) {
    if (validation_ && validation_->count() > 0) evaluation_.emplace(*validation_, options_.threads);
    make_room();
    state_.progress.status = standing();
  }
  /// A copy goes on to the same bits.
  /// @{
  Trainer(const Trainer&) = default;
  Trainer& operator=(const Trainer&) = default;
  /// @}

  /// What it was made with.
  const TrainingOptions& options() const noexcept { return options_; }
  /// Where the run stands.
  const TrainingState<Net>& state() const noexcept { return state_; }
  /// The newest weights, and the best ones so far.
  const Net& network() const noexcept { return state_.network; }
  /// The best weights so far.
  const Net& best() const noexcept { return state_.best; }

  /// From now on the learning rate of each step is schedule(TrainingTime), in place of options.schedule: a
  /// WarmUp, a Plateau, a function of the user's own. It must depend on nothing but its argument, and is
  /// called by several threads at once. Throws Error where its check() does.
  template <class S>
  void set_schedule(S schedule) {
    detail::check_schedule(schedule);
    rate_text_ = detail::schedule_text(schedule, options_.epochs);
    rate_ = std::move(schedule);
  }

  /// All that the bits of a run depend on beside its network, as a text: options but for epochs (where
  /// the schedule does not span them), patience and threads, schedule, optimiser, and a digest of the items
  /// where the objective has one. Two runs of which these agree can go on from each other's states.
  std::string fingerprint() const {
    std::string text = detail::text("batch size ", options_.batch_size, ", ", rate_text_, ", l2 ",
                                    detail::exact(options_.l2), ", dropout ", detail::exact(options_.dropout),
                                    ", optimizer ");
    if constexpr (requires(const Optimizer& optimizer) { optimizer.text(); })
      text += update_.optimizer().text();
    else
      text += "of the user's own";
    const auto add = [&](const char* what, const O& objective) {
      if constexpr (requires { objective.digest(); })
        text += detail::text(", ", what, " ", detail::hexadecimal(objective.digest()));
      else
        text += detail::text(", ", objective.count(), " ", what);
    };
    add("items", objective_);
    if (evaluation_) add("validation items", *validation_);
    return text + detail::text(", seed ", options_.seed);
  }

  /// Goes on from a state that a trainer of the same fingerprint had between two epochs. A run that was over
  /// goes on where this trainer's options give it more epochs or patience. write(state) gets a copy of this
  /// trainer's state to change; where it throws, or leaves a state that makes no sense (Error), the trainer
  /// is as it was.
  template <std::invocable<TrainingState<Net>&> Write>
  void restore(const Write& write) {
    TrainingState<Net> state = state_;
    write(state);
    detail::expect_state(state.progress, state.history, options_);
    if (state.moments.size() != moments_size)
      detail::refuse("Trainer::restore: moments", detail::text(moments_size, " numbers"),
                     state.moments.size());
    state_ = std::move(state);
    go_on();
  }

  /// The same where memory shall not hold a second state: progress and history are checked first (Error, and
  /// the trainer is as it was), then fill(network, best, moments) gets the blocks themselves, as spans. Where
  /// fill throws, weights and moments are what it left them.
  template <std::invocable<std::span<Scalar>, std::span<Scalar>, std::span<Scalar>> Fill>
  void restore(const TrainingProgress& progress, std::vector<EpochLosses>&& history, const Fill& fill) {
    detail::expect_state(progress, history, options_);
    fill(state_.network.parameters(), state_.best.parameters(),
         std::span<Scalar>(state_.moments.data(), moments_size));
    state_.progress = progress;
    state_.history = std::move(history);
    go_on();
  }

  /// One pass over the training items in a new order, and one over the validation items. Does nothing
  /// once the status is no longer `running`. What the objective throws goes to the caller; the run, whose
  /// newest weights are then of the middle of an epoch, has diverged.
  EpochReport run_epoch() {
    TrainingProgress& progress = state_.progress;
    EpochReport report;
    report.epochs = options_.epochs;
    if (progress.status == TrainingStatus::running) {
      const auto start = std::chrono::steady_clock::now();
      const EpochLosses losses = pass();
      judge(losses);
      report.train_loss = losses.train_loss;
      report.validation_loss = losses.validation_loss;
      report.learning_rate = losses.learning_rate;
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      report.samples_per_second = static_cast<double>(items_.size()) / seconds;
      report.seconds_left = seconds * (options_.epochs - static_cast<double>(progress.epoch));
    }
    report.epoch = progress.epoch;
    report.best_loss = progress.best_loss;
    report.status = progress.status;
    return report;
  }

  /// Epochs until the run is over or the callback returns false, after which a second call goes on.
  TrainingStatus train(const Callback& callback = {}) {
    TrainingStatus& status = state_.progress.status;
    if (status == TrainingStatus::stopped) status = standing();
    while (status == TrainingStatus::running) {
      const EpochReport report = run_epoch();
      if (callback && !callback(report) && status == TrainingStatus::running)
        status = TrainingStatus::stopped;
    }
    return status;
  }

 private:
  static constexpr std::size_t moments_size = detail::Update<Net, Optimizer>::moments_size;

  static const TrainingOptions& checked(const TrainingOptions& options, const O& objective) {
    options.check();
    if (objective.count() < 1) detail::refuse("Trainer: training samples", "at least one", objective.count());
    return options;
  }
  std::size_t batch_size() const { return static_cast<std::size_t>(options_.batch_size); }
  std::ptrdiff_t batch() const { return std::min<std::ptrdiff_t>(options_.batch_size, std::ssize(items_)); }
  int asked_threads() const { return options_.threads > 0 ? options_.threads : default_threads(); }

  /// After a state was taken.
  void go_on() {
    make_room();
    stagnation_ = {};
    for (const EpochLosses& epoch : state_.history) stagnation_.add(epoch.monitored(), options_.min_delta);
    state_.progress.status = standing();
  }
  /// So that an epoch allocates nothing.
  void make_room() { state_.history.reserve(static_cast<std::size_t>(std::min(options_.epochs, 10'000))); }

  /// The status that options and history give a run that nobody stopped.
  TrainingStatus standing() const {
    if (state_.progress.epoch >= static_cast<std::uint64_t>(options_.epochs)) return TrainingStatus::finished;
    if (options_.patience > 0 && stagnation_.epochs >= options_.patience)
      return TrainingStatus::early_stopped;
    return TrainingStatus::running;
  }

  /// Fisher-Yates shuffle (Durstenfeld 1964) of all items, a function of seed and epoch.
  void shuffle() {
    std::iota(items_.begin(), items_.end(), 0u);
    Random random(options_.seed, std::uint64_t{1} << 32 | state_.progress.epoch);
    for (std::size_t i = items_.size(); i > 1; --i)
      std::swap(items_[i - 1], items_[random.below(static_cast<std::uint32_t>(i))]);
  }

  /// The learning rate of the epoch's step number i.
  double rate(std::size_t i) const {
    const TrainingProgress& progress = state_.progress;
    return rate_(
        TrainingTime{static_cast<int>(progress.epoch), options_.epochs, epoch_start_ + i, state_.history});
  }
  /// Refuses, before an epoch, rates that are none; the last one.
  double checked_rates() const {
    double last = 0;
    for (std::size_t i = 0; i < (items_.size() + batch_size() - 1) / batch_size(); ++i) {
      last = rate(i);
      if (!(last >= 0 && std::isfinite(last)))
        detail::refuse(detail::text("learning rate of step ", epoch_start_ + i),
                       "a finite number, at least 0", last);
    }
    return last;
  }

  EpochLosses pass() {
    epoch_start_ = state_.progress.step;
    EpochLosses losses;
    losses.learning_rate = checked_rates();
    state_.progress.status = TrainingStatus::diverged;  // where something throws
    losses.train_loss = descend();
    losses.validation_loss =
        evaluation_ ? evaluation_->mean(current(), *validation_) : std::numeric_limits<double>::quiet_NaN();
    return losses;
  }

  /// All batches once; the mean of their losses. Stops before an update that comes from a loss that is not
  /// finite. One team for the whole epoch: a step is too short to start threads in.
  double descend() {
    shuffle();
    const std::size_t batch = batch_size();
    double mean = 0;
    parallel_team(gradients_.useful_threads(asked_threads(), this->batch()), [&](const Team& team) {
      const detail::FlushDenormals flush;
      std::uint64_t step = epoch_start_;
      double sum = 0;
      for (std::size_t first = 0; first < items_.size(); first += batch) {
        const auto items = Items(items_).subspan(first, std::min(items_.size() - first, batch));
        const double loss =
            gradients_.run(state_.network, objective_, items, {options_.dropout, options_.seed, step}, team);
        sum += loss * static_cast<double>(items.size());
        if (!std::isfinite(loss)) break;
        update_(team, gradients_, rate(first / batch), options_.l2, ++step, state_.network, state_.moments);
      }
      if (team.index() > 0) return;
      state_.progress.step = step;
      mean = sum / static_cast<double>(items_.size());
    });
    return mean;
  }

  /// The weights that are validated.
  const Net& current() { return update_.current(state_.network, state_.moments, state_.progress.step); }

  void judge(const EpochLosses& losses) {
    TrainingProgress& progress = state_.progress;
    const double loss = losses.monitored();
    // A loss on the validation items sees the newest weights; that of the epoch is older than its last step.
    const bool is_sound = evaluation_ || detail::all_finite(current().parameters().data(), Net::block_size);
    if (!std::isfinite(losses.train_loss) || !std::isfinite(loss) || !is_sound) {
      progress.status = TrainingStatus::diverged;
      return;
    }
    ++progress.epoch;
    state_.history.push_back(losses);
    stagnation_.add(loss, options_.min_delta);
    if (loss < progress.best_loss) {
      progress.best_loss = loss;
      progress.best_epoch = progress.epoch;
      const auto parameters = current().parameters();
      std::copy(parameters.begin(), parameters.end(), state_.best.parameters().begin());
    }
    progress.status = standing();
  }

  TrainingOptions options_;
  detail::Update<Net, Optimizer> update_;
  LearningRate rate_;
  std::string rate_text_;
  O objective_;
  std::optional<O> validation_;
  TrainingState<Net> state_;
  Stagnation stagnation_;
  std::vector<std::uint32_t> items_;
  std::uint64_t epoch_start_ = 0;  ///< steps done before this epoch
  detail::GradientSource<Net, O> gradients_;
  std::optional<Evaluation<Net, O>> evaluation_;
};

}  // namespace rbres::RBRES_ABI
