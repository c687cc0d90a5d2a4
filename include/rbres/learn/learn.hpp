#pragma once

/// Learning from trajectories, measured or simulated: what a world is made of, and how its bodies collide.
#include <rbres/learn/contact_law.hpp>
#include <rbres/learn/identify.hpp>
#include <rbres/learn/learn_contacts.hpp>
#include <rbres/learn/rollouts.hpp>
#include <rbres/learn/trajectory.hpp>
