// How far long work is, on one line that is printed over.
#pragma once

#include <chrono>
#include <cstdio>
#include <rbres/nn/trainer.hpp>
#include <string>

/// Minutes and seconds.
inline std::string clock_text(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%d:%02d", static_cast<int>(seconds) / 60, static_cast<int>(seconds) % 60);
  return text;
}

inline void print_progress(const rbres::EpochReport& r) {
  std::printf(
      "\r  epoch %3d/%d   training loss %8.4f   validation loss %8.4f (best %8.4f)   %6.0f samples/s   %s "
      "left ",
      static_cast<int>(r.epoch), r.epochs, r.train_loss, r.validation_loss, r.best_loss, r.samples_per_second,
      clock_text(r.seconds_left).c_str());
  std::fflush(stdout);
}

/// What generate and write_dataset call with the scenarios that are done; the first call may come with those
/// of an earlier run.
class ScenarioProgress {
 public:
  explicit ScenarioProgress(long count) : count_(count) {}

  void operator()(long done) {
    if (before_ < 0) before_ = done;
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    std::printf("\r  %ld of %ld scenarios", done, count_);
    if (done > before_) {
      const double left = seconds * static_cast<double>(count_ - done) / static_cast<double>(done - before_);
      std::printf(", %s left ", clock_text(left).c_str());
    }
    std::fflush(stdout);
  }

 private:
  long count_, before_ = -1;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};
