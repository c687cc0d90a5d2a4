#pragma once

#include <rbres/learn/scene_simulator.hpp>
#include <rbres/learn/windows.hpp>

namespace rbres::RBRES_ABI {

/// How numbers of a world are fitted.
struct IdentifyOptions {
  /// What is fitted.
  std::vector<Unknown> unknowns{Unknown::restitution, Unknown::friction, Unknown::gravity, Unknown::inertia,
                                Unknown::size};
  /// How the simulations go.
  SceneStep step{};
  int window = 80;             ///< frames that a simulation goes on from a frame of the data, at most
  long most_states = 100'000;  ///< bodies times frames to which the numbers are fitted
  /// How the search goes.
  FitOptions fit{};

  /// Throws Error naming the first option that makes no sense.
  void check() const {
    if (step.steps < 1) detail::refuse("steps in a frame", "1 or more", step.steps);
    if (window < 1) detail::refuse("frames of a window", "1 or more", window);
    if (most_states < 1) detail::refuse("states to fit to", "1 or more", most_states);
    for (auto u = unknowns.begin(); u != unknowns.end(); ++u)
      if (std::find(unknowns.begin(), u, *u) != u) detail::refuse("unknowns", "each once", name(*u));
  }
};

/// What identify found.
struct Identification {
  /// What was fitted.
  std::vector<Unknown> unknowns;
  FitResult fit;  ///< in the order of the unknowns
  /// How the simulations went.
  SceneStep step;

  /// Of unknown i.
  double value(Eigen::Index i) const { return fit.value(i); }
  /// Infinite where the data do not say.
  double standard_error(Eigen::Index i) const { return std::sqrt(fit.covariance(i, i)); }
  /// To simulate with.
  WorldNumbers numbers() const { return numbers_of(unknowns, fit.value); }

  /// These values for these unknowns, in their order.
  static WorldNumbers numbers_of(const std::vector<Unknown>& unknowns, const Eigen::VectorXd& values) {
    WorldNumbers numbers;
    for (std::size_t i = 0; i < unknowns.size(); ++i)
      numbers[unknowns[i]] = values(static_cast<Eigen::Index>(i));
    return numbers;
  }
};

/// Where the search for a number begins, and its bounds.
inline FitNumber fit_number(Unknown unknown, const TrajectorySet& set) {
  const double g = norm(set.gravity());
  switch (unknown) {
    case Unknown::restitution:
      return {0.3, 0.2, 0, 1};
    case Unknown::friction:
      return {0.3, 0.15, 0, 2};
    case Unknown::gravity:
      if (!(squared_norm(set.gravity()) > 0))
        detail::refuse("unknowns", "no gravity in a set without it", "gravity");
      return {g, 0.03 * g, 0.5 * g, 2 * g};
    case Unknown::damping:
      return {0, 0.1, 0, 10};
    case Unknown::size:
      return {1, 0.03, 0.8, 1.25};
    case Unknown::offset:
      return {0, 0.002, -0.1, 0.1};
    default:
      return {1, 0.2, 0.2, 5};
  }
}

/// Fits numbers of a world to trajectories: those with which simulations that start from the data's own
/// states stay closest to what was measured, by a robust least squares (see RobustFit) with its uncertainty.
/// Only ratios of masses and inertia move bodies: of unknowns that only appear in such a ratio the data do
/// not say each. Throws Error for options that make no sense and for a set with fewer windows than unknowns.
/// A template, so that only programs that call it compile its linear algebra.
template <class = void>
Identification identify(const TrajectorySet& set, const IdentifyOptions& options = {}) {
  options.check();
  std::vector<FitNumber> numbers;
  for (const Unknown u : options.unknowns) numbers.push_back(fit_number(u, set));
  const auto simulator = [&](const Trajectory& scene, const Eigen::VectorXd& x) {
    return SceneSimulator(set, scene, Identification::numbers_of(options.unknowns, x), options.step);
  };
  return {
      options.unknowns,
      fit_windows(set, windows_of(set, options.window, options.most_states), numbers, simulator, options.fit),
      options.step};
}

}  // namespace rbres::RBRES_ABI
