#pragma once

#include <rbres/body/check_state.hpp>
#include <rbres/nn/trainer.hpp>
#include <rbres/predict/predictor.hpp>
#include <rbres/sim/dataset.hpp>

namespace rbres::RBRES_ABI {

/// Scenario c as it starts, and where truth is at horizon h, in the types that a predictor takes. Absent
/// bodies stand at the origin. (Templates, here and below, so that only those who call them compile them.)
template <class Columns>
SystemState<double, ScenarioData::bodies> state_of(const Columns& columns, Eigen::Index c, int present) {
  SystemState<double, ScenarioData::bodies> y;
  const auto* from = columns.data() + c * columns.rows();
  std::copy_n(from, 13 * present, &y[0].position.x);
  return y;
}
/// The wrenches of scenario c.
template <class Data>
std::array<Wrench<double>, ScenarioData::bodies> wrench_of(const Data& data, Eigen::Index c) {
  std::array<Wrench<double>, ScenarioData::bodies> w;
  std::copy_n(data.wrench.data() + c * data.wrench.rows(), 30, &w[0].force.x);
  return w;
}

/// Whether a predictor's normalisers are fitted to the data, or stay those that its network was trained with.
enum class Normalization { fit, keep };

namespace detail {

/// What a TrainingSet reads: scenarios of the paper's experiment up to one of their horizons, of which only
/// the first present(c) bodies are there.
struct ScenarioSource {
  const ScenarioData* data;
  std::size_t h;

  int present(Eigen::Index c) const { return data->body_count[static_cast<std::size_t>(c)]; }
  auto start(Eigen::Index c) const { return state_of(data->initial, c, present(c)); }
  auto wrench(Eigen::Index c) const { return wrench_of(*data, c); }
  auto end(Eigen::Index c) const { return state_of(data->states[h], c, present(c)); }
};
/// The same of transitions of any world.
template <int N>
struct TransitionSource {
  const Transitions<N>* data;

  int present(Eigen::Index) const { return N; }
  const auto& start(Eigen::Index c) const { return data->starts[static_cast<std::size_t>(c)].state; }
  const auto& wrench(Eigen::Index c) const { return data->starts[static_cast<std::size_t>(c)].wrench; }
  const auto& end(Eigen::Index c) const { return data->ends[static_cast<std::size_t>(c)]; }
};

}  // namespace detail

/// Columns to train a predictor of one horizon on, and the predictor's normalisation, fitted to the training
/// columns only.
template <class Predictor>
class TrainingSet {
  using T = typename Predictor::Scalar;
  using Code = typename Predictor::Code;
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
    check(data.count(), first_train, n);
    predictor.horizon = data.horizons[h];
    encode(predictor, detail::ScenarioSource{&data, h}, first_train, n, threads, normalization);
  }
  /// The same for transitions of any world; Error also for states with an orientation that is no unit
  /// quaternion.
  TrainingSet(Predictor& predictor, const Transitions<Predictor::bodies>& data, Eigen::Index first_train,
              Eigen::Index n, int threads = 0, Normalization normalization = Normalization::fit) {
    if (data.ends.size() != data.starts.size())
      detail::refuse("ends of transitions", detail::text(data.starts.size(), ", as many as starts"),
                     data.ends.size());
    using Flow = FreeFlow<Predictor::bodies>;
    if (!(data.horizon >= Flow::shortest && data.horizon <= Flow::longest))
      detail::refuse("horizon of transitions",
                     detail::text("from ", Flow::shortest, " to ", Flow::longest, " s"), data.horizon);
    check(std::ssize(data.starts), first_train, n);
    for (std::size_t i = 0; i < data.starts.size(); ++i) {
      check_bodies("start", i, data.starts[i].state);
      check_bodies("end", i, data.ends[i]);
    }
    predictor.horizon = data.horizon;
    encode(predictor, detail::TransitionSource<Predictor::bodies>{&data}, first_train, n, threads,
           normalization);
  }

  /// Scenarios first ... first + count - 1. The views hold while this set lives.
  Samples<T> samples(Eigen::Index first, Eigen::Index count) const {
    const auto view = [&](const Columns& all) {
      return ColumnsView<T>(all.col(first).data(), all.rows(), count);
    };
    return {view(inputs_), view(targets_), view(weights_)};
  }

 private:
  static void check(Eigen::Index count, Eigen::Index first_train, Eigen::Index n) {
    if (n < 1 || n > count) detail::refuse("scenarios", detail::text("1 to ", count), n);
    if (first_train < 0 || first_train >= n)
      detail::refuse("first training scenario", detail::text("0 to ", n - 1), first_train);
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
          [&](Eigen::Index r, Eigen::Index c) { return r < 13 * source.present(first_train + c); });
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
  /// velocities, spins) is noise of the simulation: it counts as if it varied so much. Those that do not vary
  /// have a deviation of 1.
  static void quieten(Eigen::Matrix<T, Code::outputs, 1>& deviation) {
    constexpr int kinds[] = {0, 3, 7, 10, 13};
    for (int k = 0; k < 4; ++k) {
      const auto each = [&](const auto& f) {
        for (int b = 0; b < Predictor::bodies; ++b)
          for (int i = kinds[k]; i < kinds[k + 1]; ++i)
            if (T& d = deviation[13 * b + i]; d != T(1)) f(d);
      };
      T most(0);
      each([&](T& d) { most = std::max(most, d); });
      each([&](T& d) { d = std::max(d, most / 1000); });
    }
  }

  static void expect_sane(const char* what, Eigen::Index scenario, const double* numbers, int count) {
    for (int r = 0; r < count; ++r)
      if (!(std::abs(numbers[r]) <= 1e9))
        detail::refuse(detail::text("TrainingSet: scenario ", scenario, ": ", what, ": number ", r),
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
