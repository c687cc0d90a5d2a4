// One training on one's own data. Networks have the sizes that are compiled in: inputs that the data do not
// have are 0, and outputs that they do not have are never asked for, so nothing is learned of either, and the
// model that is saved has the data's sizes.
#pragma once

#include <rbres/io/cropped_network.hpp>

#include "own_data.hpp"
#include "training.hpp"

namespace train {

/// The tensors of a network's first and last Linear.
struct Ends {
  ParameterTensor first, first_bias, last, last_bias;
};
template <class Net>
Ends ends_of() {
  const std::vector<ParameterTensor> all = Net::tensors();
  return {all[0], all[1], all[all.size() - 2], all.back()};
}

/// A network to begin with, as one of these sizes is drawn.
template <class Net>
Net first_network(std::uint64_t seed, int inputs, int outputs) {
  Net net(seed);
  const auto numbers = net.parameters();
  const Ends ends = ends_of<Net>();
  const auto larger = static_cast<float>(std::sqrt(static_cast<double>(Net::input_size) / inputs));
  for (int r = 0; r < ends.first.rows; ++r)
    for (int c = 0; c < ends.first.columns; ++c)
      numbers[ends.first.index(r, c)] *= c < inputs ? larger : 0.0f;
  for (int r = outputs; r < ends.last.rows; ++r)
    for (int c = 0; c < ends.last.columns; ++c) numbers[ends.last.index(r, c)] = 0;
  return net;
}

/// Takes the data's own units in place of scaled numbers.
template <class Net>
void take_units(Net& net, const Scale& input, const Scale& output) {
  const auto numbers = net.parameters();
  const Ends ends = ends_of<Net>();
  for (int r = 0; r < ends.first.rows; ++r) {
    double bias = static_cast<double>(numbers[ends.first_bias.index(r)]);
    for (int c = 0; c < input.mean.size(); ++c) {
      float& weight = numbers[ends.first.index(r, c)];
      const double scaled = static_cast<double>(weight) / input.deviation[c];
      bias -= scaled * input.mean[c];
      weight = static_cast<float>(scaled);
    }
    numbers[ends.first_bias.index(r)] = static_cast<float>(bias);
  }
  for (int r = 0; r < output.mean.size(); ++r) {
    for (int c = 0; c < ends.last.columns; ++c)
      numbers[ends.last.index(r, c)] *= static_cast<float>(output.deviation[r]);
    float& bias = numbers[ends.last_bias.index(r)];
    bias = static_cast<float>(output.deviation[r] * static_cast<double>(bias) + output.mean[r]);
  }
}

/// Mean square error of each output over the test samples, in its unit squared.
template <class Net>
Eigen::VectorXd test_errors(const Net& net, const OwnData& data) {
  Eigen::MatrixXf inputs = Eigen::MatrixXf::Zero(Net::input_size, data.tenth);
  inputs.topRows(data.input_size()) = data.inputs.leftCols(data.tenth).cast<float>();
  Eigen::MatrixXf outputs(Net::output_size, data.tenth);
  typename Net::Workspace workspace;
  net.forward(inputs, outputs, workspace);
  return (outputs.topRows(data.output_size()).template cast<double>() - data.targets.leftCols(data.tenth))
      .array()
      .square()
      .rowwise()
      .mean();
}

template <class Net>
void run_own(const Options& o, Outputs& files) {
  const OwnData data = OwnData::read(o, Net::input_size, Net::output_size);
  const int inputs = data.input_size(), outputs = data.output_size();
  const Eigen::Index n = data.inputs.cols(), tenth = data.tenth;
  std::printf("%s, %d inputs, %d outputs: %ld samples to train on, %ld to validate, %ld to test\n",
              paper::name(o.architecture).c_str(), inputs, outputs, static_cast<long>(n - 2 * tenth),
              static_cast<long>(tenth), static_cast<long>(tenth));
  const Eigen::MatrixXf scaled_inputs = data.input.scaled(data.inputs, Net::input_size),
                        scaled_targets = data.target.scaled(data.targets, Net::output_size);
  const auto samples = [&](Eigen::Index first, Eigen::Index count) -> Samples<float> {
    return {{scaled_inputs.col(first).data(), Net::input_size, count},
            {scaled_targets.col(first).data(), Net::output_size, count}};
  };
  auto trained =
      train_network(o, first_network<Net>(o.training.seed, inputs, outputs),
                    samples(2 * tenth, n - 2 * tenth), samples(tenth, tenth), {{"data", data.digest()}});
  take_units(trained.network, data.input, data.target);
  if (trained.progress.best_epoch > 0)
    save_model(files.model, CroppedNetwork<Net>{trained.network, inputs, outputs}, {});
  say_end(trained.progress);

  const Eigen::VectorXd error = test_errors(trained.network, data);
  if (!error.allFinite())
    throw Error("the model " + o.out + " predicts numbers that are not finite for the test samples");
  const Eigen::VectorXd without =
      (data.targets.leftCols(tenth).colwise() - data.target.mean).array().square().rowwise().mean();
  const Eigen::VectorXd variance = data.target.deviation.array().square();
  std::printf("%ld test samples, mean square error over the target's variance, mean of the outputs\n",
              static_cast<long>(tenth));
  const auto row = [&](const char* what, const Eigen::VectorXd& of) {
    std::printf("  %-20s %12.4g\n", what, of.cwiseQuotient(variance).mean());
  };
  row("model", error);
  row("mean of the targets", without);
  const auto list = [](const Eigen::VectorXd& of) { return Json(std::vector<double>(of.begin(), of.end())); };
  finish(o, files,
         {{"model", {{"mean_square_error", list(error)}}},
          {"mean of the targets", {{"mean_square_error", list(without)}}},
          {"test_samples", tenth}},
         trained);
  std::printf("It is a rbres::Network<float, %s>\n",
              SafetensorsReader(o.out).metadata().at("architecture").c_str());
}

}  // namespace train
