// Writes the trajectories from which the page's contact law was learned: scenes of the page's own world.
#include <rbres/io/trajectories.hpp>

#include <cstdio>

#include "../common/help.hpp"
#include "world.hpp"

namespace {

using namespace web;

constexpr int steps_per_law_frame = 2, frames = 240;

Trajectory run(int seed) {
  World world({.bodies = 6, .seed = seed});
  std::vector<Body<double>> bodies;
  std::vector<RigidState<double>> states;
  for (int i = 0; i < world.bodies(); ++i) bodies.push_back(world.room()[i]);
  for (int k = 0; k < frames; ++k) {
    for (int i = 0; i < world.bodies(); ++i) states.push_back(world.state()[i]);
    if (!world.advance(steps_per_law_frame)) detail::fail(detail::text("scene ", seed, " is not finite"));
  }
  return {bodies, states};
}

void write(const std::filesystem::path& folder, int first, int count) {
  std::vector<Trajectory> scenes;
  for (int i = 0; i < count; ++i) scenes.push_back(run(first + i));
  write_trajectories(
      folder, {steps_per_law_frame * step, {0, 0, -9.81}, World({}).room().planes(), std::move(scenes)});
}

}  // namespace

int main(int count, char** words) {
  constexpr const char* usage =
      "usage: rbres_web_scenes [--help] FOLDER\n"
      "Writes the trajectories from which the page's contact law was learned to FOLDER/train and "
      "FOLDER/test.\n";
  if (asks_for_help(count, words)) return print_help(words, usage);
  if (count != 2) {
    std::fputs(usage, stderr);
    return 2;
  }
  try {
    const std::filesystem::path folder = words[1];
    write(folder / "train", 10'000, 600);
    write(folder / "test", 20'000, 60);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
