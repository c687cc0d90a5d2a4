#include "contact_law.hpp"

#include <algorithm>
#include <chrono>
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
                                   const std::filesystem::path& checkpoint,
                                   const std::function<void(const ContactLearningReport&)>& say) -> Law {
  // The tables' scenarios have lower numbers.
  constexpr std::uint64_t first = 1'000'000;
  const ScenarioSampler<Set> sampler(world, 1);
  const Eigen::Index kept_apart = protocol.scenarios / 5;
  const TrajectorySet fit = scenario_trajectories(sampler, first, protocol.scenarios, frame_time, duration);
  const TrajectorySet choose = scenario_trajectories(
      sampler, first + static_cast<std::uint64_t>(protocol.scenarios), kept_apart, frame_time, duration);
  ContactLearning options;
  options.stages = {
      {1, 1, 5 * protocol.epochs, 256}, {4, 2, 2 * protocol.epochs, 64}, {16, 8, 2 * protocol.epochs, 16}};
  options.loss = {.position = {200, 0.1}, .rotation = {35, 0.2}, .velocity = {20, 1}, .spin = {5, 4}};
  options.moment = ContactMoment::impact;
  options.seed = seed;
  ContactTraining<Law> training(fit, choose, options);
  if (std::filesystem::exists(checkpoint)) load_checkpoint(checkpoint, training);
  auto saved = std::chrono::steady_clock::now();
  training.train([&](const ContactLearningReport& report) {
    say(report);
    if (std::chrono::steady_clock::now() - saved > std::chrono::seconds(4)) {
      save_checkpoint(checkpoint, training);
      saved = std::chrono::steady_clock::now();
    }
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
