#pragma once

/// @file
/// Learning from trajectories, measured or simulated: what a world is made of, and how its bodies collide.
///
///     const TrajectorySet& scenes = ...;                      // frames of bodies, planes, gravity
///     const auto law = learn_contacts<ContactLaw<>>(scenes.subset(0, 90), scenes.subset(90, 10));
///     simulate(system, state, Gravity{scenes.gravity()}, Rk4{}, law,
///              {.step = law.scales.frame_time, .duration = 2});
///
///     ContactLaw<>::Workspace workspace(bodies.size(), planes.size());  // bodies counted at run time
///     law.respond<AnyShape<double>>(bodies, planes, before, flown, workspace);
#include <rbres/learn/contact_law.hpp>
#include <rbres/learn/contact_law_simulator.hpp>
#include <rbres/learn/hybrid_law.hpp>
#include <rbres/learn/identify.hpp>
#include <rbres/learn/learn_contacts.hpp>
#include <rbres/learn/rollouts.hpp>
#include <rbres/learn/spring_damper.hpp>
#include <rbres/learn/trajectory.hpp>
