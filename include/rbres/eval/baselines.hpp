#pragma once

#include <algorithm>
#include <rbres/core/lie.hpp>
#include <rbres/eval/timing.hpp>
#include <rbres/predict/free_flow.hpp>
#include <rbres/sim/simulate.hpp>
#include <span>

namespace rbres::RBRES_ABI {

/// @file
/// What a learned predictor is held against, in any world. Each is callable as (state, wrench, present) and
/// gives the state `horizon` seconds later; bodies from `present` on are absent.

/// Every body keeps its velocities.
struct ConstantVelocity {
  double horizon;  ///< s

  /// The state `horizon` after y.
  template <int N>
  SystemState<double, N> operator()(SystemState<double, N> y,
                                    const std::array<Wrench<double>, std::size_t(N)>&,
                                    int present = N) const {
    for (int b = 0; b < present; ++b) {
      y[b].position += horizon * y[b].velocity;
      y[b].orientation = normalized(y[b].orientation * quaternion_exp(horizon * y[b].angular_velocity));
    }
    return y;
  }
};

/// The flow without contacts.
template <int N>
struct ContactFree {
  FreeFlow<N> flow;  ///< of the bodies
  double horizon;    ///< s

  /// The state `horizon` after y.
  SystemState<double, N> operator()(const SystemState<double, N>& y,
                                    const std::array<Wrench<double>, std::size_t(N)>& wrench,
                                    int present = N) const {
    SystemState<double, N> next = flow(y, wrench, horizon);
    for (int b = present; b < N; ++b) next[b] = y[b];
    return next;
  }
};
/// The number of bodies is that of the flow.
template <int N>
ContactFree(FreeFlow<N>, double) -> ContactFree<N>;

/// A simulation of a world whose bodies are all present, under `forces` and the wrenches.
template <class System, class Model, class Integrator = Rk4>
struct Simulated {
  System system;              ///< the bodies and planes
  Model forces;               ///< without the wrenches
  SimulationOptions options;  ///< options.duration is the horizon
  Integrator integrator{};    ///< of the flight between contacts

  /// Of all bodies.
  using State = typename System::State;
  /// One for each body.
  using Wrenches = std::array<Wrench<double>, std::size_t(System::bodies)>;

  /// The state `horizon` after y.
  State operator()(const State& y, const Wrenches& wrench, int = System::bodies) const {
    std::array<State, 1> next;
    rollout(y, wrench, next);
    return next[0];
  }

  /// One run on: fills `states` with the states 1, 2, ... horizons later. After a number that is not finite
  /// they stay as they were.
  void rollout(State y, const Wrenches& wrench, std::span<State> states) const {
    if (!(options.duration > 0))
      detail::refuse("duration of a simulation that predicts", "more than 0 s", options.duration);
    SimulationOptions all = options;
    all.duration = options.duration * static_cast<double>(states.size());
    all.sample_rate = 1 / options.duration;
    std::size_t done = 0;
    simulate(system, y, Forces{forces, ConstantWrench<double, System::bodies>{wrench}}, integrator, all,
             [&](double time, const State& now) {
               if (time != 0) states[done++] = now;
             });
    const auto rest = states.subspan(done);
    std::fill(rest.begin(), rest.end(), y);
  }
};
/// With RK4.
template <class System, class Model>
Simulated(System, Model, SimulationOptions) -> Simulated<System, Model>;
/// With an integrator of one's own.
template <class System, class Model, class Integrator>
Simulated(System, Model, SimulationOptions, Integrator) -> Simulated<System, Model, Integrator>;

/// Predictions for transitions first ... first + count - 1 (13 N x count), over `threads` threads (0:
/// default_threads()). Error where there are no transitions of these numbers.
template <class Data, class Predict>
Eigen::MatrixXd predict_all(const Data& transitions, Eigen::Index first, Eigen::Index count,
                            const Predict& predict, int threads = 0) {
  detail::check_transitions(transitions, first, count);
  Eigen::MatrixXd out(13 * Data::bodies, count);
  constexpr Eigen::Index block = 32;
  parallel_for((count + block - 1) / block, threads, [&](std::ptrdiff_t b) {
    for (Eigen::Index c = b * block; c < std::min(count, (b + 1) * block); ++c)
      out.col(c) =
          predict(transitions.start(first + c), transitions.wrench(first + c), transitions.present(first + c))
              .vector();
  });
  return out;
}

/// Predicts for the first `count` transitions one by one, on one thread. `transitions` must outlive the call.
/// Error where there are not so many.
template <class Data, class Predict>
TimedCall one_by_one(const Data& transitions, Eigen::Index count, const Predict& predict) {
  detail::check_transitions(transitions, 0, count);
  return {[&transitions, count, predict] {
            double sum = 0;
            for (Eigen::Index c = 0; c < count; ++c)
              sum +=
                  predict(transitions.start(c), transitions.wrench(c), transitions.present(c))[0].position.x;
            volatile double keep = sum;  // or the work might be left out
            static_cast<void>(keep);
          },
          static_cast<double>(count)};
}

}  // namespace rbres::RBRES_ABI
