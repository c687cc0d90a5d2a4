#pragma once

#include <rbres/nn/kernels.hpp>

#include <array>
#include <cstddef>

/// The products that a Linear layer needs, with what goes before and after them done while numbers are in
/// registers.
namespace rbres::detail {

/// Elementwise layers; with Recorded, slope holds the dropout factors before and the slopes after.
template <class Chain, bool Recorded, class T>
[[gnu::always_inline]] inline Simd<T> apply(Simd<T> z, T* slope) noexcept {
  if constexpr (!Recorded || Chain::empty) {
    return Chain::value(z, constant<Simd<T>>(1));
  } else {
    Simd<T> derivative;
    z = Chain::value_and_slope(z, load(slope), derivative);
    store(slope, derivative);
    return z;
  }
}

/// out = chain(W in + b) + skip; the biases stand behind the weights.
template <int In, int Out, class Chain, bool HasSkip, bool Recorded, class T>
void linear(int count, const T* weights, Panels<T> in, Panels<T> skip, Panels<T> out,
            Panels<T> slope) noexcept {
  using Lanes = Groups<T, padded<T>(Out)>;
  const T* bias = weights + std::size_t{padded<T>(Out)} * In;
  const auto finish = [=](int c, int lane, Simd<T> z) __attribute__((always_inline)) {
    z = apply<Chain, Recorded>(z + load(bias + lane), slope.at(lane, c));
    if constexpr (HasSkip) z += load(skip.at(lane, c));
    store(out.at(lane, c), z);
  };
  // In training the order of sums must not depend on how a batch is split.
  if (!Recorded && in.columns == 1) return multiply_row<T>(Out, In, weights, in.data, finish);
  for (int g = 0; g < Lanes::count; ++g)
    Lanes::multiply(g, count, In, columns_as_rows<T>({in.data, in.columns}),
                    Panels<const T>{weights, In}.from(Lanes::first_lane(g), 0), finish);
}

/// out = chain(in) + skip, which may be done in place.
template <int Size, class Chain, bool HasSkip, bool Recorded, class T>
void elementwise(int count, Panels<T> in, Panels<T> skip, Panels<T> out, Panels<T> slope) noexcept {
  for (int c = 0; c < count; ++c)
    for (int lane = 0; lane < padded<T>(Size); lane += simd_width<T>) {
      Simd<T> z = apply<Chain, Recorded>(load(in.at(lane, c)), slope.at(lane, c));
      if constexpr (HasSkip) z += load(skip.at(lane, c));
      store(out.at(lane, c), z);
    }
}

/// Finishes a gradient: adds those of the skips that start here, and multiplies by the slope that stands in
/// its place.
template <class T, int Skips, bool HasSlope>
struct Gradient {
  Panels<T> out;
  std::array<Panels<T>, Skips> skips;
  [[gnu::always_inline]] void operator()(int c, int lane, Simd<T> g) const noexcept {
    for (const Panels<T>& skip : skips) g += load(skip.at(lane, c));
    if constexpr (HasSlope) g *= load(out.at(lane, c));
    store(out.at(lane, c), g);
  }
};

/// finish(c, lane, (Wᵀ in)(lane..., c)): each group of lanes is transposed into the cache and used for all
/// samples.
template <int In, int Out, class T, class Finish>
void linear_transposed(int count, const T* weights, Panels<T> in, const Finish finish) noexcept {
  using Lanes = Groups<T, padded<T>(In)>;
  constexpr int panels = (tile_vectors * simd_width<T> + lanes<T> - 1) / lanes<T>;
  for (int g = 0; g < Lanes::count; ++g) {
    const int first = Lanes::first_lane(g);
    alignas(64) T transposed[panels * lanes<T> * std::size_t{padded<T>(Out)}];
    transpose<T>(Out, In, {weights, In}, first, Lanes::first_lane(g + 1) - first,
                 {transposed, padded<T>(Out)});
    Lanes::multiply(g, count, Out, columns_as_rows<T>({in.data, in.columns}), {transposed, padded<T>(Out)},
                    finish);
  }
}

/// The gradients of one group of outputs, summed over all samples in registers: sink(place, g, true) for
/// registers of weights, sink(place, g, false) for biases, counted from the first weight at `offset`.
template <int In, int Out, class T, class Sink>
void linear_gradient(int group, int count, Panels<const T> in, Panels<const T> gradient, std::size_t offset,
                     const Sink& sink) {
  using Lanes = Groups<T, padded<T>(Out)>;
  const auto place = [offset](int row, int column) __attribute__((always_inline)) {
    const auto r = static_cast<std::size_t>(row), c = static_cast<std::size_t>(column);
    return offset + (r / lanes<T> * In + c) * lanes<T> + r % lanes<T>;
  };
  const int first = Lanes::first_lane(group), last = Lanes::first_lane(group + 1);
  constexpr int block =
      128;  // samples whose gradients stay in the nearest cache; between blocks the sums wait
  constexpr int most = tile_vectors * simd_width<T>;
  alignas(64) T sums[std::size_t{In} * most];
  for (int sample = 0; sample < count; sample += block)
    for (int i = 0; i < In; i += lanes<T>)
      Lanes::multiply(
          group, std::min(lanes<T>, In - i), std::min(block, count - sample),
          rows_as_rows<T>(in.from(i, sample)),
          gradient.from(first, sample), [&](int r, int lane, Simd<T> sum) __attribute__((always_inline)) {
            T* waiting = sums + (i + r) * most + (lane - first);
            if (sample > 0) sum += load(waiting);
            if (sample + block < count)
              store(waiting, sum);
            else
              sink(place(lane, i + r), sum, true);
          });
  for (int lane = first; lane < last; lane += simd_width<T>) {
    Simd<T> sum{};
    for (int c = 0; c < count; ++c) sum += load(gradient.at(lane, c));
    sink(offset + static_cast<std::size_t>(padded<T>(Out) * In + lane), sum, false);
  }
}

}  // namespace rbres::detail
