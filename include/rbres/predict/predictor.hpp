#pragma once

#include <algorithm>
#include <functional>
#include <rbres/nn/residual_network.hpp>
#include <rbres/predict/encoding.hpp>
#include <rbres/predict/free_flow.hpp>
#include <span>

namespace rbres::RBRES_ABI {

/// What a predictor's network says.
enum class Target {
  state,     ///< the state itself (the paper)
  residual,  ///< the state minus the contact-free flow
};

/// A trained network as a function from states to states one horizon later. predict() is noexcept and
/// allocates nothing, so that it may stand in a control loop; absent bodies stay as they are. A predictor
/// belongs to the world it was trained in: the walls are in its weights.
template <class Net, int N>
class Predictor {
 public:
  /// The network's type.
  using Network = Net;
  /// The network's numbers.
  using Scalar = typename Net::Scalar;
  /// How states become the network's numbers.
  using Code = Encoding<N>;
  /// Where the bodies are.
  using State = SystemState<double, N>;
  /// On each body: force in world frame, N; torque in body frame, N m.
  using Wrenches = std::array<Wrench<double>, std::size_t(N)>;
  /// How many there are.
  static constexpr int bodies = N;
  static_assert(Net::input_size == Code::inputs && Net::output_size == Code::outputs,
                "a Predictor of N bodies needs a network from N x 19 to N x 13 numbers");

  /// What is learned.
  Net network;
  /// Of the network's inputs.
  Normalizer<Scalar, Code::inputs> input{};
  /// Of the network's outputs.
  Normalizer<Scalar, Code::outputs> output{};
  /// The flow without contacts.
  FreeFlow<N> flow;
  /// What the network says.
  Target target = Target::residual;
  double horizon = 0.02;  ///< s

  /// The state `horizon` later, under these constant wrenches. Bodies from `present` on are absent; it counts
  /// as 0 below 0, and as N above N.
  State predict(const State& state, const Wrenches& wrench, int present = N) const noexcept {
    return decode(state, wrench, network.forward(encode(state, wrench, present)), present);
  }
  /// The same.
  State operator()(const State& state, const Wrenches& wrench, int present = N) const noexcept {
    return predict(state, wrench, present);
  }

  /// Room for predict() of many.
  class Batch {
   public:
    /// Throws Error for fewer than one.
    explicit Batch(Eigen::Index most) {
      if (most < 1) detail::refuse("predictions of a batch", "at least 1", most);
      inputs_.resize(Net::input_size, most);
      outputs_.resize(Net::output_size, most);
    }

   private:
    friend Predictor;
    typename Net::Columns inputs_, outputs_;
    typename Net::Workspace workspace_;
  };

  /// Many at once, which costs less than one by one: next[i] is the state `horizon` after states[i] under
  /// wrenches[i]; `next` may be `states` itself. Agrees with the above but for rounding; allocates nothing.
  /// Throws Error, before anything is done, where the spans are not of one size, `next` begins elsewhere in
  /// `states`, the batch has less room, or `present` is not 0 to N.
  void predict(std::span<const State> states, std::span<const Wrenches> wrenches, std::span<State> next,
               Batch& batch, int present = N) const {
    if (states.size() != next.size())
      detail::refuse("states to predict from", detail::Line(next.size()), states.size());
    const std::less<const State*> before;
    const State *from = states.data(), *to = next.data();
    if (from != to && before(from, to + next.size()) && before(to, from + states.size()))
      detail::refuse("room for predictions", "the states themselves, or none of them", "some of them");
    predict_each(
        [&](std::ptrdiff_t i) -> auto& { return states[static_cast<std::size_t>(i)]; }, wrenches, next, batch,
        present);
  }
  /// The same from one state: what each of several wrenches would lead to.
  void predict(const State& state, std::span<const Wrenches> wrenches, std::span<State> next, Batch& batch,
               int present = N) const {
    const State from = state;  // which may be one of `next`
    predict_each(
        [&](std::ptrdiff_t) -> auto& { return from; }, wrenches, next, batch, present);
  }

  /// Predictions of predictions: fills `states` with the states 1, 2, ... horizons later.
  template <class States>
  void rollout(State state, const Wrenches& wrench, States& states, int present = N) const noexcept {
    for (auto& next : states) next = state = predict(state, wrench, present);
  }

  /// The network's normalised input; what it is trained on.
  typename Net::Input encode(const State& state, const Wrenches& wrench, int present) const noexcept {
    const int some = std::clamp(present, 0, N);
    typename Net::Input x = input.normalize(Code::encode(state, wrench, some).template cast<Scalar>());
    std::fill(x.data() + Code::inputs / N * some, x.data() + Code::inputs, Scalar(0));
    return x;
  }

  /// The state that the network's normalised output `y` means for this start.
  State decode(const State& state, const Wrenches& wrench, const typename Net::Output& y,
               int present) const noexcept {
    return corrected(state, base(state, wrench), y, std::clamp(present, 0, N));
  }

  /// What the network's output is added to.
  State base(const State& state, const Wrenches& wrench) const noexcept {
    if (target == Target::residual) return flow(state, wrench, horizon);
    State zero;
    for (auto& body : zero.body) body.orientation = {0, 0, 0, 0};
    return zero;
  }

  /// What the network should say for `truth`, not normalised. A state's quaternion is put on the side of the
  /// start's.
  typename Code::template Output<double> wanted(const State& state, const Wrenches& wrench, State truth,
                                                int present) const noexcept {
    present = std::clamp(present, 0, N);
    if (target == Target::state) {
      for (int b = 0; b < present; ++b) {
        const auto q = Code::encode(state, wrench, present).template segment<4>(19 * b + 3).eval();
        auto to = truth[b].vector().template segment<4>(3);
        if (to.dot(q) < 0) to *= -1.0;
      }
    }
    return Code::difference(truth, base(state, wrench), present);
  }

 private:
  State corrected(const State& state, const State& base, const typename Net::Output& y,
                  int present) const noexcept {
    State next = Code::sum(
        base, typename Code::template Output<double>(output.restore(y).template cast<double>()), present);
    for (int b = present; b < N; ++b) next[b] = state[b];
    return next;
  }

  template <class StateOf>
  void predict_each(const StateOf& state, std::span<const Wrenches> wrenches, std::span<State> next,
                    Batch& batch, int present) const {
    const std::ptrdiff_t count = std::ssize(next);
    if (present < 0 || present > N) detail::refuse("bodies present", detail::Line("0 to ", N), present);
    if (std::ssize(wrenches) != count)
      detail::refuse("wrenches to predict under", detail::Line(count), wrenches.size());
    if (count > batch.inputs_.cols())
      detail::refuse("predictions", detail::Line("at most the batch's ", batch.inputs_.cols()), count);
    if (count == 0) return;
    const auto wrench = [&](std::ptrdiff_t i) -> auto& { return wrenches[static_cast<std::size_t>(i)]; };
    for (std::ptrdiff_t i = 0; i < count; ++i) batch.inputs_.col(i) = encode(state(i), wrench(i), present);
    network.forward(batch.inputs_.leftCols(count), batch.outputs_.leftCols(count), batch.workspace_);
    const auto correct = [&](std::ptrdiff_t i, const State& base) {
      next[static_cast<std::size_t>(i)] = corrected(state(i), base, batch.outputs_.col(i), present);
    };
    if (target == Target::residual) {
      flow.each(count, state, wrench, horizon, correct);
    } else {
      for (std::ptrdiff_t i = 0; i < count; ++i) correct(i, base(state(i), wrench(i)));
    }
  }
};

/// The paper's predictor: a residual network of width 256. Its weights are float's, or half as large (see
/// Network).
template <class Scalar, int Blocks, int N = 5, class Weight = Scalar>
using ResidualPredictor =
    Predictor<ResidualNetwork<Scalar, Encoding<N>::inputs, 256, Blocks, Encoding<N>::outputs, Weight>, N>;

}  // namespace rbres::RBRES_ABI
