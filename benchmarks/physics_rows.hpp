#pragma once

#include <benchmark/benchmark.h>

#include <cmath>
#include <deque>
#include <string>
#include <vector>

#include "scene.hpp"

namespace rbres::bench {

/// Runs `scenes` scenes for their whole duration; building the worlds is not timed. `build` gives a container
/// of engines that together hold the scenes. An engine has
///   void step()           takes all of its scenes one step
///   double contacts()     points (rbres: pairs of bodies) found touching, summed over its scenes and steps
///   double mean_height()  over the bodies of its scenes
template <class Build>
void run_scenes(benchmark::State& state, int scenes, double seconds, double step, const Build& build) {
  const long steps = std::lround(seconds / step);
  double contacts = 0.0, height = 0.0;
  for (auto _ : state) {
    state.PauseTiming();
    auto engines = build();
    state.ResumeTiming();
    for (auto& engine : engines)
      for (long i = 0; i < steps; ++i) engine.step();
    state.PauseTiming();
    contacts = height = 0.0;
    for (const auto& engine : engines) {
      contacts += engine.contacts();
      height += engine.mean_height() / static_cast<double>(engines.size());
    }
    engines.clear();
    state.ResumeTiming();
  }
  using benchmark::Counter;
  const double runs = static_cast<double>(state.iterations()) * scenes;
  state.counters["us_per_scenario"] = Counter(runs * 1e-6, Counter::kIsRate | Counter::kInvert);
  state.counters["contacts_per_step"] = contacts / static_cast<double>(scenes * steps);
  state.counters["mean_height"] = height;
}

/// Registers SHAPE/ENGINE (steps of 2 ms) and SHAPE/ENGINE/10ms; build(step) gives the engines.
template <class Build>
void register_rows(Shape shape, const std::string& engine, const Build& build) {
  const auto add = [&](const std::string& suffix, double step) {
    benchmark::RegisterBenchmark((std::string(name(shape)) + "/" + engine + suffix).c_str(),
                                 [=](benchmark::State& state) {
                                   run_scenes(state, scene_count, duration, step,
                                              [&] { return build(step); });
                                 })
        ->Unit(benchmark::kMillisecond);
  };
  add("", 0.002);
  add("/10ms", 0.010);
}

/// Registers WORK/ENGINE: scenes of the same length in steps of 2 ms, each in an Engine(scene, step,
/// options...).
template <class Engine, class... Options>
void register_scenes(const std::string& name, const std::vector<Scene>& scenes, Options... options) {
  benchmark::RegisterBenchmark(name.c_str(), [=](benchmark::State& state) {
    constexpr double step = 0.002;
    run_scenes(state, static_cast<int>(scenes.size()), scenes.front().seconds, step, [&] {
      std::deque<Engine> engines;
      for (const Scene& scene : scenes) engines.emplace_back(scene, step, options...);
      return engines;
    });
  })->Unit(benchmark::kMillisecond);
}

/// The rows of a peer, one world for each scene: Peer(scene, step, options...).
template <class Peer, class... Options>
bool register_peer(const std::string& engine, Options... options) {
  for (const Shape shape : shapes)
    register_rows(shape, engine, [=](double step) {
      std::deque<Peer> worlds;
      for (int i = 0; i < scene_count; ++i) worlds.emplace_back(thrown(shape, i), step, options...);
      return worlds;
    });
  return true;
}

/// The rows of a peer with many bodies.
template <class Peer>
bool register_crowds(const std::string& engine) {
  register_scenes<Peer>("pile60/" + engine, piles(60));
  register_scenes<Peer>("stack20/" + engine, {stack(20)});
  register_scenes<Peer>("gas1000/" + engine, {gas(1000)});
  return true;
}

}  // namespace rbres::bench
