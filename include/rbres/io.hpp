#pragma once

/// Files: safetensors and NumPy's .npy. Needs nlohmann_json and POSIX besides what <rbres/rbres.hpp> needs.
#include <rbres/io/atomic_file.hpp>
#include <rbres/io/checkpoint.hpp>
#include <rbres/io/export_header.hpp>
#include <rbres/io/model.hpp>
#include <rbres/io/npy.hpp>
#include <rbres/io/safetensors.hpp>
