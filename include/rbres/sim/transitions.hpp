#pragma once

#include <rbres/sim/batch.hpp>

#include <array>
#include <cstddef>
#include <vector>

namespace rbres::RBRES_ABI {

/// Where N bodies start, and the wrench on each (force in world frame, N; torque in body frame, N m) that
/// stays the same from there on.
template <int N>
struct Start {
  /// Where they are at the start.
  SystemState<double, N> state;
  /// Constant, on each body: force in world frame, N; torque in body frame, N m.
  std::array<Wrench<double>, std::size_t(N)> wrench{};
};

/// Starts of a world of N bodies, and where they have led one horizon later: what a Predictor is trained on
/// and measured with.
template <int N>
struct Transitions {
  static constexpr int bodies = N;  ///< N

  double horizon = 0;  ///< s
  /// Where they begin.
  std::vector<Start<N>> starts;
  std::vector<SystemState<double, N>> ends;  ///< as many as starts
  /// Whether an impact came before the end; as many as starts, or none where that is not known.
  std::vector<char> collided{};

  /// How many transitions there are.
  std::ptrdiff_t count() const { return std::ssize(starts); }
  /// How many bodies transition c has: the first ones.
  int present(std::ptrdiff_t) const { return N; }
  /// The state at the start of transition c.
  const SystemState<double, N>& start(std::ptrdiff_t c) const { return starts[at(c)].state; }
  /// The wrench on each body during transition c.
  const std::array<Wrench<double>, std::size_t(N)>& wrench(std::ptrdiff_t c) const {
    return starts[at(c)].wrench;
  }
  /// The state at the end of transition c.
  const SystemState<double, N>& end(std::ptrdiff_t c) const { return ends[at(c)]; }
  /// Whether transition c is known to have had an impact.
  bool had_impact(std::ptrdiff_t c) const { return !collided.empty() && collided[at(c)]; }
  /// Error where `ends` or `collided` are not as many as they must be.
  void check() const {
    if (ends.size() != starts.size())
      detail::refuse("ends of transitions", detail::text(starts.size(), ", as many as starts"), ends.size());
    if (!collided.empty() && collided.size() != starts.size())
      detail::refuse("impacts of transitions", detail::text(starts.size(), ", as many as starts, or none"),
                     collided.size());
  }

 private:
  static std::size_t at(std::ptrdiff_t c) { return static_cast<std::size_t>(c); }
};

namespace detail {

/// The wrenches of at(i) for the scenarios i in the lanes of S.
template <class S, int N, class Index, class At>
ConstantWrench<S, N> lane_wrenches(const Index& lanes, const At& at) {
  ConstantWrench<S, N> packed;
  for (int l = 0; l < ScalarTraits<S>::lanes; ++l)
    set_lane(packed, l, at(lanes[static_cast<std::size_t>(l)]).wrench);
  return packed;
}

}  // namespace detail

/// Simulates the user's own world from start(0) ... start(count - 1), Start<N>s, over options.duration (s),
/// under `forces` and each start's own wrenches, in lanes and over `threads` threads (0: default_threads();
/// no bit depends on them). Orientations are made unit. Throws Error for what simulate_batch refuses, and
/// where a number does not stay finite.
template <int N, class Shape, int P, class Model, class Integrator, class MakeStart>
Transitions<N> simulate_transitions(const System<double, N, Shape, P>& system, const Model& forces,
                                    const Integrator& integrator, std::ptrdiff_t count,
                                    const MakeStart& start, const SimulationOptions& options,
                                    int threads = 0) {
  using Lanes = Pack<double, detail::double_lanes>;
  if (count < 1) detail::refuse("number of starts", "1 or more", count);
  options.check();
  Transitions<N> all{options.duration, {}, {}, {}};
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    Start<N> one = start(i);
    detail::naming([&] { return detail::text("start ", i, ": "); },
                   [&] {
                     check_state(system, one.state);
                     for (std::size_t b = 0; b < N; ++b)
                       for (int k = 0; k < Wrench<double>::size; ++k)
                         if (const double x = (&one.wrench[b].force.x)[k]; !is_finite(x))
                           detail::refuse(detail::text("wrench of body ", b), "finite numbers", x);
                   });
    for (auto& body : one.state.body) detail::make_unit(body.orientation);
    all.starts.push_back(one);
  }
  all.ends.resize(all.starts.size());
  all.collided.resize(all.starts.size());
  std::vector<char> lost(all.starts.size());
  const auto at = [&](std::ptrdiff_t i) -> const Start<N>& {
    return all.starts[static_cast<std::size_t>(i)];
  };
  SimulationOptions plan = options;
  plan.sample_rate = options.duration >= options.step ? 1 / options.duration : 0;
  simulate_batch<Lanes>(
      system, count, [&](std::ptrdiff_t i) { return at(i).state; },
      [&](const auto& lanes) {
        return Forces{forces, detail::lane_wrenches<Lanes, N>(lanes, at)};
      },
      integrator, plan,
      [&](const auto& sample) {
        const auto i = static_cast<std::size_t>(sample.scenario);
        all.ends[i] = sample.state;
        all.collided[i] = sample.impacts > 0;
        lost[i] = !sample.finite;
      },
      threads);
  for (std::size_t i = 0; i < lost.size(); ++i)
    if (lost[i]) detail::refuse(detail::text("end of start ", i), "finite numbers", "others");
  return all;
}

}  // namespace rbres::RBRES_ABI
