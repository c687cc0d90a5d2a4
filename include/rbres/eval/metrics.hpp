#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <rbres/body/mechanics.hpp>
#include <rbres/core/error.hpp>
#include <vector>

namespace rbres::RBRES_ABI {

/// How far predictions are from truth, over the present bodies of some transitions (the paper's section 4.1).
struct Metrics {
  // Mean square error per component.
  double position = 0;          ///< m^2
  double orientation = 0;       ///< q and -q are the same
  double velocity = 0;          ///< (m/s)^2
  double angular_velocity = 0;  ///< (rad/s)^2
  double angle = 0;             ///< mean rotation error, degrees
  // Relative error per body and vector: |error| / |truth|, the mean; and the median, which near-zero truths
  // do not rule.
  double relative[4] = {};  ///< position, orientation, velocity, angular velocity
  /// The median of the same.
  double relative_median[4] = {};
  // The paper's element-wise formula, mean over components of |error_i| / |truth_i|. It has no finite
  // expectation: a component that happens to be near zero decides it.
  /// In the order of `relative`.
  double elementwise[4] = {};
  double energy = 0;       ///< ECE: mean |E - E_true| over the mean |E_true|, E kinetic and potential (z = 0)
  double pearson = 0;      ///< r of predicted and true velocity components, transitions that had an impact;
                           ///< 0 where either does not vary
  double within_half = 0;  ///< share of them within 0.5 m/s
  long bodies = 0;         ///< bodies compared
  long collided = 0;       ///< of them in transitions that had an impact
};

/// Quartiles of the mean square position error per transition.
struct Quartiles {
  /// Of the errors of all scenarios, m^2.
  /// @{
  double low = 0, median = 0, high = 0;
  /// @}
  /// How many scenarios there are.
  long count = 0;
};

namespace detail {

inline double quantile(std::vector<double> values, double q) {
  const bool has_nan = std::any_of(values.begin(), values.end(), [](double x) { return std::isnan(x); });
  if (values.empty() || has_nan) return std::numeric_limits<double>::quiet_NaN();
  std::sort(values.begin(), values.end());
  const double at = q * static_cast<double>(values.size() - 1);
  const auto i = static_cast<std::size_t>(at);
  const double next = values[std::min(i + 1, values.size() - 1)];
  return values[i] + (at - static_cast<double>(i)) * (next - values[i]);
}

/// Pearson's r of two lists of equal length; 0 where one of them does not vary beyond rounding.
inline double correlation(const std::vector<double>& x, const std::vector<double>& y) {
  const auto n = static_cast<double>(x.size());
  double x_mean = 0, y_mean = 0, xx = 0, yy = 0, xy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) x_mean += x[i] / n, y_mean += y[i] / n;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double a = x[i] - x_mean, b = y[i] - y_mean;
    xx += a * a, yy += b * b, xy += a * b;
  }
  const double rounding = 1e-28 * n;
  if (xx <= rounding * x_mean * x_mean || yy <= rounding * y_mean * y_mean) return 0;
  return xy / std::sqrt(xx * yy);
}

/// The angle of the rotation between two orientations (x, y, z, w; of any length), exact for small ones too:
/// four times Kahan's half angle between the quaternions.
inline double degrees_between(const double* p, const double* q) {
  double pp = 0, qq = 0, pq = 0;
  for (int i = 0; i < 4; ++i) pp += p[i] * p[i], qq += q[i] * q[i], pq += p[i] * q[i];
  const double sp = 1 / std::sqrt(pp), sq = (pq < 0 ? -1 : 1) / std::sqrt(qq);
  double difference = 0, sum = 0;
  for (int i = 0; i < 4; ++i) {
    difference += (sp * p[i] - sq * q[i]) * (sp * p[i] - sq * q[i]);
    sum += (sp * p[i] + sq * q[i]) * (sp * p[i] + sq * q[i]);
  }
  return 4 * std::atan2(std::sqrt(difference), std::sqrt(sum)) * 180 / std::numbers::pi;
}

/// Error where `data` is inconsistent, or does not have transitions first ... first + count - 1.
template <class Data>
void check_transitions(const Data& data, std::ptrdiff_t first, std::ptrdiff_t count) {
  if constexpr (requires { data.check(); }) data.check();
  check_range("transitions", data.count(), first, count);
}

template <class Data, class Predicted>
void check_predictions(const Data& transitions, std::ptrdiff_t first, const Predicted& predicted) {
  if (predicted.rows() != 13 * Data::bodies)
    refuse("rows of predictions", text("13 for each of ", Data::bodies, " bodies"), predicted.rows());
  if constexpr (requires { transitions.check(); }) transitions.check();
  if (first < 0 || predicted.cols() > static_cast<std::ptrdiff_t>(transitions.count()) - first)
    refuse("predictions", text("those of transitions 0 to ", transitions.count() - 1),
           text(first, " to ", first + predicted.cols() - 1));
}

}  // namespace detail

/// Compares predictions (13 N x n, column c for transition first + c) with the ends of `transitions`:
/// Transitions of any world, or others with the same members. Energies are those of the system's bodies
/// (mass, inertia) in its gravity (m/s^2); kinematic bodies have none. Error where truth is no state, and for
/// predictions of another size; predictions that are not finite, or whose quaternion has length 0, give
/// metrics that are not.
template <class Data, class Predicted, class System>
Metrics measure(const Data& transitions, std::ptrdiff_t first, const Predicted& predicted,
                const System& system, const Vec3<double>& gravity = {0, 0, -9.81}) {
  static_assert(System::bodies == Data::bodies, "the system has another number of bodies");
  detail::check_predictions(transitions, first, predicted);
  struct Part {
    int start, size;
    double Metrics::*mean_square;
  };
  constexpr Part parts[] = {{0, 3, &Metrics::position},
                            {3, 4, &Metrics::orientation},
                            {7, 3, &Metrics::velocity},
                            {10, 3, &Metrics::angular_velocity}};
  const auto mechanical_energy = [&](const auto& body, const RigidState<double>& y) {
    return kinetic_energy(body, y) - body.mass() * dot(gravity, y.position);
  };
  Metrics m;
  std::vector<double> relative[4];
  std::vector<double> true_velocities, guessed_velocities;
  double energy_error = 0, energy = 0, within = 0;
  long elements[4] = {};
  for (std::ptrdiff_t c = 0; c < predicted.cols(); ++c) {
    const bool collided = transitions.had_impact(first + c);
    const auto& end = transitions.end(first + c);
    for (int b = 0; b < transitions.present(first + c); ++b) {
      RigidState<double> true_state = end[b], guessed_state;
      double *truth = &true_state.position.x, *guess = &guessed_state.position.x;
      for (int i = 0; i < 13; ++i) guess[i] = static_cast<double>(predicted(13 * b + i, c));
      const bool finite = std::all_of(truth, truth + 13, [](double x) { return std::isfinite(x); });
      if (!finite || std::all_of(truth + 3, truth + 7, [](double x) { return x == 0; }))
        detail::refuse(detail::text("truth of transition ", first + c, ", body ", b),
                       "finite numbers and an orientation", "others");
      m.angle += detail::degrees_between(guess + 3, truth + 3);
      double side = 0;
      for (int i = 3; i < 7; ++i) side += guess[i] * truth[i];
      for (int i = 3; i < 7 && side < 0; ++i) guess[i] = -guess[i];

      for (std::size_t k = 0; k < 4; ++k) {
        double error2 = 0, truth2 = 0;
        for (int i = parts[k].start; i < parts[k].start + parts[k].size; ++i) {
          const double error = guess[i] - truth[i];
          error2 += error * error;
          truth2 += truth[i] * truth[i];
          if (truth[i] == 0) continue;
          m.elementwise[k] += std::abs(error / truth[i]);
          ++elements[k];
        }
        m.*parts[k].mean_square += error2 / parts[k].size;
        relative[k].push_back(std::sqrt(error2) / std::max(std::sqrt(truth2), 1e-12));
      }
      const auto& body = system[b];
      const double e_true = mechanical_energy(body, true_state);
      energy_error += std::abs(mechanical_energy(body, guessed_state) - e_true);
      energy += std::abs(e_true);
      ++m.bodies;
      if (!collided) continue;
      ++m.collided;
      for (int i = 7; i < 10; ++i) {
        const double x = truth[i], y = guess[i];
        true_velocities.push_back(x);
        guessed_velocities.push_back(y);
        within +=
            std::isfinite(y) ? double(std::abs(x - y) <= 0.5) : std::numeric_limits<double>::quiet_NaN();
      }
    }
  }
  const auto n = static_cast<double>(std::max(m.bodies, 1L));
  for (double* sum : {&m.position, &m.orientation, &m.velocity, &m.angular_velocity, &m.angle}) *sum /= n;
  for (int k = 0; k < 4; ++k) {
    double sum = 0;
    for (const double r : relative[k]) sum += r;
    m.relative[k] = sum / n;
    m.relative_median[k] = detail::quantile(relative[k], 0.5);
    m.elementwise[k] /= static_cast<double>(std::max(elements[k], 1L));
  }
  m.energy = energy_error / std::max(energy, 1e-300);
  if (!true_velocities.empty()) {
    m.pearson = detail::correlation(true_velocities, guessed_velocities);
    m.within_half = within / static_cast<double>(true_velocities.size());
  }
  return m;
}

/// Quartiles over the transitions that `chosen` (a transition's number) takes: those of one family, or with
/// several collisions. Error for predictions of another size.
template <class Data, class Predicted, class Chosen>
Quartiles position_quartiles(const Data& transitions, std::ptrdiff_t first, const Predicted& predicted,
                             const Chosen& chosen) {
  detail::check_predictions(transitions, first, predicted);
  std::vector<double> errors;
  for (std::ptrdiff_t c = 0; c < predicted.cols(); ++c) {
    if (!chosen(static_cast<std::size_t>(first + c))) continue;
    const auto& end = transitions.end(first + c);
    const int present = transitions.present(first + c);
    double sum = 0;
    for (int b = 0; b < present; ++b) {
      const auto guess = [&](int i) { return static_cast<double>(predicted(13 * b + i, c)); };
      sum += squared_norm(Vec3<double>{guess(0), guess(1), guess(2)} - end[b].position) / 3;
    }
    errors.push_back(sum / present);
  }
  return {detail::quantile(errors, 0.25), detail::quantile(errors, 0.5), detail::quantile(errors, 0.75),
          static_cast<long>(errors.size())};
}

}  // namespace rbres::RBRES_ABI
