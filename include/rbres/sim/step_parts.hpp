#pragma once

#include <algorithm>
#include <limits>
#include <rbres/contact/impact_search.hpp>
#include <rbres/contact/impacts.hpp>
#include <rbres/contact/pair_search.hpp>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/sim/contact_tally.hpp>
#include <rbres/sim/impact_log.hpp>
#include <rbres/sim/options.hpp>
#include <rbres/sim/resting_contacts.hpp>
#include <rbres/sim/sleeping_islands.hpp>
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
        end_motion_(motion_),
        probe_(free_),
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
  void restart_step() { sleeping_.forget_rests(); }
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
    if (!flown_) fly_to(free_, bodies_, forces, integrator, y, t, h);
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
    bodies_ = bodies;
    impacts_.start_step(bodies_);
    resting_.start_step(bodies_);
    search_.forget();
    search_.start_part(bodies_);
    course_.clear(bodies_);
    S left = h, known = h;  // how far those on course are known to go
    MaskOf<S> lost(false);  // too far for one step, or without an end of impacts
    bool resolved = false;  // the impacts of this instant
    S longest = h;          // part that can be computed at once
    const S shortest = as<S>(1.0 / 512) * h;
    for (int event = 0; event < options_.max_events; ++event) {
      lost = lost | impacts_.unresolved();  // bodies in a press: no impulse lets all points part
      MaskOf<S> running = (left > S(0)) & !lost;
      if (!any(running)) break;
      // No rest is left that is a rounding error: forces over such a part would be, too.
      const S ahead = select(left < as<S>(1.25) * longest, left, longest);
      // Resting contacts close a tenth of their gap in a step, and more where its parts must be short.
      // Bodies of a heap that are wedged between walls overlap both: they would push for ever.
      const ClosingRate<S> pull{as<S>(0.1) / h, select(longest < h, S(as<S>(0.5) / longest), S(0)),
                                in_crowd_ ? as<S>(1.1 * heap_sinking) : S(0)};

      // Find the pairs that may touch before the step is over.
      if constexpr (OnCourse<System>::possible) {
        if (ahead != known) course_.clear(bodies_);
      }
      if (!flown) {
        fly_to(free_, course_.others(), forces, integrator, y, now, ahead);
        sleeping_.hold(bodies_, y, free_);
        const MaskOf<S> faulty = mark_faults(search_.ways(course_.others(), y, free_, ahead), running, y);
        left = select(faulty, S(0), left);
        running = running & !faulty;
        if (!hold(course_.others(), search_.ways())) return left;
      }
      flown = false;
      const auto& ways = search_.ways();
      Pairs& pairs = search_.find(bodies_, y, running, course_);
      if (!sleeping_.sift(y, free_, ways, ahead, pairs)) {
        course_.clear(bodies_);
        continue;
      }
      if (pairs.empty()) {
        replace(running, free_, y);
        left = select(running, S(left - ahead), left);
        now = now + ahead;
        continue;
      }

      // What an impact has made spin may turn too far for the interpolation that finds the next.
      const S turn = fastest_spin<System>(pairs, y) * ahead;
      const MaskOf<S> far = turn > as<S>(1.25), helps = ahead > shortest * turn,
                      whirls = running & far & helps;
      if (any(whirls)) {
        longest = select(whirls, S(ahead / maximum(turn, S(1))), longest);
        continue;
      }

      set_motions(*system_, course_.others(), y, motion_);
      for (auto& pair : pairs) {
        if (course_.has(pair)) continue;
        for (const int i : {pair.who.first, pair.who.second}) {
          if (i >= 0 && course_.has(i)) set_motion(i, y);
        }
      }
      for (auto& pair : pairs) {
        if (!course_.has(pair)) measure(*system_, y, motion_, running, pair);
      }

      // Resolve the impacts of this instant.
      if (!resolved && any(resolve_impacts(pairs, now, observer, tally))) {
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
        resolved = true;
        continue;
      }
      resolved = false;

      // Find the forces of resting contacts.
      const bool resting = resting_.find(bodies_, pairs, motion_, running, course_);
      if (resting && leave_course()) {
        resolved = true;
        continue;
      }
      if (const MaskOf<S> stopped =
              resting ? resting_.stop_approaches(pairs, motion_, pull) : MaskOf<S>(false);
          any(stopped)) {
        take_velocities(
            bodies_, [&](int i) { return stopped & resting_.moves(i); }, y, motion_);
        for (auto& pair : pairs) {
          if (!course_.has(pair)) measure_speeds<System>(motion_, pair);
        }
        fly_to(free_, course_.others(), forces, integrator, y, now, ahead);
        sleeping_.hold(bodies_, y, free_);
      }
      if (resting) {
        if constexpr (SleepingIslands<System>::possible) resting_.expect_held(motion_, free_);
        resting_.find_forces(pairs, y, motion_, free_, ahead, pull);
      }
      const auto go = [&](State& end, const Bodies& which, const S& time) {
        const auto push = [&](const RigidState<S>& state, int i, const S& at, const Wrench<S>& wrench) {
          const auto& c = resting_.forces()[static_cast<std::size_t>(i)];
          const auto& kept = resting_.kept();
          const Vec3<S> torque =
              c.torque_at(kept.age(i, S(at - now)), state.position - kept.start(y)[i].position);
          resting_.note_torque(i, wrench.torque);
          return wrench + Wrench<S>{c.force, rotate_back(state.orientation, torque)};
        };
        if (resting) {
          fly_to(end, which, forces, integrator, y, now, time, push);
        } else {
          fly_to(end, which, forces, integrator, y, now, time);
        }
        sleeping_.hold(bodies_, y, end);
      };

      // Advance to the next impact.
      if (resting) {
        go(part_end_, course_.others(), ahead);
        if constexpr (SleepingIslands<System>::possible) {
          for (int round = 0;
               round < most_rounds && resting_.learn_held(motion_, part_end_, free_, round > 0); ++round) {
            resting_.find_forces(pairs, y, motion_, free_, ahead, pull);
            go(part_end_, course_.others(), ahead);
          }
        }
      } else {
        for (const int i : course_.others()) part_end_[i] = free_[i];
      }
      S duration = ahead;
      // Contact forces may carry a body farther than its free flight: then others may be in its way.
      if (resting && !search_.covers(course_.others(), y, part_end_, ahead, running)) {
        resolved = true;
        continue;
      }
      const S sinking = resting && in_crowd_ ? as<S>(heap_sinking) : S(0);
      // However dense the impacts, time goes on.
      const S impact =
          maximum(earliest_impact(pairs, y, ahead, sinking, lost), minimum(ahead, S(as<S>(1e-9) * h)));
      if (sleeping_.disturbed(pairs, ahead)) {
        course_.clear(bodies_);
        resolved = true;
        continue;
      }
      const MaskOf<S> cuts = running & (impact < ahead);
      const bool cut = any(cuts);
      State& end = cut ? cut_ : part_end_;
      if (cut) {
        go(end, bodies_, impact);
        duration = impact;
      }
      if (cut || resting) {
        // Forces that are constant over a part, and the interpolation that finds impacts, are off by the
        // third and fourth power of its duration: where bodies end too deep, it must be shorter.
        const MaskOf<S> divides = ahead > shortest,
                        sinks = resting_.sunk(pairs, end, duration, cuts, sinking) > S(1);
        const MaskOf<S> deep = running & divides & sinks;
        if (any(deep)) {
          longest = select(deep, maximum(S(as<S>(0.5) * ahead), shortest), longest);
          resolved = true;
          continue;
        }
      }
      // What is known is for the time up to the end of the step: islands that the impact does not reach keep
      // their forces, and their bodies their course.
      const MaskOf<S> early = ahead < left;
      const bool goes_on = in_crowd_ && cut && !any(early);
      if (resting || goes_on) resting_.keep_undisturbed(pairs, goes_on, end, duration, ahead);
      if (is_local<Model, S, typename System::Shape> && goes_on) {
        choose_course(pairs, ahead, sinking);
      } else {
        course_.clear(bodies_);
      }
      if (resting) resting_.correct_velocities(course_.others(), pairs, y, end, duration, pull);
      replace(running, end, y);
      if constexpr (may_be_crowd<System>) {
        resting ? resting_.note_manifolds(pairs, y) : search_.forget();
      }
      left = select(running, S(left - duration), left);
      known = left;
      // In a crowd it is one body of many whose parts must be short, and most often not for long.
      if (in_crowd_) longest = minimum(h, S(as<S>(1.5) * longest));
      keep_course(pairs, duration);
      now = now + duration;
      if (resting && !any(left > S(0))) sleeping_.collect(pairs);
      search_.start_part(bodies_);
    }
    return left;
  }

 private:
  /// In which forces are found again for bodies that are held.
  static constexpr int most_rounds = 8;

  /// Whether a body's forces depend on nothing but itself: else none sleeps.
  template <class Model>
  static constexpr bool may_sleep =
      SleepingIslands<System>::possible&& is_local<Model, S, typename System::Shape>;

  /// Resolves the impacts of this instant; the observer may hear their impulses.
  template <class Observer>
  MaskOf<S> resolve_impacts(Pairs& pairs, const S& now, Observer& observer, ContactTally<S>& tally) {
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

  template <class Model, class Integrator, class Push = NoPush>
  void fly_to(State& end, const Bodies& bodies, const Model& forces, const Integrator& integrator,
              const State& y, const S& t, const S& h, const Push& push = {}) const {
    fly_bodies(*system_, bodies, forces, integrator, y, t, h, end, push);
  }
  void set_motion(int i, const State& y) {
    motion_[static_cast<std::size_t>(i)] = motion_of((*system_)[i], y[i]);
  }
  /// After a part of at most so many seconds that an impact has ended: what it does not reach goes on as it
  /// did, unless a resting pair would sink in on its way.
  void choose_course(const Pairs& pairs, const S& most, const S& sinking) {
    if constexpr (OnCourse<System>::possible) {
      // Forces on what kinematic bodies push are found from their motion, too.
      course_.choose(bodies_,
                     [&](int i) { return !resting_.kept().disturbed(i) && !(*system_)[i].is_kinematic(); });
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
      const auto stays = [&](int i) { return course_.has(i) && !any(resting_.moves(i)); };
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

  /// When in a part of so many seconds from `start` to part_end_ the first pair touches that does not rest,
  /// s; all of the part where none does. `sinking`, `lost`: see impact_time().
  S earliest_impact(Pairs& pairs, const State& start, const S& seconds, const S& sinking, MaskOf<S>& lost) {
    for (const int i : course_.others()) {
      const RigidState<S>& body = part_end_[i];
      Motion<S>& motion = end_motion_[static_cast<std::size_t>(i)];
      motion.position = body.position;
      motion.velocity = body.velocity;
      motion.angular_velocity = body.angular_velocity_world();
    }
    const auto find = [&](auto& pair) {
      pair.impact =
          impact_time(*system_, pair, start, part_end_, end_motion_, seconds, sinking, probe_, lost);
      if (in_crowd_) pair.apart_for = time_apart(*system_, pair, start, part_end_);
      pair.foreseen = false;
    };
    S earliest = seconds;
    for (auto& pair : pairs) {
      if (!course_.has(pair)) find(pair);
      earliest = minimum(earliest, pair.impact);
    }
    if constexpr (may_be_crowd<System>) {
      // What was foreseen from afar may be too early.
      const auto before = [](const auto& a, const auto& b) { return a.impact < b.impact; };
      for (;;) {
        const auto first = std::min_element(pairs.begin(), pairs.end(), before);
        earliest = minimum(seconds, first->impact);
        if (!first->foreseen || !(first->impact < seconds)) break;
        for (const int i : {first->who.first, first->who.second}) {
          if (i >= 0) set_motion(i, start);
        }
        measure(*system_, start, motion_, MaskOf<S>(true), *first);
        find(*first);
      }
    }
    return earliest;
  }

  const System* system_;
  SimulationOptions options_;
  bool in_crowd_;
  Bodies bodies_;  ///< that are taken on together
  PairSearch<System> search_;
  Impacts<System> impacts_;
  RestingContacts<System> resting_;
  State free_;                   ///< after free flight
  bool flown_ = false;           ///< whether that is of all bodies over the step that starts
  State part_end_;               ///< where the present part of the step ends, if no impact does
  State cut_;                    ///< where an impact has ended it, or what the impact has made of that
  Motions motion_, end_motion_;  ///< where the part begins and ends
  State probe_;                  ///< for the search of an impact
  OnCourse<System> course_;
  ImpactLog<System> log_;
  SleepingIslands<System> sleeping_;
};

}  // namespace rbres::RBRES_ABI::detail
