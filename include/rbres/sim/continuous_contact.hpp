#pragma once

#include <numeric>
#include <rbres/contact/step_groups.hpp>
#include <rbres/sim/discrete_contact.hpp>
#include <rbres/sim/observer.hpp>
#include <rbres/sim/step_parts.hpp>

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

 public:
  /// Allocates all that steps need. `system` must outlive it.
  ContinuousContact(const System& system, const SimulationOptions& options)
      : system_(&system),
        options_(options),
        parts_(system, options),
        discrete_(system),
        end_(detail::state_of(system)),
        apart_(system) {}

  /// Takes y from t to t + h. `observer` may have impact(Impact), called for each impulse of an impact in
  /// order of time (at the end of a step that is done group by group), or impact(time, before, after), called
  /// with the states around each group of simultaneous impacts (plain scalars only); for the latter all
  /// bodies are at one time: steps are cut for all of them, cost more, and have other errors. Where a number
  /// is no longer finite, neither is the state that is left.
  template <class Model, class Integrator, class Observer>
  void step(const Model& forces, const Integrator& integrator, State& y, const S& t, const S& h,
            Observer& observer, ContactTally<S>& tally) {
    if (!parts_.start_step(all(), forces, integrator, y, t, h)) return;
    bool flown = false;  // by fly_freely(), from y
    if constexpr (grouped<Model, Observer>) {
      if (step_groups(forces, integrator, y, t, h, observer, tally, flown)) {
        parts_.template end_step<Model>(y, h);
        return;
      }
    }
    parts_.restart_step();
    parts_.log().start_step(false);
    S now = t;
    const S left = parts_.advance(all(), forces, integrator, y, now, h, observer, tally, flown,
                                  [](const auto&, const auto&) { return true; });
    finish(forces, integrator, y, now, left, tally);
    parts_.template end_step<Model>(y, h);
  }

 private:
  using Bodies = detail::BodyIndices<System>;
  /// What steps of groups need.
  struct Apart {
    explicit Apart(const System& system)
        : groups(system), start(detail::state_of(system)), all(detail::per_body<int>(system)) {
      std::iota(all.begin(), all.end(), 0);
    }
    detail::StepGroups<System> groups;
    State start;                               ///< of the step
    detail::PerBody<int, System::bodies> all;  ///< bodies
  };
  struct Together {
    explicit Together(const System&) {}
  };
  /// Whether the bodies of a step may be at different times in it.
  template <class Model, class Observer>
  static constexpr bool grouped =
      detail::has_groups<System>&& detail::is_local<Model, S, typename System::Shape> &&
      !detail::HearsImpacts<Observer, State, S>;

  /// Takes y from t to t + h group by group. Returns false, and leaves all as it was, where there is one
  /// group (which has then been `flown`), where one meets the event cap or has too many impulses for the log.
  template <class Model, class Integrator, class Observer>
  bool step_groups(const Model& forces, const Integrator& integrator, State& y, const S& t, const S& h,
                   Observer& observer, ContactTally<S>& tally, bool& flown) {
    // Balls that touch cost too little for it to pay, but in crowds.
    constexpr bool balls = detail::ContactPair<System>::central;
    if (!(h > S(0)) || (balls && !detail::is_crowd(*system_))) return false;
    detail::StepGroups<System>& groups = apart_.groups;
    State& start = apart_.start;
    groups.start_step();
    const ContactTally<S> tally_before = tally;
    // A group that does not keep to itself, or wakes another, is found anew with all that it may meet: the
    // others take the step to the same bits as if it had not been there.
    for (int attempt = 0; attempt < most_attempts; ++attempt) {
      parts_.fly_freely(all(), forces, integrator, y, t, h);
      const auto& ways = parts_.ways(y, h);
      if (parts_.mark_faults(ways, MaskOf<S>(true), y)) return true;
      flown = !groups.find(all(), y, parts_.free(), ways, h, [&](int i) { return parts_.stays_put(i, y); });
      if (flown) return false;
      start = y;
      for (const int i : groups.alone()) y[i] = parts_.free()[i];
      parts_.start_groups();
      bool apart = true;
      const auto holds = [&](const auto& some, const auto& way) {
        apart = !parts_.woke() && groups.hold(some, start, y, way);
        return apart;
      };
      if (take_groups(forces, integrator, y, t, h, observer, tally, holds)) return true;
      parts_.memory().undo_groups();
      y = start;
      tally = tally_before;
      if (apart) return false;
      parts_.restart_step();
    }
    return false;
  }
  static constexpr int most_attempts = 8;

  /// Takes each of the groups that have been found. Returns false where one is not taken to the end.
  template <class Model, class Integrator, class Observer, class Holds>
  bool take_groups(const Model& forces, const Integrator& integrator, State& y, const S& t, const S& h,
                   Observer& observer, ContactTally<S>& tally, const Holds& holds) {
    const detail::StepGroups<System>& groups = apart_.groups;
    const State& start = apart_.start;
    for (std::size_t k = 0; k < groups.count(); ++k) {
      for (const int i : groups[k]) y[i] = start[i];  // other groups have moved its kinematic bodies
      parts_.memory().start_group();
      S now = t;
      // But for kinematic bodies, which groups before have flown.
      const bool as_flown = groups.kinematic().empty();
      const S left =
          parts_.advance(groups[k], forces, integrator, y, now, h, observer, tally, as_flown, holds);
      if (left > S(0) || parts_.unresolved() || !parts_.told_all()) return false;
      parts_.memory().end_group();
    }
    parts_.memory().end_groups();
    if constexpr (detail::HearsImpulses<Observer, S>) parts_.log().end_groups(observer);
    detail::fly_bodies(*system_, groups.kinematic(), forces, integrator, start, t, h, end_);
    for (const int i : groups.kinematic()) y[i] = end_[i];
    return true;
  }

  Bodies all() const {
    if constexpr (std::is_same_v<Bodies, std::span<const int>>) {
      return {apart_.all.begin(), apart_.all.size()};
    } else {
      return {};
    }
  }

  /// The rest of a step past its event cap is divided into so many: bodies get less deep.
  static constexpr int finishing_parts = 16;
  /// Takes the lanes in which time is `left` (s) to the end of the step, with discrete contacts.
  template <class Model, class Integrator>
  void finish(const Model& forces, const Integrator& integrator, State& y, const S& now, const S& left,
              ContactTally<S>& tally) {
    const MaskOf<S> over = left > S(0), unresolved = parts_.unresolved();
    tally.overruns += over | unresolved;
    if (!any(over)) return;
    const S part = as<S>(1.0 / finishing_parts) * left;
    for (int k = 0; k < finishing_parts; ++k) {
      const S from = now + as<S>(k) * part;
      detail::fly_bodies(*system_, all(), forces, integrator, y, from, part, end_);
      discrete_.resolve(y, end_, part, as<S>(options_.rest_speed), tally);
      for (const int i : all()) y[i] = select(over, end_[i], y[i]);
    }
  }

  const System* system_;
  SimulationOptions options_;
  detail::StepParts<System> parts_;
  detail::DiscreteContact<System> discrete_;  ///< for steps past their event cap
  State end_;                                 ///< of such a step
  std::conditional_t<std::is_same_v<Bodies, std::span<const int>>, Apart, Together> apart_;
};

}  // namespace rbres::RBRES_ABI
