// Learns from measured tosses of a cube, and says how far the predictors are from tosses that none of them
// has seen; learned ones also with weights of half the size.
#include <chrono>
#include <cstdio>
#include <span>
#include <string>

#include <rbres/learn/contact_law_simulator.hpp>

#include "common/command_line.hpp"
#include "common/scenes.hpp"
#include "contacts/laws.hpp"
#include "tosses/score.hpp"
#include "tosses/toss.hpp"

namespace {

using namespace rbres;
using namespace rbres::tosses;

struct Options {
  std::string folder, test_file;
  bool json = false;
  std::uint64_t seed = 1;
};

constexpr SceneStep::Velocity mean = SceneStep::Velocity::mean;
using contacts_program::Hybrid;
using contacts_program::Law;

/// Positions count in 1.4 cm, angles in 0.1 rad. From single frames to whole tosses; the hybrid starts from
/// the simulator, which is right in the main, with long rollouts. Poses and the cube's size are known to
/// about 1 mm, and the margin is twice that.
ContactLearning learning(std::vector<ContactLearning::Stage> stages, double rate, std::uint64_t seed) {
  return {.stages = std::move(stages),
          .learning_rate = rate,
          .loss = {{70, 1}, {10, 3}, {0.7, 5}, {0.03, 50}, 3},
          .margin = 0.6,
          .velocity = mean,
          .seed = seed};
}
ContactLearning law_learning(std::uint64_t seed) {
  return learning({{1, 1, 2, 256}, {4, 2, 4, 64}, {16, 4, 8, 32}, {40, 8, 10, 32}, {79, 8, 20, 32}}, 2e-3,
                  seed);
}
ContactLearning hybrid_learning(std::uint64_t seed) {
  return learning({{40, 8, 8, 64}, {79, 4, 16, 64}}, 5e-4, seed);
}

/// Friction, restitution, gravity, inertia and size; and the floor's height, which with the cube's size says
/// where it comes to rest. What a cube does after several impacts has as many kinks as there are tosses: a
/// finer search would follow them.
Identification identify_world(const TrajectorySet& tosses) {
  IdentifyOptions options{.step = {.steps = 1, .velocity = mean}, .fit = {.tolerance = 0.1}};
  options.unknowns.push_back(Unknown::offset);
  const Identification found = identify(tosses, options);
  std::fprintf(stderr, "%d tosses\n", tosses.size());
  print_numbers(found);
  return found;
}

template <class L>
L learned(const char* name, const Parts& tosses, const ContactLearning& options) {
  const auto start = std::chrono::steady_clock::now();
  return learn_contacts<L>(tosses.fit, tosses.choose, options, [&](const ContactLearningReport& report) {
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::fprintf(stderr, "%s: rollouts of %d frames, epoch %llu of %d, loss %.3f, %.0f s to go\n", name,
                 options.stages[static_cast<std::size_t>(report.stage)].frames,
                 static_cast<unsigned long long>(report.epoch.epoch), report.epoch.epochs,
                 report.epoch.validation_loss, seconds * (1 - report.share_done) / report.share_done);
    return true;
  });
}

struct Row {
  const char* predictor;
  Score score;
};

void print_json(std::span<const Row> rows) {
  std::puts("[");
  for (const Row& row : rows)
    std::printf("  {\"predictor\": \"%s\", \"position_m\": %.6f, \"rotation_rad\": %.6f}%s\n", row.predictor,
                row.score.position, row.score.rotation, &row == &rows.back() ? "" : ",");
  std::puts("]");
}
void print_table(std::span<const Row> rows) {
  for (const Row& row : rows)
    std::printf("%-24s %10.4f %13.3f\n", row.predictor, row.score.position, row.score.rotation);
}

void run(const Options& options) {
  const std::filesystem::path folder = options.folder;
  const std::filesystem::path test_file =
      options.test_file.empty() ? folder / "validation.npy" : std::filesystem::path(options.test_file);
  const auto train_tosses = read_tosses(folder / "train.npy"), test_tosses = read_tosses(test_file);
  const double floor = floor_height(train_tosses);
  const TrajectorySet train = toss_set(train_tosses, floor), nominal = toss_set(test_tosses, floor);

  const Identification world = identify_world(train);
  const TrajectorySet tosses = world.numbers().world_of(train), test = world.numbers().world_of(nominal);
  const Parts parts(until_rest(tosses, 81));
  const auto law = learned<Law>("network", parts, law_learning(options.seed));
  auto hybrid = learned<Hybrid>("hybrid", parts, hybrid_learning(options.seed));
  hybrid.weight = best_weight(hybrid, [&](const Hybrid& law) {
    const Score s = score(
        parts.choose, [&](const auto& toss) { return ContactLawSimulator(parts.choose, toss, law, mean); });
    return s.position + half_width * s.rotation;
  });
  const auto free = [&](const Trajectory& toss) { return FreeFlight(nominal, toss, mean); };
  const auto fitted = [&](const Trajectory& toss) { return SceneSimulator(test, toss, {}, world.step); };
  const auto by = [&](const auto& learned_law) {
    return score(test, [&](const auto& t) { return ContactLawSimulator(test, t, learned_law, mean); });
  };
  const Row rows[] = {{"contact-free flow", score(nominal, free)},
                      {"fitted simulator", score(test, fitted)},
                      {"network alone", by(law)},
                      {"hybrid", by(hybrid)}};
  if (options.json) {
    print_json(rows);
  } else {
    const Row halves[] = {{"network alone, bfloat16", by(with_weights<bfloat16>(law))},
                          {"hybrid, bfloat16", by(with_weights<bfloat16>(hybrid))}};
    std::printf("%-24s %10s %13s\n", "80-frame rollouts", "position m", "rotation rad");
    print_table(rows);
    print_table(halves);
  }
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app{
      "Identifies friction, restitution, gravity, inertia, size and floor, and learns a contact law, alone "
      "and "
      "as a correction of the simulator (hybrid), from FOLDER/train.npy (the ContactNets cube tosses: a row "
      "per frame at 148 Hz, 14 columns: toss number, position in m, quaternion with its real part first, "
      "velocity in m/s, body-frame angular velocity in rad/s). Prints the mean position and rotation errors "
      "of 80-frame rollouts from the first frame of each toss of FOLDER/validation.npy. Takes some minutes. "
      "A file that is missing, or has a single broken row, is refused. Exit status: 0, or 2 with one line "
      "that says why."};
  app.add_option("FOLDER", options.folder, "of train.npy and validation.npy")->required();
  app.add_option("--test", options.test_file, "report on this file instead of FOLDER/validation.npy");
  flag(app, "--json", options.json,
       "print an array of {\"predictor\", \"position_m\", \"rotation_rad\"} instead of the table");
  seed_number(app, "--seed", options.seed, "of the networks' first weights and the order of training");
  return run_program("rbres_tosses", app, argc, argv, [&] { run(options); });
}
