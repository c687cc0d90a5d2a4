#pragma once

#include <rbres/learn/rollouts.hpp>
#include <rbres/nn/trainer.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <optional>
#include <vector>

namespace rbres {

/// How a contact law is learned. Plain numbers.
struct ContactLearning {
  /// Rollouts of a length: short ones find the law, long ones the errors that add up.
  struct Stage {
    int frames;      ///< of a rollout
    int stride;      ///< frames from the start of one rollout to that of the next
    int epochs;      ///< passes over all rollouts of this length
    int batch_size;  ///< rollouts of a step
  };
  std::vector<Stage> stages{{1, 1, 8, 256}, {4, 2, 8, 64}, {16, 8, 24, 16}, {32, 16, 20, 8}};
  double learning_rate = 2e-3;  ///< falls along half a cosine over all stages
  double largest_gradient = 1;  ///< longer ones are clipped
  RolloutLoss loss{};
  std::uint64_t seed = 0;
  int threads = 0;  ///< 0: default_threads(); changes no bit of the result

  /// Throws Error where a number is out of its range.
  void check() const {
    if (stages.empty()) detail::refuse("ContactLearning::stages", "at least one", "none");
    for (const Stage& stage : stages)
      for (const int number : {stage.frames, stage.stride, stage.epochs, stage.batch_size})
        if (number < 1) detail::refuse("ContactLearning::stages", "numbers of at least 1", number);
    if (!(learning_rate > 0) || !is_finite(learning_rate))
      detail::refuse("ContactLearning::learning_rate", "above 0", learning_rate);
  }
};

/// What is heard after each epoch of learning.
struct ContactLearningReport {
  int stage = 0;          ///< 0, 1, ...
  EpochReport epoch{};    ///< within the stage
  double share_done = 0;  ///< of all frames that are to be rolled out, in (0, 1]
};
/// Returns false to stop: the law is then the best so far.
using ContactLearningCallback = std::function<bool(const ContactLearningReport&)>;

namespace detail {

/// The learning rate of one stage of several.
struct StageSchedule {
  double initial, first, last;  ///< shares of the whole at the stage's ends
  double operator()(const TrainingTime& now) const {
    const double share = first + (last - first) * now.epoch / now.epochs;
    return initial * 0.5 * (1 + std::cos(std::numbers::pi * share));
  }
  std::string text() const {
    return detail::text("stage ", exact(initial), " ", exact(first), " ", exact(last));
  }
};

/// Calls f(frame of contacts) for single frames of free flight from the truth, some thousand of a set.
template <class Law, class F>
void each_contact_frame(const TrajectorySet& set, const ContactScales& scales, const F& f) {
  long frames = 0;
  for (const Trajectory& scene : set) frames += scene.frames() - 1;
  const long every = std::max(1L, frames / 4000);
  typename Law::Frame contacts;
  std::vector<RigidState<double>> flown;
  long number = 0;
  for (const Trajectory& scene : set) {
    for (int t = 0; t + 1 < scene.frames(); ++t) {
      if (number++ % every != 0) continue;
      flown.clear();
      for (int i = 0; i < scene.bodies(); ++i)
        flown.push_back(fly(System<double, 1>({scene.body(i)}), Gravity<double>{set.gravity()}, Rk4{},
                            SystemState<double, 1>{{scene.state(t, i)}}, 0.0, set.frame_time())[0]);
      contacts.clear();
      contacts.add(SceneView<AnyShape<double>>{{&scene.body(0), static_cast<std::size_t>(scene.bodies())},
                                               set.planes()},
                   scene.frame(t), std::span<const RigidState<double>>(flown), scales);
      f(contacts);
    }
  }
}

}  // namespace detail

/// A law that knows the set's frame time, speeds and lengths, but nothing of its contacts: all its impulses
/// are zero. Throws Error where no bodies of the set touch.
template <class Law>
Law untrained_law(const TrajectorySet& set, std::uint64_t seed) {
  Law law;
  law.network = typename Law::Network(seed);
  // The decoder's last layer starts at zero: without contacts learned there is free flight.
  const auto tensors = Law::Network::tensors();
  for (std::size_t k = tensors.size() - 2; k < tensors.size(); ++k)
    for (int r = 0; r < tensors[k].rows; ++r)
      for (int c = 0; c < tensors[k].columns; ++c) law.network.parameters()[tensors[k].index(r, c)] = 0;

  law.scales.frame_time = set.frame_time();
  double squares = 0;
  long count = 0;
  for (const Trajectory& scene : set)
    for (int t = 0; t < scene.frames(); ++t)
      for (const auto& body : scene.frame(t)) squares += squared_norm(body.velocity), ++count;
  const auto set_speed = [&] {
    law.scales.speed = std::sqrt(squares / static_cast<double>(std::max(count, 1L)));
    law.scales.margin = 0.2 * law.scales.gap();
  };
  set_speed();
  squares = 0, count = 0;
  detail::each_contact_frame<Law>(set, law.scales, [&](const auto& frame) {
    for (const auto& c : frame.contacts) squares += squared_norm(c.relative), ++count;
  });
  if (count == 0) detail::refuse("contacts of a trajectory set", "at least one", "none");
  set_speed();

  std::vector<typename Law::Frame::Normal::Vector> features;
  detail::each_contact_frame<Law>(set, law.scales, [&](const auto& frame) {
    for (std::size_t k = 0; k < frame.contacts.size(); ++k) features.push_back(frame.raw(k, law.scales));
  });
  typename Law::Frame::Columns columns(detail::Contact::features, std::ssize(features));
  for (std::size_t k = 0; k < features.size(); ++k) columns.col(static_cast<Eigen::Index>(k)) = features[k];
  law.input = Law::Frame::Normal::fit(columns, [](Eigen::Index, Eigen::Index) { return true; });
  return law;
}

/// Learns how the bodies of a set collide: rollouts of growing length from the truth, by Adam. `validation`
/// holds scenes of the same world that are not learned from and decide which weights are the best. Throws
/// Error where the sets or options make no sense.
template <class Law>
Law learn_contacts(const TrajectorySet& train, const TrajectorySet& validation,
                   const ContactLearning& options = {}, const ContactLearningCallback& callback = {}) {
  options.check();
  Law law = untrained_law<Law>(train, options.seed);
  using Objective = Rollouts<Law>;
  using Optimizer = Clipped<Adam>;

  std::vector<Objective> rollouts;
  double work = 0;
  for (const auto& stage : options.stages) {
    rollouts.emplace_back(law, train, stage.frames, stage.stride, options.loss);
    work += static_cast<double>(rollouts.back().count()) * stage.frames * stage.epochs;
  }
  double done = 0;
  for (std::size_t s = 0; s < options.stages.size(); ++s) {
    const auto& stage = options.stages[s];
    const double own = static_cast<double>(rollouts[s].count()) * stage.frames * stage.epochs / work;
    Trainer<typename Law::Network, Optimizer, Objective> trainer(
        law.network, rollouts[s], Objective(law, validation, stage.frames, 2 * stage.frames, options.loss),
        {.epochs = stage.epochs,
         .batch_size = stage.batch_size,
         .l2 = 0,
         .dropout = 0,
         .patience = 0,
         .seed = options.seed + s,
         .threads = options.threads},
        Optimizer{{}, options.largest_gradient});
    trainer.set_schedule(WarmUp{detail::StageSchedule{options.learning_rate, done, done + own}, 100});
    bool stopped = false;
    trainer.train([&](const EpochReport& epoch) {
      const double share = done + own * static_cast<double>(epoch.epoch) / stage.epochs;
      stopped = callback && !callback({static_cast<int>(s), epoch, share});
      return !stopped;
    });
    law.network = trainer.best();
    done += own;
    if (stopped) break;
  }
  return law;
}

}  // namespace rbres
