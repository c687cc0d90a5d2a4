#pragma once

#include <rbres/nn/simd.hpp>

#include <cmath>
#include <type_traits>

namespace rbres::RBRES_ABI {

/// @file
/// Layers are types without state: a network's numbers stand in its one parameter block (see Network).
/// An elementwise layer gives value(x) and slope(x), its derivative; T is a number, a number that
/// differentiates (Eigen's AutoDiffScalar), or a register of numbers.

/// y = W x + b, W of Out rows and In columns. In PyTorch: nn.Linear(In, Out).
template <int In, int Out>
struct Linear {
  static_assert(In > 0 && Out > 0, "Linear<In, Out>: both sizes must be positive");
};

/// max(x, 0); the slope at 0 is 0. A NaN stays a NaN. In PyTorch: nn.ReLU().
struct Relu {
  /// The function and its derivative.
  /// @{
  template <class T>
  static T value(const T& x) {
    const T zero = detail::constant<T>(0);
    return x < zero ? zero : x;
  }
  template <class T>
  static T slope(const T& x) {
    return x > detail::constant<T>(0) ? detail::constant<T>(1) : detail::constant<T>(0);
  }
  /// @}
};

/// In PyTorch: nn.Tanh().
struct Tanh {
  /// The function and its derivative.
  /// @{
  template <class T>
  static T value(const T& x) {
    using std::tanh;
    if constexpr (detail::is_simd<T>) {
      return detail::map_lanes(x, [](auto lane) { return tanh(lane); });
    } else {
      return tanh(x);
    }
  }
  template <class T>
  static T slope(const T& x) {
    const T y = value(x);
    return 1 - y * y;
  }
  /// @}
};

/// x / (1 + exp(-x)) (Hendrycks, Gimpel 2016; Elfwing, Uchibe, Doya 2018). In PyTorch: nn.SiLU().
struct Silu {
  /// The function and its derivative.
  /// @{
  template <class T>
  static T value(const T& x) {
    return x * sigmoid(x);
  }
  template <class T>
  static T slope(const T& x) {
    const T s = sigmoid(x);
    return s * (1 + x * (1 - s));
  }
  /// @}

 private:
  template <class T>
  static T sigmoid(const T& x) {
    using std::tanh;
    if constexpr (detail::is_simd<T>) {
      return detail::map_lanes(x, [](auto lane) { return decltype(lane)(0.5) * (1 + tanh(lane / 2)); });
    } else {
      return T((tanh(T(x * 0.5)) + 1) * 0.5);
    }
  }
};

/// In training sets each number to 0 with the probability TrainingOptions::dropout and divides the others by
/// the probability of staying (inverted dropout; Srivastava et al. 2014); elsewhere does nothing. In PyTorch:
/// nn.Dropout(p).
struct Dropout {};

/// The same with a rate of its own, in percent, whatever TrainingOptions::dropout says.
template <int Percent>
struct FixedDropout {
  static_assert(Percent >= 0 && Percent < 100, "FixedDropout<Percent>: the rate must be in [0, 100) percent");
};

/// weight (x - mean) / sqrt(variance + 1e-5) + bias, mean and variance (biased) over the Size features of one
/// sample (Ba, Kiros, Hinton 2016). L2 and weight decay leave its weight, which starts as 1, and its bias
/// alone. In PyTorch: nn.LayerNorm(Size).
template <int Size>
struct LayerNorm {
  static_assert(Size > 0, "LayerNorm<Size>: the size must be positive");
};

/// x + layers(x); the layers must return to the size they started from. In PyTorch:
///
///     class Residual(nn.Sequential):
///         def forward(self, x): return x + super().forward(x)
template <class... Layers>
struct Residual {
  static_assert(sizeof...(Layers) > 0, "Residual<Layers...>: needs at least one layer");
};

/// One layer after the other, Sequential ones among them. In PyTorch: nn.Sequential(...), whose names of
/// parameters ("0.weight", "2.3.bias") are ours.
template <class... Layers>
struct Sequential {
  static_assert(sizeof...(Layers) > 0, "Sequential<Layers...>: needs at least one layer");
};

namespace detail {

template <class Layer>
inline constexpr bool is_dropout = false;
template <>
inline constexpr bool is_dropout<Dropout> = true;
template <int Percent>
inline constexpr bool is_dropout<FixedDropout<Percent>> = true;
/// A Dropout's own rate; below 0 it has that of the run.
template <class Layer>
inline constexpr double own_rate = -1;
template <int Percent>
inline constexpr double own_rate<FixedDropout<Percent>> = Percent / 100.0;

template <class Layer>
concept Elementwise = is_dropout<Layer> || requires(double x) {
  Layer::value(x);
  Layer::slope(x);
};

}  // namespace detail
}  // namespace rbres::RBRES_ABI
