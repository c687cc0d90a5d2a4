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
/// columns. So whatever the kernel walks along lies in sequence. Weights of half the size stand in double
/// panels of twice as many rows, so that these have 64 bytes, too; an odd last panel is a single one. The
/// layout is the same for every instruction set.
namespace rbres::RBRES_ABI::detail {

/// Numbers in one column of a panel.
template <class T>
inline constexpr int lanes = static_cast<int>(64 / sizeof(T));
/// Weights of half the size take the places of as many floats.
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

/// Weights of so many columns in panels, of which the first rows may stand in double ones.
struct WeightLayout {
  int columns;
  int panel;        ///< rows of a panel
  int double_rows;  ///< rows that stand in double panels

  /// Rows of the panel in which a row stands: how far apart its numbers are.
  constexpr int panel_of(int row) const noexcept { return row < double_rows ? 2 * panel : panel; }
  /// Place of a number.
  constexpr std::size_t index(int row, int column) const noexcept {
    const int length = panel_of(row);
    const int place = (row / length * columns + column) * length + row % length;
    return static_cast<std::size_t>(place);
  }
};
/// Whether weights are of half the size of what is computed with them.
template <class W>
inline constexpr bool is_half = sizeof(W) * lanes<W> < 64;
template <class W>
constexpr WeightLayout weight_layout(int rows, int columns) noexcept {
  return {columns, lanes<W>, is_half<W> ? padded<W>(rows) / (2 * lanes<W>)*2 * lanes<W> : 0};
}

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

/// A right factor, from one of its lanes on: register v of b(lanes, k) is at data[k * step + v * apart].
template <class W>
struct Right {
  const W* data;
  std::ptrdiff_t step, apart;
  std::ptrdiff_t panel;  ///< numbers of the panel, in all columns
};
template <class T>
Right<T> lanes_as_columns(Panels<const T> x) noexcept {
  const std::ptrdiff_t panel = x.columns * lanes<T>;
  return {x.data, lanes<T>, simd_width<T> == lanes<T> ? panel : simd_width<T>, panel};
}
/// Weights from output `first` on.
template <class W>
Right<W> weights_as_columns(const W* weights, const WeightLayout& layout, int first) noexcept {
  const std::ptrdiff_t step = layout.panel_of(first), panel = layout.columns * step;
  return {weights + layout.index(first, 0), step, simd_width<W> == step ? panel : simd_width<W>, panel};
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
[[gnu::always_inline]] inline void tile(std::ptrdiff_t depth, Left<T, Row, Step> a, Right<W> b,
                                        const W* ahead, const Finish& finish) {
  constexpr int width = simd_width<T>;
  Simd<T> sum[std::size_t(Rows)][std::size_t(Vectors)] = {};
  for (std::ptrdiff_t panel = 0; panel < depth; panel += lanes<T>, a.data += a.panel) {
    const std::ptrdiff_t count = std::min<std::ptrdiff_t>(lanes<T>, depth - panel);
    for (std::ptrdiff_t k = 0; k < count; ++k, b.data += b.step, ahead += b.step) {
      __builtin_prefetch(ahead, 0, 2);
      Simd<T> column[std::size_t(Vectors)];
      if constexpr (Vectors == 2) {
        load_two(b.data, b.apart, column[0], column[1]);
      } else {
#pragma GCC unroll 16
        for (int v = 0; v < Vectors; ++v) column[v] = load(b.data + v * b.apart);
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
    if constexpr (Vectors == 2) reorder_two<W>(sum[r][0], sum[r][1]);
#pragma GCC unroll 16
    for (int v = 0; v < Vectors; ++v) finish(r, v * width, sum[r][v]);
  }
}

/// The same for any number of rows, in tiles as even as possible, all of an even number of rows but a last
/// single one: so there are half as many tiles to compile.
template <int Vectors, class T, int Row, int Step, class W, class Finish>
[[gnu::always_inline]] inline void tiles(int rows, std::ptrdiff_t depth, Left<T, Row, Step> a,
                                         const Right<W>& b, const Finish& finish) {
  const std::ptrdiff_t panels = std::max<std::ptrdiff_t>(1, Vectors * simd_width<T> / b.step);
  const int count = (rows + tile_rows - 1) / tile_rows;
  for (int t = 0, row = 0; row < rows; ++t) {
    const int left = rows - row, even = t < count ? (left / 2 + count - t - 1) / (count - t) * 2 : 0;
    const int now = even > 0 ? even : 1;
    const W* ahead = b.data + (t < panels ? panels + t : 0) * b.panel;  // the panels of the next lanes, once
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
                                       const Right<W>& b, const Finish& finish) const {
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

/// finish(0, lane, (W x)(lane...)) for one sample x in sequence and the lanes of one panel of Length rows, of
/// as many at once as leave room for sums in the registers.
template <int Length, class T, class W, class Finish>
[[gnu::always_inline]] inline void multiply_panel(int first, std::ptrdiff_t in, const W* weights, const T* x,
                                                  const Finish& finish) {
  constexpr int width = simd_width<T>, vectors = std::min(Length / width, 4);
  constexpr int parts = 8 / std::max(vectors, 2);
  for (int lane = 0; lane < Length; lane += vectors * width) {
    Simd<T> sum[std::size_t(parts)][std::size_t(vectors)] = {};
    const auto add = [&](std::ptrdiff_t k, int part) {
      const W* column = weights + k * Length + lane;
      if constexpr (vectors == 1) {
        sum[part][0] += x[k] * load(column);
      } else {
#pragma GCC unroll 16
        for (int v = 0; v < vectors; v += 2) {
          Simd<T> a, b;
          load_two(column + v * width, width, a, b);
          sum[part][v] += x[k] * a;
          sum[part][v + 1] += x[k] * b;
        }
      }
    };
    const std::ptrdiff_t whole = in / parts * parts;
    for (std::ptrdiff_t k = 0; k < whole; k += parts)
#pragma GCC unroll 16
      for (int part = 0; part < parts; ++part) add(k + part, part);
    for (std::ptrdiff_t k = whole; k < in; ++k) add(k, 0);
#pragma GCC unroll 16
    for (int step = 1; step < parts; step *= 2)
#pragma GCC unroll 16
      for (int part = 0; part < parts; part += 2 * step)
#pragma GCC unroll 16
        for (int v = 0; v < vectors; ++v) sum[part][v] += sum[part + step][v];
    if constexpr (vectors > 1) {
#pragma GCC unroll 16
      for (int v = 0; v < vectors; v += 2) reorder_two<W>(sum[0][v], sum[0][v + 1]);
    }
#pragma GCC unroll 16
    for (int v = 0; v < vectors; ++v) finish(0, first + lane + v * width, sum[0][v]);
  }
}

/// finish(0, lane, (W x)(lane...)) for one sample x in sequence. Memory bounds it, so it walks the panels in
/// sequence.
template <class T, class W, class Finish>
[[gnu::always_inline]] inline void multiply_row(int out, int in, const W* weights, const T* x,
                                                const Finish& finish) {
  const WeightLayout layout = weight_layout<W>(out, in);
  int lane = 0;
  if constexpr (is_half<W>) {
    for (; lane < layout.double_rows; lane += 2 * lanes<W>)
      multiply_panel<2 * lanes<W>>(lane, in, weights + layout.index(lane, 0), x, finish);
  }
  for (; lane < out; lane += lanes<W>)
    multiply_panel<lanes<W>>(lane, in, weights + layout.index(lane, 0), x, finish);
}

/// One step of the transposition of a square of registers: exchanges the lanes of a whose number has `Bit`
/// with those of b whose number has not.
template <int Bit, class V, int... J>
[[gnu::always_inline]] inline void exchange(V& a, V& b, std::integer_sequence<int, J...>) noexcept {
  constexpr int width = sizeof...(J);
  const V low = shuffle<((J & Bit) != 0 ? width + J - Bit : J)...>(a, b);
  b = shuffle<((J & Bit) != 0 ? width + J : J + Bit)...>(a, b);
  a = low;
}

/// to(i, o) = weights(o, first + i) for all outputs and `count` inputs, a multiple of the register; zeros
/// beyond the last.
template <class T, class W>
inline void transpose(int out, int in, const W* weights, int first, int count, Panels<T> to) noexcept {
  const WeightLayout layout = weight_layout<W>(out, in);
  constexpr int width = simd_width<T>;
  for (int o = 0; o < padded<T>(out); o += width)
    for (int i = 0; i < count; i += width) {
      Simd<T> square[std::size_t(width)];
#pragma GCC unroll 16
      for (int r = 0; r < width; ++r)
        square[r] = first + i + r < in ? load(weights + layout.index(o, first + i + r)) : Simd<T>{};
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
