#pragma once

#include <rbres/io/checkpoint.hpp>

/// A small run with everything that a checkpoint must carry: dropout, shuffling, moments, a schedule, best
/// weights.
struct SmallRun {
  using Net = rbres::Network<
      float, rbres::Sequential<rbres::Linear<4, 8>, rbres::Tanh, rbres::Dropout, rbres::Linear<8, 4>>>;

  Eigen::MatrixXf inputs = Eigen::MatrixXf::NullaryExpr(4, 40, [](auto row, auto column) {
    return static_cast<float>((row * 7 + column * 3) % 11) / 11 - 0.5f;
  });
  Eigen::MatrixXf targets = inputs.array().square();
  rbres::TrainingOptions options{
      .epochs = 6, .batch_size = 16, .schedule = {.initial = 1e-2}, .seed = 3, .threads = 1};

  template <class Optimizer = rbres::Adam>
  auto trainer(const Optimizer& optimizer = {}) const {
    return rbres::Trainer(Net(5), samples(0, 32), samples(32, 8), options, optimizer);
  }

 private:
  rbres::Samples<float> samples(Eigen::Index first, Eigen::Index count) const {
    return {{inputs.data() + 4 * first, 4, count}, {targets.data() + 4 * first, 4, count}};
  }
};
