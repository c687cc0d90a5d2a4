#pragma once

#include <concepts>
#include <memory>
#include <rbres/contact/impact_event.hpp>
#include <type_traits>
#include <utility>

namespace rbres::RBRES_ABI::detail {

/// Whether T has a member of the name `impact`, whatever it is: a second one makes the name ambiguous.
struct HasImpact {
  void impact();
};
template <class T>
struct WithImpact : T, HasImpact {};
template <class T>
concept NamesImpact = std::is_class_v<T> && !std::is_final_v<T> && !requires {
  &WithImpact<T>::impact;
};

template <class Observer, class State, class Time>
concept HearsImpacts = requires(Observer& observer, const Time& time, const State& state) {
  observer.impact(time, state, state);
};
template <class Observer, class S>
concept HearsImpulses = requires(Observer& observer, const Impact<S>& impact) {
  observer.impact(impact);
};
template <class Observer, class State>
concept HearsSamples = std::is_invocable_v<Observer&, double, const State&>;

/// What does not fit is an error of the compiler's: an observer that is passed over in silence sees nothing.
/// Lanes have no impacts to show.
template <class State, class Time, class Observer>
constexpr void check_impacts(const Observer&) {
  static_assert(Packed<Time> || !NamesImpact<Observer> || HearsImpacts<Observer, State, Time> ||
                    HearsImpulses<Observer, Time>,
                "an observer's impact is called as (time, state before, state after) or (rbres::Impact)");
}
template <class State, class Time, class Observer>
constexpr void check_observer(const Observer& observer) {
  check_impacts<State, Time>(observer);
  static_assert(
      HearsSamples<Observer, State> || HearsImpacts<Observer, State, Time> || HearsImpulses<Observer, Time>,
      "an observer is called as (double time, const State& state)");
  if constexpr (HearsSamples<Observer, State>) {
    using Answer = std::remove_cvref_t<std::invoke_result_t<Observer&, double, const State&>>;
    static_assert(std::is_void_v<Answer> || std::same_as<Answer, bool>,
                  "an observer returns nothing, or bool: false stops the run");
  }
}

/// An observer as steps see it: one type for all that hear the same, so that steps are compiled once for
/// them.
template <class State, class S, bool Impacts, bool Impulses>
class Listener {
 public:
  template <class Observer>
  explicit Listener(Observer& observer) {
    if constexpr (Impacts || Impulses)
      observer_ = const_cast<void*>(static_cast<const void*>(std::addressof(observer)));
    if constexpr (Impacts) {
      tell_impacts_ = [](void* to, const S& time, const State& before, const State& after) {
        static_cast<Observer*>(to)->impact(time, before, after);
      };
    }
    if constexpr (Impulses)
      tell_impulse_ = [](void* to, const Impact<S>& impact) { static_cast<Observer*>(to)->impact(impact); };
  }
  void impact(const S& time, const State& before, const State& after) const requires(Impacts) {
    tell_impacts_(observer_, time, before, after);
  }
  void impact(const Impact<S>& impact) const requires(Impulses) { tell_impulse_(observer_, impact); }

 private:
  void* observer_ = nullptr;
  void (*tell_impacts_)(void*, const S&, const State&, const State&) = nullptr;
  void (*tell_impulse_)(void*, const Impact<S>&) = nullptr;
};
template <class State, class S, class Observer>
auto listener(Observer& observer) {
  constexpr bool impacts = !Packed<S> && HearsImpacts<Observer, State, S>;
  constexpr bool impulses = !Packed<S> && HearsImpulses<Observer, S>;
  return Listener<State, S, impacts, impulses>(observer);
}

/// Shows the observer a state. False where it stops the run.
template <class Observer, class State>
bool observed(Observer& observer, double time, const State& state) {
  if constexpr (std::is_invocable_r_v<bool, Observer&, double, const State&>) {
    return observer(time, state);
  } else if constexpr (HearsSamples<Observer, State>) {
    observer(time, state);
  }
  return true;
}

}  // namespace rbres::RBRES_ABI::detail
