#pragma once

#include <algorithm>
#include <rbres/eval/training_set.hpp>

namespace rbres {

/// How far predictions are from truth, over the present bodies of some scenarios (the paper's section 4.1).
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
  double relative_median[4] = {};
  // The paper's element-wise formula, mean over components of |error_i| / |truth_i|. It has no finite
  // expectation: a component that happens to be near zero decides it.
  double elementwise[4] = {};
  double energy = 0;       ///< ECE: mean |E - E_true| over the mean |E_true|, E kinetic and potential (z = 0)
  double pearson = 0;      ///< r of predicted and true velocity components, scenarios that had a contact
  double within_half = 0;  ///< share of them within 0.5 m/s
  long bodies = 0;         ///< bodies compared
  long collided = 0;       ///< of them in scenarios that had a contact
};

/// Quartiles of the mean square position error per scenario.
struct Quartiles {
  double low = 0, median = 0, high = 0;
  long count = 0;
};

namespace detail {

inline double quantile(std::vector<double> values, double q) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::sort(values.begin(), values.end());
  const double at = q * static_cast<double>(values.size() - 1);
  const auto i = static_cast<std::size_t>(at);
  const double next = values[std::min(i + 1, values.size() - 1)];
  return values[i] + (at - static_cast<double>(i)) * (next - values[i]);
}

template <class S>
double mechanical_energy(const Vec3<S>& moments, const S& mass, const RigidState<S>& y) {
  return 0.5 * mass * squared_norm(y.velocity) +
         0.5 * dot(y.angular_velocity, scale(moments, y.angular_velocity)) + 9.81 * mass * y.position.z;
}

}  // namespace detail

/// A prediction's quaternion put on the truth's side.
template <class Derived>
Eigen::Vector4d near_side(const Eigen::MatrixBase<Derived>& q, const Eigen::Vector4d& truth) {
  return q.dot(truth) < 0 ? Eigen::Vector4d(-q) : Eigen::Vector4d(q);
}

/// Compares predictions (65 x n, column c for scenario first + c) with truth at horizon h.
template <class Data>
Metrics measure(const Data& data, std::size_t h, Eigen::Index first, const Eigen::MatrixXd& predicted,
                const Vec3<double>& moments, double mass) {
  Metrics m;
  std::vector<double> relative[4];
  double energy_error = 0, energy = 0, sx = 0, sy = 0, sxx = 0, syy = 0, sxy = 0;
  long pairs = 0, within = 0, elements[4] = {};
  for (Eigen::Index c = 0; c < predicted.cols(); ++c) {
    const auto scenario = static_cast<std::size_t>(first + c);
    const bool collided = static_cast<double>(data.first_contact[scenario]) <= data.horizons[h] + 1e-6;
    for (int b = 0; b < data.body_count[scenario]; ++b) {
      Eigen::Matrix<double, 13, 1> truth =
          data.states[h].col(first + c).template segment<13>(13 * b).template cast<double>();
      Eigen::Matrix<double, 13, 1> guess = predicted.col(c).segment<13>(13 * b);
      guess.segment<4>(3) = near_side(guess.segment<4>(3), truth.segment<4>(3));
      const Eigen::Matrix<double, 13, 1> error = guess - truth;
      const auto compare = [&]<int Start, int Size>(std::integral_constant<int, Start>,
                                                    std::integral_constant<int, Size>, std::size_t k,
                                                    double& mean_square) {
        const Eigen::Matrix<double, Size, 1> e = error.template segment<Size>(Start);
        const Eigen::Matrix<double, Size, 1> t = truth.template segment<Size>(Start);
        mean_square += e.squaredNorm() / Size;
        relative[k].push_back(e.norm() / std::max(t.norm(), 1e-12));
        for (int i = 0; i < Size; ++i) {
          if (t[i] == 0) continue;
          m.elementwise[k] += std::abs(e[i] / t[i]);
          ++elements[k];
        }
      };
      compare(std::integral_constant<int, 0>{}, std::integral_constant<int, 3>{}, 0, m.position);
      compare(std::integral_constant<int, 3>{}, std::integral_constant<int, 4>{}, 1, m.orientation);
      compare(std::integral_constant<int, 7>{}, std::integral_constant<int, 3>{}, 2, m.velocity);
      compare(std::integral_constant<int, 10>{}, std::integral_constant<int, 3>{}, 3, m.angular_velocity);
      const double cosine =
          std::min(1.0, guess.segment<4>(3).normalized().dot(truth.segment<4>(3).normalized()));
      m.angle += 2 * std::acos(cosine) * 180 / std::numbers::pi;
      RigidState<double> guess_state, true_state;
      guess_state.vector() = guess;
      true_state.vector() = truth;
      const double e_true = detail::mechanical_energy(moments, mass, true_state);
      energy_error += std::abs(detail::mechanical_energy(moments, mass, guess_state) - e_true);
      energy += std::abs(e_true);
      ++m.bodies;
      if (!collided) continue;
      ++m.collided;
      for (int i = 7; i < 10; ++i) {
        const double x = truth[i], y = guess[i];
        sx += x, sy += y, sxx += x * x, syy += y * y, sxy += x * y;
        within += std::abs(x - y) <= 0.5;
        ++pairs;
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
  if (pairs > 1) {
    const auto k = static_cast<double>(pairs);
    m.pearson = (k * sxy - sx * sy) / std::sqrt(std::max((k * sxx - sx * sx) * (k * syy - sy * sy), 1e-300));
    m.within_half = static_cast<double>(within) / k;
  }
  return m;
}

/// Quartiles over the scenarios of one family (or those with several contacts: `chosen` decides by scenario
/// number).
template <class Chosen>
Quartiles position_quartiles(const ScenarioData& data, std::size_t h, Eigen::Index first,
                             const Eigen::MatrixXd& predicted, const Chosen& chosen) {
  std::vector<double> errors;
  for (Eigen::Index c = 0; c < predicted.cols(); ++c) {
    const auto scenario = static_cast<std::size_t>(first + c);
    if (!chosen(scenario)) continue;
    double sum = 0;
    for (int b = 0; b < data.body_count[scenario]; ++b) {
      sum += (predicted.col(c).segment<3>(13 * b) -
              data.states[h].col(first + c).segment<3>(13 * b).cast<double>())
                 .squaredNorm() /
             3;
    }
    errors.push_back(sum / data.body_count[scenario]);
  }
  return {detail::quantile(errors, 0.25), detail::quantile(errors, 0.5), detail::quantile(errors, 0.75),
          static_cast<long>(errors.size())};
}

}  // namespace rbres
