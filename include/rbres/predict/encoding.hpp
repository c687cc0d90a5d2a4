#pragma once

#include <array>
#include <rbres/body/state.hpp>
#include <rbres/core/error.hpp>

namespace rbres::RBRES_ABI {

/// How states and wrenches of N bodies become the numbers that a network sees, and back: one place for
/// training and use. Bodies stand one after the other; bodies from `present` on are absent, and their numbers
/// are zero.
template <int N>
struct Encoding {
  static constexpr int inputs = N * (RigidState<float>::size + Wrench<float>::size);  ///< N x (13 + 6)
  static constexpr int outputs = N * RigidState<float>::size;                         ///< N x 13
  /// What a network is given.
  template <class T>
  using Input = Eigen::Matrix<T, inputs, 1>;
  /// What a network gives.
  template <class T>
  using Output = Eigen::Matrix<T, outputs, 1>;

  /// Body by body: the state's 13 numbers, the quaternion on the side w >= 0 (q and -q are one orientation),
  /// then force (world frame, N) and torque (body frame, N m).
  template <class T>
  static Input<T> encode(const SystemState<T, N>& state, const std::array<Wrench<T>, std::size_t(N)>& wrench,
                         int present) noexcept {
    Input<T> x;
    T* to = x.data();
    for (int b = 0; b < present; ++b) {
      const T *from = &state[b].position.x, *own = &wrench[static_cast<std::size_t>(b)].force.x;
      const bool turned = state[b].orientation.w < T(0);
      for (int k = 0; k < RigidState<T>::size; ++k)
        *to++ = turned && k >= 3 && k < 7 ? T(from[k] * T(-1)) : from[k];
      for (int k = 0; k < Wrench<T>::size; ++k) *to++ = own[k];
    }
    for (; to != x.data() + inputs; ++to) *to = T(0);
    return x;
  }

  /// What the network is to say: the state minus `base`, its quaternion first put on base's side.
  template <class T>
  static Output<T> difference(const SystemState<T, N>& state, const SystemState<T, N>& base,
                              int present) noexcept {
    Output<T> y = Output<T>::Zero();
    for (int b = 0; b < present; ++b) {
      auto body = y.template segment<13>(13 * b);
      body = state[b].vector();
      if (body.template segment<4>(3).dot(base[b].vector().template segment<4>(3)) < T(0))
        body.template segment<4>(3) *= T(-1);
      body -= base[b].vector();
    }
    return y;
  }

  /// base plus what the network said, with unit quaternions; absent bodies as in base.
  template <class T>
  static SystemState<T, N> sum(SystemState<T, N> base, const Output<T>& y, int present) noexcept {
    for (int b = 0; b < present; ++b) {
      T* number = &base[b].position.x;
      for (int k = 0; k < RigidState<T>::size; ++k) number[k] += y[RigidState<T>::size * b + k];
      const T length2 = squared_norm(base[b].orientation);
      base[b].orientation = length2 > T(1e-12) ? normalized(base[b].orientation) : Quat<T>{};
    }
    return base;
  }
};

/// A number's place among others: (x - mean) / deviation and back, number by number.
template <class T, int Size>
struct Normalizer {
  /// The numbers of one sample.
  using Vector = Eigen::Matrix<T, Size, 1>;
  /// Of each number.
  Vector mean = Vector::Zero();
  /// Of each number; not 0.
  Vector deviation = Vector::Ones();

  /// Mean and standard deviation of each row of `columns` over the columns where `present`(row, column)
  /// holds. A row that does not vary gets the deviation `constant`.
  template <class Derived, class Present>
  static Normalizer fit(const Eigen::MatrixBase<Derived>& columns, const Present& present,
                        const T& constant = T(1)) {
    Normalizer fitted;
    fitted.deviation.setConstant(constant);
    for (Eigen::Index r = 0; r < Size; ++r) {
      double sum = 0, squares = 0;
      long count = 0;
      for (Eigen::Index c = 0; c < columns.cols(); ++c) {
        if (!present(r, c)) continue;
        sum += static_cast<double>(columns(r, c));
        ++count;
      }
      const double mean = count > 0 ? sum / static_cast<double>(count) : 0;
      for (Eigen::Index c = 0; c < columns.cols(); ++c) {
        if (present(r, c)) squares += square(static_cast<double>(columns(r, c)) - mean);
      }
      const double deviation = count > 0 ? std::sqrt(squares / static_cast<double>(count)) : 0;
      fitted.mean[r] = static_cast<T>(mean);
      if (deviation > 1e-12 + 1e-6 * std::abs(mean)) fitted.deviation[r] = static_cast<T>(deviation);
    }
    return fitted;
  }

  /// (x - mean) / deviation
  Vector normalize(const Vector& x) const noexcept { return (x - mean).cwiseQuotient(deviation); }
  /// x deviation + mean
  Vector restore(const Vector& x) const noexcept { return x.cwiseProduct(deviation) + mean; }
};

}  // namespace rbres::RBRES_ABI
