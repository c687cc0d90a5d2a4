#pragma once

#include <rbres/core/parallel.hpp>
#include <rbres/nn/gradient.hpp>

#include <algorithm>
#include <type_traits>

namespace rbres::RBRES_ABI {

namespace detail {

/// Scratch of a task: on the stack, or on the heap where the stack of a thread may be too small for it.
template <class T, std::size_t Size>
class TaskScratch {
 public:
  T* data() noexcept {
    if constexpr (on_heap)
      return numbers_.data();
    else
      return numbers_;
  }

 private:
  static constexpr bool on_heap = Size * sizeof(T) > std::size_t{256} << 10;
  struct Heap : AlignedBuffer<T> {
    Heap() : AlignedBuffer<T>(Size) {}
  };
  alignas(64) std::conditional_t<on_heap, Heap, T[std::max<std::size_t>(Size, 1)]> numbers_;
};

/// The values and slopes of all stages for a batch of samples, and then the gradients. Allocates when it is
/// built (and where a layer is so wide that a thread's stack would not hold its scratch). Samples are
/// independent of one another, so threads may share them. A move is a copy.
template <class Net>
class BatchTape {
  using T = typename Net::Scalar;
  using Passes = typename Net::Passes;
  using Compiled = typename Net::Compiled;
  using View = typename Passes::Tape;

 public:
  BatchTape(const char* who, Eigen::Index samples)
      : samples_(samples >= 1 && samples < Eigen::Index{1} << 31
                     ? samples
                     : (refuse(text(who, ": samples"), "1 to 2^31 - 1", samples), 0)),
        room_(((samples + 7) / 8 | 1) * 8),  // as Network's chunk
        values_(static_cast<std::size_t>(room_ * View::sample_size)),
        gradients_(values_.size()) {}
  BatchTape(const BatchTape&) = default;
  BatchTape& operator=(const BatchTape&) = default;

  Eigen::Index capacity() const noexcept { return samples_; }

  void put_input(const T* x, Eigen::Index c) noexcept {
    Passes::template put<Net::input_size>(x, view().value(0), c);
  }
  void record(const T* parameters, Eigen::Index first, Eigen::Index count, const DropoutMask& mask) noexcept {
    Passes::record(parameters, view(), first, static_cast<int>(count), mask);
  }
  void take_output(Eigen::Index c, T* y) const noexcept {
    Passes::template take<Net::output_size>(view().value(Compiled::stage_count), c, y);
  }

  /// The derivative by output c; it turns into that by the last stage's z.
  void put_output_gradient(const typename Net::Output& by_output, Eigen::Index c) noexcept {
    typename Net::Output gradient = by_output;
    const auto last = view().gradient(Compiled::stage_count);
    if constexpr (Passes::output_has_slope) {
      typename Net::Output slope;
      Passes::template take<Net::output_size>(last, c, slope.data());
      gradient.array() *= slope.array();
    }
    Passes::template put<Net::output_size>(gradient.data(), last, c);
  }
  void backward(const T* parameters, Eigen::Index first, Eigen::Index count, bool to_input) {
    TaskScratch<T, Passes::backward_size> cache;
    Passes::backward(parameters, view(), first, static_cast<int>(count), to_input, cache.data());
  }
  void take_input_gradient(Eigen::Index c, T* x) const noexcept {
    Passes::template take<Net::input_size>(view().gradient(0), c, x);
  }

  /// sink(place, g, is_weight) for every register g of the gradient by the parameters over the first `count`
  /// samples, at `place` of the block, each once. The threads of a team share the parameters.
  template <class Sink>
  void parameter_gradient(const Team& team, Eigen::Index count, const Sink& sink) const {
    const View tape = view();
    team.share(task_count, [&](std::ptrdiff_t task) {
      TaskScratch<T, Passes::gradient_size> sums;
      unrolled<Compiled::stage_count>([&](auto s) {
        constexpr Stage stage = Compiled::stage(s);
        if constexpr (stage.has_linear || stage.has_norm)
          if (task >= 0 && task < tasks(s)) {
            const Panels<const T> in{tape.value(s).data, tape.samples};
            const Panels<const T> gradient{tape.gradient(s + 1).data, tape.samples};
            if constexpr (stage.has_linear)
              linear_gradient<T>(stage.inputs, stage.outputs, static_cast<int>(task), static_cast<int>(count),
                                 in, gradient, Passes::offset(s), sums.data(), sink);
            else
              norm_gradient<T>(stage.outputs, static_cast<int>(count), in, gradient, Passes::offset(s),
                               sums.data(), sink);
          }
        task -= tasks(s);
      });
    });
  }

 private:
  /// A Linear's gradient is made in tasks of one group of outputs.
  static constexpr int tasks(int s) {
    const Stage& stage = Compiled::stage(s);
    return stage.has_linear ? Groups<T>(padded<T>(stage.outputs)).count : stage.has_norm ? 1 : 0;
  }
  static constexpr int task_count = [] {
    int sum = 0;
    for (int s = 0; s < Compiled::stage_count; ++s) sum += tasks(s);
    return sum;
  }();

  View view() const noexcept {
    return {const_cast<T*>(values_.data()), const_cast<T*>(gradients_.data()), room_};
  }

  Eigen::Index samples_, room_;
  AlignedBuffer<T> values_, gradients_;
};

}  // namespace detail

/// What a network's pass over some samples leaves for the way back, so that any function of its outputs can
/// be differentiated. For one thread; a program through time keeps a tape for each step.
///
///     Tape<Net> tape(capacity);                              // allocates; the rest does not
///     tape.record(network, inputs, outputs);                 // as network.forward(inputs, outputs, ...)
///     tape.backward(network, by_outputs, gradient, by_inputs);
///
/// Samples are columns; by_outputs is the derivative of a number by `outputs`, of which backward() adds the
/// derivative by the parameters to `gradient` and writes that by `inputs` to by_inputs. `network` is a Net,
/// or the part of a NetworkParts that is one; `gradient` belongs to it.
template <class Net>
class Tape {
 public:
  /// Samples as columns.
  using Columns = typename Net::Columns;
  /// Columns to read.
  using In = Eigen::Ref<const Columns, 0, Eigen::OuterStride<>>;
  /// Columns to write.
  using Out = Eigen::Ref<Columns, 0, Eigen::OuterStride<>>;

  /// For up to `capacity` samples at once.
  explicit Tape(Eigen::Index capacity) : batch_("Tape", capacity) {}

  /// Samples at once.
  Eigen::Index capacity() const noexcept { return batch_.capacity(); }

  /// Fills `outputs` (output_size x n) from `inputs` (input_size x n). With a mask Dropouts drop, as in
  /// training. Throws Error where a size, or the mask's rate, does not fit.
  template <class Network>
  void record(const Network& network, const In& inputs, Out outputs, const DropoutMask& mask = {}) {
    const Eigen::Index count = inputs.cols();
    if (count > capacity()) detail::refuse("Tape::record: samples", detail::text("0 to ", capacity()), count);
    detail::expect_shape("Tape::record: inputs", inputs, Net::input_size, count);
    detail::expect_shape("Tape::record: outputs", outputs, Net::output_size, count);
    mask.check();
    for (Eigen::Index c = 0; c < count; ++c) batch_.put_input(inputs.col(c).data(), c);
    batch_.record(network.parameters().data(), 0, count, mask);
    for (Eigen::Index c = 0; c < count; ++c) batch_.take_output(c, outputs.col(c).data());
    recorded_ = count;
  }

  /// The way back, once for each record(), through the same parameters. Throws Error where a size does not
  /// fit or nothing is recorded.
  template <class Network, class Gradient>
  void backward(const Network& network, const In& by_outputs, Gradient&& gradient) {
    back(network, by_outputs, gradient, false);
  }
  /// The same with the derivative by the inputs, input_size x n.
  template <class Network, class Gradient>
  void backward(const Network& network, const In& by_outputs, Gradient&& gradient, Out by_inputs) {
    detail::expect_shape("Tape::backward: gradient by the inputs", by_inputs, Net::input_size, recorded_);
    const Eigen::Index count = recorded_;
    back(network, by_outputs, gradient, true);
    for (Eigen::Index c = 0; c < count; ++c) batch_.take_input_gradient(c, by_inputs.col(c).data());
  }

 private:
  static constexpr Eigen::Index nothing = -1;

  template <class Network, class Gradient>
  void back(const Network& network, const In& by_outputs, Gradient& gradient, bool to_input) {
    if (recorded_ == nothing) detail::refuse("Tape::backward", "a record() before each", "none");
    detail::expect_shape("Tape::backward: gradient by the outputs", by_outputs, Net::output_size, recorded_);
    const Eigen::Index count = std::exchange(recorded_, nothing);
    for (Eigen::Index c = 0; c < count; ++c) batch_.put_output_gradient(by_outputs.col(c), c);
    batch_.backward(network.parameters().data(), 0, count, to_input);
    auto* sums = gradient.numbers().data();
    batch_.parameter_gradient(Team{}, count, [sums](std::size_t at, const auto& g, bool) {
      detail::store(sums + at, detail::load(sums + at) + g);
    });
  }

  detail::BatchTape<Net> batch_;
  Eigen::Index recorded_ = nothing;
};

}  // namespace rbres::RBRES_ABI
