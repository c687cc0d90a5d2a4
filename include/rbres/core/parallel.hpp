#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <rbres/core/error.hpp>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace rbres::RBRES_ABI {

/// Threads that parallel work uses unless told otherwise: where the user's flags turn OpenMP on its choice,
/// but no more than there are processors; else 1.
inline int default_threads() noexcept {
#ifdef _OPENMP
  return std::min(omp_get_max_threads(), omp_get_num_procs());
#else
  return 1;
#endif
}

namespace detail {

/// Throws Error for a number of threads that nobody means.
inline void check_threads(int threads) {
  if (threads < 0 || threads > 4096) refuse("threads", "0 to 4096", threads);
}

/// The first exception of several threads, which must not leave the code that they run together.
class FirstException {
 public:
  bool caught() const noexcept { return caught_.load(std::memory_order_acquire); }
  /// Keeps the exception that is being handled, if it is the first. Call rethrow() when all threads are done.
  void keep() noexcept {
    if (!taken_.exchange(true, std::memory_order_acq_rel)) {
      exception_ = std::current_exception();
      caught_.store(true, std::memory_order_release);
    }
  }
  void rethrow() const {
    if (exception_) std::rethrow_exception(exception_);
  }

 private:
  std::atomic<bool> taken_{false}, caught_{false};
  std::exception_ptr exception_;
};

}  // namespace detail

/// Calls task(i) for i in [0, count), over `threads` threads (0: default_threads(); Error for others than 0
/// to 4096). Tasks must not share what they write: then the result cannot depend on the number of threads.
/// Where a task throws, no new ones begin, and the first exception goes to the caller.
template <class Task>
void parallel_for(std::ptrdiff_t count, int threads, const Task& task) {
  detail::check_threads(threads);
#ifdef _OPENMP
  const int team = threads > 0 ? threads : default_threads();
  if (team > 1) {
    detail::FirstException first;
#pragma omp parallel for schedule(dynamic, 1) num_threads(team)
    for (std::ptrdiff_t i = 0; i < count; ++i) {
      if (first.caught()) continue;
      try {
        task(i);
      } catch (...) {
        first.keep();
      }
    }
    first.rethrow();
    return;
  }
#endif
  for (std::ptrdiff_t i = 0; i < count; ++i) task(i);
}

/// One of several threads that do many short pieces of work together, as parallel_team() gives it; by default
/// a thread alone.
class Team {
 public:
  /// What the threads share.
  struct Shared {
    std::atomic<std::ptrdiff_t> next{0};     ///< task
    std::atomic<int> arrived{0}, passed{0};  ///< threads that wait, and how often all have
    detail::FirstException exception;
  };

  Team() noexcept = default;
  Team(int index, int size, Shared& shared) noexcept : index_(index), size_(size), shared_(&shared) {}

  int index() const noexcept { return index_; }
  int size() const noexcept { return size_; }

  /// Calls task(i) for i in [0, count), each by the thread that is free, and returns when all are done. Every
  /// thread must call it. Tasks as those of parallel_for(): where one throws, every thread of the team leaves
  /// by an exception.
  template <class Task>
  void share(std::ptrdiff_t count, const Task& task) const {
    if (size_ == 1) {
      for (std::ptrdiff_t i = 0; i < count; ++i) task(i);
      return;
    }
    try {
      for (std::ptrdiff_t i = 0; (i = shared_->next.fetch_add(1, std::memory_order_relaxed)) < count;)
        task(i);
    } catch (...) {
      shared_->exception.keep();
      shared_->next.store(count, std::memory_order_relaxed);
    }
    wait();
    if (shared_->exception.caught()) shared_->exception.rethrow();
  }

 private:
  /// Until all threads are here. Spins for some microseconds, which short pieces of work need, and then
  /// sleeps: where other work holds a processor, the thread that it keeps waiting must not be kept from it by
  /// those that wait for it.
  void wait() const noexcept {
    const int before = shared_->passed.load(std::memory_order_relaxed);
    if (shared_->arrived.fetch_add(1, std::memory_order_acq_rel) + 1 == size_) {
      shared_->next.store(0, std::memory_order_relaxed);
      shared_->arrived.store(0, std::memory_order_relaxed);
      shared_->passed.store(before + 1, std::memory_order_release);
      shared_->passed.notify_all();
      return;
    }
    for (int spin = 0; spin < 2000; ++spin) {
      if (shared_->passed.load(std::memory_order_acquire) != before) return;
#if defined(__x86_64__)
      __builtin_ia32_pause();
#endif
    }
    shared_->passed.wait(before, std::memory_order_acquire);
  }

  int index_ = 0, size_ = 1;
  Shared* shared_ = nullptr;
};

/// Calls body(team) on each of `threads` threads (0: default_threads()), or of fewer where OpenMP gives
/// fewer. It may throw where all of them do, as share() does; the caller gets the first exception.
template <class Body>
void parallel_team(int threads, const Body& body) {
  detail::check_threads(threads);
#ifdef _OPENMP
  const int size = threads > 0 ? threads : default_threads();
  if (size > 1) {
    Team::Shared shared;
#pragma omp parallel num_threads(size)
    try {
      body(Team(omp_get_thread_num(), omp_get_num_threads(), shared));
    } catch (...) {
      shared.exception.keep();
    }
    shared.exception.rethrow();
    return;
  }
#endif
  body(Team());
}

}  // namespace rbres::RBRES_ABI
