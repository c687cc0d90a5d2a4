#pragma once

#include <rbres/nn/loss.hpp>
#include <rbres/predict/encoding.hpp>

namespace rbres::RBRES_ABI {

/// A term of a Loss that sees physical quantities: term(sample, x, y, gradient) gets the network's input and
/// output in SI units, as the normalisers restore them, gives its value, and adds its derivative by y to
/// `gradient`, which starts as zeros. It is called from several threads at once.
///
///     loss.extra = decoded_term(predictor.input, predictor.output, [](Eigen::Index i, auto& x, auto& y,
///                                                                     auto& gradient) { ...; return value;
///                                                                     });
template <class T, int Inputs, int Outputs, class Term>
typename Loss<T>::Term decoded_term(const Normalizer<T, Inputs>& input, const Normalizer<T, Outputs>& output,
                                    Term term) {
  return [=](Eigen::Index sample, auto x, auto y, auto gradient) {
    using In = Eigen::Matrix<T, Inputs, 1>;
    using Out = Eigen::Matrix<T, Outputs, 1>;
    const In input_si = input.restore(In(x));
    const Out output_si = output.restore(Out(y));
    Out by_output = Out::Zero();
    const double value = term(sample, input_si, output_si, by_output);
    gradient += by_output.cwiseProduct(output.deviation);
    return value;
  };
}

}  // namespace rbres::RBRES_ABI
