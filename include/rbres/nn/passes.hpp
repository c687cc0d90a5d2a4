#pragma once

#include <rbres/nn/dropout.hpp>
#include <rbres/nn/layer_norm.hpp>
#include <rbres/nn/linear.hpp>
#include <rbres/nn/stages.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <type_traits>
#include <utility>

namespace rbres::RBRES_ABI {

namespace detail {

/// Calls f(std::integral_constant<int, 0>{}) to N - 1.
template <int N, class F>
[[gnu::always_inline]] inline void unrolled(const F& f) {
  [&]<int... I>(std::integer_sequence<int, I...>) { (f(std::integral_constant<int, I>{}), ...); }
  (std::make_integer_sequence<int, N>{});
}

/// The network's passes over samples, which are columns of activations in panels.
template <class T, class C>
struct Passes {
  using Matrix = Panels<T>;

  static constexpr std::size_t weight_size(int s) {
    const Stage& stage = C::stage(s);
    const auto columns = static_cast<std::size_t>(stage.has_linear ? stage.inputs : stage.has_norm ? 1 : 0);
    return static_cast<std::size_t>(padded<T>(stage.outputs)) * columns;
  }
  static constexpr std::size_t bias_size(int s) {
    const Stage& stage = C::stage(s);
    return stage.has_linear || stage.has_norm ? static_cast<std::size_t>(padded<T>(stage.outputs)) : 0;
  }
  /// Where stage s has its weights; its biases follow. offset(stage_count) is the size of the whole block.
  static constexpr std::size_t offset(int s) {
    std::size_t sum = 0;
    for (int t = 0; t < s; ++t) sum += weight_size(t) + bias_size(t);
    return sum;
  }
  static constexpr std::size_t parameter_size = offset(C::stage_count);
  static constexpr bool output_has_slope = C::stage(C::stage_count - 1).count > 0;

  /// Calls f(begin, end, is_weight) for the parts of [first, last) of the block that are weights of a Linear
  /// and those that are not.
  template <class F>
  static void each_range(std::size_t first, std::size_t last, const F& f) {
    const auto within = [&](std::size_t begin, std::size_t end, bool is_weight) {
      begin = std::max(begin, first), end = std::min(end, last);
      if (begin < end) f(begin, end, is_weight);
    };
    for (int s = 0; s < C::stage_count; ++s) {
      const std::size_t bias = offset(s) + weight_size(s);
      within(offset(s), bias, C::stage(s).has_linear);
      within(bias, bias + bias_size(s), false);
    }
  }

  /// Numbers that backward() and the gradient of one group of outputs need beside the tape.
  static constexpr std::size_t backward_size = [] {
    std::size_t most = 0;
    for (int s = 0; s < C::stage_count; ++s)
      if (C::stage(s).has_linear) most = std::max(most, group_size<T>(padded<T>(C::stage(s).outputs)));
    return most;
  }();
  static constexpr std::size_t gradient_size = [] {
    std::size_t most = 0;
    for (int s = 0; s < C::stage_count; ++s) {
      if (C::stage(s).has_linear) most = std::max(most, group_size<T>(C::stage(s).inputs));
      if (C::stage(s).has_norm) most = std::max(most, 2 * bias_size(s));
    }
    return most;
  }();

  /// Buffers of one sample at inference.
  static constexpr std::ptrdiff_t slot_size = padded<T>(C::max_size);
  static constexpr std::ptrdiff_t slots_size = slot_size * C::slot_count;

  /// Every value of up to `samples` samples and, beside it, first the slope of the elementwise layers that
  /// made it, then the gradient of their z. Gradient 0 is that of the input.
  struct Tape {
    T* values;
    T* gradients;
    std::ptrdiff_t samples;
    Matrix value(int v) const { return {values + value_offset(v) * samples, samples}; }
    Matrix gradient(int v) const { return {gradients + value_offset(v) * samples, samples}; }

    static constexpr std::ptrdiff_t value_offset(int v) {
      std::ptrdiff_t sum = 0;
      for (int u = 0; u < v; ++u) sum += padded<T>(C::size(u));
      return sum;
    }
    /// Numbers in the values of one sample, and in its gradients.
    static constexpr std::ptrdiff_t sample_size = value_offset(C::stage_count + 1);
  };

  /// Copies one sample of Size numbers in, with zeros behind it, and out.
  template <int Size>
  static void put(const T* x, Matrix to, std::ptrdiff_t sample) noexcept {
    for (int i = 0; i < Size; i += lanes<T>) {
      const int count = std::min(lanes<T>, Size - i);
      std::fill_n(std::copy_n(x + i, count, to.at(i, sample)), lanes<T> - count, T{});
    }
  }
  template <int Size>
  static void take(Matrix from, std::ptrdiff_t sample, T* y) noexcept {
    for (int i = 0; i < Size; i += lanes<T>)
      std::copy_n(from.at(i, sample), std::min(lanes<T>, Size - i), y + i);
  }

  /// Value v at inference, of `samples` samples in all buffers.
  static Matrix slot(T* slots, std::ptrdiff_t samples, int v) noexcept {
    return {slots + C::slots[static_cast<std::size_t>(v)] * slot_size * samples, samples};
  }
  /// Inference of the first `count` samples in slot 0, into slot stage_count.
  template <class W>
  static void forward(int count, const W* parameters, T* slots, std::ptrdiff_t samples) noexcept {
    unrolled<C::stage_count>([&](auto s) {
      constexpr int skip = std::max(C::stage(s).skip, 0);
      stage<s, false>(count, parameters, slot(slots, samples, s), slot(slots, samples, skip),
                      slot(slots, samples, s + 1), slot(slots, samples, s));
    });
  }
  /// The same of one sample, which the buffers have room for. Sums are taken in another order.
  template <class W>
  static void forward_one(const W* parameters, T* slots) noexcept {
    unrolled<C::stage_count>([&](auto s) {
      constexpr Stage info = C::stage(s);
      const Matrix in = slot(slots, 1, s), skip = slot(slots, 1, std::max(info.skip, 0)),
                   out = slot(slots, 1, s + 1);
      if constexpr (info.has_linear) {
        linear_one<typename C::template ChainAtInference<s>, info.skip != no_stage>(
            info.inputs, info.outputs, parameters + offset(s), in.data, skip.data, out.data);
      } else {
        stage<s, false>(1, parameters, in, skip, out, in);
      }
    });
  }

  /// Fills values and slopes of samples [first, first + count) of the tape from value 0.
  template <class W>
  static void record(const W* parameters, const Tape& tape, std::ptrdiff_t first, int count,
                     const DropoutMask& mask) noexcept {
    unrolled<C::stage_count>([&](auto s) {
      constexpr Stage info = C::stage(s);
      if constexpr (info.has_dropout)
        for (std::ptrdiff_t c = first; c < first + count; ++c)
          fill_dropout(of_layer(mask, info.rate), s, padded<T>(info.outputs), tape.gradient(s + 1), c);
      stage<s, true>(count, parameters, tape.value(s).from(0, first),
                     tape.value(std::max(info.skip, 0)).from(0, first), tape.value(s + 1).from(0, first),
                     tape.gradient(s + 1).from(0, first));
    });
  }

  /// Turns the slopes of sample 0 into tangents, from the input's in gradient 0 to the output's in the last
  /// (forward mode). For a tape of one sample.
  template <class W>
  static void tangent(const W* parameters, const Tape& tape) noexcept {
    unrolled<C::stage_count>([&](auto s) {
      constexpr Stage info = C::stage(s);
      const T* in = tape.gradient(s).data;
      T* out = tape.gradient(s + 1).data;
      const auto finish = [&](int, int lane, Simd<T> z) {
        if constexpr (info.count > 0) z *= load(out + lane);
        if constexpr (info.skip != no_stage) z += load(tape.gradient(info.skip).data + lane);
        store(out + lane, z);
      };
      if constexpr (info.has_linear) {
        multiply_row<T>(info.outputs, info.inputs, parameters + offset(s), in, finish);
      } else if constexpr (info.has_norm) {
        norm_tangent<T>(info.outputs, parameters + offset(s), {tape.value(s).data, 1}, in, finish);
      } else {
        for (int lane = 0; lane < padded<T>(info.outputs); lane += simd_width<T>)
          finish(0, lane, load(in + lane));
      }
    });
  }

  /// Turns the slopes of samples [first, first + count) into gradients of every z, from the output's in the
  /// last (reverse mode). `cache` has backward_size numbers, aligned.
  template <class W>
  static void backward(const W* parameters, const Tape& tape, std::ptrdiff_t first, int count, bool to_input,
                       T* cache) noexcept {
    unrolled<C::stage_count>([&](auto reversed) {
      constexpr int v =
          C::stage_count - 1 - reversed;  // the value whose gradient comes next, through stage v
      if (v == 0 && !to_input) return;
      constexpr int skips = [] {
        int sum = 0;
        for (int s = 0; s < C::stage_count; ++s) sum += C::stage(s).skip == v;
        return sum;
      }();
      Gradient<T, skips, (v > 0 && C::stage(std::max(v, 1) - 1).count > 0)> finish{
          tape.gradient(v).from(0, first), {}};
      for (int s = 0, at = 0; s < C::stage_count; ++s)
        if (C::stage(s).skip == v)
          finish.skips[static_cast<std::size_t>(at++)] = tape.gradient(s + 1).from(0, first);

      const Matrix in = tape.gradient(v + 1).from(0, first);
      if constexpr (C::stage(v).has_linear) {
        constexpr Stage info = C::stage(v);
        linear_transposed<T>(info.inputs, info.outputs, count, parameters + offset(v), in, cache, finish);
      } else if constexpr (C::stage(v).has_norm) {
        norm_backward<T>(C::size(v), count, parameters + offset(v), tape.value(v).from(0, first), in, finish);
      } else {
        for (int c = 0; c < count; ++c)
          for (int lane = 0; lane < padded<T>(C::size(v)); lane += simd_width<T>)
            finish(c, lane, load(in.at(lane, c)));
      }
    });
  }

 private:
  /// Stage S; skip and slope are used only where they mean something.
  template <int S, bool Recorded, class W>
  static void stage(int count, const W* parameters, Matrix in, Matrix skip, Matrix out,
                    Matrix slope) noexcept {
    constexpr Stage info = C::stage(S);
    using Chain = std::conditional_t<Recorded, typename C::template ChainOfStage<S>,
                                     typename C::template ChainAtInference<S>>;
    if constexpr (info.has_linear) {
      linear<Chain, info.skip != no_stage, Recorded>(info.inputs, info.outputs, count, parameters + offset(S),
                                                     in, skip, out, slope);
    } else if constexpr (info.has_norm) {
      norm<Chain, Recorded>(info.outputs, count, parameters + offset(S), in, out, slope);
    } else {
      elementwise<Chain, info.skip != no_stage, Recorded>(info.outputs, count, in, skip, out, slope);
    }
  }
};

}  // namespace detail
}  // namespace rbres::RBRES_ABI
