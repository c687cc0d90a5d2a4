#pragma once

#include <rbres/nn/simd.hpp>

#include <algorithm>
#include <cstddef>
#include <type_traits>
#include <utility>

/// @file
/// The one matrix kernel. Every matrix stands in panels of 64 bytes: number (r, c) of a matrix with C columns
/// is number (r / lanes * C + c) * lanes + r % lanes, with zeros up to the next multiple of `lanes` rows.
/// Weights have outputs as rows and inputs as columns; activations have features as rows and samples as
/// columns. So whatever the kernel walks along lies in sequence. The layout is the same for every instruction
/// set.
namespace rbres::RBRES_ABI::detail {

/// Numbers in one column of a panel.
template <class T>
inline constexpr int lanes = static_cast<int>(64 / sizeof(T));
/// Weights of half the size stand where floats would, in panels of 32 bytes.
template <>
inline constexpr int lanes<bfloat16> = lanes<float>;

/// n rounded up to whole panels.
template <class T>
constexpr int padded(int n) {
  return (n + lanes<T> - 1) / lanes<T> * lanes<T>;
}

/// A matrix in panels, or what is right of and below one of its numbers.
template <class T>
struct Panels {
  T* data;
  std::ptrdiff_t columns;  ///< of the whole matrix
  [[gnu::always_inline]] T* at(std::ptrdiff_t row, std::ptrdiff_t column) const noexcept {
    const auto r = static_cast<std::size_t>(row);  // without a sign, division is a shift
    constexpr std::size_t length = lanes<std::remove_const_t<T>>;
    return data +
           (static_cast<std::ptrdiff_t>(r / length) * columns + column) * lanes<std::remove_const_t<T>> +
           r % length;
  }
  [[gnu::always_inline]] Panels from(std::ptrdiff_t row, std::ptrdiff_t column) const noexcept {
    return {at(row, column), columns};
  }
};

/// A left factor a(r, k) at data[r * Row + k / lanes * panel + k % lanes * Step].
template <class T, int Row, int Step>
struct Left {
  const T* data;
  std::ptrdiff_t panel;
};
/// a(r, k) = x(k, r)
template <class T>
Left<T, lanes<T>, 1> columns_as_rows(Panels<const T> x) noexcept {
  return {x.data, x.columns * lanes<T>};
}
/// a(r, k) = x(r, k), for rows of one panel
template <class T>
Left<T, 1, lanes<T>> rows_as_rows(Panels<const T> x) noexcept {
  return {x.data, lanes<T> * lanes<T>};
}

/// Accumulators that fill the registers: at most tile_rows x tile_vectors of them.
#if defined(__AVX512F__)
inline constexpr int tile_rows = 14, tile_vectors = 2;
#else
inline constexpr int tile_rows = 6, tile_vectors = 2;
#endif

/// finish(r, lane, sum over k of a(r, k) * b(lane..., k)) for Rows rows and Vectors registers of lanes. Each
/// sum is taken in the order of k whatever the tile, so that the result does not depend on how rows are
/// split. Fetches `ahead` meanwhile.
template <int Rows, int Vectors, class T, int Row, int Step, class W, class Finish>
[[gnu::always_inline]] inline void tile(std::ptrdiff_t depth, Left<T, Row, Step> a, Panels<const W> b,
                                        const W* ahead, const Finish& finish) {
  constexpr int width = simd_width<T>;
  constexpr bool paired = Vectors == 2 && lanes<T> >= 2 * width;  // two registers of one panel
  Simd<T> sum[std::size_t(Rows)][std::size_t(Vectors)] = {};
  const W* right = b.data;
  for (std::ptrdiff_t panel = 0; panel < depth; panel += lanes<T>, a.data += a.panel) {
    const std::ptrdiff_t count = std::min<std::ptrdiff_t>(lanes<T>, depth - panel);
    for (std::ptrdiff_t k = 0; k < count; ++k, right += lanes<T>, ahead += lanes<T>) {
      __builtin_prefetch(ahead, 0, 2);
      Simd<T> column[std::size_t(Vectors)];
      if constexpr (paired) {
        load_two(right, column[0], column[Vectors - 1]);
      } else {
#pragma GCC unroll 16
        for (int v = 0; v < Vectors; ++v)
          column[v] = load(Panels<const W>{right, b.columns}.at(v * width, 0));
      }
#pragma GCC unroll 16
      for (int r = 0; r < Rows; ++r) {
        const T x = a.data[std::ptrdiff_t{r} * Row + k * Step];
#pragma GCC unroll 16
        for (int v = 0; v < Vectors; ++v) sum[r][v] += x * column[v];
      }
    }
  }
#pragma GCC unroll 16
  for (int r = 0; r < Rows; ++r) {
    if constexpr (paired) reorder_two<W>(sum[r][0], sum[r][Vectors - 1]);
#pragma GCC unroll 16
    for (int v = 0; v < Vectors; ++v) finish(r, v * width, sum[r][v]);
  }
}

/// The same for any number of rows, in tiles as even as possible, all of an even number of rows but a last
/// single one: so there are half as many tiles to compile.
template <int Vectors, class T, int Row, int Step, class W, class Finish>
[[gnu::always_inline]] inline void tiles(int rows, std::ptrdiff_t depth, Left<T, Row, Step> a,
                                         Panels<const W> b, const Finish& finish) {
  constexpr int panels = std::max(1, Vectors * simd_width<T> / lanes<T>);
  const int count = (rows + tile_rows - 1) / tile_rows;
  for (int t = 0, row = 0; row < rows; ++t) {
    const int left = rows - row, even = t < count ? (left / 2 + count - t - 1) / (count - t) * 2 : 0;
    const int now = even > 0 ? even : 1;
    const W* ahead = b.at((t < panels ? panels + t : 0) * lanes<T>, 0);  // the panels of the next lanes, once
    const Left<T, Row, Step> from{a.data + row * Row, a.panel};
    const auto shifted = [&finish, row ](int r, int lane, const Simd<T>& z) __attribute__((always_inline)) {
      finish(row + r, lane, z);
    };
    [&]<int... R>(std::integer_sequence<int, R...>) __attribute__((always_inline)) {
      ((now == 2 * R + 2 ? tile<2 * R + 2, Vectors>(depth, from, b, ahead, shifted) : void()), ...);
    }
    (std::make_integer_sequence<int, tile_rows / 2>{});
    if (now == 1) tile<1, Vectors>(depth, from, b, ahead, shifted);
    row += now;
  }
}

/// How lanes fall into groups of at most tile_vectors registers, as even as possible, the larger first.
template <class T>
struct Groups {
  int count, vectors, larger;

  constexpr explicit Groups(int total) {
    const int registers = total / simd_width<T>;
    count = (registers + tile_vectors - 1) / tile_vectors;
    vectors = registers / count;
    larger = registers % count;
  }
  constexpr int first_lane(int group) const {
    return (group * vectors + std::min(group, larger)) * simd_width<T>;
  }

  /// finish(r, lane, (a b)(r, lane...)) for all rows and the lanes of one group, from which on b stands.
  template <int Row, int Step, class W, class Finish>
  [[gnu::always_inline]] void multiply(int group, int rows, std::ptrdiff_t depth, Left<T, Row, Step> a,
                                       Panels<const W> b, const Finish& finish) const {
    const int first = first_lane(group), now = vectors + (group < larger ? 1 : 0);
    const auto shifted = [&finish, first ](int r, int lane, const Simd<T>& z) __attribute__((always_inline)) {
      finish(r, first + lane, z);
    };
    [&]<int... V>(std::integer_sequence<int, V...>) __attribute__((always_inline)) {
      ((now == V + 1 ? tiles<V + 1>(rows, depth, a, b, shifted) : void()), ...);
    }
    (std::make_integer_sequence<int, tile_vectors>{});
  }
};

/// finish(0, lane, (W x)(lane...)) for one sample x in sequence. Memory bounds it, so it walks the panels in
/// sequence.
template <class T, class W, class Finish>
[[gnu::always_inline]] inline void multiply_row(int out, std::ptrdiff_t in, const W* weights, const T* x,
                                                const Finish& finish) {
  constexpr int width = simd_width<T>, vectors = lanes<T> / width, parts = 4;
  for (int lane = 0; lane < out; lane += lanes<T>, weights += in * lanes<T>) {
    Simd<T> sum[parts][std::size_t(vectors)] = {};
    const auto add = [&](std::ptrdiff_t k, int part) {
      const W* column = weights + k * lanes<T>;
      if constexpr (vectors == 1) {
        sum[part][0] += x[k] * load(column);
      } else {
#pragma GCC unroll 16
        for (int v = 0; v < vectors; v += 2) {
          Simd<T> a, b;
          load_two(column + v * width, a, b);
          sum[part][v] += x[k] * a;
          sum[part][v + 1] += x[k] * b;
        }
      }
    };
    const std::ptrdiff_t whole = in / parts * parts;
    for (std::ptrdiff_t k = 0; k < whole; k += parts) {
      constexpr std::ptrdiff_t line = 64 / sizeof(W), away = 64 * line;
#pragma GCC unroll 16
      for (std::ptrdiff_t at = 0; at < parts * lanes<T>; at += line)
        __builtin_prefetch(weights + k * lanes<T> + away + at);
#pragma GCC unroll 16
      for (int part = 0; part < parts; ++part) add(k + part, part);
    }
    for (std::ptrdiff_t k = whole; k < in; ++k) add(k, 0);
#pragma GCC unroll 16
    for (int v = 0; v < vectors; ++v) sum[0][v] = (sum[0][v] + sum[1][v]) + (sum[2][v] + sum[3][v]);
    if constexpr (vectors == 2) reorder_two<W>(sum[0][0], sum[0][vectors - 1]);
#pragma GCC unroll 16
    for (int v = 0; v < vectors; ++v) finish(0, lane + v * width, sum[0][v]);
  }
}

/// One step of the transposition of a square of registers: exchanges the lanes of a whose number has `Bit`
/// with those of b whose number has not.
template <int Bit, class V, int... J>
[[gnu::always_inline]] inline void exchange(V& a, V& b, std::integer_sequence<int, J...>) noexcept {
  constexpr int width = sizeof...(J);
#if defined(__GNUC__) && !defined(__clang__) && __GNUC__ < 12
  // The older name of the same instruction, with the lanes' numbers in a vector.
  using Numbers = decltype(a < b);
  const V low = __builtin_shuffle(a, b, Numbers{((J & Bit) != 0 ? width + J - Bit : J)...});
  b = __builtin_shuffle(a, b, Numbers{((J & Bit) != 0 ? width + J : J + Bit)...});
#else
  const V low = __builtin_shufflevector(a, b, ((J & Bit) != 0 ? width + J - Bit : J)...);
  b = __builtin_shufflevector(a, b, ((J & Bit) != 0 ? width + J : J + Bit)...);
#endif
  a = low;
}

/// to(i, o) = weights(o, first + i) for all outputs and `count` inputs, a multiple of the register; zeros
/// beyond the last.
template <class T, class W>
inline void transpose(int out, int in, Panels<const W> weights, int first, int count, Panels<T> to) noexcept {
  constexpr int width = simd_width<T>;
  for (int o = 0; o < padded<T>(out); o += width)
    for (int i = 0; i < count; i += width) {
      Simd<T> square[std::size_t(width)];
#pragma GCC unroll 16
      for (int r = 0; r < width; ++r)
        square[r] = first + i + r < in ? load(weights.at(o, first + i + r)) : Simd<T>{};
      const auto step = [&]<int Bit>(std::integral_constant<int, Bit>) {
        if constexpr (Bit < width)
#pragma GCC unroll 16
          for (int r = 0; r < width; ++r)
            if ((r & Bit) == 0)
              exchange<Bit>(square[r], square[r + Bit], std::make_integer_sequence<int, width>{});
      };
      step(std::integral_constant<int, 1>{});
      step(std::integral_constant<int, 2>{});
      step(std::integral_constant<int, 4>{});
      step(std::integral_constant<int, 8>{});
#pragma GCC unroll 16
      for (int r = 0; r < width; ++r) store(to.at(i, o + r), square[r]);
    }
}

}  // namespace rbres::RBRES_ABI::detail
