#pragma once

/// @file
/// The version.

/// The one place where it stands; CMake reads these three lines.
/// @{
#define RBRES_VERSION_MAJOR 0
#define RBRES_VERSION_MINOR 1
#define RBRES_VERSION_PATCH 0
/// @}
