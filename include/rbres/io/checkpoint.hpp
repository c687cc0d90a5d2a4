#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <rbres/core/error.hpp>
#include <rbres/io/metadata.hpp>
#include <rbres/io/parameters.hpp>
#include <rbres/io/safetensors.hpp>
#include <rbres/nn/trainer.hpp>

namespace rbres::RBRES_ABI {

namespace detail {

template <class Net, class Optimizer, class Objective>
Metadata checkpoint_metadata(const Trainer<Net, Optimizer, Objective>& trainer, const Metadata& metadata) {
  Metadata all = network_metadata<Net>();
  all["options"] = trainer.fingerprint();
  for (const auto& [key, value] : metadata)
    if (key == digest_key || !all.emplace(key, value).second)
      refuse("metadata of a checkpoint", "keys that leave its own alone", "'" + key + "'");
  return all;
}

inline constexpr Eigen::Index losses_of_epoch = sizeof(EpochLosses) / sizeof(double);
static_assert(std::is_trivially_copyable_v<EpochLosses>);

/// The blocks of a state, which is const or not, and what precedes the names of their tensors.
template <class Net, class State>
auto state_blocks(State& state) {
  std::vector<std::pair<std::string, decltype(state.network.parameters().data())>> blocks{
      {"network.", state.network.parameters().data()}, {"best.", state.best.parameters().data()}};
  for (std::size_t at = 0; at < state.moments.size(); at += Net::block_size)
    blocks.emplace_back(text("moments.", at / Net::block_size, "."), state.moments.data() + at);
  return blocks;
}

}  // namespace detail

/// Saves all that a training run needs to go on with the same bits, beside its samples, optimiser and loss,
/// as a safetensors file: "network.0.weight", ..., "best.0.weight", ..., "moments.0.0.weight", ... and
/// "progress" and "history", with a digest of it all. Atomic (see AtomicFile): a run killed at any moment
/// leaves the whole old checkpoint or the whole new one. Call it after each epoch:
///
///     trainer.train([&](const EpochReport&) { save_checkpoint(path, trainer); return true; });
///
/// `metadata` say what else the run depends on, such as its data set, and must be the same when it is
/// resumed; the keys "architecture", "scalar", "options" and "sha256" are taken. A diverged run saves
/// nothing: the checkpoint of its last good epoch stays.
template <class Net, class Optimizer, class Objective>
void save_checkpoint(const std::filesystem::path& path, const Trainer<Net, Optimizer, Objective>& trainer,
                     const Metadata& metadata = {}) {
  const TrainingState<Net>& state = trainer.state();
  const TrainingProgress& progress = state.progress;
  if (progress.status == TrainingStatus::diverged) return;
  SafetensorsWriter file;
  file.metadata = detail::checkpoint_metadata(trainer, metadata);
  for (const auto& [prefix, block] : detail::state_blocks<Net>(state))
    detail::add_parameters<Net>(file, prefix, block);
  // The best loss is infinite before the first epoch, so its bits are stored.
  const std::array<std::uint64_t, 5> numbers{progress.epoch, progress.step, progress.best_epoch,
                                             std::bit_cast<std::uint64_t>(progress.best_loss),
                                             static_cast<std::uint64_t>(progress.status)};
  file.add("progress", {static_cast<Eigen::Index>(numbers.size())}, numbers.data());
  // So are those of the losses, which are NaN where nothing validates.
  const auto epochs = std::ssize(state.history);
  if (epochs > 0)
    file.add<std::uint64_t>("history", {epochs, detail::losses_of_epoch}, [&](std::uint64_t* to) {
      std::memcpy(to, state.history.data(), state.history.size() * sizeof(EpochLosses));
    });
  file.write_with_digest(path);
}

/// Lets a trainer go on from a checkpoint that a trainer of the same fingerprint saved; a run that its
/// callback stopped goes on too, and one that was done where this trainer has more epochs. Error that names
/// the path when the file is malformed or changed, or is of another network, fingerprint or other metadata;
/// the trainer is then as it was.
template <class Net, class Optimizer, class Objective>
void load_checkpoint(const std::filesystem::path& path, Trainer<Net, Optimizer, Objective>& trainer,
                     const Metadata& metadata = {}) {
  const SafetensorsReader file(path);
  file.require_digest("; its weights can be read with SafetensorsReader, its run must be made again");
  require_metadata(file, detail::checkpoint_metadata(trainer, metadata));
  std::array<std::uint64_t, 5> numbers{};
  file.read("progress", {static_cast<Eigen::Index>(numbers.size())}, numbers.data());
  TrainingProgress progress{numbers[0], numbers[1], numbers[2], std::bit_cast<double>(numbers[3]),
                            static_cast<TrainingStatus>(numbers[4])};
  const bool is_known = numbers[4] < static_cast<std::uint64_t>(TrainingStatus::diverged);
  if (const auto epochs = static_cast<std::uint64_t>(trainer.options().epochs); progress.epoch > epochs)
    detail::refuse(path.string(), detail::text("the progress of a run of at most ", epochs, " epochs"),
                   detail::text("that of ", progress.epoch));
  if (!is_known || progress.best_epoch > progress.epoch || std::isnan(progress.best_loss))
    detail::refuse(path.string(), "the progress of a run", "numbers that make no sense");

  // All tensors are read and checked before the first is taken, as there is no room for two states.
  for (const auto& entry : detail::state_blocks<Net>(trainer.state()))
    detail::each_parameter<Net>(file, entry.first, [](auto...) {});
  std::vector<std::uint64_t> bits(detail::losses_of_epoch * progress.epoch);
  std::vector<EpochLosses> history(progress.epoch);
  if (!bits.empty()) {
    file.read("history", {std::ssize(history), detail::losses_of_epoch}, bits.data());
    std::memcpy(static_cast<void*>(history.data()), bits.data(), bits.size() * sizeof(std::uint64_t));
  }
  trainer.restore(progress, std::move(history), [&](auto network, auto best, auto moments) {
    detail::read_parameters<Net>(file, "network.", network.data());
    detail::read_parameters<Net>(file, "best.", best.data());
    for (std::size_t at = 0; at < moments.size(); at += Net::block_size)
      detail::read_parameters<Net>(file, detail::text("moments.", at / Net::block_size, "."),
                                   moments.data() + at);
  });
}

}  // namespace rbres::RBRES_ABI
