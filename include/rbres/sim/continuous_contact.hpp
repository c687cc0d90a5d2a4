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
  using Pairs = detail::Reserved<detail::ContactPair<System>>;
  using Motions = detail::MotionsOf<System>;

 public:
  /// Allocates all that steps need. `system` must outlive it.
  ContinuousContact(const System& system, const SimulationOptions& options)
      : system_(&system),
        options_(options),
        search_(system, as<S>(options.rest_speed)),
        impacts_(system),
        resting_(system),
        discrete_(system),
        free_(detail::state_of(system)),
        part_end_(free_),
        motion_(detail::per_body<Motion<S>>(system)),
        end_motion_(motion_),
        probe_(free_) {}

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
      fly_to(free_, forces, integrator, y, now, ahead);
      const MaskOf<S> faulty = mark_faults(search_.ways(y, free_, ahead), free_, running, y);
      left = select(faulty, S(0), left);
      running = running & !faulty;
      Pairs& pairs = search_.find(y, running);
      if (pairs.empty()) {
        replace(running, free_, y);
        left = select(running, S(left - ahead), left);
        now = now + ahead;
        continue;
      }

      detail::set_motions(*system_, y, motion_);
      detail::measure(*system_, y, motion_, running, pairs);

      // Resolve the impacts of this instant.
      if (!resolved && any(impacts_.resolve(pairs, motion_, tally.impacts))) {
        free_ = y;
        detail::take_velocities([&](int i) { return impacts_.changed(i); }, free_, motion_);
        if constexpr (requires { observer.impact(now, y, free_); })
          observer.impact(now, std::as_const(y), std::as_const(free_));
        y = free_;
        resolved = true;
        continue;
      }
      resolved = false;

      // Find the forces of resting contacts.
      const bool resting = resting_.find(pairs, running);
      if (const MaskOf<S> stopped =
              resting ? resting_.stop_approaches(pairs, motion_, pull) : MaskOf<S>(false);
          any(stopped)) {
        detail::take_velocities([&](int i) { return stopped & resting_.rests(i); }, y, motion_);
        detail::measure_speeds<System>(motion_, pairs);
        fly_to(free_, forces, integrator, y, now, ahead);
      }
      if (resting) resting_.find_forces(pairs, y, motion_, free_, ahead, pull);
      const auto go = [&](const S& time) {
        const auto push = [&](const RigidState<S>& state, int i, const S& at, const Wrench<S>& wrench) {
          const auto& c = resting_.forces()[static_cast<std::size_t>(i)];
          const Vec3<S> torque = c.torque_at(S(at - now), state.position - y[i].position);
          return wrench + Wrench<S>{c.force, rotate_back(state.orientation, torque)};
        };
        if (resting) {
          fly_to(part_end_, forces, integrator, y, now, time, push);
        } else {
          fly_to(part_end_, forces, integrator, y, now, time);
        }
      };

      // Advance to the next impact.
      if (resting) {
        go(ahead);
      } else {
        part_end_ = free_;
      }
      S duration = ahead;
      // Contact forces may carry a body farther than its free flight: then others may be in its way.
      if (resting && !search_.covers(y, part_end_, ahead, running)) {
        resolved = true;
        continue;
      }
      // However dense the impacts, time goes on.
      const S impact = maximum(earliest_impact(pairs, y, ahead, lost), minimum(ahead, S(as<S>(1e-9) * h)));
      const bool cut = any(running & (impact < ahead));
      if (cut) {
        go(impact);
        duration = impact;
      }
      if (cut || resting) {
        // Forces that are constant over a part, and the interpolation that finds impacts, are off by the
        // third and fourth power of its duration: where bodies end too deep, it must be shorter.
        const S shortest = as<S>(1.0 / 512) * h;
        const MaskOf<S> divides = ahead > shortest, sinks = resting_.sunk(pairs, part_end_, cut) > S(1);
        const MaskOf<S> deep = running & divides & sinks;
        if (any(deep)) {
          longest = select(deep, maximum(S(as<S>(0.5) * ahead), shortest), longest);
          resolved = true;
          continue;
        }
      }
      if (resting) resting_.settle(pairs, y, part_end_, duration, pull);
      replace(running, part_end_, y);
      left = select(running, S(left - duration), left);
      now = now + duration;
      search_.start_part();
    }
    finish(forces, integrator, y, now, left, tally);
    resting_.end_step(y);
  }

 private:
  /// Where y is after h seconds from t without impacts.
  template <class Model, class Integrator, class Push = NoPush>
  void fly_to(State& end, const Model& forces, const Integrator& integrator, const State& y, const S& t,
              const S& h, const Push& push = {}) const {
    end = y;
    fly_on(*system_, forces, integrator, end, t, h, push);
  }
  /// Gives y the numbers of `other` in these lanes.
  static void replace(const MaskOf<S>& lanes, const State& other, State& y) {
    for (std::size_t i = 0; i < y.body.size(); ++i) y.body[i] = select(lanes, other.body[i], y.body[i]);
  }

  /// Returns the running lanes in which a number on the way to `free`, or its square, is not finite; there
  /// the position of its body in y says so, too.
  static MaskOf<S> mark_faults(const typename detail::PairSearch<System>::Ways& way, const State& free,
                               const MaskOf<S>& running, State& y) {
    constexpr auto nan = std::numeric_limits<typename Constants<S>::Real>::quiet_NaN();
    MaskOf<S> faulty(false);
    for (std::size_t i = 0; i < y.body.size(); ++i) {
      const RigidState<S>& ahead = free.body[i];
      const Quat<S>& q = ahead.orientation;
      const S all_of_it = way[i] + norm(ahead.velocity) + norm(ahead.angular_velocity) + q.x + q.w;
      const MaskOf<S> unfit = running & !is_finite(all_of_it);
      faulty = faulty | unfit;
      y.body[i].position.x = select(unfit, S(nan), y.body[i].position.x);
    }
    return faulty;
  }

  /// When in a part of so many seconds from `start` to part_end_ the first pair touches that does not rest,
  /// s; all of the part where none does. `lost` gains the lanes in which a pair goes too far for one step.
  S earliest_impact(const Pairs& pairs, const State& start, const S& seconds, MaskOf<S>& lost) {
    for (std::size_t i = 0; i < part_end_.body.size(); ++i) {
      const RigidState<S>& body = part_end_.body[i];
      end_motion_[i].position = body.position;
      end_motion_[i].velocity = body.velocity;
      end_motion_[i].angular_velocity = body.angular_velocity_world();
    }
    S earliest = seconds;
    for (const auto& pair : pairs) {
      earliest = minimum(earliest, detail::impact_time(*system_, pair, start, part_end_, end_motion_, seconds,
                                                       probe_, lost));
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
    fly_to(part_end_, forces, integrator, y, now, left);
    discrete_.resolve(y, part_end_, left, as<S>(options_.rest_speed), tally);
    replace(over, part_end_, y);
  }

  const System* system_;
  SimulationOptions options_;
  detail::PairSearch<System> search_;
  detail::Impacts<System> impacts_;
  detail::RestingContacts<System> resting_;
  detail::DiscreteContact<System> discrete_;  ///< for steps past their event cap
  State free_;                                ///< after free flight
  State part_end_;                            ///< where the present part of the step ends
  Motions motion_, end_motion_;               ///< where the part begins and ends
  State probe_;                               ///< for the search of an impact
};

}  // namespace rbres::RBRES_ABI
