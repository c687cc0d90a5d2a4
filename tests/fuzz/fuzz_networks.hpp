#pragma once

#include <rbres/io/checkpoint.hpp>

/// What the fuzzed files of networks and runs hold; the seeds are of the same types.
using FuzzNetwork =
    rbres::Network<float, rbres::Sequential<rbres::Linear<2, 2>, rbres::Relu, rbres::Linear<2, 1>>>;

struct FuzzRun {
  Eigen::MatrixXf inputs = Eigen::MatrixXf::Identity(2, 2), targets = Eigen::MatrixXf::Ones(1, 2);
  rbres::Trainer<FuzzNetwork> trainer{FuzzNetwork(1),
                                      {rbres::columns(inputs), rbres::columns(targets)},
                                      {{nullptr, 2, 0}, {nullptr, 1, 0}},
                                      {.epochs = 3, .threads = 1}};
};
