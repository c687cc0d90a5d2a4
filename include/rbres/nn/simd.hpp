#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <rbres/core/abi.hpp>
#include <rbres/core/bfloat16.hpp>
#include <type_traits>

#if defined(__AVX__)
#include <immintrin.h>  // much slower to include than the next
#elif defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace rbres::RBRES_ABI::detail {

#if defined(__AVX512F__)
inline constexpr std::size_t simd_bytes = 64;
#elif defined(__AVX__)
inline constexpr std::size_t simd_bytes = 32;
#else
inline constexpr std::size_t simd_bytes = 16;
#endif

template <class T>
struct SimdOf {
  typedef T type __attribute__((vector_size(simd_bytes)));
};

/// Numbers of half the size are computed with as floats.
template <>
struct SimdOf<bfloat16> : SimdOf<float> {};

/// The widest register of numbers that the compiler's flags allow, as a vector extension of GCC and Clang.
template <class T>
using Simd = typename SimdOf<T>::type;

template <class T>
inline constexpr int simd_width = static_cast<int>(simd_bytes / sizeof(T));

template <class T>
inline constexpr bool is_simd = requires(T x) {
  x[0];
};

/// c as a number of any kind, or in every lane.
template <class T>
[[gnu::always_inline]] inline T constant(int c) noexcept {
  if constexpr (is_simd<T>) {
    using Lane = std::remove_cvref_t<decltype(T{}[0])>;
    return T{} + static_cast<Lane>(c);
  } else {
    return T(c);
  }
}

template <class T>
[[gnu::always_inline]] inline Simd<T> load(const T* from) noexcept {
  Simd<T> x;
  std::memcpy(&x, from, sizeof x);
  return x;
}

/// The lanes of a and b, which are counted on from those of a, with these numbers.
template <int... Lane, class V>
[[gnu::always_inline]] inline V shuffle(const V& a, const V& b) noexcept {
#if defined(__GNUC__) && !defined(__clang__) && __GNUC__ < 12
  using Numbers = decltype(a < b);  // the older name of the same instruction, with the numbers in a vector
  return __builtin_shuffle(a, b, Numbers{Lane...});
#else
  return __builtin_shufflevector(a, b, Lane...);
#endif
}

/// A register of floats from numbers of half their size.
[[gnu::always_inline]] inline Simd<float> load(const bfloat16* from) noexcept {
#if defined(__AVX512F__)  // zero-masked with every lane kept, as in root_of_lanes()
  const __m256i halves = _mm256_loadu_si256((const __m256i*)from);
  return (Simd<float>)_mm512_maskz_slli_epi32(0xffff, _mm512_maskz_cvtepu16_epi32(0xffff, halves), 16);
#elif defined(__AVX2__)
  return (Simd<float>)_mm256_slli_epi32(_mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i*)from)), 16);
#else
  typedef std::uint16_t Halves __attribute__((vector_size(simd_bytes / 2)));
  Halves halves;
  std::memcpy(&halves, from, sizeof halves);
  return (Simd<float>)(__builtin_convertvector(halves, Simd<std::uint32_t>) << 16);
#endif
}

/// Two registers of weights, `apart` numbers from each other, in an order in which they are had soonest;
/// those of half the size are neighbours.
/// @{
template <class T>
[[gnu::always_inline]] inline void load_two(const T* from, std::ptrdiff_t apart, Simd<T>& a,
                                            Simd<T>& b) noexcept {
  a = load(from);
  b = load(from + apart);
}
[[gnu::always_inline]] inline void load_two(const bfloat16* from, std::ptrdiff_t, Simd<float>& a,
                                            Simd<float>& b) noexcept {
#if defined(__AVX512F__)  // numbers 0, 2, ... and 1, 3, ...
  const __m512i halves = _mm512_loadu_si512(from);
  a = (Simd<float>)_mm512_maskz_slli_epi32(0xffff, halves, 16);
  b = (Simd<float>)((Simd<std::uint32_t>)halves & 0xffff0000u);
#elif defined(__AVX2__)  // numbers 0-3, 8-11 and the others
  const __m256i halves = _mm256_loadu_si256((const __m256i*)from);
  a = (Simd<float>)_mm256_unpacklo_epi16(_mm256_setzero_si256(), halves);
  b = (Simd<float>)_mm256_unpackhi_epi16(_mm256_setzero_si256(), halves);
#elif !defined(__AVX__)  // in their order
  typedef std::uint16_t Halves __attribute__((vector_size(simd_bytes)));
  Halves halves;
  std::memcpy(&halves, from, sizeof halves);
  a = (Simd<float>)shuffle<0, 8, 1, 9, 2, 10, 3, 11>(Halves{}, halves);
  b = (Simd<float>)shuffle<4, 12, 5, 13, 6, 14, 7, 15>(Halves{}, halves);
#else
  a = load(from);
  b = load(from + simd_width<float>);
#endif
}
/// @}

/// Puts sums over what load_two() gave in the order of the weights.
/// @{
template <class W, class V>
[[gnu::always_inline]] inline void reorder_two([[maybe_unused]] V& a, [[maybe_unused]] V& b) noexcept {
#if defined(__AVX512F__)
  if constexpr (std::is_same_v<W, bfloat16>) {
    const auto even = (__m512)a, odd = (__m512)b;
    a = (V)_mm512_permutex2var_ps(
        even, _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23), odd);
    b = (V)_mm512_permutex2var_ps(
        even, _mm512_setr_epi32(8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31), odd);
  }
#elif defined(__AVX2__)
  if constexpr (std::is_same_v<W, bfloat16>) {
    const __m256 low = (__m256)a, high = (__m256)b;
    a = (V)_mm256_permute2f128_ps(low, high, 0x20);
    b = (V)_mm256_permute2f128_ps(low, high, 0x31);
  }
#endif
}
/// @}

template <class T>
[[gnu::always_inline]] inline void store(T* to, const Simd<T>& x) noexcept {
  std::memcpy(to, &x, sizeof x);
}

/// Whether no number of the block is infinite or NaN; size is a multiple of simd_width<T>.
template <class T>
bool all_finite(const T* block, std::size_t size) noexcept {
  Simd<T> sum{};  // of zeros, and of NaN where a number is not finite
  for (std::size_t at = 0; at < size; at += simd_width<T>) {
    const Simd<T> x = load(block + at);
    sum += x - x;
  }
  for (int i = 0; i < simd_width<T>; ++i)
    if (!(sum[i] == 0)) return false;
  return true;
}

/// f of every lane. f must not be one that the compiler has a vector instruction for: it is called lane by
/// lane, and that takes longer than a call.
template <class V, class F>
[[gnu::noinline]] V map_lanes(const V& x, F f) noexcept {
  V y{};
  for (std::size_t i = 0; i < sizeof(V) / sizeof(x[0]); ++i) y[i] = f(x[i]);
  return y;
}

/// The exact square root of every lane. (A loop of std::sqrt is not made one instruction, as it may have to
/// set errno.)
template <class V>
[[gnu::always_inline]] inline V root_of_lanes(const V& x) noexcept {
  [[maybe_unused]] constexpr bool single = sizeof(x[0]) == sizeof(float);
#if defined(__AVX512F__)  // zero-masked with every lane kept: the plain forms warn inside GCC 12's header
  if constexpr (single)
    return (V)_mm512_maskz_sqrt_ps(0xffff, (__m512)x);
  else
    return (V)_mm512_maskz_sqrt_pd(0xff, (__m512d)x);
#elif defined(__AVX__)
  if constexpr (single)
    return (V)_mm256_sqrt_ps((__m256)x);
  else
    return (V)_mm256_sqrt_pd((__m256d)x);
#elif defined(__SSE2__)
  if constexpr (single)
    return (V)_mm_sqrt_ps((__m128)x);
  else
    return (V)_mm_sqrt_pd((__m128d)x);
#else
  return map_lanes(x, [](auto lane) { return std::sqrt(lane); });
#endif
}

/// x * factor for lanes below 2^32, which is one instruction where a product of whole 64-bit lanes is
/// several.
inline Simd<std::uint64_t> multiply_low(const Simd<std::uint64_t>& x, std::uint32_t factor) noexcept {
  using Register = Simd<std::uint64_t>;
  const Register y = Register{} + factor;
#if defined(__AVX512F__)
  return (Register)_mm512_maskz_mul_epu32(0xff, (__m512i)x, (__m512i)y);
#elif defined(__AVX2__)
  return (Register)_mm256_mul_epu32((__m256i)x, (__m256i)y);
#elif defined(__SSE2__) && !defined(__AVX__)
  return (Register)_mm_mul_epu32((__m128i)x, (__m128i)y);
#else
  return x * y;
#endif
}

}  // namespace rbres::RBRES_ABI::detail
