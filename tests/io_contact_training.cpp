// Learning a contact law that is interrupted and goes on.
#include <rbres/io/contact_training.hpp>

#include <algorithm>
#include <stdexcept>

#include "io_support.hpp"

using namespace rbres;

namespace {

using Law = ContactLaw<4, 2>;
using Training = ContactTraining<Law>;

/// Two balls that bounce against a wall and one another, each as fast as before.
TrajectorySet bounces(int scenes, std::uint64_t seed) {
  const std::vector<Body<double>> balls{{Sphere{0.1}, 1.0}, {Sphere{0.1}, 1.0}};
  std::vector<Trajectory> all;
  for (int s = 0; s < scenes; ++s) {
    Random random(seed, static_cast<std::uint64_t>(s));
    std::vector<RigidState<double>> states(2);
    states[0].position = {0.15 + 0.1 * random.uniform(), 0, 0};
    states[1].position = {0.5 + 0.1 * random.uniform(), 0, 0};
    states[0].velocity = {-1 - random.uniform(), 0, 0};
    states[1].velocity = {-0.5, 0, 0};
    for (int t = 1; t < 40; ++t) {
      RigidState<double> a = states[states.size() - 2], b = states[states.size() - 1];
      a.position += 0.01 * a.velocity, b.position += 0.01 * b.velocity;
      if (a.position.x < 0.1 && a.velocity.x < 0) a.velocity.x *= -1;
      if (b.position.x - a.position.x < 0.2 && a.velocity.x > b.velocity.x) std::swap(a.velocity, b.velocity);
      states.push_back(a);
      states.push_back(b);
    }
    all.push_back({balls, states});
  }
  return {0.01, {0, 0, 0}, {{{1, 0, 0}, 0, {}}}, all};
}

struct Scenes {
  TrajectorySet train = bounces(6, 1), validation = bounces(2, 2);
};
const ContactLearning brief{.stages = {{1, 2, 3, 32}, {8, 4, 3, 16}}, .seed = 5, .threads = 2};
constexpr int epochs = 6;

bool same(const Law& a, const Law& b) {
  return std::ranges::equal(a.network.parameters(), b.network.parameters()) && a.input.mean == b.input.mean &&
         a.scales.margin == b.scales.margin;
}

/// Epochs of a training that goes on from `path`, where there is such a file, until its process would be
/// killed.
Law run(const Scenes& scenes, const std::filesystem::path& path, int epochs_until_killed,
        ContactLearning options = brief) {
  Training training(scenes.train, scenes.validation, options);
  if (std::filesystem::exists(path)) load_checkpoint(path, training);
  training.train([&](const ContactLearningReport&) {
    save_checkpoint(path, training);
    return --epochs_until_killed > 0;
  });
  return training.law();
}

}  // namespace

TEST_CASE("killed after any epoch, learning goes on from its checkpoint and ends with the same bits") {
  const Scenes scenes;
  const Law whole = learn_contacts<Law>(scenes.train, scenes.validation, brief);
  const TemporaryFolder folder;
  for (int killed = 1; killed < epochs; ++killed) {
    CAPTURE(killed);
    const auto path = folder / "checkpoint";
    std::filesystem::remove(path);
    CHECK(!same(run(scenes, path, killed), whole));
    ContactLearning other = brief;
    other.threads = 1;
    CHECK(same(run(scenes, path, epochs, other), whole));
    CHECK(same(run(scenes, path, epochs), whole));  // of a run that was done
  }
}

TEST_CASE("what a callback throws goes to the caller, and learning goes on as if nothing had been") {
  const Scenes scenes;
  Training training(scenes.train, scenes.validation, brief);
  int calls = 0;
  const auto restless = [&](const ContactLearningReport&) -> bool {
    ++calls;
    throw std::runtime_error("no disk");
  };
  for (int k = 0; k < epochs; ++k) CHECK_THROWS_AS(training.train(restless), std::runtime_error);
  CHECK(training.train(restless));
  CHECK(calls == epochs);
  CHECK(same(training.law(), learn_contacts<Law>(scenes.train, scenes.validation, brief)));
}

TEST_CASE("checkpoints of other scenes, options or stages are refused, and change nothing") {
  const Scenes scenes;
  const TemporaryFolder folder;
  const auto path = folder / "checkpoint";
  run(scenes, path, 4);
  const auto refused = [&](const TrajectorySet& train, const ContactLearning& options) {
    Training training(train, scenes.validation, options);
    CHECK_THROWS_AS(load_checkpoint(path, training), Error);
    CHECK(training.stage() == 0);
    CHECK(training.trainer().state().progress.epoch == 0);
  };
  refused(bounces(6, 3), brief);
  ContactLearning other = brief;
  other.seed = 6;
  refused(scenes.train, other);
  other = brief;
  other.stages.pop_back();
  refused(scenes.train, other);
  // Heavier balls take the same ways.
  std::vector<Trajectory> heavy;
  for (const Trajectory& scene : scenes.train)
    heavy.push_back({{{Sphere{0.1}, 2.0}, {Sphere{0.1}, 2.0}}, scene.states()});
  refused({0.01, {0, 0, 0}, scenes.train.planes(), heavy}, brief);
  Training training(scenes.train, scenes.validation, brief);
  CHECK_THROWS_AS(training.restore(2, [](auto&) {}), Error);
  CHECK_THROWS_AS(training.restore(-1, [](auto&) {}), Error);
}
