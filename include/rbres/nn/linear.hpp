#pragma once

#include <rbres/nn/kernels.hpp>

#include <array>
#include <cstddef>

/// @file
/// The products that a Linear layer needs, with what goes before and after them done while numbers are in
/// registers.
namespace rbres::RBRES_ABI::detail {

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

/// out = chain(W in + b) + skip; the biases stand behind the weights. Sizes are no template parameters, so
/// that layers of any size share the code.
template <class Chain, bool HasSkip, bool Recorded, class T, class W>
[[gnu::noinline]] void linear(int inputs, int outputs, int count, const W* weights, Panels<T> in,
                              Panels<T> skip, Panels<T> out, Panels<T> slope) noexcept {
  const W* bias = weights + std::ptrdiff_t{padded<T>(outputs)} * inputs;
  const auto finish = [=](int c, int lane, Simd<T> z) __attribute__((always_inline)) {
    z = apply<Chain, Recorded>(z + load(bias + lane), slope.at(lane, c));
    if constexpr (HasSkip) z += load(skip.at(lane, c));
    store(out.at(lane, c), z);
  };
  const Groups<T> groups(padded<T>(outputs));
  const WeightLayout layout = weight_layout<W>(outputs, inputs);
  for (int g = 0; g < groups.count; ++g)
    groups.multiply(g, count, inputs, columns_as_rows<T>({in.data, in.columns}),
                    weights_as_columns(weights, layout, groups.first_lane(g)), finish);
}

/// The same for one sample in sequence, at inference: in a function of its own, so that a program that
/// predicts one by one does not compile the above.
template <class Chain, bool HasSkip, class T, class W>
[[gnu::noinline]] void linear_one(int inputs, int outputs, const W* weights, const T* in, const T* skip,
                                  T* out) noexcept {
  const W* bias = weights + std::ptrdiff_t{padded<T>(outputs)} * inputs;
  const auto finish = [=](int, int lane, Simd<T> z) __attribute__((always_inline)) {
    z = Chain::value(z + load(bias + lane), constant<Simd<T>>(1));
    if constexpr (HasSkip) z += load(skip + lane);
    store(out + lane, z);
  };
  multiply_row<T>(outputs, inputs, weights, in, finish);
}

/// out = chain(in) + skip, which may be done in place.
template <class Chain, bool HasSkip, bool Recorded, class T>
void elementwise(int size, int count, Panels<T> in, Panels<T> skip, Panels<T> out, Panels<T> slope) noexcept {
  for (int c = 0; c < count; ++c)
    for (int lane = 0; lane < padded<T>(size); lane += simd_width<T>) {
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
  std::array<Panels<T>, std::size_t(Skips)> skips;
  [[gnu::always_inline]] void operator()(int c, int lane, Simd<T> g) const noexcept {
    for (const Panels<T>& skip : skips) g += load(skip.at(lane, c));
    if constexpr (HasSlope) g *= load(out.at(lane, c));
    store(out.at(lane, c), g);
  }
};

/// Numbers that a group of lanes of a matrix of `depth` columns has, in whole panels.
template <class T>
constexpr std::size_t group_size(int depth) {
  constexpr int width = (tile_vectors * simd_width<T> + lanes<T> - 1) / lanes<T> * lanes<T>;
  return std::size_t{width} * static_cast<std::size_t>(depth);
}

/// finish(c, lane, (Wᵀ in)(lane..., c)): each group of lanes is transposed into the cache, which has
/// group_size(padded(outputs)) numbers, and used for all samples.
template <class T, class W, class Finish>
[[gnu::noinline]] void linear_transposed(int inputs, int outputs, int count, const W* weights, Panels<T> in,
                                         T* cache, const Finish finish) noexcept {
  const Groups<T> groups(padded<T>(inputs));
  for (int g = 0; g < groups.count; ++g) {
    const int first = groups.first_lane(g);
    transpose<T>(outputs, inputs, weights, first, groups.first_lane(g + 1) - first,
                 {cache, padded<T>(outputs)});
    groups.multiply(g, count, outputs, columns_as_rows<T>({in.data, in.columns}),
                    lanes_as_columns<T>({cache, padded<T>(outputs)}), finish);
  }
}

/// sums(i, lane) = or += the sum over samples of in(i, sample) * gradient(lane, sample), for the rows of one
/// panel and the lanes of one group.
template <class T>
[[gnu::noinline]] void add_products(const Groups<T>& groups, int group, int rows, int samples,
                                    Panels<const T> in, Panels<const T> gradient, bool add,
                                    T* sums) noexcept {
  const int first = groups.first_lane(group);
  groups.multiply(
      group, rows, samples, rows_as_rows<T>(in),
      lanes_as_columns<T>(gradient), [=](int r, int lane, Simd<T> sum) __attribute__((always_inline)) {
        T* to = sums + r * tile_vectors * simd_width<T> + (lane - first);
        if (add) sum += load(to);
        store(to, sum);
      });
}

/// Inputs whose weight gradients are summed before they go to the sink: few, so that its memory traffic
/// spreads.
template <class T>
inline constexpr int gradient_rows = lanes<T> / 2;

/// The gradients of one group of outputs, summed over all samples: sink(place, g, true) for registers of
/// weights, sink(place, g, false) for biases, counted from the first weight at `offset`. `sums` has
/// group_size(inputs) numbers.
template <class T, class Sink>
[[gnu::noinline]] void linear_gradient(int inputs, int outputs, int group, int count, Panels<const T> in,
                                       Panels<const T> gradient, std::size_t offset, T* sums,
                                       const Sink& sink) {
  constexpr int block = 128;  // samples whose gradients stay in the nearest cache
  const Groups<T> groups(padded<T>(outputs));
  const int first = groups.first_lane(group), last = groups.first_lane(group + 1);
  for (int sample = 0; sample < count; sample += block)
    for (int input = 0; input < inputs; input += gradient_rows<T>) {
      T* now = sums + input * tile_vectors * simd_width<T>;
      const int rows = std::min(gradient_rows<T>, inputs - input);
      add_products<T>(groups, group, rows, std::min(block, count - sample), in.from(input, sample),
                      gradient.from(first, sample), sample > 0, now);
      if (sample + block < count) continue;
      for (int lane = first; lane < last; lane += simd_width<T>) {
        const std::size_t place =
            offset +
            static_cast<std::size_t>((lane / lanes<T> * inputs + input) * lanes<T> + lane % lanes<T>);
        for (int r = 0; r < rows; ++r)
          sink(place + static_cast<std::size_t>(r * lanes<T>),
               load(now + r * tile_vectors * simd_width<T> + (lane - first)), true);
      }
    }
  for (int lane = first; lane < last; lane += simd_width<T>) {
    Simd<T> sum{};
    for (int c = 0; c < count; ++c) sum += load(gradient.at(lane, c));
    sink(offset + static_cast<std::size_t>(padded<T>(outputs) * inputs + lane), sum, false);
  }
}

}  // namespace rbres::RBRES_ABI::detail
