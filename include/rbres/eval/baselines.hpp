#pragma once

#include <rbres/core/lie.hpp>
#include <rbres/eval/timing.hpp>
#include <rbres/eval/training_set.hpp>
#include <span>

namespace rbres::RBRES_ABI {

/// @file
/// What a learned predictor is held against. Each is callable as (state, wrench, present) and gives the state
/// `horizon` seconds later.

/// Every body keeps its velocities.
struct ConstantVelocity {
  double horizon;  ///< s

  /// The state `horizon` after y. Absent bodies stay.
  SystemState<double, 5> operator()(SystemState<double, 5> y, const std::array<Wrench<double>, 5>&,
                                    int present) const {
    for (int b = 0; b < present; ++b) {
      y[b].position += horizon * y[b].velocity;
      y[b].orientation = normalized(y[b].orientation * quaternion_exp(horizon * y[b].angular_velocity));
    }
    return y;
  }
};

/// The flow without contacts.
struct ContactFree {
  /// Of the bodies.
  FreeFlow<ScenarioData::bodies> flow;
  double horizon;  ///< s

  /// The state `horizon` after y. Absent bodies stay.
  template <class State>
  State operator()(const State& y, const std::array<Wrench<double>, 5>& wrench, int present) const {
    State next = flow(y, wrench, horizon);
    for (int b = present; b < 5; ++b) next[b] = y[b];
    return next;
  }
};

/// The paper's baseline: RK4 with contacts checked at the end of each step, or the continuous simulation.
template <BodySet Set>
struct Simulated {
  /// What is around the bodies.
  World world;
  SimulationOptions options;  ///< options.duration is the horizon

  /// The state `horizon` after y. Absent bodies stay.
  SystemState<double, 5> operator()(const SystemState<double, 5>& y,
                                    const std::array<Wrench<double>, 5>& wrench, int present) const {
    std::array<SystemState<double, 5>, 1> next;
    rollout(y, wrench, next, present);
    return next[0];
  }

  /// One run on: fills `states` with the states 1, 2, ... horizons later. After a number that is not finite
  /// they stay as they were.
  void rollout(const SystemState<double, 5>& y, const std::array<Wrench<double>, 5>& wrench,
               std::span<SystemState<double, 5>> states, int present) const;

 private:
  template <int N>
  void run(SystemState<double, 5> y, const std::array<Wrench<double>, 5>& wrench,
           std::span<SystemState<double, 5>> states) const {
    const auto system = scenario_system<Set, N>(world);
    SystemState<double, N> part;
    ConstantWrench<double, N> own;
    std::copy_n(y.body.begin(), N, part.body.begin());
    std::copy_n(wrench.begin(), N, own.wrench.begin());
    SimulationOptions all = options;
    all.duration = options.duration * static_cast<double>(states.size());
    all.sample_rate = 1 / options.duration;
    std::size_t done = 0;
    simulate(system, part, scenario_forces<Set>(own), Rk4{}, all, [&](double time, const auto& now) {
      if (time == 0) return;
      std::copy_n(now.body.begin(), N, y.body.begin());
      states[done++] = y;
    });
    std::copy_n(part.body.begin(), N, y.body.begin());
    std::ranges::fill(states.subspan(done), y);
  }
};

// Not inline, so that a program may compile it once.
template <BodySet Set>
void Simulated<Set>::rollout(const SystemState<double, 5>& y, const std::array<Wrench<double>, 5>& wrench,
                             std::span<SystemState<double, 5>> states, int present) const {
  present == 3   ? run<3>(y, wrench, states)
  : present == 4 ? run<4>(y, wrench, states)
                 : run<5>(y, wrench, states);
}

/// The contact-free flow of a set's bodies.
template <BodySet Set>
FreeFlow<ScenarioData::bodies> free_flow() {
  const Body<double> body = scenario_body<Set>();
  FreeFlow<ScenarioData::bodies> flow{System<double, ScenarioData::bodies>::of(body)};
  std::tie(flow.gravity, flow.friction, flow.damping) = scenario_forces<Set>().models;
  return flow;
}

/// Predictions for scenarios first ... first + count - 1 of the data (65 x count), over `threads` threads (0:
/// default_threads()).
template <class Data, class Predict>
Eigen::MatrixXd predict_all(const Data& data, Eigen::Index first, Eigen::Index count, const Predict& predict,
                            int threads = 0) {
  Eigen::MatrixXd out(65, count);
  constexpr Eigen::Index block = 32;
  parallel_for((count + block - 1) / block, threads, [&](std::ptrdiff_t b) {
    for (Eigen::Index c = b * block; c < std::min(count, (b + 1) * block); ++c) {
      const int present = data.body_count[static_cast<std::size_t>(first + c)];
      out.col(c) =
          predict(state_of(data.initial, first + c, present), wrench_of(data, first + c), present).vector();
    }
  });
  return out;
}

/// Predicts for the first `count` scenarios one by one, on one thread. `data` must outlive the call.
template <class Predict>
TimedCall one_by_one(const ScenarioData& data, Eigen::Index count, const Predict& predict) {
  return {[&data, count, predict] {
            double sum = 0;
            for (Eigen::Index c = 0; c < count; ++c) {
              const int present = data.body_count[static_cast<std::size_t>(c)];
              sum += predict(state_of(data.initial, c, present), wrench_of(data, c), present)[0].position.x;
            }
            volatile double keep = sum;  // or the work might be left out
            static_cast<void>(keep);
          },
          static_cast<double>(count)};
}

}  // namespace rbres::RBRES_ABI
