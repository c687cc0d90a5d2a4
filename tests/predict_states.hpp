// States that tests of predictors share.
#pragma once

#include <rbres/body/state.hpp>
#include <rbres/core/philox.hpp>

template <class State>
State random_state(std::uint64_t seed) {
  rbres::Random random(seed);
  State y;
  for (double& x : y.vector().reshaped()) x = random.normal();
  for (auto& body : y.body) body.orientation = normalized(body.orientation);
  return y;
}

/// The same orientations by the other quaternions.
template <class State>
State turned(State y) {
  for (int b = 0; b < State::bodies; ++b) y[b].vector().template segment<4>(3) *= -1;
  return y;
}
