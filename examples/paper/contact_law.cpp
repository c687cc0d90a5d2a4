#include "contact_law.hpp"

#include <algorithm>
#include <cmath>
#include <rbres/io/contact_law.hpp>
#include <rbres/io/contact_training.hpp>
#include <rbres/learn/contact_law_simulator.hpp>
#include <rbres/paper/scenario_trajectories.hpp>

#include "../scenarios/compiled.hpp"

namespace paper {

namespace {

constexpr double frame_time = 0.02, duration = 2;  // s

}  // namespace

template <LawKind Kind, BodySet Set>
auto LawScenario<Kind, Set>::learn(World world, const LawProtocol& protocol, std::uint64_t seed,
                                   const std::filesystem::path& checkpoint, const UnitRun& run) -> Law {
  // The tables' scenarios have lower numbers.
  constexpr std::uint64_t first = 1'000'000;
  const ScenarioSampler<Set> sampler(world, 1);
  const Eigen::Index kept_apart = protocol.scenarios / 5;
  const auto trajectories = [&](std::uint64_t from, Eigen::Index count) {
    return scenario_trajectories(sampler, from, count, frame_time, duration, {.threads = run.threads});
  };
  const TrajectorySet fit = trajectories(first, protocol.scenarios);
  const TrajectorySet choose =
      trajectories(first + static_cast<std::uint64_t>(protocol.scenarios), kept_apart);
  ContactLearning options;
  options.stages = {
      {1, 1, 5 * protocol.epochs, 256}, {4, 2, 2 * protocol.epochs, 64}, {16, 8, 2 * protocol.epochs, 16}};
  options.loss = {.position = {200, 0.1}, .rotation = {35, 0.2}, .velocity = {20, 1}, .spin = {5, 4}};
  options.moment = ContactMoment::impact;
  options.seed = seed;
  options.threads = run.threads;
  ContactTraining<Law> training(fit, choose, options);
  if (std::filesystem::exists(checkpoint)) load_checkpoint(checkpoint, training);
  Every checkpoints(run.checkpoint_every);
  training.train([&](const ContactLearningReport& report) {
    if (checkpoints.due()) save_checkpoint(checkpoint, training);
    run.advance(report.share_done);
    return true;
  });
  return training.law();
}

template <LawKind Kind, BodySet Set>
void LawScenario<Kind, Set>::rollout(const State& y, const Wrenches& wrench, std::span<State> states,
                                     int present) const {
  const Body<double, ShapeOf<Set>> own = scenario_body<Set>();
  const Body<double> body(own.shape(), own.mass(), own.inertia(), own.material());
  const auto [gravity, friction, damping] = scenario_forces<Set>().models;
  ContactLawSimulator simulator(SceneSystem(std::vector(static_cast<std::size_t>(present), body),
                                            scenario_system<Set, 1>(world).planes()),
                                SceneForces{gravity, {friction, damping}, {{wrench.begin(), wrench.end()}}},
                                *law);
  SceneState now{{y.body.begin(), y.body.begin() + present}};
  const long frames = std::lround(horizon / frame_time);
  for (auto& next : states) {
    for (long k = 0; k < frames; ++k) simulator(now);
    next = y;
    std::copy_n(now.body.begin(), present, next.body.begin());
  }
}

template struct LawScenario<LawKind::alone, BodySet::standard>;
template struct LawScenario<LawKind::alone, BodySet::box>;
template struct LawScenario<LawKind::hybrid, BodySet::standard>;
template struct LawScenario<LawKind::hybrid, BodySet::box>;

}  // namespace paper
