#pragma once

#include <malloc.h>
#include <unistd.h>

#include <cstdlib>

namespace rbres::bench {

/// Takes away what slows some libraries and not others. OpenBLAS reads its variables while the program is
/// being loaded, so when one is set the program starts itself anew without it.
inline void settle_environment(char** argv) {
  // Large buffers are kept, not given back to the system at every call: up to a factor of 2 for libtorch.
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
  mallopt(M_MMAP_THRESHOLD, 32 << 20);  // glibc's largest
  bool changed = false;
  for (const char* variable : {"OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE"})
    if (std::getenv(variable) != nullptr) {
      unsetenv(variable);
      changed = true;
    }
  if (changed) execv("/proc/self/exe", argv);  // returns only if it failed: then the run goes on as it is
}

}  // namespace rbres::bench
