#pragma once

#include <rbres/body/check_state.hpp>
#include <rbres/nn/trainer.hpp>
#include <rbres/predict/predictor.hpp>
#include <rbres/sim/transitions.hpp>

namespace rbres::RBRES_ABI {

/// Whether a predictor's normalisers are fitted to the data, or stay those that its network was trained with.
enum class Normalization { fit, keep };

/// Columns to train a predictor of one horizon on, and the predictor's normalisation, fitted to the training
/// columns only.
template <class Predictor>
class TrainingSet {
  using T = typename Predictor::Scalar;
  using Code = typename Predictor::Code;
  using Columns = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;

 public:
  /// Encodes the first n of `transitions`: Transitions of the user's own world, or others with the same
  /// members. Sets the predictor's horizon, and its normalisers from transitions first_train ... n - 1 alone:
  /// those that train. Throws Error for numbers that the data does not have; for a flow that is not finite;
  /// for data of which a number is not finite or beyond 1e9 (SI): no rigid body is there, and beside it a
  /// normaliser would see nothing else; and for Transitions with an orientation that is no unit quaternion.
  template <class Data>
  TrainingSet(Predictor& predictor, const Data& transitions, Eigen::Index first_train, Eigen::Index n,
              int threads = 0, Normalization normalization = Normalization::fit) {
    static_assert(Data::bodies == Predictor::bodies, "the transitions are of another number of bodies");
    using Flow = FreeFlow<Predictor::bodies>;
    if (!(transitions.horizon >= Flow::shortest && transitions.horizon <= Flow::longest))
      detail::refuse("horizon of transitions",
                     detail::text("from ", Flow::shortest, " to ", Flow::longest, " s"), transitions.horizon);
    const Eigen::Index count = transitions.count();
    if (n < 1 || n > count) detail::refuse("transitions", detail::text("1 to ", count), n);
    if (first_train < 0 || first_train >= n)
      detail::refuse("first training transition", detail::text("0 to ", n - 1), first_train);
    if constexpr (std::is_same_v<Data, Transitions<Predictor::bodies>>) check(transitions);
    const auto& flow = predictor.flow;
    for (const double x :
         {flow.gravity.g.x, flow.gravity.g.y, flow.gravity.g.z, flow.friction.density, flow.friction.drag,
          flow.friction.rotational_drag, flow.damping.linear, flow.damping.angular})
      if (!std::isfinite(x)) detail::refuse("forces of the predictor's flow", "finite numbers", x);
    predictor.horizon = transitions.horizon;
    encode(predictor, transitions, first_train, n, threads, normalization);
  }

  /// Transitions first ... first + count - 1, Error where there are none of these numbers. The views hold
  /// while this set lives.
  Samples<T> samples(Eigen::Index first, Eigen::Index count) const {
    detail::check_range("samples", inputs_.cols(), first, count);
    const auto view = [&](const Columns& all) {
      return ColumnsView<T>(all.data() + first * all.rows(), all.rows(), count);
    };
    return {view(inputs_), view(targets_), view(weights_)};
  }

 private:
  static void check(const Transitions<Predictor::bodies>& transitions) {
    transitions.check();
    for (std::size_t i = 0; i < transitions.starts.size(); ++i) {
      check_bodies("start", i, transitions.starts[i].state);
      check_bodies("end", i, transitions.ends[i]);
    }
  }
  template <class State>
  static void check_bodies(const char* what, std::size_t transition, const State& state) {
    for (std::size_t b = 0; b < state.body.size(); ++b)
      detail::naming([&] { return detail::text("transition ", transition, ", ", what, ", body ", b, ": "); },
                     [&] { detail::check_rigid_state(state.body[b]); });
  }

  template <class Source>
  void encode(Predictor& predictor, const Source& source, Eigen::Index first_train, Eigen::Index n,
              int threads, Normalization normalization) {
    inputs_.resize(Code::inputs, n);
    targets_.resize(Code::outputs, n);
    weights_.resize(Code::outputs, n);
    for (Eigen::Index c = 0; c < n; ++c) {
      const int present = source.present(c);
      const auto& wrench = source.wrench(c);
      expect_sane("initial state", c, &source.start(c)[0].position.x, 13 * present);
      expect_sane("wrench", c, &wrench[0].force.x, 6 * present);
      expect_sane("state", c, &source.end(c)[0].position.x, 13 * present);
    }
    each_block(n, threads, [&](Eigen::Index c) {
      const int present = source.present(c);
      inputs_.col(c) = Code::encode(source.start(c), source.wrench(c), present).template cast<T>();
      targets_.col(c) =
          predictor.wanted(source.start(c), source.wrench(c), source.end(c), present).template cast<T>();
      weights_.col(c).setZero();
      weights_.col(c).head(13 * present).setOnes();
    });
    if (normalization == Normalization::fit) {
      predictor.input = Normalizer<T, Code::inputs>::fit(
          inputs_.rightCols(n - first_train),
          [&](Eigen::Index r, Eigen::Index c) { return r < 19 * source.present(first_train + c); });
      predictor.output = Normalizer<T, Code::outputs>::fit(
          targets_.rightCols(n - first_train),
          [&](Eigen::Index r, Eigen::Index c) { return r < 13 * source.present(first_train + c); }, T(0));
      quieten(predictor.output.deviation);
    }
    each_block(n, threads, [&](Eigen::Index c) {
      const int present = source.present(c);
      inputs_.col(c) = predictor.encode(source.start(c), source.wrench(c), present);
      targets_.col(c) = predictor.output.normalize(targets_.col(c));
      targets_.col(c).tail(Code::outputs - 13 * present).setZero();
    });
  }

  /// A number that varies less than a thousandth as much as others of its kind (positions, orientations,
  /// velocities, spins), or not at all, counts as if it varied so much: it is noise of the simulation, and
  /// what the network says of it, which is never quite nothing, must weigh as little. Where no number of a
  /// kind varies, all count as if they varied by 1e-6 (SI).
  static void quieten(Eigen::Matrix<T, Code::outputs, 1>& deviation) {
    constexpr int kinds[] = {0, 3, 7, 10, 13};
    for (int k = 0; k < 4; ++k) {
      const auto each = [&](const auto& f) {
        for (int b = 0; b < Predictor::bodies; ++b)
          for (int i = kinds[k]; i < kinds[k + 1]; ++i) f(deviation[13 * b + i]);
      };
      T most(0);
      each([&](T& d) { most = std::max(most, d); });
      const T least = most > T(0) ? most / 1000 : T(1e-6);
      each([&](T& d) { d = std::max(d, least); });
    }
  }

  static void expect_sane(const char* what, Eigen::Index transition, const double* numbers, int count) {
    for (int r = 0; r < count; ++r)
      if (!(std::abs(numbers[r]) <= 1e9))
        detail::refuse(detail::text("TrainingSet: transition ", transition, ": ", what, ": number ", r),
                       "a finite one of at most 1e9", numbers[r]);
  }

  template <class F>
  static void each_block(Eigen::Index n, int threads, const F& f) {
    constexpr Eigen::Index block = 256;
    parallel_for((n + block - 1) / block, threads, [&](std::ptrdiff_t b) {
      for (Eigen::Index c = b * block; c < std::min(n, (b + 1) * block); ++c) f(c);
    });
  }

  Columns inputs_, targets_, weights_;
};

}  // namespace rbres::RBRES_ABI
