#pragma once

#include <algorithm>
#include <limits>
#include <rbres/contact/impacts.hpp>
#include <rbres/contact/pair_search.hpp>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/sim/contact_tally.hpp>
#include <rbres/sim/impact_log.hpp>
#include <rbres/sim/next_impact.hpp>
#include <rbres/sim/options.hpp>
#include <rbres/sim/resting_contacts.hpp>
#include <rbres/sim/sleeping_islands.hpp>
#include <rbres/sim/step_clock.hpp>
#include <utility>

namespace rbres::RBRES_ABI::detail {

/// Takes bodies through a step part by part, each up to the next impact: finds the pairs that may touch,
/// resolves the impacts of the instant, finds the forces of resting contacts, and advances.
template <class System>
class StepParts {
  using S = typename System::Scalar;
  using State = typename System::State;
  using Pairs = ContactPairs<System>;
  using Motions = MotionsOf<System>;
  using Bodies = BodyIndices<System>;

 public:
  StepParts(const System& system, const SimulationOptions& options)
      : system_(&system),
        options_(options),
        in_crowd_(is_crowd(system)),
        search_(system, as<S>(options.rest_speed)),
        impacts_(system),
        resting_(system),
        free_(state_of(system)),
        part_end_(free_),
        cut_(free_),
        motion_(per_body<Motion<S>>(system)),
        next_impact_(system),
        course_(system),
        log_(system),
        sleeping_(system) {}

  /// A step of `all` bodies, h seconds from t after y; what does not come out of the last one owes nothing to
  /// it. False where all sleep: then it changes nothing.
  template <class Model, class Integrator>
  bool start_step(const Bodies& all, const Model& forces, const Integrator& integrator, const State& y,
                  const S& t, const S& h) {
    resting_.continue_from(y);
    sleeping_.forget_rests();
    flown_ = false;
    if constexpr (may_sleep<Model>) {
      if (sleeping_.any()) {
        fly_bodies(*system_, all, forces, integrator, y, t, h, free_);
        sleeping_.start_step(y, free_);
        flown_ = true;
      }
    }
    return !sleeping_.all_sleep(y);
  }
  template <class Model>
  void end_step(State& y, const S& h) {
    if constexpr (may_sleep<Model>) sleeping_.end_step(y, h, resting_.memory());
    resting_.end_step(y);
  }
  /// Starts the step anew, with bodies that have not rested yet.
  void restart_step() {
    sleeping_.forget_rests();
    flown_ = false;
  }
  /// What resting contacts know of their forces.
  ContactMemory<System>& memory() { return resting_.memory(); }
  /// What tells an observer of impulses.
  ImpactLog<System>& log() { return log_; }
  /// Starts a step that is done group by group, after fly_freely() of all bodies.
  void start_groups() {
    resting_.memory().start_groups();
    sleeping_.start_groups();
    log_.start_step(true);
    impacts_.start_count();
  }
  /// Whether the log has room for the impulses of the groups.
  bool told_all() const { return log_.has_room(impacts_.noted()); }
  /// Where advance() met a press of bodies that no impulse lets part.
  MaskOf<S> unresolved() const { return impacts_.unresolved(); }

  /// Where `bodies` would be h seconds from t after y without impacts: free().
  template <class Model, class Integrator>
  void fly_freely(const Bodies& bodies, const Model& forces, const Integrator& integrator, const State& y,
                  const S& t, const S& h) {
    bodies_ = bodies;
    course_.clear(bodies_);
    if (!flown_) fly_bodies(*system_, bodies_, forces, integrator, y, t, h, free_);
    sleeping_.hold(bodies_, y, free_);
    search_.start_part(bodies_);
  }
  const State& free() const { return free_; }
  /// Whether body i of y sleeps, or is a still kinematic body; whether one that slept when the groups of the
  /// step were found does not any longer.
  /// @{
  bool stays_put(int i, const State& y) const { return sleeping_.stays_put(i, y); }
  bool woke() const { return sleeping_.woke(); }
  /// @}
  /// How far (m) each body gets in that time.
  const auto& ways(const State& y, const S& h) { return search_.ways(bodies_, y, free_, h); }

  /// Returns the running lanes in which a number on the way to free(), or its square, is not finite; there
  /// the position of its body in y says so, too.
  MaskOf<S> mark_faults(const typename PairSearch<System>::Ways& way, const MaskOf<S>& running,
                        State& y) const {
    constexpr auto nan = std::numeric_limits<typename Constants<S>::Real>::quiet_NaN();
    MaskOf<S> faulty(false);
    for (const int i : course_.others()) {
      const RigidState<S>& ahead = free_[i];
      const Quat<S>& q = ahead.orientation;
      const S all_of_it =
          way[static_cast<std::size_t>(i)] + norm(ahead.velocity) + norm(ahead.angular_velocity) + q.x + q.w;
      const MaskOf<S> unfit = running & !is_finite(all_of_it);
      faulty = faulty | unfit;
      y[i].position.x = select(unfit, S(nan), y[i].position.x);
    }
    return faulty;
  }

  /// Takes `bodies` of y from `now` on by h, until its event cap is met or some of them no longer `hold` to
  /// the ways (m) that they may go. Returns how much of h is left. `flown`: fly_freely() has taken them that
  /// far, and they would hold to that.
  template <class Model, class Integrator, class Observer, class Hold>
  S advance(const Bodies& bodies, const Model& forces, const Integrator& integrator, State& y, S& now,
            const S& h, Observer& observer, ContactTally<S>& tally, bool flown, const Hold& hold) {
    start_parts(bodies);
    const auto fly = [&](State& end, const Bodies& which, const S& seconds, const auto& push) {
      fly_bodies(*system_, which, forces, integrator, y, now, seconds, end, push);
      sleeping_.hold(bodies_, y, end);
    };
    StepClock<S> clock(h, in_crowd_);
    bool resolved = false;  // the impacts of this instant
    const long most = most_events(bodies);
    for (long event = 0; event < most; ++event) {
      clock.give_up(impacts_.unresolved());  // bodies in a press: no impulse lets all points part
      StepPart<S> part = clock.next();
      if (!any(part.running)) break;

      // Find the pairs that may touch before the part is over.
      if (!clock.goes_on(part)) course_.clear(bodies_);
      if (!std::exchange(flown, false)) {
        fly(free_, course_.others(), part.seconds, NoPush{});
        const auto& ways = search_.ways(course_.others(), y, free_, part.seconds);
        const MaskOf<S> faulty = mark_faults(ways, part.running, y);
        clock.stop(faulty);
        part.running = part.running & !faulty;
        if (!hold(course_.others(), ways)) return clock.left();
      }
      Pairs& pairs = search_.find(bodies_, y, part.running, course_);
      if (!sleeping_.sift(y, free_, search_.ways(), part.seconds, pairs)) {
        course_.clear(bodies_);
        continue;
      }
      if (pairs.empty()) {
        replace(part.running, free_, y);
        course_.clear(bodies_);
        clock.pass(part, part.seconds);
        now = now + part.seconds;
        continue;
      }
      if (clock.shorten_for(fastest_spin<System>(pairs, y), part)) continue;
      measure_others(pairs, y, part.running);

      // Resolve the impacts of this instant.
      if (!std::exchange(resolved, true) && resolve_impacts(pairs, y, now, observer, tally)) continue;

      // Find the forces of resting contacts, and where they take the bodies.
      const bool resting = resting_.find(bodies_, pairs, motion_, part.running, course_);
      if (resting) {
        if (leave_course()) continue;
        hold_resting(pairs, y, now, part, fly);
        // They may carry a body farther than its free flight: then others may be in its way.
        if (!search_.covers(course_.others(), y, part_end_, part.seconds, part.running)) continue;
      } else {
        for (const int i : course_.others()) part_end_[i] = free_[i];
      }

      // Find the next impact, and go there.
      const S sinking = resting && in_crowd_ ? as<S>(heap_sinking) : S(0);
      MaskOf<S> lost(false);
      const S first = next_impact_.find(pairs, course_, y, motion_, part_end_, part.seconds, sinking, lost);
      const S impact = maximum(first, clock.least(part));
      clock.give_up(lost);
      if (sleeping_.disturbed(pairs, part.seconds)) {
        course_.clear(bodies_);
        continue;
      }
      const MaskOf<S> cuts = part.running & (impact < part.seconds);
      const bool cut = any(cuts);
      const S duration = cut ? impact : part.seconds;
      State& end = cut ? cut_ : part_end_;
      if (cut) {
        resting ? fly(end, bodies_, duration, push_from(y, now)) : fly(end, bodies_, duration, NoPush{});
      }
      if ((cut || resting) &&
          clock.shorten_where(resting_.sunk(pairs, end, duration, cuts, sinking) > S(1), part))
        continue;

      // What is known is for the time up to the end of the step: islands that the impact does not reach keep
      // their forces, and their bodies their course.
      const bool goes_on = in_crowd_ && cut && clock.ends_with(part);
      if (resting || goes_on) resting_.keep_undisturbed(pairs, goes_on, end, duration, part.seconds);
      if (is_local<Model, S, typename System::Shape> && goes_on) {
        choose_course(pairs, part.seconds, sinking);
      } else {
        course_.clear(bodies_);
      }
      if (resting) resting_.correct_velocities(course_.others(), pairs, y, end, duration, part.pull);
      replace(part.running, end, y);
      if constexpr (may_be_crowd<System>) {
        resting ? resting_.note_manifolds(pairs, y) : search_.forget();
      }
      clock.pass(part, duration);
      now = now + duration;
      keep_course(pairs, duration);
      if (resting && !any(clock.left() > S(0))) sleeping_.collect(pairs);
      search_.start_part(bodies_);
      resolved = false;
    }
    return clock.left();
  }

 private:
  /// In which forces are found again for bodies that are held.
  static constexpr int most_rounds = 8;

  /// Whether a body's forces depend on nothing but itself: else none sleeps.
  template <class Model>
  static constexpr bool may_sleep =
      SleepingIslands<System>::possible&& is_local<Model, S, typename System::Shape>;

  /// How many events a step of `bodies` may have. Each of a crowd is one of a few of them.
  long most_events(const Bodies& bodies) const {
    long most = options_.max_events;
    if constexpr (may_be_crowd<System>) {
      if (in_crowd_) most *= (std::ssize(bodies) + few_bodies - 1) / few_bodies;
    }
    return most;
  }

  void start_parts(const Bodies& bodies) {
    bodies_ = bodies;
    impacts_.start_step(bodies_);
    resting_.start_step(bodies_);
    search_.forget();
    search_.start_part(bodies_);
    course_.clear(bodies_);
  }

  /// Notes how pairs meet in y, but for those of two bodies that are on course.
  void measure_others(Pairs& pairs, const State& y, const MaskOf<S>& running) {
    set_motions(*system_, course_.others(), y, motion_);
    for (auto& pair : pairs) {
      if (course_.has(pair)) continue;
      for (const int i : {pair.who.first, pair.who.second}) {
        if (i >= 0 && course_.has(i)) motion_[static_cast<std::size_t>(i)] = motion_of((*system_)[i], y[i]);
      }
    }
    for (auto& pair : pairs) {
      if (!course_.has(pair)) measure(*system_, y, motion_, running, pair);
    }
  }

  /// Resolves the impacts of this instant, of which the observer may hear. False where there are none.
  template <class Observer>
  bool resolve_impacts(Pairs& pairs, State& y, const S& now, Observer& observer, ContactTally<S>& tally) {
    if (!any(find_impulses(pairs, now, observer, tally))) return false;
    for (const int i : bodies_) cut_[i] = y[i];
    take_velocities(
        bodies_, [&](int i) { return impacts_.changed(i); }, cut_, motion_);
    if constexpr (HearsImpacts<Observer, State, S>)
      observer.impact(now, std::as_const(y), std::as_const(cut_));
    for (const int i : bodies_) {
      if (!any(impacts_.changed(i))) continue;
      resting_.note_impact(i, y[i], cut_[i]);
      y[i] = cut_[i];
    }
    course_.choose(bodies_, [&](int i) { return course_.has(i) && !any(impacts_.changed(i)); });
    return true;
  }
  /// Gives motion_ the velocities after these impacts, and returns where there are any.
  template <class Observer>
  MaskOf<S> find_impulses(Pairs& pairs, const S& now, Observer& observer, ContactTally<S>& tally) {
    if constexpr (!Packed<S> && HearsImpulses<Observer, S>) {
      const auto hear = [&](const Candidate& who, const Vec3<S>& normal, const Vec3<S>& point,
                            const Vec3<S>& impulse) {
        if (squared_norm(impulse) > S(0))
          log_.hear(Impact<S>{now, who.first, who.second, point, normal, impulse}, observer);
      };
      return impacts_.resolve(bodies_, pairs, motion_, tally.impacts, hear);
    } else {
      return impacts_.resolve(bodies_, pairs, motion_, tally.impacts, Unheard{});
    }
  }

  /// Finds the forces of resting contacts over a part from y on, and where they take the bodies: part_end_.
  template <class Fly>
  void hold_resting(Pairs& pairs, State& y, const S& now, const StepPart<S>& part, const Fly& fly) {
    if (const MaskOf<S> stopped = resting_.stop_approaches(pairs, motion_, part.pull); any(stopped)) {
      take_velocities(
          bodies_, [&](int i) { return stopped & resting_.islands().moves(i); }, y, motion_);
      for (auto& pair : pairs) {
        if (!course_.has(pair)) measure_speeds<System>(motion_, pair);
      }
      fly(free_, course_.others(), part.seconds, NoPush{});
    }
    const auto hold = [&] {
      resting_.find_forces(pairs, y, motion_, free_, part.seconds, part.pull);
      fly(part_end_, course_.others(), part.seconds, push_from(y, now));
    };
    if constexpr (SleepingIslands<System>::possible) {
      resting_.expect_held(motion_, free_);
      hold();
      for (int round = 0; round < most_rounds && resting_.learn_held(motion_, part_end_, free_, round > 0);
           ++round)
        hold();
    } else {
      hold();
    }
  }
  /// What resting contacts add to other forces in a part that begins at y and `now`.
  auto push_from(const State& y, const S& now) {
    return [&](const RigidState<S>& state, int i, const S& at, const Wrench<S>& wrench) {
      const auto& contact = resting_.forces()[static_cast<std::size_t>(i)];
      const auto& kept = resting_.islands().kept();
      const Vec3<S> torque =
          contact.torque_at(kept.age(i, S(at - now)), state.position - kept.start(y)[i].position);
      resting_.note_torque(i, wrench.torque);
      return wrench + Wrench<S>{contact.force, rotate_back(state.orientation, torque)};
    };
  }

  /// After a part of at most so many seconds that an impact has ended: what it does not reach goes on as it
  /// did, unless a resting pair would sink in on its way.
  void choose_course(const Pairs& pairs, const S& most, const S& sinking) {
    if constexpr (OnCourse<System>::possible) {
      // Forces on what kinematic bodies push are found from their motion, too.
      course_.choose(bodies_, [&](int i) {
        return !resting_.islands().kept().disturbed(i) && !(*system_)[i].is_kinematic();
      });
      for (const auto& pair : pairs) {
        if (!pair.any_resting || pair.foreseen || !course_.has(pair)) continue;
        if (pair.impact < most || resting_.sinks(pair, part_end_, sinking)) course_.drop(pair);
      }
      course_.choose(bodies_, [&](int i) { return course_.has(i); });
    }
  }
  /// Bodies on which another has come to rest do not go on as they did. False where there are none.
  bool leave_course() {
    if constexpr (OnCourse<System>::possible) {
      const auto stays = [&](int i) { return course_.has(i) && !any(resting_.islands().moves(i)); };
      if (std::all_of(bodies_.begin(), bodies_.end(), [&](int i) { return course_.has(i) == stays(i); }))
        return false;
      course_.choose(bodies_, stays);
      return true;
    }
    return false;
  }
  /// So many seconds later, the pairs of bodies that are on course meet as was found before.
  void keep_course(Pairs& pairs, const S& seconds) {
    for (const int i : bodies_) {
      if (course_.has(i)) free_[i] = part_end_[i];
    }
    for (auto& pair : pairs) {
      if (!course_.has(pair)) continue;
      pair.foreseen = true;
      pair.impact -= seconds;
      pair.apart_for -= seconds;
      for (auto& point : pair.touching) point = MaskOf<S>(false);
    }
  }
  /// Gives y the numbers of `other` in these lanes.
  void replace(const MaskOf<S>& lanes, const State& other, State& y) const {
    for (const int i : bodies_) y[i] = select(lanes, other[i], y[i]);
  }

  const System* system_;
  SimulationOptions options_;
  bool in_crowd_;
  Bodies bodies_;  ///< that are taken on together
  PairSearch<System> search_;
  Impacts<System> impacts_;
  RestingContacts<System> resting_;
  State free_;          ///< after free flight
  bool flown_ = false;  ///< whether that is of all bodies over the step that starts
  State part_end_;      ///< where the present part of the step ends, if no impact does
  State cut_;           ///< where an impact has ended it, or what the impact has made of that
  Motions motion_;      ///< where the part begins
  NextImpact<System> next_impact_;
  OnCourse<System> course_;
  ImpactLog<System> log_;
  SleepingIslands<System> sleeping_;
};

}  // namespace rbres::RBRES_ABI::detail
