// How far long work is: on a terminal one line that is printed over, elsewhere (a file, a pipe) a line now
// and then.
#pragma once

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <rbres/core/error.hpp>
#include <rbres/nn/training.hpp>
#include <string>

/// Minutes and seconds.
inline std::string clock_text(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%d:%02d", static_cast<int>(seconds) / 60, static_cast<int>(seconds) % 60);
  return text;
}

/// The line of one piece of work.
class ProgressLine {
 public:
  explicit ProgressLine(std::FILE* to = stdout) : to_(to), is_terminal_(::isatty(::fileno(to)) == 1) {}

  /// Says how far the work is. Where there is no terminal, one line for each hundredth of it.
  void print(double share_done, const std::string& line) {
    const int hundredths = static_cast<int>(100 * share_done);
    if (!is_terminal_ && hundredths <= hundredths_) return;
    hundredths_ = hundredths;
    width_ = std::max(width_, static_cast<int>(line.size()));
    if (is_terminal_) std::fprintf(to_, "\r  %-*s ", width_, line.c_str());
    if (!is_terminal_) std::fprintf(to_, "  %s\n", line.c_str());
    std::fflush(to_);
  }
  /// A line that stays; on a terminal above that of the work, which comes again with its next print.
  void say(const std::string& line) {
    if (is_terminal_) std::fprintf(to_, "\r");
    std::fprintf(to_, "  %-*s\n", is_terminal_ ? width_ : 0, line.c_str());
    std::fflush(to_);
  }
  /// What follows stands on a line of its own.
  void end() {
    if (is_terminal_) std::fprintf(to_, "\n");
  }

 private:
  std::FILE* to_;
  bool is_terminal_;
  int hundredths_ = -1, width_ = 0;
};

inline void print_progress(ProgressLine& line, const rbres::EpochReport& r) {
  char text[200];
  std::snprintf(text, sizeof text,
                "epoch %3d/%d   training loss %8.4f   validation loss %8.4f (best %8.4f)   %6.0f samples/s   "
                "%s left",
                static_cast<int>(r.epoch), r.epochs, r.train_loss, r.validation_loss, r.best_loss,
                r.samples_per_second, clock_text(r.seconds_left).c_str());
  line.print(static_cast<double>(r.epoch) / r.epochs, text);
}

/// What generate and write_dataset call with the scenarios that are done; the first call may come with those
/// of an earlier run.
class ScenarioProgress {
 public:
  explicit ScenarioProgress(long count) : count_(count) {}

  void operator()(long done) {
    if (before_ < 0) before_ = done;
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    std::string text = rbres::detail::text(done, " of ", count_, " scenarios");
    if (done > before_) {
      const double left = seconds * static_cast<double>(count_ - done) / static_cast<double>(done - before_);
      text += ", " + clock_text(left) + " left";
    }
    line_.print(static_cast<double>(done) / static_cast<double>(count_), text);
  }
  void end() { line_.end(); }

 private:
  long count_, before_ = -1;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  ProgressLine line_;
};
