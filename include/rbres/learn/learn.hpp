#pragma once

/// Learning from trajectories, measured or simulated: what a world is made of, and how its bodies collide.
#include <rbres/learn/trajectory.hpp>
