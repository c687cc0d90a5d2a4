#pragma once

#include <benchmark/benchmark.h>

#include <cmath>
#include <deque>
#include <string>

#include "scene.hpp"

namespace rbres::bench {

/// Runs every scene of a shape for its whole duration; building the worlds is not timed. An engine is
///   Engine(Shape, const std::vector<Start>&, double step, options...)
///   int step()            one step; returns the number of contact points at which bodies touch
///   double mean_height()  over the bodies
template <class Engine, class... Options>
void run_scenes(benchmark::State& state, Shape shape, double step, Options... options) {
  const long steps = std::lround(duration / step);
  double contacts = 0.0, height = 0.0;
  for (auto _ : state) {
    state.PauseTiming();
    std::deque<Engine> engines;
    for (int i = 0; i < scene_count; ++i) engines.emplace_back(shape, scene(i), step, options...);
    state.ResumeTiming();
    for (Engine& engine : engines)
      for (long i = 0; i < steps; ++i) contacts += engine.step();
    state.PauseTiming();
    height = 0.0;
    for (const Engine& engine : engines) height += engine.mean_height() / scene_count;
    engines.clear();
    state.ResumeTiming();
  }
  using benchmark::Counter;
  const double runs = static_cast<double>(state.iterations()) * scene_count;
  state.counters["us_per_scenario"] = Counter(runs * 1e-6, Counter::kIsRate | Counter::kInvert);
  state.counters["contacts_per_step"] = contacts / (runs * static_cast<double>(steps));
  state.counters["mean_height"] = height;
}

/// Registers SHAPE/ENGINE (steps of 2 ms) and SHAPE/ENGINE/10ms for both shapes.
template <class Engine, class... Options>
bool register_rows(const std::string& engine, Options... options) {
  for (const Shape shape : shapes) {
    const std::string row = std::string(name(shape)) + "/" + engine;
    const auto add = [&](const std::string& suffix, double step) {
      benchmark::RegisterBenchmark((row + suffix).c_str(), run_scenes<Engine, Options...>, shape, step,
                                   options...)
          ->Unit(benchmark::kMillisecond);
    };
    add("", 0.002);
    add("/10ms", 0.010);
  }
  return true;
}

}  // namespace rbres::bench
