// Columns of one's own: any numbers to any others, of sizes that only their files say.
#pragma once

#include <cmath>
#include <rbres/core/sha256.hpp>
#include <rbres/io/npy.hpp>
#include <utility>

#include "options.hpp"

namespace train {

/// The numbers of a .npy file, a sample a column. Error where they are not float32 or float64, not finite,
/// more than `most` of a sample, or of fewer than 10 samples.
inline Eigen::MatrixXd read_columns(const std::string& path, int most) {
  const std::string type = detail::read_npy_header(detail::InputFile(path)).descr;
  if (type != "<f4" && type != "<f8")
    detail::refuse(path, "an array of float32 or float64", "one of " + type);
  Eigen::MatrixXd columns =
      type == "<f4" ? read_npy<float>(path).cast<double>().eval() : read_npy<double>(path);
  if (columns.rows() < 1 || columns.rows() > most)
    detail::refuse(path,
                   detail::text("samples of 1 to ", most,
                                " numbers (the sizes of NetworkOf in examples/paper/training.hpp, which are "
                                "compiled in)"),
                   columns.rows());
  if (columns.cols() < 10) detail::refuse(path, "10 samples or more", columns.cols());
  for (Eigen::Index c = 0; c < columns.cols(); ++c)
    for (Eigen::Index r = 0; r < columns.rows(); ++r)
      if (!(std::abs(columns(r, c)) <= 1e15))
        detail::refuse(detail::text(path, ": sample ", c, ", number ", r), "a finite number of at most 1e15",
                       columns(r, c));
  return columns;
}

/// Mean and standard deviation of each row; 1 for a row that does not vary.
struct Scale {
  Eigen::VectorXd mean, deviation;

  explicit Scale(const Eigen::Ref<const Eigen::MatrixXd>& columns)
      : mean(columns.rowwise().mean()), deviation(Eigen::VectorXd::Ones(columns.rows())) {
    for (Eigen::Index r = 0; r < columns.rows(); ++r) {
      const double found = std::sqrt((columns.row(r).array() - mean[r]).square().mean());
      if (found > 1e-12 * std::abs(mean[r])) deviation[r] = found;
    }
  }
  /// The columns with mean 0 and deviation 1, and below them rows of zeros up to the `rows` of a network that
  /// takes more.
  Eigen::MatrixXf scaled(const Eigen::MatrixXd& columns, int rows) const {
    Eigen::MatrixXf result = Eigen::MatrixXf::Zero(rows, columns.cols());
    for (Eigen::Index c = 0; c < columns.cols(); ++c)
      result.col(c).head(columns.rows()) = (columns.col(c) - mean).cwiseQuotient(deviation).cast<float>();
    return result;
  }
};

/// Inputs and targets in an order without meaning, the same for every run: a tenth to test, a tenth to
/// validate, the rest to train on, by which they are scaled.
struct OwnData {
  Eigen::MatrixXd inputs, targets;
  Eigen::Index tenth;
  Scale input, target;

  /// As many columns of both.
  OwnData(Eigen::MatrixXd all_inputs, Eigen::MatrixXd all_targets)
      : inputs(shuffled(std::move(all_inputs))),
        targets(shuffled(std::move(all_targets))),
        tenth(inputs.cols() / 10),
        input(inputs.rightCols(inputs.cols() - 2 * tenth)),
        target(targets.rightCols(inputs.cols() - 2 * tenth)) {}

  /// Of the files; Error where they do not fit one another, or a network with so many inputs and outputs.
  static OwnData read(const Options& o, int most_inputs, int most_outputs) {
    const auto read = [](const std::string& option, const std::string& path, int most) {
      return detail::naming([&] { return option + ": "; }, [&] { return read_columns(path, most); });
    };
    Eigen::MatrixXd inputs = read("--inputs", o.inputs, most_inputs);
    Eigen::MatrixXd targets = read("--targets", o.targets, most_outputs);
    if (inputs.cols() != targets.cols())
      detail::refuse("--targets: " + o.targets, detail::text(inputs.cols(), " samples, as --inputs has"),
                     targets.cols());
    return {std::move(inputs), std::move(targets)};
  }

  int input_size() const { return static_cast<int>(inputs.rows()); }
  int output_size() const { return static_cast<int>(targets.rows()); }

  /// Of all numbers and shapes.
  std::string digest() const {
    Sha256 hash;
    for (const Eigen::MatrixXd* columns : {&inputs, &targets}) {
      const std::string shape = detail::text(columns->rows(), " x ", columns->cols(), "\n");
      hash.add(shape.data(), shape.size());
      hash.add(columns->data(), static_cast<std::size_t>(columns->size()) * sizeof(double));
    }
    return hash.text();
  }

 private:
  static Eigen::MatrixXd shuffled(Eigen::MatrixXd columns) {
    Random random(0);
    for (Eigen::Index i = columns.cols() - 1; i > 0; --i)
      columns.col(i).swap(columns.col(random.below(static_cast<std::uint32_t>(i + 1))));
    return columns;
  }
};

}  // namespace train
