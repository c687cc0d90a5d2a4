#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <rbres/core/scalar.hpp>
#if defined(__AVX__)
#include <immintrin.h>  // much slower to include than the next
#elif defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace rbres::RBRES_ABI {

namespace detail {
template <class T, int N>
struct VectorOf {
  typedef T type __attribute__((vector_size(sizeof(T) * N)));
};

// The three operations on a full register that vector extensions lack: whether a bit is set, the square root
// (a loop over std::sqrt stays scalar, because it may set errno), and a fast inverse square root. (The masked
// forms avoid a false warning of g++ 12 about the unmasked ones.)
#if defined(__AVX512F__)
inline constexpr int register_bytes = 64;
inline bool any_bit(__m512i x) { return _mm512_test_epi64_mask(x, x) != 0; }
inline __m512 sqrt_of(__m512 x) { return _mm512_maskz_sqrt_ps(0xFFFF, x); }
inline __m512d sqrt_of(__m512d x) { return _mm512_maskz_sqrt_pd(0xFF, x); }
// To 14 bits, then a step of Newton's method, where the processor takes several times as long for the exact
// number.
inline __m512 inverse_of(__m512 x) {
  const __m512 r = _mm512_maskz_rcp14_ps(0xFFFF, x);
  return r + r * (1.0f - x * r);
}
inline __m512 positive_sqrt_of(__m512 x) {
  const __m512 r = _mm512_maskz_rsqrt14_ps(0xFFFF, x), n = x * r;
  return n + 0.5f * r * (x - n * n);
}
inline __m512 inverse_sqrt_of(__m512 x) {
  const __m512 r = _mm512_maskz_rsqrt14_ps(0xFFFF, x);
  return r + 0.5f * r * (1.0f - x * r * r);
}
#elif defined(__AVX__)
inline constexpr int register_bytes = 32;
inline bool any_bit(__m256i x) { return _mm256_testz_si256(x, x) == 0; }
inline __m256 sqrt_of(__m256 x) { return _mm256_sqrt_ps(x); }
inline __m256d sqrt_of(__m256d x) { return _mm256_sqrt_pd(x); }
#elif defined(__SSE2__)
inline constexpr int register_bytes = 16;
inline bool any_bit(__m128i x) { return _mm_movemask_epi8(x) != 0; }
inline __m128 sqrt_of(__m128 x) { return _mm_sqrt_ps(x); }
inline __m128d sqrt_of(__m128d x) { return _mm_sqrt_pd(x); }
#else
inline constexpr int register_bytes = 16;
template <class Vector>
bool any_bit(const Vector& x) {
  return (x[0] | x[1]) != 0;
}
template <class Vector>
Vector sqrt_of(Vector x) {
  for (unsigned i = 0; i < sizeof x / sizeof x[0]; ++i) x[i] = std::sqrt(x[i]);
  return x;
}
#endif

/// A vector in registers: [part], the last one filled up with zeros.
template <class T, class Vector>
auto split(const Vector& from) {
  using Part = typename VectorOf<T, register_bytes / int(sizeof(T))>::type;
  std::array<Part, (sizeof(Vector) + register_bytes - 1) / register_bytes> parts{};
  std::memcpy(&parts, &from, sizeof from);
  return parts;
}
}  // namespace detail

/// The comparison of two packs: all bits set in the lanes where it holds.
template <class T, int N>
struct LaneMask {
  /// An integer as large as T.
  using Int = std::conditional_t<sizeof(T) == 4, std::int32_t, std::int64_t>;
  /// The compiler's vector of them.
  using Vector = typename detail::VectorOf<Int, N>::type;
  /// All bits of a lane are set where the comparison holds.
  Vector bits;

  LaneMask() = default;
  /// Takes the bits as they are.
  LaneMask(const Vector& b) : bits(b) {}
  /// The same in every lane.
  LaneMask(bool b) : bits(Vector{} - Int{b}) {}

  /// Lane by lane.
  /// @{
  friend LaneMask operator&(LaneMask a, LaneMask b) { return {a.bits & b.bits}; }
  friend LaneMask operator|(LaneMask a, LaneMask b) { return {a.bits | b.bits}; }
  friend LaneMask operator!(LaneMask a) { return {~a.bits}; }
  /// @}

  /// Whether it holds in at least one lane.
  friend bool any(LaneMask m) {
    auto parts = detail::split<long long>(m.bits);
    for (std::size_t i = 1; i < parts.size(); ++i) parts[0] |= parts[i];
    return detail::any_bit(parts[0]);
  }
  /// Whether it holds in every lane.
  friend bool all(LaneMask m) { return !any(!m); }
  /// Whether it holds in this lane.
  bool operator[](int lane) const { return bits[lane] != 0; }
};

/// A count in each lane, as exact as its whole numbers: what a tally of packs is made of.
template <class T, int N>
struct LaneCount {
  /// One count for each lane.
  typename LaneMask<T, N>::Vector counts{};

  /// One more in the lanes where m holds.
  LaneCount& operator+=(LaneMask<T, N> m) { return counts -= m.bits, *this; }
  /// The count of one lane.
  long operator[](int lane) const { return static_cast<long>(counts[lane]); }
};

/// N numbers of type T, one scenario per lane, computed together: the compilers' vector extensions behind the
/// interface of a scalar. sizeof(T) * N may exceed one register; the compiler splits it.
template <class T, int N>
struct Pack {
  static_assert(std::is_same_v<T, float> || std::is_same_v<T, double>, "Pack holds float or double");
  static_assert(N >= 2 && (N & (N - 1)) == 0, "a Pack has 2, 4, 8, ... lanes");
  /// The compiler's vector of N numbers.
  using Vector = typename detail::VectorOf<T, N>::type;
  /// What a comparison gives.
  using Mask = LaneMask<T, N>;
  /// The numbers.
  Vector v;

  Pack() = default;
  /// The numbers of a vector.
  Pack(const Vector& x) : v(x) {}
  /// The same number in every lane.
  Pack(T x) : v(x - Vector{}) {}

  /// Lane by lane.
  /// @{
  friend Pack operator+(Pack a, Pack b) { return {a.v + b.v}; }
  friend Pack operator-(Pack a, Pack b) { return {a.v - b.v}; }
  friend Pack operator*(Pack a, Pack b) { return {a.v * b.v}; }
  friend Pack operator/(Pack a, Pack b) { return {a.v / b.v}; }
  friend Pack operator-(Pack a) { return {-a.v}; }
  Pack& operator+=(Pack b) { return v += b.v, *this; }
  Pack& operator-=(Pack b) { return v -= b.v, *this; }
  Pack& operator*=(Pack b) { return v *= b.v, *this; }
  friend Mask operator<(Pack a, Pack b) { return {a.v < b.v}; }
  friend Mask operator>(Pack a, Pack b) { return {a.v > b.v}; }
  friend Mask operator<=(Pack a, Pack b) { return {a.v <= b.v}; }
  friend Mask operator>=(Pack a, Pack b) { return {a.v >= b.v}; }
  friend Mask operator==(Pack a, Pack b) { return {a.v == b.v}; }
  /// @}
  /// The number in one lane.
  T operator[](int lane) const { return v[lane]; }

  /// a where the mask holds, else b, lane by lane.
  /// @{
#if defined(__AVX__)
  friend Pack select(Mask m, Pack a, Pack b) { return {m.bits ? a.v : b.v}; }
#else
  // Below AVX no instruction compares 64-bit integers, and g++ 12 can fail on the form above.
  friend Pack select(Mask m, Pack a, Pack b) {
    using Bits = typename Mask::Vector;
    return {reinterpret_cast<Vector>((reinterpret_cast<Bits>(a.v) & m.bits) |
                                     (reinterpret_cast<Bits>(b.v) & ~m.bits))};
  }
#endif
  /// @}
  /// The absolute values.
  friend Pack abs(Pack a) { return {a.v < T(0) ? -a.v : a.v}; }
  /// A copy, see in_register of a scalar.
  friend Pack in_register(Pack a) { return {a.v}; }
  /// The square roots, NaN of negative numbers.
  [[gnu::always_inline]] friend Pack sqrt(Pack a) {
    return by_register(a, [](auto part) { return detail::sqrt_of(part); });
  }
#if defined(__AVX512F__)
  [[gnu::always_inline]] friend Pack inverse(Pack a) requires(std::is_same_v<T, float>) {
    return by_register(a, [](auto part) { return detail::inverse_of(part); });
  }
  [[gnu::always_inline]] friend Pack positive_root(Pack a) requires(std::is_same_v<T, float>) {
    return by_register(a, [](auto part) { return detail::positive_sqrt_of(part); });
  }
  [[gnu::always_inline]] friend Pack inverse_root(Pack a) requires(std::is_same_v<T, float>) {
    return by_register(a, [](auto part) { return detail::inverse_sqrt_of(part); });
  }
#endif

 private:
  template <class F>
  [[gnu::always_inline]] static Pack by_register(Pack a, const F& f) {
    auto parts = detail::split<T>(a.v);
    for (auto& part : parts) part = f(part);
    std::memcpy(&a.v, &parts, sizeof a.v);
    return a;
  }
};

/// A Pack as a scalar.
template <class T, int N>
struct ScalarTraits<Pack<T, N>> {
  /// The type of one lane.
  using Value = T;
  /// What a comparison gives.
  using Mask = LaneMask<T, N>;
  /// A count in each lane.
  using Count = LaneCount<T, N>;
  /// Scenarios that one number carries.
  static constexpr int lanes = N;
  /// The number in lane i.
  static T lane(const Pack<T, N>& x, int i) { return x.v[i]; }
  /// Sets the number in lane i.
  static void set_lane(Pack<T, N>& x, int i, T value) { x.v[i] = value; }
};

/// As many lanes as fill the widest register that the compiler was told of.
template <class T>
inline constexpr int native_lanes = detail::register_bytes / int(sizeof(T));

namespace detail {

/// Simulations in double at a time; lanes decide the last bits, so there are some on every processor.
inline constexpr int double_lanes = native_lanes<double> > 2 ? native_lanes<double> : 2;

}  // namespace detail

}  // namespace rbres::RBRES_ABI
