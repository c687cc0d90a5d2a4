#pragma once

#include <rbres/core/pack.hpp>
#include <rbres/core/parallel.hpp>
#include <rbres/sim/simulate.hpp>

namespace rbres::RBRES_ABI {

namespace detail {
inline bool mask_lane(bool mask, int) { return mask; }
template <class T, int N>
bool mask_lane(const LaneMask<T, N>& mask, int lane) {
  return mask[lane];
}
inline long count_lane(long count, int) { return count; }
template <class T, int N>
long count_lane(const LaneCount<T, N>& count, int lane) {
  return count[lane];
}
}  // namespace detail

/// What an observer of a batch hears: one scenario at one sample.
template <class T, int N>
struct BatchSample {
  /// Its number.
  std::ptrdiff_t scenario;
  long sample;  ///< 0 is the start
  double time;  ///< s
  /// Where its bodies are.
  SystemState<T, N> state;
  long impacts;   ///< approaches answered so far
  long overruns;  ///< steps so far that met the event cap
  bool finite;    ///< false: the state is the last good one
};

/// Simulates scenarios 0 ... count - 1 of one system, one scenario per lane of S (a Pack, or a plain scalar),
/// over `threads` threads (0: default_threads(), at most 4096). start(i) gives scenario i's state;
/// forces(lanes) the force model of the scenarios in lanes[0], lanes[1], ... as it acts on S (scenarios past
/// the end repeat the last one); observe(BatchSample) is called at the start, at every sample and at the end,
/// from several threads at once but for one scenario never twice at the same time. No bit of the result
/// depends on the threads. Orientations are made unit at the start. `contacts` says how bodies collide, as in
/// simulate(). Throws Error for options, numbers and starts that make no sense, see check_state; start(i) is
/// called twice.
template <class S, class T, int N, class Shape, int P, class Start, class MakeForces, class Integrator,
          class Contacts, class Observe>
void simulate_batch(const System<T, N, Shape, P>& system, std::ptrdiff_t count, const Start& start,
                    const MakeForces& forces, const Integrator& integrator, const Contacts& contacts,
                    const SimulationOptions& options, const Observe& observe, int threads = 0) {
  using Value = typename ScalarTraits<S>::Value;
  static_assert(std::is_same_v<Value, T>, "the lanes hold numbers of the system's scalar");
  constexpr int L = ScalarTraits<S>::lanes;
  static_assert(std::is_void_v<std::invoke_result_t<const Observe&, const BatchSample<T, N>&>>,
                "a batch's observer is called with a BatchSample and returns nothing");
  options.check();
  detail::check_threads(threads);
  if (count < 0) detail::refuse("scenarios", "0 or more", count);
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    detail::naming([&] { return detail::text("scenario ", i, ": "); },
                   [&] { detail::check_start<Contacts>(system, start(i)); });
  }
  const auto lanes_system = system.template cast<S>();
  using Lanes = std::decay_t<decltype(lanes_system)>;
  const StepPlan plan(options);
  detail::check_plan(contacts, plan);
  const std::ptrdiff_t blocks = (count + L - 1) / L;

  parallel_for(blocks, threads, [&](std::ptrdiff_t block) {
    std::array<std::ptrdiff_t, std::size_t(L)> index;
    auto y = detail::state_of(lanes_system);
    for (int l = 0; l < L; ++l) {
      index[static_cast<std::size_t>(l)] = std::min(block * L + l, count - 1);
      SystemState<T, N> first = start(index[static_cast<std::size_t>(l)]);
      for (auto& body : first.body) detail::make_unit(body.orientation);
      set_lane(y, l, first);
    }
    const auto model = forces(std::as_const(index));
    Stepper<Lanes, std::decay_t<decltype(model)>, Integrator, Contacts> stepper(
        lanes_system, model, integrator, contacts, options);
    const auto look = [&](long sample, double time) {
      for (int l = 0; l < L && block * L + l < count; ++l) {
        observe(BatchSample<T, N>{index[static_cast<std::size_t>(l)], sample, time, lane(y, l),
                                  detail::count_lane(stepper.tally().impacts, l),
                                  detail::count_lane(stepper.tally().overruns, l),
                                  detail::mask_lane(stepper.finite(), l)});
      }
    };
    look(0, 0);
    for (long k = 0; k < plan.parts(); ++k) {
      const StepPlan::Part part = plan.part(k);
      for (long j = 0; j < part.steps; ++j) stepper.step(y, as<S>(part.time(j)), as<S>(part.step));
      look(k + 1, part.end);
    }
  });
}

/// The same with AnalyticContacts.
template <class S, class T, int N, class Shape, int P, class Start, class MakeForces, class Integrator,
          class Observe>
void simulate_batch(const System<T, N, Shape, P>& system, std::ptrdiff_t count, const Start& start,
                    const MakeForces& forces, const Integrator& integrator, const SimulationOptions& options,
                    const Observe& observe, int threads = 0) {
  simulate_batch<S>(system, count, start, forces, integrator, AnalyticContacts{}, options, observe, threads);
}

}  // namespace rbres::RBRES_ABI
