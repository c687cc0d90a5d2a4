#pragma once

/// What only the paper's experiment needs: its scenarios of three to five bodies, truth for them, and what
/// its predictors are held against. Files of it are in <rbres/io/scenario_data.hpp>.
#include <rbres/paper/scenario.hpp>
#include <rbres/paper/scenario_data.hpp>
#include <rbres/paper/scenario_trajectories.hpp>
#include <rbres/paper/scenario_transitions.hpp>
#include <rbres/paper/simulated_scenario.hpp>
