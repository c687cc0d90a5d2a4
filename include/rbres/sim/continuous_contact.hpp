#pragma once

#include <algorithm>
#include <limits>
#include <numeric>
#include <rbres/contact/impact_search.hpp>
#include <rbres/contact/impacts.hpp>
#include <rbres/contact/pair_search.hpp>
#include <rbres/contact/step_groups.hpp>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/sim/discrete_contact.hpp>
#include <rbres/sim/impact_log.hpp>
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
  using Pairs = detail::ContactPairs<System>;
  using Motions = detail::MotionsOf<System>;

 public:
  /// Allocates all that steps need. `system` must outlive it.
  ContinuousContact(const System& system, const SimulationOptions& options)
      : system_(&system),
        options_(options),
        in_crowd_(detail::is_crowd(system)),
        search_(system, as<S>(options.rest_speed)),
        impacts_(system),
        resting_(system),
        discrete_(system),
        free_(detail::state_of(system)),
        part_end_(free_),
        motion_(detail::per_body<Motion<S>>(system)),
        end_motion_(motion_),
        probe_(free_),
        log_(system),
        apart_(system) {}

  /// Takes y from t to t + h. `observer` may have impact(Impact), called for each impulse of an impact in
  /// order of time (at the end of a step that is done group by group), or impact(time, before, after), called
  /// with the states around each group of simultaneous impacts (plain scalars only); for the latter all
  /// bodies are at one time, so that more than a few cost more and come to other roundings. Where a number is
  /// no longer finite, neither is the state that is left.
  template <class Model, class Integrator, class Observer>
  void step(const Model& forces, const Integrator& integrator, State& y, const S& t, const S& h,
            Observer& observer, ContactTally<S>& tally) {
    resting_.continue_from(y);
    if constexpr (grouped<Model, Observer>) {
      if (step_groups(forces, integrator, y, t, h, observer, tally)) {
        resting_.end_step(y);
        return;
      }
    }
    log_.start_step(false);
    bodies_ = all();
    S now = t;
    const S left = advance(forces, integrator, y, now, h, observer, tally, [](const auto&) { return true; });
    finish(forces, integrator, y, now, left, tally);
    resting_.end_step(y);
  }

 private:
  using Bodies = detail::BodyIndices<System::bodies>;
  /// What steps of groups need.
  struct Apart {
    explicit Apart(const System& system)
        : groups(system), start(detail::state_of(system)), all(static_cast<std::size_t>(system.size())) {
      std::iota(all.begin(), all.end(), 0);
    }
    detail::StepGroups<System> groups;
    State start;                 ///< of the step
    detail::HeapArray<int> all;  ///< bodies
  };
  struct Together {
    explicit Together(const System&) {}
  };
  /// Whether the bodies of a step may be at different times in it.
  template <class Model, class Observer>
  static constexpr bool grouped =
      System::bodies == dynamic && !Packed<S> && detail::is_local<Model, S, typename System::Shape> &&
      !detail::HearsImpacts<Observer, State, S>;

  /// Takes y from t to t + h group by group. Returns false, and leaves all as it was, where a group does not
  /// keep to itself or meets the event cap.
  template <class Model, class Integrator, class Observer>
  bool step_groups(const Model& forces, const Integrator& integrator, State& y, const S& t, const S& h,
                   Observer& observer, ContactTally<S>& tally) {
    if (!in_crowd_ || !(h > S(0))) return false;
    detail::StepGroups<System>& groups = apart_.groups;
    State& start = apart_.start;
    bodies_ = all();
    fly_to(free_, forces, integrator, y, t, h);
    search_.start_part(bodies_);
    const auto& ways = search_.ways(bodies_, y, free_, h);
    if (mark_faults(ways, free_, MaskOf<S>(true), y)) return true;
    if (!groups.find(y, ways, h)) return false;
    start = y;
    const ContactTally<S> tally_before = tally;
    for (const int i : groups.alone()) y[i] = free_[i];
    resting_.memory().start_groups();
    log_.start_step(true);
    for (std::size_t k = 0; k < groups.count(); ++k) {
      bodies_ = groups[k];
      for (const int i : bodies_) y[i] = start[i];  // other groups have moved its kinematic bodies
      resting_.memory().start_group();
      S now = t;
      const S left = advance(forces, integrator, y, now, h, observer, tally,
                             [&](const auto& way) { return groups.hold(bodies_, start, y, way); });
      if (left > S(0) || impacts_.unresolved()) {
        resting_.memory().undo_groups();
        y = start;
        tally = tally_before;
        return false;
      }
      resting_.memory().end_group();
    }
    resting_.memory().end_groups();
    if constexpr (detail::HearsImpulses<Observer, S>) log_.end_groups(observer);
    bodies_ = groups.kinematic();
    for (const int i : bodies_) free_[i] = start[i];
    detail::fly_each_on(*system_, bodies_, forces, integrator, free_, t, h, NoPush{});
    for (const int i : bodies_) y[i] = free_[i];
    return true;
  }

  /// Resolves the impacts of this instant; the observer may hear their impulses.
  template <class Observer>
  MaskOf<S> resolve_impacts(Pairs& pairs, const S& now, Observer& observer, ContactTally<S>& tally) {
    if constexpr (!Packed<S> && detail::HearsImpulses<Observer, S>) {
      const auto hear = [&](const Candidate& who, const Vec3<S>& normal, const Vec3<S>& point,
                            const Vec3<S>& impulse) {
        if (squared_norm(impulse) > S(0))
          log_.hear(Impact<S>{now, who.first, who.second, point, normal, impulse}, observer);
      };
      return impacts_.resolve(bodies_, pairs, motion_, tally.impacts, hear);
    } else {
      return impacts_.resolve(bodies_, pairs, motion_, tally.impacts, detail::Unheard{});
    }
  }
  /// Takes bodies_ of y from `now` on by h, until its event cap is met or they no longer `hold` to the ways
  /// (m) that they may go. Returns how much of h is left.
  template <class Model, class Integrator, class Observer, class Hold>
  S advance(const Model& forces, const Integrator& integrator, State& y, S& now, const S& h,
            Observer& observer, ContactTally<S>& tally, const Hold& hold) {
    impacts_.start_step(bodies_);
    resting_.start_step(bodies_);
    search_.start_part(bodies_);
    S left = h;
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
      const auto& ways = search_.ways(bodies_, y, free_, ahead);
      const MaskOf<S> faulty = mark_faults(ways, free_, running, y);
      left = select(faulty, S(0), left);
      running = running & !faulty;
      if (!hold(ways)) return left;
      Pairs& pairs = search_.find(bodies_, y, running);
      if (pairs.empty()) {
        replace(running, free_, y);
        left = select(running, S(left - ahead), left);
        now = now + ahead;
        continue;
      }

      detail::set_motions(*system_, bodies_, y, motion_);
      detail::measure(*system_, y, motion_, running, pairs);

      // Resolve the impacts of this instant.
      if (!resolved && any(resolve_impacts(pairs, now, observer, tally))) {
        for (const int i : bodies_) free_[i] = y[i];
        detail::take_velocities(
            bodies_, [&](int i) { return impacts_.changed(i); }, free_, motion_);
        if constexpr (detail::HearsImpacts<Observer, State, S>)
          observer.impact(now, std::as_const(y), std::as_const(free_));
        for (const int i : bodies_) y[i] = free_[i];
        resolved = true;
        continue;
      }
      resolved = false;

      // Find the forces of resting contacts.
      const bool resting = resting_.find(bodies_, pairs, running);
      if (const MaskOf<S> stopped =
              resting ? resting_.stop_approaches(pairs, motion_, pull) : MaskOf<S>(false);
          any(stopped)) {
        detail::take_velocities(
            bodies_, [&](int i) { return stopped & resting_.moves(i); }, y, motion_);
        detail::measure_speeds<System>(motion_, pairs);
        fly_to(free_, forces, integrator, y, now, ahead);
      }
      if (resting) resting_.find_forces(pairs, y, motion_, free_, ahead, pull);
      const auto go = [&](const S& time) {
        const auto push = [&](const RigidState<S>& state, int i, const S& at, const Wrench<S>& wrench) {
          const auto& c = resting_.forces()[static_cast<std::size_t>(i)];
          const auto& kept = resting_.kept();
          const Vec3<S> torque =
              c.torque_at(kept.age(i, S(at - now)), state.position - kept.start(y)[i].position);
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
        for (const int i : bodies_) part_end_[i] = free_[i];
      }
      S duration = ahead;
      // Contact forces may carry a body farther than its free flight: then others may be in its way.
      if (resting && !search_.covers(bodies_, y, part_end_, ahead, running)) {
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
        const MaskOf<S> divides = ahead > shortest,
                        sinks = resting_.sunk(pairs, part_end_, cut, in_crowd_) > S(1);
        const MaskOf<S> deep = running & divides & sinks;
        if (any(deep)) {
          longest = select(deep, maximum(S(as<S>(0.5) * ahead), shortest), longest);
          resolved = true;
          continue;
        }
      }
      // Forces are for the time up to the end of the step: an island that the impact does not reach keeps
      // them.
      const MaskOf<S> early = ahead < left;
      if (resting) resting_.keep_undisturbed(pairs, in_crowd_ && cut && !any(early), duration);
      if (resting) resting_.settle(pairs, y, part_end_, duration, pull);
      replace(running, part_end_, y);
      left = select(running, S(left - duration), left);
      now = now + duration;
      search_.start_part(bodies_);
    }
    return left;
  }

  /// Where y is after h seconds from t without impacts.
  template <class Model, class Integrator, class Push = NoPush>
  void fly_to(State& end, const Model& forces, const Integrator& integrator, const State& y, const S& t,
              const S& h, const Push& push = {}) const {
    for (const int i : bodies_) end[i] = y[i];
    if constexpr (detail::is_local<Model, S, typename System::Shape>) {
      detail::fly_each_on(*system_, bodies_, forces, integrator, end, t, h, push);
    } else {
      fly_on(*system_, forces, integrator, end, t, h, push);
    }
  }
  /// Gives y the numbers of `other` in these lanes.
  void replace(const MaskOf<S>& lanes, const State& other, State& y) const {
    for (const int i : bodies_) y[i] = select(lanes, other[i], y[i]);
  }

  /// Returns the running lanes in which a number on the way to `free`, or its square, is not finite; there
  /// the position of its body in y says so, too.
  MaskOf<S> mark_faults(const typename detail::PairSearch<System>::Ways& way, const State& free,
                        const MaskOf<S>& running, State& y) const {
    constexpr auto nan = std::numeric_limits<typename Constants<S>::Real>::quiet_NaN();
    MaskOf<S> faulty(false);
    for (const int i : bodies_) {
      const RigidState<S>& ahead = free[i];
      const Quat<S>& q = ahead.orientation;
      const S all_of_it =
          way[static_cast<std::size_t>(i)] + norm(ahead.velocity) + norm(ahead.angular_velocity) + q.x + q.w;
      const MaskOf<S> unfit = running & !is_finite(all_of_it);
      faulty = faulty | unfit;
      y[i].position.x = select(unfit, S(nan), y[i].position.x);
    }
    return faulty;
  }

  /// When in a part of so many seconds from `start` to part_end_ the first pair touches that does not rest,
  /// s; all of the part where none does. `lost` gains the lanes in which a pair goes too far for one step.
  S earliest_impact(Pairs& pairs, const State& start, const S& seconds, MaskOf<S>& lost) {
    for (const int i : bodies_) {
      const RigidState<S>& body = part_end_[i];
      Motion<S>& motion = end_motion_[static_cast<std::size_t>(i)];
      motion.position = body.position;
      motion.velocity = body.velocity;
      motion.angular_velocity = body.angular_velocity_world();
    }
    S earliest = seconds;
    for (auto& pair : pairs) {
      pair.impact = detail::impact_time(*system_, pair, start, part_end_, end_motion_, seconds, probe_, lost);
      earliest = minimum(earliest, pair.impact);
    }
    return earliest;
  }

  Bodies all() const {
    if constexpr (System::bodies == dynamic) {
      return {apart_.all.begin(), apart_.all.size()};
    } else {
      return {};
    }
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
  bool in_crowd_;
  Bodies bodies_;  ///< that are taken on together
  detail::PairSearch<System> search_;
  detail::Impacts<System> impacts_;
  detail::RestingContacts<System> resting_;
  detail::DiscreteContact<System> discrete_;  ///< for steps past their event cap
  State free_;                                ///< after free flight
  State part_end_;                            ///< where the present part of the step ends
  Motions motion_, end_motion_;               ///< where the part begins and ends
  State probe_;                               ///< for the search of an impact
  detail::ImpactLog<System> log_;
  std::conditional_t<System::bodies == dynamic, Apart, Together> apart_;
};

}  // namespace rbres::RBRES_ABI
