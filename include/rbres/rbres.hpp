#pragma once

/// Everything but files (those are in <rbres/io.hpp>); needs Eigen alone.
#include <rbres/core/aligned.hpp>
#include <rbres/core/error.hpp>
#include <rbres/core/pack.hpp>
#include <rbres/core/parallel.hpp>
#include <rbres/core/philox.hpp>
#include <rbres/dynamics/dormand_prince.hpp>
#include <rbres/dynamics/forces.hpp>
#include <rbres/dynamics/integrators.hpp>
#include <rbres/sim/simulate.hpp>
#include <rbres/nn/nn.hpp>
#include <rbres/version.hpp>
