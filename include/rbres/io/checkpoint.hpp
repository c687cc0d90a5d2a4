#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>

#include <rbres/core/aligned.hpp>
#include <rbres/core/error.hpp>
#include <rbres/io/parameters.hpp>
#include <rbres/io/safetensors.hpp>
#include <rbres/nn/trainer.hpp>

namespace rbres {

namespace detail {

/// The options on which the bits of a run depend, which is all but the threads.
inline std::string options_text(const TrainingOptions& o) {
  const Schedule& s = o.schedule;
  return text("epochs ", o.epochs, ", batch size ", o.batch_size, ", schedule ", static_cast<int>(s.kind),
              " ", s.initial, " ", s.gamma, " ", s.power, ", l2 ", o.l2, ", dropout ", o.dropout,
              ", patience ", o.patience, ", seed ", o.seed);
}

template <class Net, class Optimizer>
Metadata checkpoint_metadata(const Trainer<Net, Optimizer>& trainer, const Metadata& metadata) {
  Metadata all = network_metadata<Net>();
  all["options"] = options_text(trainer.options());
  all.insert(metadata.begin(), metadata.end());
  return all;
}

inline std::string moment_prefix(int i) { return text("moments.", i, "."); }

}  // namespace detail

/// Saves all that a training run needs to go on with the same bits, beside its samples, optimiser and loss,
/// as a safetensors file: "network.0.weight", ..., "best.0.weight", ..., "moments.0.0.weight", ... and
/// "progress". Atomic (see AtomicFile): a run killed at any moment leaves the whole old checkpoint or the
/// whole new one. Call it after each epoch:
///     trainer.train([&](const EpochReport&) { save_checkpoint(path, trainer); return true; });
/// `metadata` say what else the run depends on, such as its data set, and must be the same when it is
/// resumed. A diverged run saves nothing: the checkpoint of its last good epoch stays.
template <class Net, class Optimizer>
void save_checkpoint(const std::filesystem::path& path, const Trainer<Net, Optimizer>& trainer,
                     const Metadata& metadata = {}) {
  const TrainingState<Net>& state = trainer.state();
  const TrainingProgress& progress = state.progress;
  if (progress.status == TrainingStatus::diverged) return;
  SafetensorsWriter file;
  file.metadata = detail::checkpoint_metadata(trainer, metadata);
  detail::add_parameters<Net>(file, "network.", state.network.parameters().data());
  detail::add_parameters<Net>(file, "best.", state.best.parameters().data());
  for (int i = 0; i < Optimizer::moment_count; ++i)
    detail::add_parameters<Net>(file, detail::moment_prefix(i),
                                state.moments.data() + static_cast<std::size_t>(i) * Net::block_size);
  // The best loss is infinite before the first epoch, so its bits are stored.
  const std::array<std::uint64_t, 5> numbers{progress.epoch, progress.step, progress.best_epoch,
                                             std::bit_cast<std::uint64_t>(progress.best_loss),
                                             static_cast<std::uint64_t>(progress.status)};
  file.add("progress", {static_cast<Eigen::Index>(numbers.size())}, numbers.data());
  file.write(path);
}

/// Lets a trainer go on from a checkpoint that a trainer with the same samples, options, optimiser and loss
/// saved; a run that its callback stopped goes on too. Error that names the path when the file is malformed,
/// or is of another network, other options (but for the threads) or other metadata; the trainer is then as it
/// was.
template <class Net, class Optimizer>
void load_checkpoint(const std::filesystem::path& path, Trainer<Net, Optimizer>& trainer,
                     const Metadata& metadata = {}) {
  const SafetensorsReader file(path);
  detail::require_metadata(file, detail::checkpoint_metadata(trainer, metadata));
  std::array<std::uint64_t, 5> numbers{};
  file.read("progress", {static_cast<Eigen::Index>(numbers.size())}, numbers.data());
  const TrainingProgress progress{numbers[0], numbers[1], numbers[2], std::bit_cast<double>(numbers[3]),
                                  static_cast<TrainingStatus>(numbers[4])};
  const bool is_known = numbers[4] < static_cast<std::uint64_t>(TrainingStatus::diverged);
  if (!is_known || progress.best_epoch > progress.epoch || std::isnan(progress.best_loss) ||
      progress.epoch > static_cast<std::uint64_t>(trainer.options().epochs))
    detail::refuse(path.string(), "the progress of a run", "numbers that make no sense");

  TrainingState<Net> state{Net(), Net(), AlignedBuffer<typename Net::Scalar>(trainer.state().moments.size()),
                           progress};
  if (state.progress.status == TrainingStatus::stopped) state.progress.status = TrainingStatus::running;
  detail::read_parameters<Net>(file, "network.", state.network.parameters().data());
  detail::read_parameters<Net>(file, "best.", state.best.parameters().data());
  for (int i = 0; i < Optimizer::moment_count; ++i)
    detail::read_parameters<Net>(file, detail::moment_prefix(i),
                                 state.moments.data() + static_cast<std::size_t>(i) * Net::block_size);
  trainer.restore(std::move(state));
}

}  // namespace rbres
