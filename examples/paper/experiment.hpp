// The whole experiment.
#pragma once

#include "plan.hpp"
#include "store.hpp"
#include "work.hpp"

namespace paper {

/// Makes what the store does not hold of the plan's data, networks, contact laws and measurements, and times
/// all methods; everything that was found, by name.
Json run_experiment(const Plan& plan, const Store& store, const RunOptions& options = {});

}  // namespace paper
