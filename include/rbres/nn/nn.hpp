#pragma once

/// @file
/// Networks as types: layers, forward passes, derivatives, training. Knows no physics: it maps columns to
/// columns.
///
///     using Net = ResidualNetwork<float, 95, 256, 10, 65>;    // or Network<float, Sequential<Linear<6, 32>,
///     Tanh, ...>> Net net(1);                                             // He initialisation from seed 1;
///     Net() is all zeros
///
///     Net::Output y = net.forward(x);                         // one sample: fixed sizes, noexcept, no heap
///     Net::Workspace workspace;                               // batches: kept by the caller
///     net.forward(inputs, outputs, workspace);                // 95 x n to 65 x n, a sample is a column
///     net.forward(x.cast<AutoDiff>());                        // any other scalar
///     net.jvp(x, v, workspace); net.vjp(x, w, workspace);     // J v, Jᵀ w
///
///     for (const ParameterTensor& tensor : Net::tensors())    // names and shapes as in PyTorch's state_dict
///       ... net.parameters()[tensor.index(row, column)] ...   // the one flat block; same places in
///       gradients and moments
///
///     Trainer trainer(net, {columns(inputs), columns(targets)}, {columns(val_inputs), columns(val_targets)},
///                     {.epochs = 200, .batch_size = 64, .schedule = {.initial = 1e-3}});
///     trainer.train([&](const EpochReport& report) { ...; return true; });
///     net = trainer.best();      // trainer.state() is all that a checkpoint needs, trainer.restore(...)
///     goes on
///
///     // Anything that an Objective describes trains as columns do; a Tape differentiates through the
///     network. Trainer rollouts(net, MyRollouts(...), MyRollouts(...), options, Clipped<AdamW>{{}, 1.0});
///     rollouts.set_schedule(WarmUp{Schedule{.initial = 2e-3}, 100});
#include <rbres/nn/backpropagation.hpp>
#include <rbres/nn/columns.hpp>
#include <rbres/nn/evaluation.hpp>
#include <rbres/nn/gradient.hpp>
#include <rbres/nn/layers.hpp>
#include <rbres/nn/loss.hpp>
#include <rbres/nn/network.hpp>
#include <rbres/nn/objective.hpp>
#include <rbres/nn/optimizer.hpp>
#include <rbres/nn/residual_network.hpp>
#include <rbres/nn/schedule.hpp>
#include <rbres/nn/tape.hpp>
#include <rbres/nn/trainer.hpp>
#include <rbres/nn/training.hpp>
