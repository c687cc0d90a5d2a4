#pragma once

#include <rbres/io/checkpoint.hpp>
#include <rbres/learn/learn_contacts.hpp>

#include <filesystem>

namespace rbres::RBRES_ABI {

/// Saves all that the learning of a contact law needs to go on with the same bits: the checkpoint of its
/// stage's trainer, with the stage's number in the metadata ("stage"). Call it after each epoch:
///
///     training.train([&](const ContactLearningReport&) { save_checkpoint(path, training); return true; });
template <class Law>
void save_checkpoint(const std::filesystem::path& path, const ContactTraining<Law>& training) {
  save_checkpoint(path, training.trainer(), {{"stage", detail::text(training.stage())}});
}

/// Lets learning go on from such a checkpoint. Error that names the path when the file is malformed or
/// changed, or is of other scenes or options; the training is then as it was.
template <class Law>
void load_checkpoint(const std::filesystem::path& path, ContactTraining<Law>& training) {
  Eigen::Matrix<double, 1, 1> stage;
  detail::numbers_from_metadata(SafetensorsReader(path), "stage", stage,
                                {0, static_cast<double>(training.stages() - 1)});
  const int number = static_cast<int>(stage[0]);
  training.restore(number, [&](auto& trainer) {
    load_checkpoint(path, trainer, {{"stage", detail::text(number)}});
  });
}

}  // namespace rbres::RBRES_ABI
