// Learns from measured tosses of a cube, and says how far four predictors are from tosses that none of them
// has seen.
#include <chrono>
#include <cstdio>
#include <cstring>
#include <string>

#include "tosses/simulator.hpp"
#include "tosses/training.hpp"

namespace {

using namespace rbres;
using namespace rbres::tosses;

constexpr const char* usage =
    "usage: rbres_tosses FOLDER [--test FILE] [--json] [--help]\n"
    "Fits the simulator's friction and restitution and trains a network and a hybrid on FOLDER/train.npy "
    "(the\n"
    "ContactNets cube tosses: a row per frame at 148 Hz, 14 columns: toss number, position in m, quaternion "
    "with its\n"
    "real part first, velocity in m/s, body-frame angular velocity in rad/s). Prints the mean position and "
    "rotation\n"
    "errors of 80-frame rollouts from the first frame of each toss of FOLDER/validation.npy. Takes some "
    "minutes.\n"
    "  --test FILE  report on this file instead of FOLDER/validation.npy\n"
    "  --json       print an array of {\"predictor\", \"position_m\", \"rotation_rad\"} instead of the "
    "table\n"
    "A file that is missing, or has a single broken row, is refused. Exit status: 0, or 2 with one line that "
    "says why.\n";

/// One network for all corners; its last layer starts at zero, so that training starts from the prior's own
/// motion.
using Net = Network<float, Sequential<Linear<36, 64>, Relu, Residual<Linear<64, 64>, Relu, Linear<64, 64>>,
                                      Linear<64, Corner<double>::coefficients>>>;

Net new_network(std::uint64_t seed) {
  Net network(seed);
  const auto tensors = Net::tensors();
  const ParameterTensor& last = tensors[tensors.size() - 2];
  for (int r = 0; r < last.rows; ++r) {
    for (int c = 0; c < last.columns; ++c) network.parameters()[last.index(r, c)] = 0;
  }
  return network;
}

CornerPredictor<Net> trained(const char* name, const Prior& prior, double floor,
                             const std::vector<Toss>& tosses) {
  CornerPredictor<Net> predictor{new_network(1), prior, floor};
  const RolloutTraining options;
  const auto start = std::chrono::steady_clock::now();
  train(predictor, tosses, options, [&](int step, double error) {
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::fprintf(stderr, "%s: step %d of %d, error over %d frames %.2f mm, %.0f s to go\n", name, step,
                 options.steps, options.frames, 1e3 * error, seconds / step * (options.steps - step));
  });
  return predictor;
}

struct Row {
  const char* predictor;
  Score score;
};

void run(const std::filesystem::path& folder, std::filesystem::path test_file, bool json) {
  if (test_file.empty()) test_file = folder / "validation.npy";
  const std::vector<Toss> tosses = read_tosses(folder / "train.npy"), test = read_tosses(test_file);

  const double floor = floor_height(tosses);
  const Material<double> material = fit_material(tosses, floor);
  std::fprintf(stderr, "%zu tosses; floor at %.2f mm, friction %.3f, restitution %.3f\n", tosses.size(),
               1e3 * floor, material.friction, material.restitution);
  const Simulator simulator(material, floor);
  const auto network = trained("network", free_flight, floor, tosses);
  const auto hybrid = trained("hybrid", simulator, floor, tosses);
  const Row rows[] = {{"contact-free flow", score(free_flight, test)},
                      {"fitted simulator", score(simulator, test)},
                      {"network alone", score(network, test)},
                      {"hybrid", score(hybrid, test)}};

  if (!json) std::printf("%-18s %10s %13s\n", "80-frame rollouts", "position m", "rotation rad");
  if (json) std::puts("[");
  for (const Row& row : rows) {
    if (json) {
      std::printf("  {\"predictor\": \"%s\", \"position_m\": %.6f, \"rotation_rad\": %.6f}%s\n",
                  row.predictor, row.score.position, row.score.rotation,
                  &row == std::end(rows) - 1 ? "" : ",");
    } else {
      std::printf("%-18s %10.4f %13.3f\n", row.predictor, row.score.position, row.score.rotation);
    }
  }
  if (json) std::puts("]");
}

}  // namespace

int main(int argc, char** argv) {
  std::string folder, test_file;
  bool json = false;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument == "--help") {
      std::fputs(usage, stdout);
      return 0;
    } else if (argument == "--json") {
      json = true;
    } else if (argument == "--test" && i + 1 < argc) {
      test_file = argv[++i];
    } else if (folder.empty() && !argument.starts_with("-")) {
      folder = argument;
    } else {
      std::fprintf(stderr, "rbres_tosses: %s %s; see --help\n",
                   argument == "--test" ? "no file after" : "unexpected argument", argument.c_str());
      return 2;
    }
  }
  if (folder.empty()) {
    std::fputs("rbres_tosses: which folder holds train.npy? see --help\n", stderr);
    return 2;
  }
  try {
    run(folder, test_file, json);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "rbres_tosses: %s\n", error.what());
    return 2;
  }
  return 0;
}
