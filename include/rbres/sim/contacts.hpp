#pragma once

#include <rbres/sim/continuous_contact.hpp>

namespace rbres::RBRES_ABI {

/// What answers contacts in simulate(), Stepper and simulate_batch() unless they are told otherwise: Newton's
/// restitution and Coulomb's friction, when and where SimulationOptions::contacts says.
///
/// Something else may stand in its place that has
///
///     static constexpr bool allows_overlap;  // whether a run may start with bodies that overlap
///     void check(const StepPlan&) const;     // optional: refuses (Error) runs whose steps it cannot take
///     template <class System> class Step;    // made from (contacts, system, options), it may allocate
///
/// Its Step's step(forces, integrator, y, t, h, observer, tally) takes y from t to t + h and allocates
/// nothing.
struct AnalyticContacts {
  /// Bodies that overlap are refused, see check_state.
  static constexpr bool allows_overlap = false;

  /// Takes one system's state over steps.
  template <class System>
  class Step {
    using S = typename System::Scalar;
    using State = typename System::State;

   public:
    /// Allocates all that steps need.
    Step(const AnalyticContacts&, const System& system, const SimulationOptions& options)
        : system_(&system),
          options_(options),
          continuous_(system, options),
          discrete_(system),
          before_(detail::state_of(system)) {}

    /// Takes y from t (s) to t + h. Allocates nothing.
    template <class Model, class Integrator, class Observer>
    void step(const Model& forces, const Integrator& integrator, State& y, const S& t, const S& h,
              Observer& observer, ContactTally<S>& tally) {
      if (options_.contacts == ContactMode::continuous) {
        auto listener = detail::listener<State, S>(observer);
        continuous_.step(forces, integrator, y, t, h, listener, tally);
      } else {
        before_ = y;
        fly_on(*system_, forces, integrator, y, t, h);
        discrete_.resolve(before_, y, h, as<S>(options_.rest_speed), tally);
      }
    }

   private:
    const System* system_;
    SimulationOptions options_;
    ContinuousContact<System> continuous_;
    detail::DiscreteContact<System> discrete_;
    State before_;  ///< where the step began
  };
};

}  // namespace rbres::RBRES_ABI
