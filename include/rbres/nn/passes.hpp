#pragma once

#include <rbres/core/philox.hpp>
#include <rbres/nn/kernels.hpp>
#include <rbres/nn/stages.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace rbres {

/// Which numbers Dropout keeps: a pure function of seed, step, stage, sample and feature, so that threads
/// change nothing.
struct DropoutMask {
  double rate = 0;  ///< probability of becoming 0, in [0, 1), in steps of 1/65536
  std::uint64_t seed = 0;
  std::uint64_t step = 0;
};

namespace detail {

/// Calls f(std::integral_constant<int, 0>{}) to N - 1.
template <int N, class F>
[[gnu::always_inline]] inline void unrolled(const F& f) {
  [&]<int... I>(std::integer_sequence<int, I...>) { (f(std::integral_constant<int, I>{}), ...); }
  (std::make_integer_sequence<int, N>{});
}

/// Writes 0 or 1 / (1 - rate) for `columns` numbers of one sample.
template <class T>
void fill_dropout(const DropoutMask& mask, int stage, std::ptrdiff_t sample, int columns,
                  T* factor) noexcept {
  const auto threshold = static_cast<std::uint32_t>(mask.rate * 65536 + 0.5);
  const T keep = static_cast<T>(1 / (1 - threshold / 65536.0));
  const std::array<std::uint32_t, 2> key{static_cast<std::uint32_t>(mask.seed),
                                         static_cast<std::uint32_t>(mask.seed >> 32)};
  const auto high =
      static_cast<std::uint32_t>(mask.step >> 32) | 0x80000000u;  // apart from every stream of Random
  for (int first = 0; first < columns; first += 8) {
    const auto block = static_cast<std::uint32_t>(stage) << 16 | static_cast<std::uint32_t>(first / 8);
    const auto words = philox4x32(
        {block, static_cast<std::uint32_t>(sample), static_cast<std::uint32_t>(mask.step), high}, key);
    for (int i = 0; i < 8; ++i)
      factor[first + i] =
          (words[static_cast<std::size_t>(i / 2)] >> (i % 2 * 16) & 0xffffu) < threshold ? T{} : keep;
  }
}

/// The network's passes over rows of activations, one row for each sample, in buffers of one stride.
template <class T, class C>
struct Passes {
  static constexpr int stride = activation_stride<T>(C::max_size);
  static constexpr std::size_t row = static_cast<std::size_t>(stride);

  static constexpr std::size_t weight_size(int s) {
    const Stage& stage = C::stage(s);
    return stage.has_linear
               ? static_cast<std::size_t>(padded<T>(stage.outputs)) * static_cast<std::size_t>(stage.inputs)
               : 0;
  }
  static constexpr std::size_t bias_size(int s) {
    return C::stage(s).has_linear ? static_cast<std::size_t>(padded<T>(C::stage(s).outputs)) : 0;
  }
  /// Where stage s has its weights; its biases follow. offset(stage_count) is the size of the whole block.
  static constexpr std::size_t offset(int s) {
    std::size_t sum = 0;
    for (int t = 0; t < s; ++t) sum += weight_size(t) + bias_size(t);
    return sum;
  }
  static constexpr bool output_has_slope = C::stage(C::stage_count - 1).count > 0;
  static constexpr std::size_t parameter_size = offset(C::stage_count);

  /// Values and, beside them, first the slopes of the elementwise layers, then the gradients of the z of each
  /// stage. Row r of value v stands at [(v * capacity + r) * stride]; gradient 0 is the one of the input.
  struct Tape {
    T* values;
    T* gradients;
    std::ptrdiff_t capacity;
    T* value(int v, std::ptrdiff_t r) const { return values + (v * capacity + r) * stride; }
    T* gradient(int v, std::ptrdiff_t r) const { return gradients + (v * capacity + r) * stride; }
  };
  static constexpr std::size_t tape_row = 2 * static_cast<std::size_t>(C::stage_count + 1) * row;

  /// out = chain(W in + b) + skip; with Recorded, slope holds the dropout factors before and the slopes
  /// after.
  template <int In, int Out, class Chain, bool HasSkip, bool Recorded>
  static void linear(int rows, const T* weights, const T* in, const T* skip, T* out, T* slope) noexcept {
    const T* bias = weights + static_cast<std::size_t>(padded<T>(Out)) * In;
    const auto finish = [=](int r, int lane, Simd<T> z) {
      const std::ptrdiff_t at = std::ptrdiff_t{r} * stride + lane;
      z = chain<Chain, Recorded>(z + load(bias + lane), slope + at);
      if constexpr (HasSkip) z += load(skip + at);
      store(out + at, z);
    };
    if (!Recorded && rows == 1)  // in training the order of sums must not depend on how a batch is split
      multiply_row<T>(Out, In, weights, in, finish);
    else
      multiply<T>(rows, 0, padded<T>(Out), In, Left<T>{in, stride, 1},
                  Right<T>{weights, lanes<T>, In * lanes<T>}, finish);
  }

  /// out = chain(in) + skip, which may be done in place.
  template <int Size, class Chain, bool HasSkip, bool Recorded>
  static void elementwise(int rows, const T* in, const T* skip, T* out, T* slope) noexcept {
    for (int r = 0; r < rows; ++r)
      for (int lane = 0; lane < padded<T>(Size); lane += simd_width<T>) {
        const std::ptrdiff_t at = std::ptrdiff_t{r} * stride + lane;
        Simd<T> z = chain<Chain, Recorded>(load(in + at), slope + at);
        if constexpr (HasSkip) z += load(skip + at);
        store(out + at, z);
      }
  }

  /// Stage S from row to row; skip and slope are read only where they are needed.
  template <int S, bool Recorded>
  static void stage(int rows, const T* parameters, const T* in, const T* skip, T* out, T* slope) noexcept {
    constexpr Stage info = C::stage(S);
    using Chain = typename C::template ChainOfStage<S>;
    if constexpr (info.has_linear) {
      linear<info.inputs, info.outputs, Chain, info.skip != none, Recorded>(rows, parameters + offset(S), in,
                                                                            skip, out, slope);
    } else {
      elementwise<info.outputs, Chain, info.skip != none, Recorded>(rows, in, skip, out, slope);
    }
  }

  /// Inference of rows that stand in slot slots[0]; the output is then in slot slots[stage_count].
  static void forward(int rows, const T* parameters, T* slots, std::ptrdiff_t slot_size) noexcept {
    const auto slot = [=](int v) { return slots + C::slots[static_cast<std::size_t>(v)] * slot_size; };
    unrolled<C::stage_count>([&](auto s) {
      constexpr int skip = C::stage(s).skip;
      stage<s, false>(rows, parameters, slot(s), skip == none ? nullptr : slot(skip), slot(s + 1), nullptr);
    });
  }

  /// Fills values and slopes of rows [first, first + rows) of the tape from value 0; samples are numbered as
  /// rows.
  static void record(const T* parameters, const Tape& tape, std::ptrdiff_t first, int rows,
                     const DropoutMask& mask) noexcept {
    unrolled<C::stage_count>([&](auto s) {
      constexpr Stage info = C::stage(s);
      T* slope = tape.gradient(s + 1, first);
      if constexpr (info.has_dropout)
        for (int r = 0; r < rows; ++r)
          fill_dropout(mask, s, first + r, padded<T>(info.outputs), slope + r * stride);
      stage<s, true>(rows, parameters, tape.value(s, first),
                     info.skip == none ? nullptr : tape.value(info.skip, first), tape.value(s + 1, first),
                     slope);
    });
  }

  /// Turns the slopes of row 0 into tangents, from the input's in gradient 0 to the output's in the last
  /// (forward mode).
  static void tangent(const T* parameters, const Tape& tape) noexcept {
    unrolled<C::stage_count>([&](auto s) {
      constexpr Stage info = C::stage(s);
      const T* in = tape.gradient(s, 0);
      T* out = tape.gradient(s + 1, 0);
      const auto finish = [&](int, int lane, Simd<T> z) {
        if constexpr (info.count > 0) z *= load(out + lane);
        if constexpr (info.skip != none) z += load(tape.gradient(info.skip, 0) + lane);
        store(out + lane, z);
      };
      if constexpr (info.has_linear) {
        multiply_row<T>(info.outputs, info.inputs, parameters + offset(s), in, finish);
      } else {
        for (int lane = 0; lane < padded<T>(info.outputs); lane += simd_width<T>)
          finish(0, lane, load(in + lane));
      }
    });
  }

  /// Finishes a gradient: adds those of the skips that start here, and multiplies by the slope that stands in
  /// its place.
  template <int Skips, bool HasSlope>
  struct Gradient {
    T* out;
    std::array<const T*, Skips> skips;
    [[gnu::always_inline]] void operator()(int r, int lane, Simd<T> g) const noexcept {
      const std::ptrdiff_t at = std::ptrdiff_t{r} * stride + lane;
      for (const T* skip : skips) g += load(skip + at);
      if constexpr (HasSlope) g *= load(out + at);
      store(out + at, g);
    }
  };

  /// Turns the slopes of rows [first, first + rows) into gradients of every z, from the output's gradient in
  /// the last (reverse mode). product(s, in, finish) must call finish(r, lane, (Wᵀ in)[r, lane...]) for stage
  /// s.
  template <class Product>
  static void backward(const Tape& tape, std::ptrdiff_t first, int rows, bool to_input,
                       const Product& product) noexcept {
    unrolled<C::stage_count>([&](auto reversed) {
      constexpr int v =
          C::stage_count - 1 - reversed;  // the value whose gradient comes next, through stage v
      if (v == 0 && !to_input) return;
      constexpr int skips = [] {
        int count = 0;
        for (int s = 0; s < C::stage_count; ++s) count += C::stage(s).skip == v;
        return count;
      }();
      Gradient<skips, (v > 0 && C::stage(std::max(v, 1) - 1).count > 0)> finish{tape.gradient(v, first), {}};
      for (std::size_t s = 0, at = 0; s < static_cast<std::size_t>(C::stage_count); ++s)
        if (C::plan.stages[s].skip == v) finish.skips[at++] = tape.gradient(static_cast<int>(s) + 1, first);

      const T* in = tape.gradient(v + 1, first);
      if constexpr (C::stage(v).has_linear) {
        product(std::integral_constant<int, v>{}, in, finish);
      } else {
        for (int r = 0; r < rows; ++r)
          for (int lane = 0; lane < padded<T>(C::size(v)); lane += simd_width<T>)
            finish(r, lane, load(in + std::ptrdiff_t{r} * stride + lane));
      }
    });
  }

 private:
  template <class Chain, bool Recorded>
  [[gnu::always_inline]] static Simd<T> chain(Simd<T> z, T* slope) noexcept {
    if constexpr (!Recorded || Chain::empty) {
      return Chain::value(z, Simd<T>{} + 1);
    } else {
      Simd<T> derivative;
      z = Chain::value_and_slope(z, load(slope), derivative);
      store(slope, derivative);
      return z;
    }
  }
};

}  // namespace detail
}  // namespace rbres
