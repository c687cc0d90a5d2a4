#pragma once

#include <rbres/eval/training_set.hpp>

#include <utility>

namespace rbres::RBRES_ABI {

/// Trains a predictor on transitions of the user's own world: fits its normalisers, sets its horizon, and
/// trains its network, of which it gets the best weights. One transition in ten, the first ones, validates
/// and does not train. `report` is called after each epoch, as by Trainer::train; where it returns false,
/// training ends. Throws Error for fewer than ten transitions, and for what TrainingSet and Trainer refuse;
/// the predictor is then as it was.
template <class Net, int N>
TrainingProgress train_predictor(Predictor<Net, N>& predictor, const Transitions<N>& data,
                                 const TrainingOptions& options = {},
                                 const typename Trainer<Net>::Callback& report = {}) {
  const std::ptrdiff_t count = std::ssize(data.starts), validation = count / 10;
  if (validation < 1) detail::refuse("transitions to train on", "at least 10", count);
  Predictor<Net, N> trained = predictor;
  const TrainingSet<Predictor<Net, N>> set(trained, data, validation, count, options.threads);
  Trainer<Net> trainer(trained.network, set.samples(validation, count - validation),
                       set.samples(0, validation), options);
  trainer.train(report);
  trained.network = trainer.best();
  predictor = std::move(trained);
  return trainer.state().progress;
}

}  // namespace rbres::RBRES_ABI
