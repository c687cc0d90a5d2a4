#pragma once

#include <rbres/core/error.hpp>

#include <Eigen/Core>

#include <cmath>
#include <cstddef>
#include <functional>
#include <iterator>
#include <limits>
#include <new>
#include <string_view>
#include <vector>

namespace rbres::RBRES_ABI {

/// A view of a column-major matrix whose columns are samples. Unlike an Eigen::Map that is assigned to it
/// looks at another matrix.
template <class T>
class ColumnsView : public Eigen::Map<const Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>> {
  using Map = Eigen::Map<const Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>>;

 public:
  using Map::Map;
  /// Looks at what `other` looks at.
  /// @{
  ColumnsView(const ColumnsView&) = default;
  ColumnsView& operator=(const ColumnsView& other) noexcept {
    // As Eigen's manual sets a Map anew.
    new (static_cast<Map*>(this)) Map(other.data(), other.rows(), other.cols());
    return *this;
  }
  /// @}
};

/// View of a matrix that lives at least as long as the view.
template <class T>
ColumnsView<T> columns(const Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>& matrix) {
  return {matrix.data(), matrix.rows(), matrix.cols()};
}
template <class T>
ColumnsView<T> columns(const Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>&& matrix) = delete;

/// What a network learns from; views only. Column i of each belongs to sample i.
template <class T>
struct Samples {
  ColumnsView<T> inputs{nullptr, 0, 0};   ///< inputs x samples
  ColumnsView<T> targets{nullptr, 0, 0};  ///< outputs x samples
  /// Outputs x samples, or empty for all ones: what each squared error counts, at least 0. 0 where a target
  /// says nothing.
  ColumnsView<T> weights{nullptr, 0, 0};

  /// How many samples there are.
  Eigen::Index count() const noexcept { return inputs.cols(); }
};

/// Mean over samples of sum_o output_weights[o] weights[o, i] (y[o] - target[o])^2 + extra(i, x, y). Without
/// weights: the mean over samples of the squared norm of the error (arXiv 2407.18798, section 3).
template <class T>
struct Loss {
  /// The numbers of one sample.
  using Vector = Eigen::Matrix<T, Eigen::Dynamic, 1>;
  /// The user's own term of one sample: its value; adds its derivative by the output to `gradient`. It is
  /// called from several threads at once, and must depend on nothing but its arguments.
  using Term = std::function<double(Eigen::Index sample, Eigen::Map<const Vector> input,
                                    Eigen::Map<const Vector> output, Eigen::Map<Vector> gradient)>;

  std::vector<T> output_weights{};  ///< one for each output, at least 0, or empty for all ones
  /// None where it is empty.
  Term extra{};

  /// Throws Error where the weights are not one for each output, or none of an error.
  void expect_outputs(Eigen::Index outputs) const {
    if (!output_weights.empty() && std::ssize(output_weights) != outputs)
      detail::refuse("Loss::output_weights", detail::text(outputs, " numbers or none"),
                     output_weights.size());
    for (std::size_t o = 0; o < output_weights.size(); ++o)
      if (!(output_weights[o] >= 0 && std::isfinite(output_weights[o])))
        detail::refuse(detail::text("Loss::output_weights: number ", o), "a finite number of at least 0",
                       output_weights[o]);
  }

  /// The loss of one sample, and its derivative by the output.
  double evaluate(const Samples<T>& samples, Eigen::Index i, const T* output, T* gradient) const {
    const Eigen::Index size = samples.targets.rows();
    const T* target = samples.targets.data() + i * size;
    const T* weight = samples.weights.size() == 0 ? nullptr : samples.weights.data() + i * size;
    double sum = 0;
    for (Eigen::Index o = 0; o < size; ++o) {
      T w = output_weights.empty() ? T{1} : output_weights[static_cast<std::size_t>(o)];
      if (weight != nullptr) w *= weight[o];
      const T error = output[o] - target[o];
      gradient[o] = 2 * w * error;
      sum += static_cast<double>(w * error * error);
    }
    if (extra)
      sum += extra(i, {samples.inputs.data() + i * samples.inputs.rows(), samples.inputs.rows()},
                   {output, size}, {gradient, size});
    return sum;
  }
};

namespace detail {

/// Refuses numbers that are not finite or below `least`.
template <class T>
void expect_finite(std::string_view what, const ColumnsView<T>& matrix,
                   T least = std::numeric_limits<T>::lowest()) {
  for (Eigen::Index c = 0; c < matrix.cols(); ++c)
    for (Eigen::Index r = 0; r < matrix.rows(); ++r)
      if (!std::isfinite(matrix(r, c)) || matrix(r, c) < least)
        refuse(text(what, ": row ", r, ", column ", c),
               least < 0 ? "a finite number" : text("a finite number of at least ", least), matrix(r, c));
}

template <class T>
void expect_shapes(const char* what, const Samples<T>& samples, Eigen::Index inputs, Eigen::Index outputs) {
  const auto expect = [&](const char* which, const ColumnsView<T>& m, Eigen::Index rows) {
    if (m.rows() != rows || m.cols() != samples.count())
      refuse(text(what, ": ", which), text(rows, " x ", samples.count()), text(m.rows(), " x ", m.cols()));
  };
  expect("inputs", samples.inputs, inputs);
  expect("targets", samples.targets, outputs);
  if (samples.weights.size() != 0) expect("weights", samples.weights, outputs);
}

template <class T>
void expect_samples(const char* what, const Samples<T>& samples, Eigen::Index inputs, Eigen::Index outputs) {
  expect_shapes(what, samples, inputs, outputs);
  expect_finite(text(what, ": inputs"), samples.inputs);
  expect_finite(text(what, ": targets"), samples.targets);
  if (samples.weights.size() != 0) expect_finite(text(what, ": weights"), samples.weights, T{0});
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI
