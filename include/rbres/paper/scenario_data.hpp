#pragma once

#include <cstdint>
#include <limits>
#include <rbres/paper/scenario.hpp>
#include <rbres/sim/batch.hpp>
#include <rbres/sim/transitions.hpp>
#include <span>

namespace rbres::RBRES_ABI {

/// Scenarios as columns: what they start from, and where truth is at some horizons. float, because that is
/// what networks learn from; absent bodies are zero.
struct ScenarioData {
  /// Room for so many in a column.
  static constexpr int bodies = Scenario::most_bodies;
  /// One sample a column.
  using Columns = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic>;

  std::vector<double> horizons;  ///< s
  Columns initial;               ///< 65 x scenarios: the state at the start, body by body
  Columns wrench;                ///< 30 x scenarios: force and torque of each body
  std::vector<Columns> states;   ///< for each horizon 65 x scenarios: truth
  /// Bodies of each scenario.
  std::vector<std::uint8_t> body_count;
  /// How each scenario was drawn.
  std::vector<Family> family;
  std::vector<float> first_contact;  ///< time of the first impact to within a sample, s; infinity: none
  /// Horizons x scenarios: impacts (approaches answered by an impulse) by each horizon.
  Eigen::Matrix<std::int32_t, Eigen::Dynamic, Eigen::Dynamic> impacts;

  /// How many scenarios there are.
  Eigen::Index count() const { return initial.cols(); }
};

/// How truth is made.
struct TruthOptions {
  double step = 5e-3;       ///< s; chosen by halving it, see the predictability floor of the experiment
  double sample_rate = 50;  ///< Hz; horizons are whole numbers of samples
  int threads = 0;          ///< 0: default_threads(); changes no bit
};

namespace detail {

/// Simulates `count` scenarios at(i) of N bodies each, those of S's lanes together; see(sample) as in
/// simulate_batch.
template <class S, BodySet Set, int N, class At, class See>
void simulate_lanes_of(World world, std::ptrdiff_t count, const At& at, const SimulationOptions& options,
                       const See& see, int threads) {
  simulate_batch<S>(
      scenario_system<Set, N>(world), count,
      [&](std::ptrdiff_t i) {
        SystemState<double, N> y;
        std::copy_n(at(i).state.body.begin(), N, y.body.begin());
        return y;
      },
      [&](const auto& lanes) { return scenario_forces<Set>(lane_wrenches<S, N>(lanes, at)); }, Rk4{}, options,
      see, threads);
}

/// The same in lanes where that is faster: boxes that slide and rest each need steps of their own.
template <BodySet Set, int N, class At, class See>
void simulate_lanes(World world, std::ptrdiff_t count, const At& at, const SimulationOptions& options,
                    const See& see, int threads) {
  if constexpr (Set == BodySet::box) {
    if (world == World::room)
      return simulate_lanes_of<double, Set, N>(world, count, at, options, see, threads);
  }
  simulate_lanes_of<Pack<double, double_lanes>, Set, N>(world, count, at, options, see, threads);
}

template <BodySet Set, int N>
void simulate_scenarios(World world, std::span<const Scenario> all, const std::vector<std::size_t>& chosen,
                        const TruthOptions& options, Eigen::Index start, ScenarioData& data) {
  simulate_lanes<Set, N>(
      world, std::ssize(chosen),
      [&](std::ptrdiff_t i) -> const Scenario& { return all[chosen[static_cast<std::size_t>(i)]]; },
      {.step = options.step, .duration = data.horizons.back(), .sample_rate = options.sample_rate},
      [&](const auto& sample) {
        const std::size_t column =
            static_cast<std::size_t>(start) + chosen[static_cast<std::size_t>(sample.scenario)];
        if (sample.impacts > 0 && !(data.first_contact[column] <= sample.time)) {
          data.first_contact[column] = static_cast<float>(sample.time);
        }
        for (std::size_t h = 0; h < data.horizons.size(); ++h) {
          if (sample.sample != std::lround(data.horizons[h] * options.sample_rate)) continue;
          data.impacts(static_cast<Eigen::Index>(h), static_cast<Eigen::Index>(column)) =
              static_cast<std::int32_t>(sample.impacts);
          auto to = data.states[h].col(static_cast<Eigen::Index>(column));
          to.template head<13 * N>() = sample.state.vector().template cast<float>();
          if (!sample.finite) to[0] = std::numeric_limits<float>::quiet_NaN();
        }
      },
      options.threads);
}

}  // namespace detail

namespace detail {

inline void check_horizons(const std::vector<double>& horizons, double sample_rate) {
  if (horizons.empty()) refuse("horizons", "at least one", "none");
  for (std::size_t h = 0; h < horizons.size(); ++h) {
    const double samples = horizons[h] * sample_rate;
    const bool whole = samples > 0.5 && std::abs(samples - std::round(samples)) < 1e-6;
    if (!whole || (h > 0 && !(horizons[h] > horizons[h - 1]))) {
      refuse(text("horizon ", h), "increasing times of a whole number of samples", horizons[h]);
    }
  }
}

/// Scenarios that are simulated at a time: all families and body counts in equal shares. Which scenarios
/// share lanes depends on it, and so do the last bits of truth where boxes rest.
inline constexpr Eigen::Index scenario_piece = 2304;

/// Columns start ... start + count - 1 of `data`: scenarios first + start, ... (A template of Data, as are
/// others of ScenarioData, so that only those who call it compile its expressions.)
template <BodySet Set, class Data>
void generate_piece(const ScenarioSampler<Set>& sampler, std::uint64_t first, Eigen::Index start,
                    Eigen::Index count, const TruthOptions& options, Data& data) {
  std::vector<Scenario> scenarios(static_cast<std::size_t>(count));
  parallel_for(count, options.threads, [&](std::ptrdiff_t i) {
    scenarios[static_cast<std::size_t>(i)] = sampler(first + static_cast<std::uint64_t>(start + i));
  });
  std::array<std::vector<std::size_t>, 3> by_count;  // those of 3, 4 and 5 bodies
  for (Eigen::Index i = 0; i < count; ++i) {
    const Scenario& s = scenarios[static_cast<std::size_t>(i)];
    data.initial.col(start + i).head(13 * s.bodies) = s.state.vector().head(13 * s.bodies).cast<float>();
    for (int b = 0; b < s.bodies; ++b) {
      const Eigen::Map<const Eigen::Matrix<double, 6, 1>> wrench(
          &s.wrench[static_cast<std::size_t>(b)].force.x);
      data.wrench.col(start + i).template segment<6>(6 * b) = wrench.cast<float>();
    }
    data.body_count[static_cast<std::size_t>(start + i)] = static_cast<std::uint8_t>(s.bodies);
    data.family[static_cast<std::size_t>(start + i)] = s.family;
    by_count[static_cast<std::size_t>(s.bodies - 3)].push_back(static_cast<std::size_t>(i));
  }
  simulate_scenarios<Set, 3>(sampler.world(), scenarios, by_count[0], options, start, data);
  simulate_scenarios<Set, 4>(sampler.world(), scenarios, by_count[1], options, start, data);
  simulate_scenarios<Set, 5>(sampler.world(), scenarios, by_count[2], options, start, data);
}

}  // namespace detail

/// Simulates scenarios first ... first + count - 1 of a sampler up to each horizon (s, increasing), piece by
/// piece; progress(done) is called at the start and after each. A scenario's column depends on nothing but
/// the sampler, its number and the options. Throws Error where a horizon is no whole number of samples, or
/// truth met a number that is not finite.
template <BodySet Set, class Progress>
ScenarioData generate(const ScenarioSampler<Set>& sampler, std::uint64_t first, Eigen::Index count,
                      const std::vector<double>& horizons, const TruthOptions& options, Progress&& progress) {
  if (count < 1) detail::refuse("number of scenarios", "1 or more", count);
  detail::check_horizons(horizons, options.sample_rate);
  const auto n = static_cast<std::size_t>(count);
  ScenarioData data{
      horizons,
      ScenarioData::Columns::Zero(65, count),
      ScenarioData::Columns::Zero(30, count),
      std::vector<ScenarioData::Columns>(horizons.size(), ScenarioData::Columns::Zero(65, count)),
      std::vector<std::uint8_t>(n),
      std::vector<Family>(n),
      std::vector<float>(n, std::numeric_limits<float>::infinity()),
      decltype(ScenarioData::impacts)::Zero(static_cast<Eigen::Index>(horizons.size()), count)};
  progress(Eigen::Index{0});
  for (Eigen::Index start = 0; start < count; start += detail::scenario_piece) {
    const Eigen::Index size = std::min(detail::scenario_piece, count - start);
    detail::generate_piece(sampler, first, start, size, options, data);
    for (const auto& states : data.states) {
      for (Eigen::Index c = start; c < start + size; ++c) {
        if (std::isfinite(states(0, c))) continue;
        detail::refuse(detail::text("truth of scenario ", first + static_cast<std::uint64_t>(c)),
                       "finite numbers", "others");
      }
    }
    progress(start + size);
  }
  return data;
}
/// The same without progress.
template <BodySet Set>
ScenarioData generate(const ScenarioSampler<Set>& sampler, std::uint64_t first, Eigen::Index count,
                      const std::vector<double>& horizons, const TruthOptions& options = {}) {
  return generate(sampler, first, count, horizons, options, [](Eigen::Index) {});
}

}  // namespace rbres::RBRES_ABI
