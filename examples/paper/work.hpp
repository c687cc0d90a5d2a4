// Units of work that do not need each other, several at once.
#pragma once

#include <chrono>
#include <exception>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "../common/progress.hpp"

namespace paper {

/// How the experiment is run; changes no bit of what it finds.
struct RunOptions {
  int threads = 0;               ///< 0: default_threads()
  double checkpoint_every = 20;  ///< s, of each unit
};

/// True once in so many seconds.
class Every {
 public:
  explicit Every(double seconds) : wait_(seconds) {}
  bool due() {
    const auto now = Clock::now();
    if (now - last_ < wait_) return false;
    last_ = now;
    return true;
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::chrono::duration<double> wait_;
  Clock::time_point last_ = Clock::now();
};

/// Thrown where a unit is to stop because another one has failed.
struct Stopped : std::exception {
  const char* what() const noexcept override { return "stopped because another unit failed"; }
};

/// How far all units are, as one line, and a line for each that is finished.
class WorkProgress {
 public:
  /// Of `all` units those of `amounts` are still to be done.
  WorkProgress(std::vector<double> amounts, std::size_t all)
      : amounts_(std::move(amounts)), shares_(amounts_.size(), -1), all_(all) {
    for (const double amount : amounts_) left_ += amount;
  }

  /// The first call comes with the share that was done before. Throws Stopped after fail().
  void advance(std::size_t unit, double share) {
    const std::scoped_lock lock(mutex_);
    if (problem_) throw Stopped();
    const bool first = shares_[unit] < 0;
    const double more = amounts_[unit] * (share - (first ? 0 : shares_[unit]));
    shares_[unit] = share;
    left_ -= more;
    if (!first) done_ += more;
    show();
  }
  /// A unit may be finished before all of it is done. Says so.
  void finish(std::size_t unit, const std::string& text) {
    const std::scoped_lock lock(mutex_);
    left_ -= amounts_[unit] * (1 - std::max(0.0, shares_[unit]));
    ++finished_;
    line_.say(text);
    show();
  }
  void say(const std::string& text) {
    const std::scoped_lock lock(mutex_);
    line_.say(text);
  }
  /// Whether a unit may begin.
  bool goes_on() {
    const std::scoped_lock lock(mutex_);
    return !problem_;
  }
  /// Keeps the exception that is being handled, if it is the first.
  void fail() {
    const std::scoped_lock lock(mutex_);
    if (!problem_) problem_ = std::current_exception();
  }
  /// Throws the first exception.
  void end() {
    line_.end();
    if (problem_) std::rethrow_exception(problem_);
  }

 private:
  void show() {
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    std::string text = rbres::detail::text(all_ - amounts_.size() + finished_, " of ", all_, " units done");
    if (done_ > 0 && left_ > 0) text += ", about " + clock_text(seconds * left_ / done_) + " left";
    line_.print(done_ / (done_ + std::max(left_, 0.0)), text);
  }

  std::vector<double> amounts_, shares_;
  std::size_t all_, finished_ = 0;
  double done_ = 0, left_ = 0;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::exception_ptr problem_;
  ProgressLine line_;
  std::mutex mutex_;
};

/// What a unit is done with.
struct UnitRun {
  int threads;
  double checkpoint_every;  ///< s
  std::size_t unit;
  WorkProgress& progress;

  /// To be called now and then, first with the share that was done before. Throws where the unit is to stop.
  void advance(double share) const { progress.advance(unit, share); }
};

/// One unit.
struct Work {
  double amount;  ///< how long it takes, in any measure that all units share
  /// Returns what is said of it in the end.
  std::function<std::string(const UnitRun&)> run;
};

/// Does the units that are left of `all`, the longest first, each with one thread, or with several where
/// there are more threads than units. Where one throws, the others stop, and the caller gets its exception.
inline void do_all(std::vector<Work> units, std::size_t all, const RunOptions& options) {
  if (units.empty()) return;
  std::ranges::stable_sort(units, std::greater(), &Work::amount);
  std::vector<double> amounts;
  for (const Work& unit : units) amounts.push_back(unit.amount);
  WorkProgress progress(std::move(amounts), all);
  const int threads = options.threads > 0 ? options.threads : rbres::default_threads();
  const int each = std::max(1, threads / static_cast<int>(units.size()));
  rbres::parallel_for(std::ssize(units), threads, [&](std::ptrdiff_t i) {
    const auto unit = static_cast<std::size_t>(i);
    if (!progress.goes_on()) return;
    try {
      progress.finish(unit, units[unit].run({each, options.checkpoint_every, unit, progress}));
    } catch (...) {
      progress.fail();
    }
  });
  progress.end();
}

}  // namespace paper
