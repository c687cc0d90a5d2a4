#pragma once

#include <Eigen/Core>
#include <array>
#include <bit>
#include <cstdint>
#include <rbres/core/scalar.hpp>

namespace rbres {

namespace detail {
template <class T, int N>
struct VectorOf {
  typedef T type __attribute__((vector_size(sizeof(T) * N)));
};

// The one operation that vector extensions lack: a loop over std::sqrt stays scalar, because it may set
// errno. (The masked forms avoid a false warning of g++ 12 about the unmasked ones.)
#if defined(__AVX512F__)
template <class T>
inline constexpr int sqrt_lanes = 64 / int(sizeof(T));
inline VectorOf<float, 16>::type sqrt_part(VectorOf<float, 16>::type x) {
  return _mm512_maskz_sqrt_ps(0xFFFF, x);
}
inline VectorOf<double, 8>::type sqrt_part(VectorOf<double, 8>::type x) {
  return _mm512_maskz_sqrt_pd(0xFF, x);
}
#elif defined(__AVX__)
template <class T>
inline constexpr int sqrt_lanes = 32 / int(sizeof(T));
inline VectorOf<float, 8>::type sqrt_part(VectorOf<float, 8>::type x) { return _mm256_sqrt_ps(x); }
inline VectorOf<double, 4>::type sqrt_part(VectorOf<double, 4>::type x) { return _mm256_sqrt_pd(x); }
#elif defined(__SSE2__)
template <class T>
inline constexpr int sqrt_lanes = 16 / int(sizeof(T));
inline VectorOf<float, 4>::type sqrt_part(VectorOf<float, 4>::type x) { return _mm_sqrt_ps(x); }
inline VectorOf<double, 2>::type sqrt_part(VectorOf<double, 2>::type x) { return _mm_sqrt_pd(x); }
#else
template <class T>
inline constexpr int sqrt_lanes = 1;
#endif
}  // namespace detail

/// The comparison of two packs: all bits set in the lanes where it holds.
template <class T, int N>
struct LaneMask {
  using Int = std::conditional_t<sizeof(T) == 4, std::int32_t, std::int64_t>;
  using Vector = typename detail::VectorOf<Int, N>::type;
  Vector bits;

  LaneMask() = default;
  LaneMask(Vector b) : bits(b) {}
  LaneMask(bool b) : bits(Vector{} - Int{b}) {}

  friend LaneMask operator&(LaneMask a, LaneMask b) { return {a.bits & b.bits}; }
  friend LaneMask operator|(LaneMask a, LaneMask b) { return {a.bits | b.bits}; }
  friend LaneMask operator!(LaneMask a) { return {~a.bits}; }

  friend bool any(LaneMask m) {
    std::array<std::uint64_t, sizeof(Vector) / 8> words = std::bit_cast<decltype(words)>(m.bits);
    std::uint64_t join = 0;
    for (const std::uint64_t word : words) join |= word;
    return join != 0;
  }
  friend bool all(LaneMask m) { return !any(!m); }
  bool operator[](int lane) const { return bits[lane] != 0; }
};

/// N numbers of type T, one scenario per lane, computed together: the compilers' vector extensions behind the
/// interface of a scalar. sizeof(T) * N may exceed one register; the compiler splits it.
template <class T, int N>
struct Pack {
  static_assert(std::is_same_v<T, float> || std::is_same_v<T, double>, "Pack holds float or double");
  static_assert(N >= 2 && (N & (N - 1)) == 0, "a Pack has 2, 4, 8, ... lanes");
  using Vector = typename detail::VectorOf<T, N>::type;
  using Mask = LaneMask<T, N>;
  Vector v;

  Pack() = default;
  Pack(Vector x) : v(x) {}
  /// The same number in every lane.
  Pack(T x) : v(Vector{} + x) {}

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
  T operator[](int lane) const { return v[lane]; }

  friend Pack select(Mask m, Pack a, Pack b) { return {m.bits ? a.v : b.v}; }
  friend Pack abs(Pack a) { return {a.v < T(0) ? -a.v : a.v}; }
  friend Pack sqrt(Pack a) {
    constexpr int width = detail::sqrt_lanes<T>;
    if constexpr (width > 1 && N % width == 0) {
      using Part = typename detail::VectorOf<T, width>::type;
      Part parts[N / width];
      __builtin_memcpy(parts, &a.v, sizeof parts);
      for (Part& part : parts) part = detail::sqrt_part(part);
      __builtin_memcpy(&a.v, parts, sizeof parts);
    } else {
      for (int i = 0; i < N; ++i) a.v[i] = std::sqrt(a.v[i]);
    }
    return a;
  }
};

template <class T, int N>
struct ScalarTraits<Pack<T, N>> {
  using Value = T;
  using Mask = LaneMask<T, N>;
  static constexpr int lanes = N;
  static T lane(const Pack<T, N>& x, int i) { return x.v[i]; }
  static void set_lane(Pack<T, N>& x, int i, T value) { x.v[i] = value; }
};

/// As many lanes as fill the widest register that the compiler was told of, at least 16 bytes.
template <class T>
inline constexpr int native_lanes = EIGEN_MAX_STATIC_ALIGN_BYTES >= 64   ? 64 / int(sizeof(T))
                                    : EIGEN_MAX_STATIC_ALIGN_BYTES >= 32 ? 32 / int(sizeof(T))
                                                                         : 16 / int(sizeof(T));

}  // namespace rbres
