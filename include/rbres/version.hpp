#pragma once

/// The one place where the version stands; CMake reads these three lines.
#define RBRES_VERSION_MAJOR 0
#define RBRES_VERSION_MINOR 1
#define RBRES_VERSION_PATCH 0
