#pragma once

#include <algorithm>
#include <cmath>
#include <rbres/core/error.hpp>
#include <rbres/core/scalar.hpp>

namespace rbres::RBRES_ABI {

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
  /// When contacts are found.
  ContactMode contacts = ContactMode::continuous;
  /// Contacts that approach slower rest instead of bouncing (restitution below 1), m/s: for bodies with a
  /// bounding radius of 0.1 m. For others it grows with the root of the radius, as speeds of falls do.
  double rest_speed = 5e-3;
  /// Impacts and times of impact in one step before the rest of it is done discretely. A dynamic system of
  /// more than 12 bodies may have as many for each 12.
  int max_events = 1000;

  /// Throws Error naming the first option that makes no sense.
  void check() const {
    if (!(step > 0) || !is_finite(step) || !is_finite(1 / step))
      detail::refuse("step", "a positive time in s", step);
    if (!(duration >= 0) || !is_finite(duration))
      detail::refuse("duration", "a time of 0 s or more", duration);
    if (!(sample_rate >= 0) || !is_finite(sample_rate) || (sample_rate > 0 && !is_finite(1 / sample_rate))) {
      detail::refuse("sample rate", "a frequency of 0 Hz or more", sample_rate);
    }
    if (!(rest_speed >= 0) || !is_finite(rest_speed))
      detail::refuse("rest speed", "0 m/s or more", rest_speed);
    if (max_events < 1) detail::refuse("max events", "1 or more", max_events);
    const double steps = duration * std::max(1 / step, sample_rate);
    if (!(steps <= 1e12)) detail::refuse("duration", "at most 1e12 steps", detail::Line(steps, " steps"));
  }
};

/// The step that is used: options.step, or the nearest smaller one of which a whole number makes a sample
/// (without sampling: the duration).
inline double whole_step(const SimulationOptions& options) {
  const double span = options.sample_rate > 0 ? 1 / options.sample_rate : options.duration;
  if (!(span > 0)) return options.step;
  return span / std::max(1.0, std::ceil(span / options.step - 1e-9));
}

/// How a run is cut: samples at whole multiples of 1 / sample_rate and at the end, between them whole numbers
/// of equal steps, none longer than options.step. Without sampling every step is a sample. The last sample is
/// at options.duration, be it a whole number of steps and samples or not.
class StepPlan {
 public:
  /// What lies between one sample and the next.
  struct Part {
    double start;  ///< s
    double end;    ///< s
    double step;   ///< s
    /// How many of them make the part.
    long steps;
    /// The time at which step j of the part begins, s.
    double time(long j) const { return start + static_cast<double>(j) * step; }
  };

  /// The plan of a run; its options must make sense, see SimulationOptions::check.
  explicit StepPlan(const SimulationOptions& options)
      : duration_(options.duration),
        longest_(options.step),
        step_(whole_step(options)),
        span_(options.sample_rate > 0 ? 1 / options.sample_rate : step_),
        per_sample_(std::max(1L, std::lround(span_ / step_))),
        parts_(duration_ > 0 ? std::max(1L, static_cast<long>(std::ceil(duration_ / span_ - 1e-9))) : 0) {}

  /// How many there are: one for each sample but the start.
  long parts() const { return parts_; }
  /// Part k, from 0.
  Part part(long k) const {
    const double start = static_cast<double>(k) * span_;
    if (k + 1 < parts_) return {start, static_cast<double>(k + 1) * span_, step_, per_sample_};
    const double left = duration_ - start;
    if (std::abs(left - span_) <= 1e-9 * span_) return {start, duration_, step_, per_sample_};
    const long steps = std::max(1L, static_cast<long>(std::ceil(left / longest_ - 1e-9)));
    return {start, duration_, left / static_cast<double>(steps), steps};
  }

 private:
  double duration_, longest_, step_, span_;
  long per_sample_, parts_;
};

}  // namespace rbres::RBRES_ABI
