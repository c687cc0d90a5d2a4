#pragma once

/// @file
/// Files: models, checkpoints and headers of networks, NumPy's .npy for data, glTF animations. Needs
/// nlohmann_json and POSIX besides what <rbres/rbres.hpp> needs.
///
///     save("model.safetensors", network);                       // Python's safetensors reads it
///     const auto network = load<Network>("model.safetensors");
///     const auto theirs = load<Network>("torch.safetensors", Digest::optional);  // PyTorch stores no digest
///     save_checkpoint("run.safetensors", trainer);              // after each epoch
///     load_checkpoint("run.safetensors", trainer);              // goes on to the same bits
///     write_npy("inputs.npy", inputs);                          // columns are samples: (samples, features)
///     const auto inputs = read_npy<float>("inputs.npy");
///     write_transitions("data", system, forces, Rk4{}, 100'000, start, {.duration = 0.2});  // resumes
///     const auto data = read_transitions("data", system, forces);
///     const auto scenes = read_trajectories("tosses");  // measured, or of another simulator
///     write_trajectories("scenes", scenes);
#include <rbres/io/atomic_file.hpp>
#include <rbres/io/checkpoint.hpp>
#include <rbres/io/contact_law.hpp>
#include <rbres/io/contact_training.hpp>
#include <rbres/io/cropped_network.hpp>
#include <rbres/io/digest.hpp>
#include <rbres/io/export_contact_law.hpp>
#include <rbres/io/export_header.hpp>
#include <rbres/io/export_predictor.hpp>
#include <rbres/io/folder_lock.hpp>
#include <rbres/io/gltf.hpp>
#include <rbres/io/model.hpp>
#include <rbres/io/npy.hpp>
#include <rbres/io/predictor.hpp>
#include <rbres/io/safetensors.hpp>
#include <rbres/io/trajectories.hpp>
#include <rbres/io/transitions.hpp>
