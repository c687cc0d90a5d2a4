// Learning a contact law in the time that is left.
#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <rbres/learn/contact_law_simulator.hpp>
#include <vector>

#include "../common/progress.hpp"
#include "laws.hpp"
#include "score.hpp"

namespace rbres::contacts_program {

/// When something must be done.
class Deadline {
 public:
  explicit Deadline(double minutes) : end_(Clock::now() + std::chrono::duration<double>(60 * minutes)) {}
  double seconds_left() const { return std::chrono::duration<double>(end_ - Clock::now()).count(); }
  /// The end of a part of the time that is left.
  Deadline part(double share) const { return Deadline(share * seconds_left() / 60); }

 private:
  using Clock = std::chrono::steady_clock;
  std::chrono::time_point<Clock, std::chrono::duration<double>> end_;
};

/// Rollouts of a set that have so many frames and begin so many apart.
inline long count_rollouts(const TrajectorySet& set, int frames, int stride) {
  long count = 0;
  for (const Trajectory& scene : set) count += (std::max(0, scene.frames() - frames) + stride - 1) / stride;
  return count;
}

inline int longest_rollout(const TrajectorySet& set) {
  int longest = 0;
  for (const Trajectory& scene : set) longest = std::max(longest, scene.frames() - 1);
  return longest;
}

/// Stages whose rollouts have `most_frames` frames in all, or as many as they can learn from.
inline std::vector<ContactLearning::Stage> stages_of(const TrajectorySet& fit, const TrajectorySet& choose,
                                                     double most_frames) {
  struct Kind {
    int frames, stride, batch_size;
    double share;  ///< of all frames
  };
  constexpr std::array kinds{Kind{1, 1, 256, 0.1}, Kind{4, 2, 64, 0.2}, Kind{16, 8, 16, 0.4},
                             Kind{32, 16, 16, 0.3}};
  constexpr double most_epochs = 300;  // of a stage: more of them learn small sets by heart
  const int longest = std::min(longest_rollout(fit), longest_rollout(choose));
  std::vector<ContactLearning::Stage> stages;
  for (const Kind& kind : kinds) {
    if (kind.frames > longest) break;
    const double wanted = std::max(1.0, kind.share * most_frames / kind.frames);  // rollouts
    // Where one pass is too much, it leaves out some.
    const double all = static_cast<double>(count_rollouts(fit, kind.frames, kind.stride));
    const int stride = static_cast<int>(
        std::clamp(kind.stride * all / wanted, 1.0 * kind.stride, 1.0 * std::max(kind.stride, longest)));
    const double pass = static_cast<double>(count_rollouts(fit, kind.frames, stride));
    const double epochs = std::clamp(std::round(wanted / pass), 1.0, most_epochs);
    stages.push_back({kind.frames, stride, static_cast<int>(epochs), kind.batch_size});
  }
  return stages;
}

/// How long learning takes for a frame of a scene, s: measured for a moment.
template <class L>
double seconds_per_frame(const TrajectorySet& fit, const ContactLearning& options, double moment) {
  ContactLearning brief = options;
  const int stride = static_cast<int>(std::max(1L, count_rollouts(fit, 1, 1) / 2000));
  brief.stages = {{1, stride, 1000, 256}};
  const TrajectorySet one = fit.subset(0, 1);
  const Deadline end(moment / 60);
  double epochs = 0;
  learn_contacts<L>(fit, one, brief, [&](const ContactLearningReport& report) {
    epochs = static_cast<double>(report.epoch.epoch);
    return end.seconds_left() > 0;
  });
  return (moment - end.seconds_left()) / (epochs * static_cast<double>(count_rollouts(fit, 1, stride)));
}

/// Learns from `fit`, with the weights that are best for `choose`, until a little before the deadline.
/// The stages are those that the time allows.
template <class L>
L learn_law(const TrajectorySet& fit, const TrajectorySet& choose, ContactLearning options,
            const Deadline& deadline) {
  // A bit is for what is slower than expected, and for the predictions that follow.
  const Deadline end = deadline.part(0.97);
  const double each = seconds_per_frame<L>(fit, options, std::clamp(0.02 * end.seconds_left(), 0.05, 2.0));
  options.stages = stages_of(fit, choose, 0.9 * end.seconds_left() / each);
  const double start = end.seconds_left();
  double before = start;
  ProgressLine line(stderr);
  bool all = true;
  const L law = learn_contacts<L>(fit, choose, options, [&](const ContactLearningReport& report) {
    const double left = end.seconds_left(), epoch = before - left;
    before = left;
    const double to_go = std::min(left, (start - left) * (1 / report.share_done - 1));
    char text[200];
    std::snprintf(
        text, sizeof text,
        "rollouts of %2d frames, epoch %d of %d   training loss %.4f   validation loss %.4f   %s left",
        options.stages[static_cast<std::size_t>(report.stage)].frames, static_cast<int>(report.epoch.epoch),
        report.epoch.epochs, report.epoch.train_loss, report.epoch.validation_loss,
        clock_text(std::max(0.0, to_go)).c_str());
    line.print(report.share_done, text);
    return all = left > epoch;
  });
  line.end();
  if (!all) std::fprintf(stderr, "  the time was up before all epochs were done\n");
  return law;
}

}  // namespace rbres::contacts_program
