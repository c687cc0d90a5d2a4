#pragma once

#include <cmath>
#include <limits>
#include <rbres/core/abi.hpp>
#include <type_traits>
#if defined(__SSE2__)
#include <emmintrin.h>
#endif

// With them is_finite() is always true: NaN would pass every check.
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "rbres needs infinity and NaN: compile without -ffast-math, or add -fno-finite-math-only"
#endif

namespace rbres::RBRES_ABI {

/// What a number type is to the numeric code. A scalar is float, double, a dual number (Eigen's
/// AutoDiffScalar), or a Pack of SIMD lanes: something with + - * / and comparisons, sqrt, abs, and select.
/// Specialise it for a new type.
template <class S>
struct ScalarTraits {
  using Value = S;                 ///< the type of one lane
  using Mask = bool;               ///< what a comparison gives
  using Count = long;              ///< how often something happened; += a mask
  static constexpr int lanes = 1;  ///< scenarios that one number carries
  /// The number in a lane; a plain scalar has one lane.
  static S lane(const S& x, int) { return x; }
  /// Sets the number in a lane.
  static void set_lane(S& x, int, const S& value) { x = value; }
};

/// What a comparison of two S gives: bool, or a mask of lanes.
template <class S>
using MaskOf = typename ScalarTraits<S>::Mask;
/// A count of how often something happened, by lane.
template <class S>
using CountOf = typename ScalarTraits<S>::Count;

/// A scalar that carries several scenarios, so that its comparisons are masks.
template <class S>
concept Packed = !std::is_same_v<MaskOf<S>, bool>;

/// a where the condition holds, else b, lane by lane: numeric code branches through this.
template <class S>
constexpr S select(bool condition, const S& a, const S& b) {
  return condition ? a : b;
}
/// A plain condition has one lane.
/// @{
constexpr bool any(bool condition) { return condition; }
constexpr bool all(bool condition) { return condition; }
/// @}

/// The smaller of two, lane by lane; a where one of them is NaN.
template <class S>
S minimum(const S& a, const S& b) {
  return select(b < a, b, a);
}
/// The larger of two, lane by lane; a where one of them is NaN.
template <class S>
S maximum(const S& a, const S& b) {
  return select(a < b, b, a);
}
/// x, but not below `low` nor above `high`.
template <class S>
S clamp(const S& x, const S& low, const S& high) {
  return minimum(maximum(x, low), high);
}
/// x times x.
template <class S>
S square(const S& x) {
  return x * x;
}

/// The square root, NaN of a negative number. Unlike std::sqrt it leaves errno alone, and so is one
/// instruction and never a call, for whose sake the compiler would keep every register in memory.
template <class S>
S root(const S& x) {
  using std::sqrt;
  return sqrt(x);
}
#if defined(__SSE2__)
inline double root(double x) {
  const __m128d v = _mm_set_sd(x);
  return _mm_cvtsd_f64(_mm_sqrt_sd(v, v));
}
inline float root(float x) { return _mm_cvtss_f32(_mm_sqrt_ss(_mm_set_ss(x))); }
#endif

/// A copy. That of a pack goes through a register: g++ moves structs of packs by parts through memory, and
/// reading those back as a whole stalls.
template <class S>
S in_register(const S& x) {
  return x;
}

/// One over a number; within 2 units in the last place where neither of them is subnormal.
template <class S>
S inverse(const S& x) {
  return S(1) / x;
}
/// The square root of a positive number; within 2 units in the last place.
template <class S>
S positive_root(const S& x) {
  return root(x);
}
/// One over the square root of a positive number; within 2 units in the last place.
template <class S>
S inverse_root(const S& x) {
  return S(1) / root(x);
}

namespace detail {
/// double for double and dual numbers of double, float for float and packs of float.
template <class S, class = void>
struct RealOf {
  using type = double;
};
template <class S>
struct RealOf<S, std::enable_if_t<std::is_floating_point_v<typename ScalarTraits<S>::Value>>> {
  using type = typename ScalarTraits<S>::Value;
};
}  // namespace detail

/// Tolerances in one place. Lengths are relative to the size of the bodies that touch.
template <class S>
struct Constants {
  /// The plain number behind S: double or float.
  using Real = typename detail::RealOf<S>::type;
  /// The distance from 1 to the next larger number.
  static constexpr Real epsilon = std::numeric_limits<Real>::epsilon();
  /// Added under a square root whose argument may be zero, so that its derivative stays finite.
  static constexpr Real tiny = std::numeric_limits<Real>::min() * Real(16);
  /// Two surfaces touch when their gap is below this share of the smaller body's radius.
  static constexpr Real touch = std::is_same_v<Real, float> ? Real(2e-5) : Real(1e-8);
  /// Contacts are solved until no velocity is off by more than this share of speed_scale().
  static constexpr Real solved = std::is_same_v<Real, float> ? Real(6e-6) : Real(1e-12);
};

/// A plain number, or one that already is an S, as an S.
template <class S>
const S& as(const S& x) {
  return x;
}
/// A plain number as an S.
template <class S, class Number>
requires std::is_arithmetic_v<Number> &&(!std::is_same_v<S, Number>)S as(Number x) {
  if constexpr (std::is_arithmetic_v<S>) {
    return static_cast<S>(x);
  } else {
    return S(static_cast<typename detail::RealOf<S>::type>(x));
  }
}

/// True where x is neither infinite nor NaN.
template <class S>
MaskOf<S> is_finite(const S& x) {
  const S zero = x - x;
  return zero == S(0);
}

}  // namespace rbres::RBRES_ABI
