#pragma once

#include <cstddef>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace rbres {

/// Threads that parallel work uses unless told otherwise: OpenMP's choice where the user's flags turn it on,
/// else 1.
inline int default_threads() noexcept {
#ifdef _OPENMP
  return omp_get_max_threads();
#else
  return 1;
#endif
}

/// Calls task(i) for i in [0, count), over `threads` threads (0: default_threads()). Tasks must not throw,
/// and must not share what they write: then the result cannot depend on the number of threads.
template <class Task>
void parallel_for(std::ptrdiff_t count, int threads, const Task& task) {
#ifdef _OPENMP
  const int team = threads > 0 ? threads : default_threads();
#pragma omp parallel for schedule(dynamic, 1) num_threads(team) if (team > 1)
#else
  static_cast<void>(threads);
#endif
  for (std::ptrdiff_t i = 0; i < count; ++i) task(i);
}

}  // namespace rbres
