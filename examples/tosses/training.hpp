#pragma once

#include <algorithm>
#include <memory>
#include <numbers>
#include <rbres/core/parallel.hpp>
#include <rbres/core/philox.hpp>

#include "rollouts.hpp"

namespace rbres::tosses {

/// How to train on rollouts; the defaults were chosen on a part of train.npy held out from the rest.
struct RolloutTraining {
  int frames = 16;
  int batch = 256;  ///< rollouts a step
  int steps = 1500;
  double rate = 2e-3;  ///< of Adam at its height; up over the first 100 steps, then down along half a cosine
  double clip = 1;     ///< largest norm of a step's gradient
  std::uint64_t seed = 1;
};

/// What the sum of the rollouts' gradients is multiplied with so that its norm is at most `largest`.
template <class Net>
typename Net::Scalar shrinkage(const std::vector<std::unique_ptr<Rollouts<Net>>>& rollouts, double largest) {
  double sum = 0;
  for (std::size_t at = 0; at < Net::block_size; ++at) {
    double g = 0;
    for (const auto& r : rollouts) g += static_cast<double>(r->gradient()[at]);
    sum += g * g;
  }
  return static_cast<typename Net::Scalar>(sum > largest * largest ? largest / std::sqrt(sum) : 1.0);
}

/// Trains a predictor's network on rollouts from random frames of the tosses, up to shortly after the cube
/// has come to rest. progress(steps done, mean error of their rollouts in m) every twentieth of the way. The
/// bits do not depend on the number of threads. Throws Error where no toss is long enough.
template <class Net, class Progress>
void train(CornerPredictor<Net>& predictor, const std::vector<Toss>& tosses, const RolloutTraining& options,
           const Progress& progress, int threads = 0) {
  using T = typename Net::Scalar;
  std::vector<const State*> starts;
  for (const Toss& toss : tosses) {
    const auto moves = [](const State& s) {
      return std::sqrt(squared_norm(s.velocity)) + half_width * std::sqrt(squared_norm(s.angular_velocity)) >
             0.05;
    };
    const auto rest = std::find_if(toss.rbegin(), toss.rend(), moves).base() - toss.begin() + 5;
    const auto last = std::min<std::ptrdiff_t>(rest, std::ssize(toss) - options.frames);
    for (std::ptrdiff_t t = 0; t < last; ++t) starts.push_back(&toss[static_cast<std::size_t>(t)]);
  }
  if (starts.empty()) {
    detail::refuse("training", detail::text("a toss of more than ", options.frames, " frames"), "none");
  }

  constexpr int chunk = 32;  // rollouts a task: the sum of gradients does not depend on who does which
  std::vector<std::unique_ptr<Rollouts<Net>>> rollouts;
  std::vector<std::vector<const State*>> first;
  std::vector<std::vector<int>> turns;
  for (int begin = 0; begin < options.batch; begin += chunk) {
    const int count = std::min(chunk, options.batch - begin);
    rollouts.push_back(std::make_unique<Rollouts<Net>>(count, options.frames));
    first.emplace_back(static_cast<std::size_t>(count));
    turns.emplace_back(static_cast<std::size_t>(count));
  }
  std::vector<double> errors(rollouts.size());
  AlignedBuffer<T> moments(Adam::moment_count * Net::block_size);
  double sum = 0;
  int summed = 0;
  for (int step = 0; step < options.steps; ++step) {
    Random random(options.seed, static_cast<std::uint64_t>(step));
    for (std::size_t i = 0; i < rollouts.size(); ++i) {
      for (auto& s : first[i]) s = starts[random.below(static_cast<std::uint32_t>(starts.size()))];
      for (int& turn : turns[i]) turn = static_cast<int>(random.below(Corner<double>::turns));
    }
    parallel_for(std::ssize(rollouts), threads, [&](std::ptrdiff_t task) {
      const auto i = static_cast<std::size_t>(task);
      errors[i] = rollouts[i]->run(predictor, first[i], turns[i]);
    });
    for (const double error : errors) sum += error / options.batch;
    if (!std::isfinite(sum)) detail::refuse(detail::text("training, step ", step), "a finite error", sum);

    const double height = std::min(1.0, (step + 1) / 100.0);
    const double rate = height * options.rate * (1 + std::cos(std::numbers::pi * step / options.steps)) / 2;
    const auto rule = Adam{}.rule<T>(rate, static_cast<std::uint64_t>(step) + 1);
    const T shrink = shrinkage(rollouts, options.batch * options.clip);
    T* parameters = predictor.network.parameters().data();
    for (std::size_t at = 0; at < Net::block_size; at += static_cast<std::size_t>(detail::simd_width<T>)) {
      detail::Simd<T> g{},
          m[2] = {detail::load(moments.data() + at), detail::load(moments.data() + Net::block_size + at)};
      for (const auto& r : rollouts) g += shrink * detail::load(r->gradient().data() + at);
      detail::store(parameters + at, rule(detail::load(parameters + at), g, m, true));
      detail::store(moments.data() + at, m[0]);
      detail::store(moments.data() + Net::block_size + at, m[1]);
    }
    ++summed;
    if ((step + 1) % std::max(1, options.steps / 20) == 0 || step + 1 == options.steps) {
      progress(step + 1, sum / summed);
      sum = summed = 0;
    }
  }
}

}  // namespace rbres::tosses
