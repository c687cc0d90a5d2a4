// Writes the trajectories from which the page's contact law was learned: scenes of the page's own world.
#include <rbres/io/trajectories.hpp>

#include "../common/command_line.hpp"
#include "world.hpp"

namespace {

using namespace web;

constexpr int steps_per_law_frame = 2, frames = 240;

Trajectory simulated(int seed) {
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

void run(const std::filesystem::path& folder) {
  // What cannot be written is found out before the scenes are simulated.
  for (const char* name : {"train", "test"}) detail::make_empty_folder(folder / name);
  const auto write = [&](const char* name, int first, int count) {
    std::vector<Trajectory> scenes;
    for (int i = 0; i < count; ++i) scenes.push_back(simulated(first + i));
    write_trajectories(
        folder / name,
        {steps_per_law_frame * step, {0, 0, -9.81}, World({}).room().planes(), std::move(scenes)});
  };
  write("train", 10'000, 600);
  write("test", 20'000, 60);
}

}  // namespace

int main(int argc, char** argv) {
  std::string folder;
  CLI::App app{
      "Writes FOLDER/train and FOLDER/test: the trajectories from which the page's contact law was learned."};
  app.add_option("FOLDER", folder, "where the sets go")->required();
  return run_program("rbres_web_scenes", app, argc, argv, [&] { run(folder); });
}
