#pragma once

#include <algorithm>
#include <cmath>
#include <rbres/core/error.hpp>
#include <rbres/core/scalar.hpp>

namespace rbres {

/// When contacts are found.
enum class ContactMode {
  continuous,  ///< at the time of impact inside the step: nothing tunnels; what truth is made with
  discrete,    ///< at the end of the step: cheap; what the paper's RK4 baseline does
};

/// How a run goes. Plain numbers, apart from what runs.
struct SimulationOptions {
  double step = 1e-3;      ///< s
  double duration = 1;     ///< s
  double sample_rate = 0;  ///< how often the observer is called, Hz; 0: after every step
  ContactMode contacts = ContactMode::continuous;
  double rest_speed =
      5e-3;  ///< contacts that approach slower rest instead of bouncing (restitution below 1), m/s
  int max_events =
      1000;  ///< impacts and times of impact in one step before the rest of it is done discretely

  /// Throws Error naming the first option that makes no sense.
  void check() const {
    if (!(step > 0) || !is_finite(step)) detail::refuse("step", "a positive time in s", step);
    if (!(duration >= 0) || !is_finite(duration))
      detail::refuse("duration", "a time of 0 s or more", duration);
    if (!(sample_rate >= 0) || !is_finite(sample_rate)) {
      detail::refuse("sample rate", "a frequency of 0 Hz or more", sample_rate);
    }
    if (!(rest_speed >= 0) || !is_finite(rest_speed))
      detail::refuse("rest speed", "0 m/s or more", rest_speed);
    if (max_events < 1) detail::refuse("max events", "1 or more", max_events);
  }
};

/// The step that is used: options.step, or the nearest smaller one of which a whole number makes a sample
/// (without sampling: the duration).
inline double whole_step(const SimulationOptions& options) {
  const double span = options.sample_rate > 0 ? 1 / options.sample_rate : options.duration;
  if (!(span > 0)) return options.step;
  return span / std::max(1.0, std::ceil(span / options.step - 1e-9));
}

}  // namespace rbres
