#include "contact_law.hpp"

#include <chrono>
#include <rbres/io/contact_law.hpp>
#include <rbres/io/contact_training.hpp>
#include <rbres/paper/scenario_trajectories.hpp>

#include "../scenarios/compiled.hpp"

namespace paper {

namespace {

constexpr double frame_time = 0.02, duration = 2;  // s

template <BodySet Set, int N>
void run(const LawScenario<Set>& scenario, const typename LawScenario<Set>::State& y,
         const typename LawScenario<Set>::Wrenches& wrench,
         std::span<typename LawScenario<Set>::State> states) {
  SystemState<double, N> now;
  ConstantWrench<double, N> own;
  std::copy_n(y.body.begin(), N, now.body.begin());
  std::copy_n(wrench.begin(), N, own.wrench.begin());
  for (auto& next : states) {
    simulate(scenario_system<Set, N>(scenario.world), now, scenario_forces<Set>(own), Rk4{}, *scenario.law,
             {.step = frame_time, .duration = scenario.horizon});
    next = y;
    std::copy_n(now.body.begin(), N, next.body.begin());
  }
}

}  // namespace

template <BodySet Set>
Law learn_law(World world, const LawProtocol& protocol, std::uint64_t seed,
              const std::filesystem::path& checkpoint,
              const std::function<void(const ContactLearningReport&)>& say) {
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

template <BodySet Set>
void LawScenario<Set>::rollout(const State& y, const Wrenches& wrench, std::span<State> states,
                               int present) const {
  if (present < 3 || present > 5) detail::refuse("bodies of a scenario", "3 to 5", present);
  present == 3   ? run<Set, 3>(*this, y, wrench, states)
  : present == 4 ? run<Set, 4>(*this, y, wrench, states)
                 : run<Set, 5>(*this, y, wrench, states);
}

template struct LawScenario<BodySet::standard>;
template struct LawScenario<BodySet::box>;
template Law learn_law<BodySet::standard>(World, const LawProtocol&, std::uint64_t,
                                          const std::filesystem::path&,
                                          const std::function<void(const ContactLearningReport&)>&);
template Law learn_law<BodySet::box>(World, const LawProtocol&, std::uint64_t, const std::filesystem::path&,
                                     const std::function<void(const ContactLearningReport&)>&);

}  // namespace paper
