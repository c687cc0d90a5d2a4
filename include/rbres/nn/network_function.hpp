#pragma once

#include <rbres/core/aligned.hpp>
#include <rbres/core/error.hpp>
#include <rbres/nn/passes.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <vector>

namespace rbres::RBRES_ABI {

namespace detail {

template <class Matrix>
void expect_shape(const char* what, const Matrix& m, Eigen::Index rows, Eigen::Index columns) {
  if (m.rows() != rows || m.cols() != columns)
    refuse(what, text(rows, " x ", columns), text(m.rows(), " x ", m.cols()));
}

/// Stage by stage on any scalar.
template <class T, class Compiled, class Passes, class W, class Derived>
auto plain_forward(const W* parameters, const Eigen::MatrixBase<Derived>& x) {
  using S = typename Derived::Scalar;
  using Vector = Eigen::Matrix<S, Eigen::Dynamic, 1>;
  std::vector<Vector> values{x};
  unrolled<Compiled::stage_count>([&](auto s) {
    constexpr Stage stage = Compiled::stage(s);
    const Vector& in = values.back();
    Vector out = in;
    if constexpr (stage.has_linear) {
      out.resize(stage.outputs);
      const W* weights = parameters + Passes::offset(s);
      const W* bias = weights + Passes::weight_size(s);
      constexpr WeightLayout layout = weight_layout<W>(stage.outputs, stage.inputs);
      for (int o = 0; o < stage.outputs; ++o) {
        S sum = static_cast<S>(T(bias[o]));
        for (int i = 0; i < stage.inputs; ++i) {
          const T weight(weights[layout.index(o, i)]);
          sum += static_cast<S>(in[i] * weight);
        }
        out[o] = sum;
      }
    }
    if constexpr (stage.has_norm) {
      const W* weights = parameters + Passes::offset(s);
      S mean(0);
      for (const S& number : out) mean += S(number / T(stage.outputs));
      S variance(0);
      for (const S& number : out) variance += S((number - mean) * (number - mean)) / T(stage.outputs);
      using std::sqrt;
      const S scale = S(1) / S(sqrt(S(variance + T(1e-5))));
      const W* shift = weights + Passes::weight_size(s);
      for (int o = 0; o < stage.outputs; ++o)
        out[o] = S((out[o] - mean) * scale) * T(weights[o]) + T(shift[o]);
    }
    for (S& number : out) number = Compiled::template ChainOfStage<s>::value(number, S(1));
    if constexpr (stage.skip != no_stage) out += values[stage.skip];
    values.push_back(std::move(out));
  });
  return Eigen::Matrix<S, Compiled::size(Compiled::stage_count), 1>(values.back());
}

}  // namespace detail

template <class Net>
class NetworkPart;

/// What a network of numbers T may keep its parameters in: T itself, or half of a float.
template <class W, class T>
concept WeightOf = std::same_as<W, T> ||(std::same_as<W, bfloat16>&& std::same_as<T, float>);

/// What a network computes, wherever its parameters stand: `Net`, which derives from it, has a block().
template <class Net, std::floating_point T, class Layers, WeightOf<T> W>
class NetworkFunction {
 public:
  /// The type of its numbers.
  using Scalar = T;
  /// The type in which its parameters are kept.
  using Weight = W;
  /// Its layers.
  using Architecture = Layers;
  /// The layers as stages that are computed at once.
  using Compiled = detail::Compiled<Layers>;
  /// How the stages are computed.
  using Passes = detail::Passes<T, Compiled>;

  /// Numbers of one sample that it is given.
  static constexpr int input_size = Compiled::size(0);
  /// Numbers of one sample that it gives.
  static constexpr int output_size = Compiled::size(Compiled::stage_count);
  /// Numbers in the parameter block, with the zeros that fill up panels, and without.
  static constexpr std::size_t block_size = Passes::parameter_size;
  /// Numbers that are learned.
  static constexpr std::size_t parameter_count = [] {
    std::size_t sum = 0;
    for (int s = 0; s < Compiled::stage_count; ++s)
      if (const auto& stage = Compiled::stage(s); stage.has_linear)
        sum += static_cast<std::size_t>(stage.outputs) * static_cast<std::size_t>(stage.inputs + 1);
      else if (stage.has_norm)
        sum += 2 * static_cast<std::size_t>(stage.outputs);
    return sum;
  }();

  /// What it is given.
  using Input = Eigen::Matrix<T, input_size, 1>;
  /// What it gives.
  using Output = Eigen::Matrix<T, output_size, 1>;
  /// Samples as columns.
  using Columns = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;

  /// Scratch for batches and for derivatives, which the caller keeps; its size does not depend on the batch.
  /// It has no value: a copy, and what a move leaves, is new scratch.
  class Workspace {
   public:
    Workspace()
        : numbers_(std::max(static_cast<std::size_t>(chunk * Passes::slots_size),
                            static_cast<std::size_t>(2 * Tape::sample_size) + Passes::backward_size)) {}
    /// New scratch: nothing is copied.
    /// @{
    Workspace(const Workspace&) : Workspace() {}
    Workspace& operator=(const Workspace&) noexcept { return *this; }
    /// @}

   private:
    friend NetworkFunction;
    AlignedBuffer<T> numbers_;
  };

  /// The prediction for one sample. Allocates nothing.
  Output forward(const Input& x) const noexcept {
    static_assert(
        static_cast<std::size_t>(Passes::slots_size) * sizeof(T) <= std::size_t{1} << 20,
        "Network::forward: so wide a network has no room on the stack; pass columns and a Workspace");
    alignas(64) T slots[static_cast<std::size_t>(Passes::slots_size)];
    Output y;
    Passes::template put<input_size>(x.data(), Passes::slot(slots, 1, 0), 0);
    Passes::forward_one(block(), slots);
    Passes::template take<output_size>(Passes::slot(slots, 1, Compiled::stage_count), 0, y.data());
    return y;
  }

  /// The same on any other scalar, such as Eigen's AutoDiffScalar: plain loops, and the heap.
  template <class Derived>
  requires(!std::same_as<typename Derived::Scalar, T>) auto forward(
      const Eigen::MatrixBase<Derived>& x) const {
    static_assert(Derived::SizeAtCompileTime == input_size,
                  "Network::forward: x must have input_size numbers");
    return detail::plain_forward<T, Compiled, Passes>(block(), x);
  }

  /// A prediction for each column: `inputs` is input_size x n, `outputs` output_size x n, else throws Error.
  /// Allocates nothing where both are column-major.
  void forward(const Eigen::Ref<const Columns, 0, Eigen::OuterStride<>>& inputs,
               Eigen::Ref<Columns, 0, Eigen::OuterStride<>> outputs, Workspace& workspace) const {
    detail::expect_shape("Network::forward: inputs", inputs, input_size, inputs.cols());
    detail::expect_shape("Network::forward: outputs", outputs, output_size, inputs.cols());
    predict(block(), inputs, outputs, workspace);
  }

  /// J v: the derivative of the prediction at x along the input's direction v. Allocates nothing.
  Output jvp(const Input& x, const Input& v, Workspace& workspace) const noexcept {
    const Tape tape = record(x, workspace);
    Output y;
    Passes::template put<input_size>(v.data(), tape.gradient(0), 0);
    Passes::tangent(block(), tape);
    Passes::template take<output_size>(tape.gradient(Compiled::stage_count), 0, y.data());
    return y;
  }

  /// Jᵀ w: the gradient by the input, at x, of the inner product of w and the prediction. Allocates nothing.
  Input vjp(const Input& x, const Output& w, Workspace& workspace) const noexcept {
    const Tape tape = record(x, workspace);
    Input gradient;
    Output last = w;
    if constexpr (Passes::output_has_slope)
      for (int i = 0; i < output_size; ++i) last[i] *= *tape.gradient(Compiled::stage_count).at(i, 0);
    Passes::template put<output_size>(last.data(), tape.gradient(Compiled::stage_count), 0);
    Passes::backward(block(), tape, 0, 1, true, workspace.numbers_.data() + 2 * Tape::sample_size);
    Passes::template take<input_size>(tape.gradient(0), 0, gradient.data());
    return gradient;
  }

 private:
  template <class>
  friend class NetworkPart;
  using Tape = typename Passes::Tape;
  /// Samples that go through all layers while they are in the cache; an odd multiple of 8, so that panels do
  /// not fall into the same few sets of it.
  static constexpr std::ptrdiff_t chunk = 104;

  static void predict(const W* parameters, const Eigen::Ref<const Columns, 0, Eigen::OuterStride<>>& inputs,
                      Eigen::Ref<Columns, 0, Eigen::OuterStride<>> outputs, Workspace& workspace) noexcept {
    T* slots = workspace.numbers_.data();
    for (Eigen::Index first = 0; first < inputs.cols(); first += chunk) {
      const int count = static_cast<int>(std::min<Eigen::Index>(chunk, inputs.cols() - first));
      const std::ptrdiff_t room = count == 1 ? 1 : chunk;
      for (int c = 0; c < count; ++c)
        Passes::template put<input_size>(inputs.col(first + c).data(), Passes::slot(slots, room, 0), c);
      if (count == 1)
        Passes::forward_one(parameters, slots);
      else
        Passes::forward(count, parameters, slots, room);
      for (int c = 0; c < count; ++c)
        Passes::template take<output_size>(Passes::slot(slots, room, Compiled::stage_count), c,
                                           outputs.col(first + c).data());
    }
  }

  Tape record(const Input& x, Workspace& workspace) const noexcept {
    T* numbers = workspace.numbers_.data();
    const Tape tape{numbers, numbers + Tape::sample_size, 1};
    Passes::template put<input_size>(x.data(), tape.value(0), 0);
    Passes::record(block(), tape, 0, 1, DropoutMask{});
    return tape;
  }

  const W* block() const noexcept { return static_cast<const Net&>(*this).block(); }
};

}  // namespace rbres::RBRES_ABI
