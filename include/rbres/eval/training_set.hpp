#pragma once

#include <rbres/nn/trainer.hpp>
#include <rbres/predict/predictor.hpp>
#include <rbres/sim/dataset.hpp>

namespace rbres {

/// Scenario c as it starts, and where truth is at horizon h, in the types that a predictor takes. Absent
/// bodies stand at the origin. (Templates, here and below, so that only those who call them compile them.)
template <class Columns>
SystemState<double, ScenarioData::bodies> state_of(const Columns& columns, Eigen::Index c, int present) {
  SystemState<double, ScenarioData::bodies> y;
  const auto* from = columns.data() + c * columns.rows();
  std::copy_n(from, 13 * present, &y[0].position.x);
  return y;
}
template <class Data>
std::array<Wrench<double>, ScenarioData::bodies> wrench_of(const Data& data, Eigen::Index c) {
  std::array<Wrench<double>, ScenarioData::bodies> w;
  std::copy_n(data.wrench.data() + c * data.wrench.rows(), 30, &w[0].force.x);
  return w;
}

/// Whether a predictor's normalisers are fitted to the data, or stay those that its network was trained with.
enum class Normalization { fit, keep };

/// Columns to train a predictor of one horizon on, and the predictor's normalisation, fitted to the training
/// columns only.
template <class Predictor>
class TrainingSet {
  using T = typename Predictor::Scalar;
  using Columns = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;

 public:
  /// Encodes the first n scenarios of `data` for horizon number h. Sets the predictor's horizon, and its
  /// normalisers from scenarios first_train ... n - 1 alone: those that train. Throws Error for numbers that
  /// the data does not have, and for data of which a number is not finite or beyond 1e9 (SI): no rigid body
  /// is there, and beside it a normaliser would see nothing else.
  TrainingSet(Predictor& predictor, const ScenarioData& data, std::size_t h, Eigen::Index first_train,
              Eigen::Index n, int threads = 0, Normalization normalization = Normalization::fit) {
    if (h >= data.horizons.size())
      detail::refuse("horizon number", detail::text("less than ", data.horizons.size()), h);
    if (n < 1 || n > data.count()) detail::refuse("scenarios", detail::text("1 to ", data.count()), n);
    if (first_train < 0 || first_train >= n) {
      detail::refuse("first training scenario", detail::text("0 to ", n - 1), first_train);
    }
    predictor.horizon = data.horizons[h];
    using Code = typename Predictor::Code;
    inputs_.resize(Code::inputs, n);
    targets_.resize(Code::outputs, n);
    weights_.resize(Code::outputs, n);
    const auto present = [&](Eigen::Index c) {
      return static_cast<int>(data.body_count[static_cast<std::size_t>(c)]);
    };
    expect_sane("initial state", data.initial.leftCols(n), data.body_count, 13);
    expect_sane("wrench", data.wrench.leftCols(n), data.body_count, 6);
    expect_sane("state", data.states[h].leftCols(n), data.body_count, 13);
    each_block(n, threads, [&](Eigen::Index c) {
      const auto state = state_of(data.initial, c, present(c));
      const auto wrench = wrench_of(data, c);
      const auto truth = state_of(data.states[h], c, present(c));
      inputs_.col(c) = Code::encode(state, wrench, present(c)).template cast<T>();
      targets_.col(c) = predictor.wanted(state, wrench, truth, present(c)).template cast<T>();
      weights_.col(c).setZero();
      weights_.col(c).head(13 * present(c)).setOnes();
    });
    if (normalization == Normalization::fit) fit(predictor, first_train, n, present);
    each_block(n, threads, [&](Eigen::Index c) {
      const auto state = state_of(data.initial, c, present(c));
      inputs_.col(c) = predictor.encode(state, wrench_of(data, c), present(c));
      targets_.col(c) = predictor.output.normalize(targets_.col(c));
      targets_.col(c).tail(Code::outputs - 13 * present(c)).setZero();
    });
  }

  /// Scenarios first ... first + count - 1. The views hold while this set lives.
  Samples<T> samples(Eigen::Index first, Eigen::Index count) const {
    const auto view = [&](const Columns& all) {
      return ColumnsView<T>(all.col(first).data(), all.rows(), count);
    };
    return {view(inputs_), view(targets_), view(weights_)};
  }

 private:
  template <class Present>
  void fit(Predictor& predictor, Eigen::Index first_train, Eigen::Index n, const Present& present) {
    using Code = typename Predictor::Code;
    predictor.input = Normalizer<T, Code::inputs>::fit(
        inputs_.rightCols(n - first_train),
        [&](Eigen::Index r, Eigen::Index c) { return r < 19 * present(first_train + c); });
    predictor.output = Normalizer<T, Code::outputs>::fit(
        targets_.rightCols(n - first_train),
        [&](Eigen::Index r, Eigen::Index c) { return r < 13 * present(first_train + c); });
  }

  /// Of the present bodies, each with `size` numbers.
  template <class Numbers, class Counts>
  static void expect_sane(const char* what, const Numbers& numbers, const Counts& bodies, Eigen::Index size) {
    for (Eigen::Index c = 0; c < numbers.cols(); ++c)
      for (Eigen::Index r = 0; r < size * bodies[static_cast<std::size_t>(c)]; ++r)
        if (!(std::abs(numbers(r, c)) <= 1e9))
          detail::refuse(detail::text("TrainingSet: scenario ", c, ": ", what, ": number ", r),
                         "a finite one of at most 1e9", numbers(r, c));
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

}  // namespace rbres
