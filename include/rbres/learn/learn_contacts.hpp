#pragma once

#include <rbres/learn/rollouts.hpp>
#include <rbres/nn/trainer.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <functional>
#include <memory>
#include <numbers>
#include <utility>
#include <vector>

namespace rbres::RBRES_ABI {

/// How a contact law is learned. Plain numbers.
struct ContactLearning {
  /// Rollouts of a length: short ones find the law, long ones the errors that add up.
  struct Stage {
    int frames;      ///< of a rollout
    int stride;      ///< frames from the start of one rollout to that of the next
    int epochs;      ///< passes over all rollouts of this length
    int batch_size;  ///< rollouts of a step
  };
  /// One after the other.
  std::vector<Stage> stages{{1, 1, 8, 256}, {4, 2, 8, 64}, {16, 8, 24, 16}, {32, 16, 20, 8}};
  double learning_rate = 2e-3;  ///< falls along half a cosine over all stages
  double largest_gradient = 1;  ///< longer ones are clipped
  /// What is made small.
  RolloutLoss loss{};
  /// When in a frame the law looks at contacts.
  ContactMoment moment = ContactMoment::halfway;
  /// Contacts whose gap is smaller take part, in ways of a frame (ContactScales::gap()). More than the errors
  /// of measured poses: what touches may seem not to.
  double margin = 0.2;
  /// What the velocities of the trajectories are. A law learned from means takes SemiImplicitEuler where it
  /// is used, else Rk4.
  SceneStep::Velocity velocity = SceneStep::Velocity::instant;
  /// Of the network's first weights and the order of rollouts.
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
    if (!(margin > 0) || !is_finite(margin)) detail::refuse("ContactLearning::margin", "above 0", margin);
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
        flown.push_back(fly(System<double, 1>({scene.body(i)}), body_forces(set, scene, i), Rk4{},
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
/// are zero. Of `options` it takes the seed, and where a law looks at contacts. Throws Error where no bodies
/// of the set touch.
template <class Law>
Law untrained_law(const TrajectorySet& set, const ContactLearning& options = {}) {
  Law law;
  law.scales.moment = options.moment;
  law.network = typename Law::Network(options.seed);
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
    law.scales.margin = options.margin * law.scales.gap();
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
/// holds scenes of the same world that are not learned from and decide which weights are the best. Between
/// two epochs all that is learned stands in the trainer of the stage, so that a run can be interrupted
/// anywhere, also by a callback that throws, and saved (io/contact_training.hpp).
template <class Law>
class ContactTraining {
 public:
  /// Trains the network on rollouts of one length.
  using StageTrainer = Trainer<typename Law::Network, Clipped<Adam>, Rollouts<Law>>;

  /// Both sets must outlive it. Throws Error where the sets or options make no sense.
  ContactTraining(const TrajectorySet& train, const TrajectorySet& validation,
                  const ContactLearning& options = {})
      : options_(options), train_(&train), validation_(&validation) {
    options_.check();
    law_ = untrained_law<Law>(train, options_);
    double work = 0;
    for (const auto& stage : options_.stages) {
      const auto windows = detail::naming([] { return "training scenes: "; },
                                          [&] { return windows_of(train, stage, stage.stride).count(); });
      detail::naming([] { return "validation scenes: "; },
                     [&] { return windows_of(validation, stage, 2 * stage.frames); });
      work += static_cast<double>(windows) * stage.frames * stage.epochs;
      work_done_.push_back(work);
    }
    for (double& done : work_done_) done /= work;
    trainer_ = trainer_of(0, law_.network);
  }

  ContactTraining(const TrajectorySet&&, const TrajectorySet&, const ContactLearning& = {}) = delete;
  ContactTraining(const TrajectorySet&, const TrajectorySet&&, const ContactLearning& = {}) = delete;

  /// How many there are.
  int stages() const { return static_cast<int>(options_.stages.size()); }
  int stage() const { return stage_; }  ///< the one that runs: 0, 1, ...
  /// That of the stage that runs.
  const StageTrainer& trainer() const { return *trainer_; }

  /// The law with the best weights so far.
  Law law() const {
    Law law = law_;
    law.network = trainer_->best();
    return law;
  }

  /// Epochs until all stages are done (true) or the callback returns false, after which a second call goes
  /// on.
  bool train(const ContactLearningCallback& callback = {}) {
    for (;;) {
      trainer_->train([&](const EpochReport& epoch) { return !callback || callback(report(epoch)); });
      if (trainer_->state().progress.status == TrainingStatus::stopped) return false;
      if (stage_ + 1 == stages()) return true;
      trainer_ = trainer_of(stage_ + 1, trainer_->best());
      ++stage_;
    }
  }

  /// Goes on from a state that the trainer of this stage had: restore(trainer) puts it there. Where it
  /// throws, nothing has changed; Error for a stage that there is none of.
  template <std::invocable<StageTrainer&> Restore>
  void restore(int stage, const Restore& restore) {
    if (stage < 0 || stage >= stages())
      detail::refuse("ContactTraining: stage", detail::text("0 to ", stages() - 1), stage);
    auto trainer = trainer_of(stage, law_.network);
    restore(*trainer);
    trainer_ = std::move(trainer);
    stage_ = stage;
  }

 private:
  Rollouts<Law> windows_of(const TrajectorySet& set, const ContactLearning::Stage& stage, int stride) const {
    return {law_, set, stage.frames, stride, options_.loss, options_.velocity};
  }
  std::unique_ptr<StageTrainer> trainer_of(int number, const typename Law::Network& network) const {
    const auto& stage = options_.stages[static_cast<std::size_t>(number)];
    auto trainer = std::make_unique<StageTrainer>(
        network, windows_of(*train_, stage, stage.stride), windows_of(*validation_, stage, 2 * stage.frames),
        TrainingOptions{.epochs = stage.epochs,
                        .batch_size = stage.batch_size,
                        .l2 = 0,
                        .dropout = 0,
                        .patience = 0,
                        .seed = options_.seed + static_cast<std::uint64_t>(number),
                        .threads = options_.threads},
        Clipped<Adam>{{}, options_.largest_gradient});
    trainer->set_schedule(
        WarmUp{detail::StageSchedule{options_.learning_rate, begin(number), begin(number + 1)}, 100});
    return trainer;
  }
  /// The share of all work that is done when a stage begins.
  double begin(int stage) const { return stage > 0 ? work_done_[static_cast<std::size_t>(stage - 1)] : 0; }
  ContactLearningReport report(const EpochReport& epoch) const {
    const double own = begin(stage_ + 1) - begin(stage_);
    return {stage_, epoch, begin(stage_) + own * static_cast<double>(epoch.epoch) / epoch.epochs};
  }

  ContactLearning options_;
  const TrajectorySet *train_, *validation_;
  Law law_;                        ///< before it learns
  std::vector<double> work_done_;  ///< at the end of each stage, as a share of all
  int stage_ = 0;
  std::unique_ptr<StageTrainer> trainer_;
};

/// The law that a ContactTraining of these arguments comes to, or has come to when the callback returns
/// false.
template <class Law>
Law learn_contacts(const TrajectorySet& train, const TrajectorySet& validation,
                   const ContactLearning& options = {}, const ContactLearningCallback& callback = {}) {
  ContactTraining<Law> training(train, validation, options);
  training.train(callback);
  return training.law();
}

}  // namespace rbres::RBRES_ABI
