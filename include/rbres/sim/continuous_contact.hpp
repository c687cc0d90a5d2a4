#pragma once

#include <limits>
#include <rbres/contact/impact_search.hpp>
#include <rbres/contact/impacts.hpp>
#include <rbres/contact/pair_search.hpp>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/sim/discrete_contact.hpp>
#include <rbres/sim/options.hpp>
#include <rbres/sim/resting_contacts.hpp>
#include <utility>

namespace rbres::RBRES_ABI {

/// Motion over one step with every impact at its own time. The step is cut at each time of impact; contacts
/// that rest, slide or roll get constant forces over each part, found such that none approaches at its end:
/// exact where the forces are constant, of second order otherwise, so that nothing drifts and a slide stops
/// where it should. A resting contact costs no events.
///
/// What is guaranteed: no impact deeper than about 5e-5 of the smaller body's radius is missed, unless the
/// step meets its event cap; then its rest is done with discrete contacts and counted as an overrun.
template <class System>
class ContinuousContact {
  using S = typename System::Scalar;
  using State = typename System::State;
  static constexpr int N = System::bodies;
  using Pairs = detail::Reserved<detail::ContactPair<System>>;
  using Motions = detail::MotionsOf<System>;

 public:
  /// Allocates all that steps need. `system` must outlive it.
  ContinuousContact(const System& system, const SimulationOptions& options)
      : system_(&system),
        options_(options),
        search_(system, as<S>(options.rest_speed)),
        impacts_(system, detail::most_pairs(system)),
        resting_(system),
        discrete_(system) {}

  /// Takes y from t to t + h. `observer` may have impact(time, before, after), called with the states around
  /// each group of simultaneous impacts (plain scalars only). Where a number is no longer finite, neither is
  /// the state that is left.
  template <class Model, class Integrator, class Observer>
  void step(const Model& forces, const Integrator& integrator, State& y, const S& t, const S& h,
            Observer& observer, ContactTally<S>& tally) {
    resting_.continue_from(y);
    impacts_.start_step();
    search_.start_part();
    S left = h, now = t;
    MaskOf<S> lost(false);  // too far for one step, or without an end of impacts
    bool resolved = false;  // the impacts of this instant
    S longest = h;          // part that can be computed at once
    for (int event = 0; event < options_.max_events; ++event) {
      lost = lost | impacts_.unresolved();  // bodies in a press: no impulse lets all points part
      MaskOf<S> running = (left > S(0)) & !lost;
      if (!any(running)) break;
      // No rest is left that is a rounding error: forces over such a part would be, too.
      const S ahead = select(left < as<S>(1.25) * longest, left, longest);
      // Resting contacts close a tenth of their gap in a step, and more where its parts must be short.
      const S pull = maximum(S(as<S>(0.1) / h), select(longest < h, S(as<S>(0.5) / longest), S(0)));

      // Find the pairs that may touch before the step is over.
      State free = fly(*system_, forces, integrator, y, now, ahead);
      const MaskOf<S> faulty = mark_faults(search_.ways(y, free, ahead), free, running, y);
      left = select(faulty, S(0), left);
      running = running & !faulty;
      Pairs& pairs = search_.find(y, running);
      if (pairs.empty()) {
        y = chosen(running, free, y);
        left = select(running, S(left - ahead), left);
        now = now + ahead;
        continue;
      }

      Motions motion = detail::motions_of(*system_, y);
      detail::measure(*system_, y, motion, running, pairs);

      // Resolve the impacts of this instant.
      if (!resolved && any(impacts_.resolve(pairs, motion, tally.impacts))) {
        const State after = detail::with_velocities(y, motion, [&](int i) { return impacts_.changed(i); });
        if constexpr (requires { observer.impact(now, y, after); })
          observer.impact(now, std::as_const(y), after);
        y = after;
        resolved = true;
        continue;
      }
      resolved = false;

      // Find the forces of resting contacts.
      const bool resting = resting_.find(pairs, running);
      if (const MaskOf<S> stopped =
              resting ? resting_.stop_approaches(pairs, motion, pull) : MaskOf<S>(false);
          any(stopped)) {
        y = detail::with_velocities(y, motion, [&](int i) { return stopped & resting_.rests(i); });
        detail::measure_speeds<System>(motion, pairs);
        free = fly(*system_, forces, integrator, y, now, ahead);
      }
      RestingForces contact;
      if (resting) contact = resting_.forces(pairs, y, motion, free, ahead, pull);
      const auto flown = [&](const S& time) {
        const auto push = [&](const RigidState<S>& state, int i, const S& at, const Wrench<S>& wrench) {
          const auto& c = contact[static_cast<std::size_t>(i)];
          const Vec3<S> torque = c.torque_at(S(at - now), state.position - y[i].position);
          return wrench + Wrench<S>{c.force, rotate_back(state.orientation, torque)};
        };
        return resting ? fly(*system_, forces, integrator, y, now, time, push)
                       : fly(*system_, forces, integrator, y, now, time);
      };

      // Advance to the next impact.
      Part part{resting ? flown(ahead) : free, ahead};
      // Contact forces may carry a body farther than its free flight: then others may be in its way.
      if (resting && !search_.covers(y, part.end, ahead, running)) {
        resolved = true;
        continue;
      }
      // However dense the impacts, time goes on.
      const S impact = maximum(earliest_impact(pairs, y, part, lost), minimum(ahead, S(as<S>(1e-9) * h)));
      const bool cut = any(running & (impact < ahead));
      if (cut) part = {flown(impact), impact};
      if (cut || resting) {
        // Forces that are constant over a part, and the interpolation that finds impacts, are off by the
        // third and fourth power of its duration: where bodies end too deep, it must be shorter.
        const S shortest = as<S>(1.0 / 512) * h;
        const MaskOf<S> divides = ahead > shortest, sinks = resting_.sunk(pairs, part.end, cut) > S(1);
        const MaskOf<S> deep = running & divides & sinks;
        if (any(deep)) {
          longest = select(deep, maximum(S(as<S>(0.5) * ahead), shortest), longest);
          resolved = true;
          continue;
        }
      }
      if (resting) part.end = resting_.settled(pairs, y, contact, part.end, part.duration, pull);
      y = chosen(running, part.end, y);
      left = select(running, S(left - part.duration), left);
      now = now + part.duration;
      search_.start_part();
    }
    finish(forces, integrator, y, now, left, tally);
    resting_.end_step(y);
  }

 private:
  using RestingForces = typename detail::RestingContacts<System>::Forces;

  /// The motion from one instant to the next.
  struct Part {
    State end;
    S duration;  ///< s
  };

  static State chosen(const MaskOf<S>& m, const State& a, const State& b) {
    State out;
    for (int i = 0; i < N; ++i) out[i] = select(m, a[i], b[i]);
    return out;
  }

  /// Returns the running lanes in which a number on the way to `free`, or its square, is not finite; there
  /// the position of its body in y says so, too.
  static MaskOf<S> mark_faults(const std::array<S, std::size_t(N)>& way, const State& free,
                               const MaskOf<S>& running, State& y) {
    constexpr auto nan = std::numeric_limits<typename Constants<S>::Real>::quiet_NaN();
    MaskOf<S> faulty(false);
    for (int i = 0; i < N; ++i) {
      const Quat<S>& q = free[i].orientation;
      const S all_of_it = way[static_cast<std::size_t>(i)] + norm(free[i].velocity) +
                          norm(free[i].angular_velocity) + q.x + q.w;
      const MaskOf<S> unfit = running & !is_finite(all_of_it);
      faulty = faulty | unfit;
      y[i].position.x = select(unfit, S(nan), y[i].position.x);
    }
    return faulty;
  }

  /// When in a part the first pair touches that does not rest, s; its whole duration where none does. `lost`
  /// gains the lanes in which a pair goes too far for one step.
  S earliest_impact(const Pairs& pairs, const State& start, const Part& part, MaskOf<S>& lost) const {
    Motions motion;
    for (int i = 0; i < N; ++i) {
      auto& m = motion[static_cast<std::size_t>(i)];
      m.position = part.end[i].position;
      m.velocity = part.end[i].velocity;
      m.angular_velocity = part.end[i].angular_velocity_world();
    }
    S earliest = part.duration;
    for (const auto& pair : pairs) {
      earliest = minimum(earliest,
                         detail::impact_time(*system_, pair, start, part.end, motion, part.duration, lost));
    }
    return earliest;
  }

  /// Takes the lanes in which time is `left` (s) to the end of the step, with discrete contacts.
  template <class Model, class Integrator>
  void finish(const Model& forces, const Integrator& integrator, State& y, const S& now, const S& left,
              ContactTally<S>& tally) {
    const MaskOf<S> over = left > S(0), unresolved = impacts_.unresolved();
    tally.overruns += over | unresolved;
    if (!any(over)) return;
    State end = fly(*system_, forces, integrator, y, now, left);
    discrete_.resolve(y, end, left, as<S>(options_.rest_speed), tally);
    y = chosen(over, end, y);
  }

  const System* system_;
  SimulationOptions options_;
  detail::PairSearch<System> search_;
  detail::Impacts<System> impacts_;
  detail::RestingContacts<System> resting_;
  detail::DiscreteContact<System> discrete_;  ///< for steps past their event cap
};

}  // namespace rbres::RBRES_ABI
