#pragma once

#include <limits>
#include <rbres/body/check_state.hpp>
#include <rbres/contact/contact_query.hpp>
#include <rbres/sim/contacts.hpp>
#include <rbres/sim/observer.hpp>
#include <type_traits>
#include <utility>

namespace rbres::RBRES_ABI {

/// How a run ended.
enum class SimulationStatus {
  finished,    ///< all of the duration was simulated
  stopped,     ///< the observer returned false
  non_finite,  ///< a number became infinite or NaN; the state is the last good one
};

/// What a run did.
struct SimulationReport {
  /// How it ended.
  SimulationStatus status = SimulationStatus::finished;
  long steps = 0;     ///< steps done
  double time = 0;    ///< simulated, s
  long impacts = 0;   ///< approaches answered by an impulse
  long touching = 0;  ///< discrete contacts: touching pairs, summed over steps
  long overruns = 0;  ///< steps that met the event cap
  int bad_body = -1;  ///< the first body whose state was not finite
};

/// Takes a system's state forward, step by step: what simulate does, for a program that has its own loop.
/// Allocates when it is built and never after. It remembers the forces of resting contacts, where the next
/// step starts: a copy goes on to the same bits, and so does a stepper to which such a copy is assigned.
/// `Contacts` says how bodies collide, see AnalyticContacts.
template <class System, class Model, class Integrator, class Contacts = AnalyticContacts>
class Stepper {
  using S = typename System::Scalar;

 public:
  /// Where the bodies are.
  using State = typename System::State;

  /// Throws Error for options that make no sense. `system` must outlive the stepper and its copies, and so
  /// must `contacts`.
  Stepper(const System& system, const Model& forces, const Integrator& integrator, const Contacts& contacts,
          const SimulationOptions& options)
      : system_(&system),
        forces_(forces),
        integrator_(integrator),
        contacts_(contacts, system, options),
        before_(detail::state_of(system)) {
    options.check();
  }
  /// The same where how bodies collide needs no data.
  Stepper(const System& system, const Model& forces, const Integrator& integrator,
          const SimulationOptions& options) requires(std::is_empty_v<Contacts>)
      : Stepper(system, forces, integrator, Contacts{}, options) {}
  Stepper(System&&, const Model&, const Integrator&, const Contacts&, const SimulationOptions&) = delete;
  Stepper(System&&, const Model&, const Integrator&, const SimulationOptions&) = delete;

  /// y at t becomes y at t + h, h of 0 s or more. Returns -1, or the first body that is no longer finite;
  /// then y is as it was in the lanes where it happened. Where t or h is not finite or h is negative, nothing
  /// moves, and that is body 0. `observer` may have an impact(), see ContinuousContact.
  template <class Observer>
  int step(State& y, const S& t, const S& h, Observer& observer) {
    detail::check_impacts<State, S>(observer);
    detail::check_size(*system_, y);
    before_ = y;
    const MaskOf<S> forward = h >= S(0);
    const MaskOf<S> sound = forward & is_finite(S(t + h));
    // A time so short that its square has no inverse moves nothing.
    const MaskOf<S> lasts = square(h) >= S(std::numeric_limits<typename Constants<S>::Real>::min());
    const S time = select(sound & lasts, h, S(0));
    contacts_.step(forces_, integrator_, y, t, time, observer, tally_);
    if (!all(sound)) {
      constexpr auto nan = std::numeric_limits<typename Constants<S>::Real>::quiet_NaN();
      y[0].position.x = select(sound, y[0].position.x, S(nan));
    }
    return keep_finite(y);
  }
  /// The same without an observer.
  int step(State& y, const S& t, const S& h) {
    struct None {
    } none;
    return step(y, t, h, none);
  }

  /// What has happened so far.
  const ContactTally<S>& tally() const { return tally_; }
  /// Where every state so far was finite, lane by lane.
  const MaskOf<S>& finite() const { return finite_; }

 private:
  int keep_finite(State& y) {
    S sum(0);
    for (const RigidState<S>& body : y.body) sum += component_sum(body);
    const MaskOf<S> good = is_finite(sum);
    if (all(good)) return -1;
    finite_ = finite_ & good;
    int bad = 0;
    for (std::size_t i = y.body.size(); i-- > 0;) {
      if (!all(is_finite(component_sum(y.body[i])))) bad = static_cast<int>(i);
      y.body[i] = select(good, y.body[i], before_.body[i]);
    }
    return bad;
  }
  /// Not finite where one of the numbers is not.
  static S component_sum(const RigidState<S>& b) {
    const Quat<S>& q = b.orientation;
    const Vec3<S> sum = b.position + b.velocity + b.angular_velocity;
    return (sum.x + sum.y) + (sum.z + q.x) + (q.y + q.z + q.w);
  }

  const System* system_;
  Model forces_;
  Integrator integrator_;
  typename Contacts::template Step<System> contacts_;
  State before_;  ///< where the step began
  ContactTally<S> tally_;
  MaskOf<S> finite_{true};
};

namespace detail {

/// Refuses states of another number of bodies, numbers that are not finite, and quaternions that are not unit
/// (off by more than 1e-3).
template <class System>
void check_numbers(const System& system, const typename System::State& y) {
  check_size(system, y);
  for (int i = 0; i < system.size(); ++i)
    naming([&] { return text("body ", i, ", "); }, [&] { check_rigid_state(y[i]); });
}

}  // namespace detail

/// Refuses states that no simulation can start from: numbers that are not finite, quaternions that are not
/// unit (off by more than 1e-3), bodies that overlap by more than a thousandth of the smaller one's bounding
/// radius. Small overlaps stay: they part without gaining energy.
template <class System>
void check_state(const System& system, const typename System::State& y) {
  using S = typename System::Scalar;
  detail::check_numbers(system, y);
  for (const auto& contact : contacts(system, y)) {
    S size = system[contact.second].bounding_radius();
    if (!contact.with_plane()) size = minimum(size, system[contact.first].bounding_radius());
    if (contact.gap < as<S>(-1e-3) * size) {
      const auto other = contact.with_plane() ? detail::Line("plane ", contact.plane())
                                              : detail::Line("body ", contact.first);
      detail::refuse(detail::Line("body ", contact.second, " and ", other), "surfaces apart or touching",
                     detail::Line("an overlap of ", S(-contact.gap), " m"));
    }
  }
}

namespace detail {

/// Refuses runs that `contacts` cannot do.
template <class Contacts>
void check_plan(const Contacts& contacts, const StepPlan& plan) {
  if constexpr (requires { contacts.check(plan); }) contacts.check(plan);
}
/// Refuses states that a run with `Contacts` cannot start from.
template <class Contacts, class System>
void check_start(const System& system, const typename System::State& y) {
  if constexpr (Contacts::allows_overlap)
    check_numbers(system, y);
  else
    check_state(system, y);
}

}  // namespace detail

/// Simulates `state` over options.duration (s) and leaves it at the end. `observer` is callable as (time,
/// state) and returns nothing, or bool: false stops the run. It sees the start, its orientations made unit,
/// every sample and the end, and changes no bit of the result: see StepPlan. It may also, or only, have
/// impact(Impact) or impact(time, before, after), see ContinuousContact; anything else does not compile.
/// `contacts` says how bodies collide: a ContactLaw, or where there is none AnalyticContacts. Throws Error
/// for options and states that make no sense.
template <class System, class Model, class Integrator, class Contacts, class Observer>
SimulationReport simulate(const System& system, typename System::State& state, const Model& forces,
                          const Integrator& integrator, const Contacts& contacts,
                          const SimulationOptions& options, Observer&& observer) {
  using S = typename System::Scalar;
  static_assert(!Packed<S>, "simulate runs one scenario; simulate_batch runs many in lanes");
  detail::check_observer<typename System::State, S>(observer);
  Stepper<System, Model, Integrator, Contacts> stepper(system, forces, integrator, contacts, options);
  detail::check_start<Contacts>(system, state);
  const StepPlan plan(options);
  detail::check_plan(contacts, plan);
  for (auto& body : state.body) detail::make_unit(body.orientation);
  SimulationReport report;
  const auto look = [&](double time) { return detail::observed(observer, time, std::as_const(state)); };
  bool going = look(0.0);
  for (long k = 0; k < plan.parts() && going && report.bad_body < 0; ++k) {
    const StepPlan::Part part = plan.part(k);
    for (long j = 0; j < part.steps && report.bad_body < 0; ++j) {
      report.bad_body = stepper.step(state, as<S>(part.time(j)), as<S>(part.step), observer);
      if (report.bad_body < 0) ++report.steps;
      report.time = part.time(report.bad_body < 0 ? j + 1 : j);
    }
    if (report.bad_body >= 0) {
      report.status = SimulationStatus::non_finite;
    } else {
      report.time = part.end;
      going = look(part.end);
    }
  }
  if (!going) report.status = SimulationStatus::stopped;
  report.impacts = stepper.tally().impacts;
  report.touching = stepper.tally().touching;
  report.overruns = stepper.tally().overruns;
  return report;
}

/// The same with AnalyticContacts, or without an observer, or both.
/// @{
template <class System, class Model, class Integrator, class Observer>
SimulationReport simulate(const System& system, typename System::State& state, const Model& forces,
                          const Integrator& integrator, const SimulationOptions& options,
                          Observer&& observer) {
  return simulate(system, state, forces, integrator, AnalyticContacts{}, options,
                  std::forward<Observer>(observer));
}
template <class System, class Model, class Integrator, class Contacts>
SimulationReport simulate(const System& system, typename System::State& state, const Model& forces,
                          const Integrator& integrator, const Contacts& contacts,
                          const SimulationOptions& options) {
  return simulate(system, state, forces, integrator, contacts, options, [](double, const auto&) {});
}
template <class System, class Model, class Integrator>
SimulationReport simulate(const System& system, typename System::State& state, const Model& forces,
                          const Integrator& integrator, const SimulationOptions& options) {
  return simulate(system, state, forces, integrator, AnalyticContacts{}, options);
}
/// @}

}  // namespace rbres::RBRES_ABI
