#pragma once

#include <rbres/nn/simd.hpp>

#include <array>
#include <cstddef>
#include <utility>

/// The one matrix kernel. Matrices of weights stand in panels of 64 bytes: number (o, i) of an Out x In
/// matrix is number (o / lanes * In + i) * lanes + o % lanes, with zeros up to the next multiple of `lanes`
/// outputs. The layout is the same for every instruction set.
namespace rbres::detail {

/// Numbers in one row of a panel.
template <class T>
inline constexpr int lanes = static_cast<int>(64 / sizeof(T));

/// n rounded up to whole panels.
template <class T>
constexpr int padded(int n) {
  return (n + lanes<T> - 1) / lanes<T> * lanes<T>;
}

/// Distance of two samples in a buffer of activations: an odd number of cache lines, so that columns of
/// samples do not fall into the same few sets of the cache.
template <class T>
constexpr int activation_stride(int n) {
  return (padded<T>(n) / lanes<T> | 1) * lanes<T>;
}

/// Left factor a[r, k] at data[r * row + k * step].
template <class T>
struct Left {
  const T* data;
  std::ptrdiff_t row, step;
};

/// Right factor b[k, lane] at data[lane / lanes * panel + k * step + lane % lanes].
template <class T>
struct Right {
  const T* data;
  std::ptrdiff_t step, panel;
};

/// Registers of accumulators that the tile below takes: Rows x Vectors.
#if defined(__AVX512F__)
inline constexpr int tile_rows = 6, tile_vectors = 4;
#else
inline constexpr int tile_rows = 6, tile_vectors = 2;
#endif

/// finish(r, lane, sum over k of a[r, k] * b[k, lane...]) for Rows rows and Vectors registers from `lane` on.
/// Each sum is taken in the order of k whatever the tile, so that the result does not depend on how rows are
/// split.
template <int Rows, int Vectors, class T, class Finish>
[[gnu::always_inline]] inline void tile(int depth, Left<T> a, Right<T> b, int row, int lane,
                                        const Finish& finish) {
  constexpr int width = simd_width<T>;
  Simd<T> sum[Rows][Vectors] = {};
  const T* left = a.data + row * a.row;
  const T* right[Vectors];
  for (int v = 0; v < Vectors; ++v) {
    const int at = lane + v * width;
    right[v] = b.data + at / lanes<T> * b.panel + at % lanes<T>;
  }
  for (int k = 0; k < depth; ++k) {
    Simd<T> column[Vectors];
#pragma GCC unroll 4
    for (int v = 0; v < Vectors; ++v) column[v] = load(right[v] + k * b.step);
#pragma GCC unroll 16
    for (int r = 0; r < Rows; ++r) {
      const T x = left[r * a.row + k * a.step];
#pragma GCC unroll 4
      for (int v = 0; v < Vectors; ++v) sum[r][v] += x * column[v];
    }
  }
#pragma GCC unroll 16
  for (int r = 0; r < Rows; ++r)
#pragma GCC unroll 4
    for (int v = 0; v < Vectors; ++v) finish(row + r, lane + v * width, sum[r][v]);
}

template <int Vectors, class T, class Finish>
[[gnu::always_inline]] inline void tiles_of_lane(int rows, int depth, Left<T> a, Right<T> b, int lane,
                                                 const Finish& finish) {
  const int count = (rows + tile_rows - 1) / tile_rows;  // as even as possible: 8 rows are 4 + 4
  for (int t = 0, row = 0; t < count; ++t) {
    const int now = (rows - row + count - t - 1) / (count - t);
    [&]<int... R>(std::integer_sequence<int, R...>) {
      ((now == R + 1 ? tile<R + 1, Vectors>(depth, a, b, row, lane, finish) : void()), ...);
    }
    (std::make_integer_sequence<int, tile_rows>{});
    row += now;
  }
}

/// finish(r, lane, (a b)[r, lane...]) for all rows and `columns` lanes from `first` on.
template <class T, class Finish>
void multiply(int rows, int first, int columns, int depth, Left<T> a, Right<T> b, const Finish& finish) {
  constexpr int width = simd_width<T>;
  int lane = first;
  for (; lane + tile_vectors * width <= first + columns; lane += tile_vectors * width)
    tiles_of_lane<tile_vectors>(rows, depth, a, b, lane, finish);
  for (; lane < first + columns; lane += width) tiles_of_lane<1>(rows, depth, a, b, lane, finish);
}

/// finish(0, lane, (W x)[lane...]) for one sample. Memory bounds it, so it walks the panels from first to
/// last.
template <class T, class Finish>
void multiply_row(int out, int in, const T* weights, const T* x, const Finish& finish) {
  constexpr int width = simd_width<T>, vectors = lanes<T> / width, parts = 4;
  for (int lane = 0; lane < padded<T>(out); lane += lanes<T>) {
    Simd<T> sum[parts][vectors] = {};
    const auto add = [&](int k, int part) {
      for (int v = 0; v < vectors; ++v) sum[part][v] += x[k] * load(weights + k * lanes<T> + v * width);
    };
    int k = 0;
    for (; k + parts <= in; k += parts)
      for (int part = 0; part < parts; ++part) add(k + part, part);
    for (; k < in; ++k) add(k, 0);
    for (int v = 0; v < vectors; ++v)
      finish(0, lane + v * width, (sum[0][v] + sum[1][v]) + (sum[2][v] + sum[3][v]));
    weights += std::ptrdiff_t{in} * lanes<T>;
  }
}

/// to = Wᵀ y for one sample, with zeros up to the next whole panel.
template <class T>
void multiply_row_transposed(int out, int in, const T* weights, const T* y, T* to) {
  constexpr int width = simd_width<T>;
  for (int i = 0; i < padded<T>(in); ++i) {
    to[i] = 0;
    if (i >= in) continue;
    Simd<T> sum{};
    for (int lane = 0; lane < padded<T>(out); lane += width)
      sum += load(y + lane) * load(weights + (lane / lanes<T> * in + i) * lanes<T> + lane % lanes<T>);
    for (int l = 0; l < width; ++l) to[i] += sum[l];
  }
}

/// Panels of the transpose of an Out x In matrix of panels.
template <class T>
void transpose_panels(int out, int in, const T* from, T* to) {
  for (int p = 0; p < padded<T>(out) / lanes<T>; ++p)
    for (int i = 0; i < in; ++i)
      for (int l = 0; l < lanes<T> && p * lanes<T> + l < out; ++l)
        to[(i / lanes<T> * out + p * lanes<T> + l) * lanes<T> + i % lanes<T>] =
            from[(p * in + i) * lanes<T> + l];
}

}  // namespace rbres::detail
