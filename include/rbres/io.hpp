#pragma once

/// Files: safetensors, NumPy's .npy and glTF animations. Needs nlohmann_json and POSIX besides what
/// <rbres/rbres.hpp> needs.
#include <rbres/io/atomic_file.hpp>
#include <rbres/io/checkpoint.hpp>
#include <rbres/io/export_header.hpp>
#include <rbres/io/gltf.hpp>
#include <rbres/io/model.hpp>
#include <rbres/io/npy.hpp>
#include <rbres/io/predictor.hpp>
#include <rbres/io/safetensors.hpp>
