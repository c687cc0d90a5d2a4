#pragma once

#include <time.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <functional>
#include <rbres/eval/metrics.hpp>
#include <vector>

namespace rbres::RBRES_ABI {

/// Something to time.
struct TimedCall {
  /// What is called.
  std::function<void()> run;
  double scenarios;  ///< that one run takes care of
};

/// Microseconds per scenario over several rounds.
struct Spread {
  /// Of the times of all rounds, us.
  /// @{
  double median = 0, low = 0, high = 0;
  /// @}
};

namespace detail {

/// Processor time of this thread where the system tells it, s: other work of the machine does not count.
inline double thread_seconds() {
#ifdef CLOCK_THREAD_CPUTIME_ID
  timespec now{};
  if (::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now) == 0)
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
#endif
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace detail

/// Times calls side by side: in each round all of them in turn, so that whatever else the machine does
/// disturbs all alike. A call that is over in less than `least` seconds is repeated within its turn. What
/// calls do on other threads is not counted. Error for no rounds, and for calls without a function or
/// scenarios.
inline std::vector<Spread> time_side_by_side(const std::vector<TimedCall>& calls, int rounds,
                                             double least = 1e-3) {
  if (rounds < 1) detail::refuse("rounds of timing", "at least 1", rounds);
  for (const TimedCall& call : calls) {
    if (!call.run) detail::refuse("call to time", "a function", "none");
    if (!(call.scenarios > 0)) detail::refuse("scenarios of a timed call", "more than 0", call.scenarios);
  }
  const auto seconds = [](const TimedCall& call, long repeats) {
    const double start = detail::thread_seconds();
    for (long i = 0; i < repeats; ++i) call.run();
    return detail::thread_seconds() - start;
  };
  std::vector<long> repeats;
  for (const TimedCall& call : calls) {
    const double warm = seconds(call, 1);
    repeats.push_back(1 + static_cast<long>(std::min(least / std::max(warm, 1e-9), 1e6)));
  }
  std::vector<std::vector<double>> found(calls.size());
  for (int round = 0; round < rounds; ++round) {
    for (std::size_t i = 0; i < calls.size(); ++i) {
      const double done = calls[i].scenarios * static_cast<double>(repeats[i]);
      found[i].push_back(1e6 * seconds(calls[i], repeats[i]) / done);
    }
  }
  std::vector<Spread> spreads;
  for (const auto& rounds_of : found) {
    spreads.push_back(
        {detail::quantile(rounds_of, 0.5), detail::quantile(rounds_of, 0), detail::quantile(rounds_of, 1)});
  }
  return spreads;
}

}  // namespace rbres::RBRES_ABI
