#pragma once

#include <rbres/sim/batch.hpp>

#include "follow.hpp"

namespace validate {

/// Runs of any duration in any step with any rate of samples, of balls that nothing pulls: how far the times
/// that are told, and the places where the bodies then are, are from the truth, over the duration. What is
/// refused is no error. A sample too many or too few counts 1.
template <class S>
Figure times(const Cases& cases) {
  using T = typename ScalarTraits<S>::Value;
  Figure worst;
  const World<Sphere<double>> balls = World<Sphere<double>>::of(Body{Sphere{0.1}, 1.0});
  const auto plain = balls.template cast<T>();
  each_case(cases, [&](long i, Random& r) {
    SimulationOptions options;
    options.duration = log_uniform(r, 1e-3, 10);
    options.step = options.duration / log_uniform(r, 0.1, 300);
    switch (r.below(4)) {
      case 0:
        break;  // after every step
      case 1:
        options.sample_rate = static_cast<double>(1 + r.below(30)) / options.duration;
        break;
      case 2:
        options.sample_rate = log_uniform(r, 0.1, 30) / options.duration;
        break;
      default:  // numbers that a person would write
        options.duration = 0.1 * (1 + r.below(20));
        options.step = r.below(2) == 0 ? 1.0 / (1 + r.below(150)) : 0.01 * (1 + r.below(100));
        options.sample_rate = 1 + r.below(30);
    }
    options.contacts = r.below(2) == 0 ? ContactMode::continuous : ContactMode::discrete;
    SystemState<T, bodies> start;
    for (int k = 0; k < bodies; ++k) start[k].position.x = T(k);
    const T speed = static_cast<T>(1 / options.duration);
    for (auto& body : start.body) body.velocity.z = speed;

    std::vector<double> told;
    double error = 0;
    const auto see = [&](double time, const SystemState<T, bodies>& y) {
      told.push_back(time);
      error = std::max(error, std::abs(static_cast<double>(y[1].position.z) - time / options.duration));
    };
    try {
      if constexpr (ScalarTraits<S>::lanes == 1) {
        auto y = start;
        const auto report = simulate(plain, y, Loads{}, Rk4{}, options, see);
        error = std::max(error, std::abs(report.time / options.duration - 1));
      } else {
        simulate_batch<S>(
            plain, 1, [&](std::ptrdiff_t) { return start; }, [](const auto&) { return Loads{}; }, Rk4{},
            options, [&](const auto& sample) { see(sample.time, sample.state); }, 1);
      }
    } catch (const Error&) {
      return;
    }
    // At 0, 1 / rate, 2 / rate, ... and at the end.
    if (told.size() < 2 || told.front() != 0) error = 1;
    if (!told.empty()) error = std::max(error, std::abs(told.back() / options.duration - 1));
    if (options.sample_rate > 0) {
      const double spans = options.duration * options.sample_rate;
      if (static_cast<double>(told.size()) != std::ceil(spans - 1e-9) + 1) error = 1;
      for (std::size_t k = 0; k + 1 < told.size(); ++k) {
        error = std::max(error,
                         std::abs(told[k] - static_cast<double>(k) / options.sample_rate) / options.duration);
      }
    } else {
      for (std::size_t k = 0; k + 1 < told.size(); ++k) {
        if (told[k + 1] - told[k] > options.step * (1 + 1e-9))
          error = std::max(error, (told[k + 1] - told[k] - options.step) / options.duration);
      }
    }
    worst(error, i,
          detail::text("step ", options.step, " s, duration ", options.duration, " s, ", options.sample_rate,
                       " Hz"));
  });
  return worst;
}

}  // namespace validate
