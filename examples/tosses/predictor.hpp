#pragma once

#include <rbres/core/parallel.hpp>
#include <rbres/nn/nn.hpp>

#include "corner.hpp"

namespace rbres::tosses {

/// A rigid body's step with learned contacts: the prior's step, and an impulse at each corner that comes near
/// the floor, which one small network gives for all corners alike. With free flight as the prior this is the
/// network alone, with the simulator it is the hybrid.
template <class Net>
struct CornerPredictor {
  static_assert(Net::input_size == Corner<double>::features &&
                Net::output_size == Corner<double>::coefficients);

  Net network;
  Prior prior;
  double floor;  ///< height of the floor in the data, m

  State operator()(const State& state) const {
    using T = typename Net::Scalar;
    State next = prior(state);
    const State free = free_flight(state);
    const Posture<double> posture(state, floor, next.velocity - free.velocity,
                                  next.angular_velocity - free.angular_velocity);
    Vec3<double> change, spin;
    for (int i = 0; i < Corner<double>::count; ++i) {
      if (!Corner<double>(posture, i, 0).active()) continue;
      // The mean over the three ways to number a corner's edges, so that the cube's symmetry is exact.
      typename Net::Output mean = Net::Output::Zero();
      for (int turn = 0; turn < Corner<double>::turns; ++turn) {
        const auto x = Corner<double>(posture, i, turn).encode();
        typename Net::Input input;
        for (int k = 0; k < Net::input_size; ++k) input[k] = static_cast<T>(x[static_cast<std::size_t>(k)]);
        mean += network.forward(input) / T(Corner<double>::turns);
      }
      const Corner<double> corner(posture, i, 0);
      const Vec3<double> impulse = corner.impulse(mean);
      change += impulse;
      spin += corner.spin_of(impulse);
    }
    add_velocity(next, change, spin);
    return next;
  }
};

/// Mean errors over the frames 1, ..., 80 and the tosses of a rollout from frame 0; a toss that ends earlier
/// counts with the frames it has.
struct Score {
  double position = 0;  ///< distance of the centres, m
  double rotation = 0;  ///< angle of the rotation between, rad
};

template <class Step>
Score score(const Step& step, const std::vector<Toss>& tosses) {
  constexpr std::size_t frames = 80;
  std::vector<Score> sums(tosses.size());
  parallel_for(static_cast<std::ptrdiff_t>(tosses.size()), 0, [&](std::ptrdiff_t task) {
    const Toss& toss = tosses[static_cast<std::size_t>(task)];
    Score& sum = sums[static_cast<std::size_t>(task)];
    State state = toss[0];
    for (std::size_t t = 1; t <= frames && t < toss.size(); ++t) {
      state = step(state);
      sum.position += std::sqrt(squared_norm(state.position - toss[t].position));
      sum.rotation += std::sqrt(squared_norm(rotation_between(state.orientation, toss[t].orientation)));
    }
  });
  Score mean;
  std::size_t count = 0;
  for (std::size_t i = 0; i < tosses.size(); ++i) {
    mean.position += sums[i].position;
    mean.rotation += sums[i].rotation;
    count += std::min(frames, tosses[i].size() - 1);
  }
  return {mean.position / static_cast<double>(count), mean.rotation / static_cast<double>(count)};
}

}  // namespace rbres::tosses
