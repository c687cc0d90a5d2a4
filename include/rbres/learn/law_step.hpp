#pragma once

#include <rbres/contact/contact_pair.hpp>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/sim/discrete_contact.hpp>
#include <rbres/sim/options.hpp>

#include <algorithm>
#include <span>
#include <type_traits>
#include <variant>

namespace rbres::RBRES_ABI::detail {

/// A frame of a learned law, as simulate(), Stepper and simulate_batch() take it: free flight, then, where
/// the law `corrects` them, discrete contacts by Newton and Coulomb, then the law.
template <class Law, class System>
class LawStep {
  using State = typename System::State;
  using Shape = typename System::Shape;
  static_assert(std::is_same_v<typename System::Scalar, double>,
                "a learned contact law takes states of double");
  static_assert(!PartsOf<Shape>::compound, "a learned contact law is not for a Compound");
  using Discrete = std::conditional_t<Law::corrects, DiscreteContact<System>, std::monostate>;

 public:
  LawStep(const Law& law, const System& system, const SimulationOptions& options)
      : law_(&law),
        system_(&system),
        rest_speed_(options.rest_speed),
        workspace_(bodies().size(), system.planes().size(),
                   static_cast<std::size_t>(
                       std::max(PairManifold<double, Shape>::points, PlaneManifold<double, Shape>::points))),
        discrete_(discrete(system)) {
    law.check_step(options.step);
    if constexpr (requires { system.without_contact(); }) {
      if (!system.without_contact().empty())
        refuse("pairs without contact", "none, for a learned contact law", system.without_contact().size());
    }
    if constexpr (requires { start_.body.reserve(bodies().size()); }) {
      start_.body.reserve(bodies().size());
      flown_.body.reserve(bodies().size());
    }
  }

  /// Throws Error where h is neither the law's frame time nor 0 s, which moves nothing.
  template <class Model, class Integrator, class Observer>
  void step(const Model& forces, const Integrator& integrator, State& y, double t, double h, Observer&,
            ContactTally<double>& tally) {
    if (h == 0) return;
    law_->check_step(h);
    start_ = y;
    fly_on(*system_, forces, integrator, y, t, h);
    const std::span<const Plane<double>> planes(system_->planes());
    const std::span<const RigidState<double>> start(start_.body);
    const std::span<RigidState<double>> states(y.body);
    if constexpr (Law::corrects) {
      flown_ = y;
      const std::span<const RigidState<double>> flown(flown_.body);
      discrete_.resolve(start_, y, h, rest_speed_, tally);
      law_->correct(bodies(), planes, start, flown, states, law_->weight, workspace_);
    } else {
      tally.touching += law_->respond(bodies(), planes, start, states, workspace_);
    }
  }

 private:
  std::span<const Body<double, Shape>> bodies() const {
    return {&(*system_)[0], static_cast<std::size_t>(system_->size())};
  }
  static Discrete discrete(const System& system) {
    if constexpr (Law::corrects) {
      return Discrete(system);
    } else {
      return {};
    }
  }

  const Law* law_;
  const System* system_;
  double rest_speed_;
  typename Law::Workspace workspace_;
  Discrete discrete_;
  State start_, flown_;
};

}  // namespace rbres::RBRES_ABI::detail
