#pragma once

/// @file
/// Everything but files (those are in <rbres/io.hpp>) and the paper's experiment (<rbres/paper/paper.hpp>);
/// needs Eigen alone.
#include <rbres/body/compound.hpp>
#include <rbres/body/mechanics.hpp>
#include <rbres/body/system.hpp>
#include <rbres/contact/contact_query.hpp>
#include <rbres/core/aligned.hpp>
#include <rbres/core/error.hpp>
#include <rbres/core/lie.hpp>
#include <rbres/core/pack.hpp>
#include <rbres/core/parallel.hpp>
#include <rbres/core/philox.hpp>
#include <rbres/dynamics/dormand_prince.hpp>
#include <rbres/dynamics/forces.hpp>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/dynamics/integrators.hpp>
#include <rbres/eval/baselines.hpp>
#include <rbres/eval/metrics.hpp>
#include <rbres/eval/timing.hpp>
#include <rbres/eval/train_predictor.hpp>
#include <rbres/eval/training_set.hpp>
#include <rbres/learn/learn.hpp>
#include <rbres/nn/nn.hpp>
#include <rbres/predict/decoded_loss.hpp>
#include <rbres/predict/predictor.hpp>
#include <rbres/sim/batch.hpp>
#include <rbres/sim/simulate.hpp>
#include <rbres/sim/transitions.hpp>
#include <rbres/version.hpp>
