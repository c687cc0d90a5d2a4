#pragma once

#include <rbres/core/error.hpp>

#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <span>
#include <string>

namespace rbres::RBRES_ABI {

/// What an epoch of training found.
struct EpochLosses {
  double train_loss = 0;       ///< mean over the epoch, with dropout, without the L2 term
  double validation_loss = 0;  ///< without dropout and the L2 term; NaN where there are no validation items
  double learning_rate = 0;    ///< of the epoch's last step

  /// What decides which weights are the best.
  double monitored() const noexcept { return std::isnan(validation_loss) ? train_loss : validation_loss; }
};

/// Where a run is at a step. A schedule is a function of it: double schedule(const TrainingTime&), the
/// learning rate. One whose rates depend on `epochs` says so by bool spans_run() const: a run of another
/// length does not go on with it, as its rate would jump.
struct TrainingTime {
  /// 0, 1, ..., epochs - 1.
  /// @{
  int epoch = 0, epochs = 1;
  /// @}
  std::uint64_t step = 0;                  ///< 0, 1, ..., counted from the run's first
  std::span<const EpochLosses> history{};  ///< of the epochs before this one
};

/// How many epochs ago the loss last fell by more than min_delta below its lowest value at that time.
struct Stagnation {
  /// The lowest loss so far.
  double least = std::numeric_limits<double>::infinity();
  /// Since it fell.
  int epochs = 0;
  /// The loss of one more epoch.
  void add(double loss, double min_delta) noexcept {
    if (loss < least - min_delta)
      least = loss, epochs = 0;
    else
      ++epochs;
  }
};

/// How the learning rate falls from epoch to epoch.
struct Schedule {
  /// How it falls.
  enum class Kind {
    power,   ///< initial (1 + gamma t)^-power at epoch t (arXiv 2407.18798, section 3)
    cosine,  ///< from initial to 0 along half a cosine over all epochs (Loshchilov, Hutter 2017, equation 5)
    constant
  };
  /// How it falls.
  Kind kind = Kind::power;
  /// The rate of the first epoch.
  double initial = 1e-3;
  /// Of Kind::power, 0 or more.
  double gamma = 0.1;
  /// Of Kind::power.
  double power = 0.75;

  /// The rate in epoch t = 0, 1, ..., epochs - 1.
  double rate(int t, int epochs) const noexcept {
    switch (kind) {
      case Kind::power:
        return initial * std::pow(1 + gamma * t, -power);
      case Kind::cosine:
        return initial * (1 + std::cos(std::numbers::pi * t / epochs)) / 2;
      case Kind::constant:
        break;
    }
    return initial;
  }
  /// The rate of a step.
  double operator()(const TrainingTime& now) const noexcept { return rate(now.epoch, now.epochs); }

  /// Whether rates depend on how many epochs there are.
  bool spans_run() const noexcept { return kind == Kind::cosine; }

  /// Throws Error where a number is out of its range.
  void check() const {
    const auto expect = [](bool fits, const char* what, const char* expected, double found) {
      if (!fits) detail::refuse(what, expected, found);
    };
    expect(initial > 0 && std::isfinite(initial), "TrainingOptions::schedule.initial", "above 0", initial);
    expect(gamma >= 0 && std::isfinite(gamma), "TrainingOptions::schedule.gamma", "at least 0", gamma);
    expect(std::isfinite(power), "TrainingOptions::schedule.power", "a finite number", power);
  }
  /// By which a checkpoint knows it again.
  std::string text() const {
    return detail::text("schedule ", static_cast<int>(kind), " ", detail::exact(initial), " ",
                        detail::exact(gamma), " ", detail::exact(power));
  }
};

namespace detail {
/// A schedule's own text, or that it has none.
template <class S>
std::string schedule_text(const S& schedule) {
  if constexpr (requires { schedule.text(); })
    return schedule.text();
  else
    return "a schedule of the user's own";
}

template <class S>
bool spans_run(const S& schedule) {
  if constexpr (requires { schedule.spans_run(); })
    return schedule.spans_run();
  else
    return false;
}

/// The schedule of a run, by which a checkpoint knows it again.
template <class S>
std::string schedule_text(const S& schedule, int epochs) {
  return spans_run(schedule) ? text(schedule_text(schedule), " over ", epochs, " epochs")
                             : schedule_text(schedule);
}

/// Refuses numbers that a schedule says are out of their range.
template <class S>
void check_schedule(const S& schedule) {
  if constexpr (requires { schedule.check(); }) schedule.check();
}
}  // namespace detail

/// Another schedule whose rates rise from nearly 0 along a line over the first `steps` steps (Goyal et al.
/// 2017, section 2.2). As PyTorch's LinearLR with start_factor 1 / steps and total_iters steps - 1.
template <class S>
struct WarmUp {
  /// What it changes.
  S schedule;
  /// How many steps it takes.
  std::uint64_t steps;

  /// The rate of a step.
  double operator()(const TrainingTime& now) const {
    const double height =
        now.step + 1 < steps ? static_cast<double>(now.step + 1) / static_cast<double>(steps) : 1;
    return height * schedule(now);
  }
  /// Whether rates depend on how many epochs there are.
  bool spans_run() const { return detail::spans_run(schedule); }
  /// Throws Error where the schedule's check() does.
  void check() const { detail::check_schedule(schedule); }
  /// By which a checkpoint knows it again.
  std::string text() const { return detail::text(detail::schedule_text(schedule), " warm-up ", steps); }
};
/// Around a schedule of any type.
template <class S, class Count>
WarmUp(S, Count) -> WarmUp<S>;

/// Another schedule whose rates are multiplied by `factor` each time that the loss has not fallen by more
/// than min_delta for more than `patience` epochs. As PyTorch's ReduceLROnPlateau with threshold_mode "abs".
template <class S>
struct Plateau {
  /// What it changes.
  S schedule;
  /// Above 0, at most 1.
  double factor = 0.1;
  /// Epochs without a lower loss.
  int patience = 10;
  /// Lower by more than this, 0 or more.
  double min_delta = 0;

  /// The rate of a step.
  double operator()(const TrainingTime& now) const {
    Stagnation stagnation;
    double height = 1;
    for (const EpochLosses& epoch : now.history) {
      stagnation.add(epoch.monitored(), min_delta);
      if (stagnation.epochs <= patience) continue;
      height *= factor;
      stagnation.epochs = 0;
    }
    return height * schedule(now);
  }
  /// Whether rates depend on how many epochs there are.
  bool spans_run() const { return detail::spans_run(schedule); }
  /// Throws Error where a number is out of its range.
  void check() const {
    detail::check_schedule(schedule);
    if (!(factor > 0 && factor <= 1)) detail::refuse("Plateau::factor", "above 0, at most 1", factor);
    if (patience < 0) detail::refuse("Plateau::patience", "at least 0", patience);
    if (!(min_delta >= 0 && std::isfinite(min_delta)))
      detail::refuse("Plateau::min_delta", "at least 0", min_delta);
  }
  /// By which a checkpoint knows it again.
  std::string text() const {
    return detail::text(detail::schedule_text(schedule), " plateau ", detail::exact(factor), " ", patience,
                        " ", detail::exact(min_delta));
  }
};
/// Around a schedule of any type.
template <class S, class... Numbers>
Plateau(S, Numbers...) -> Plateau<S>;

}  // namespace rbres::RBRES_ABI
