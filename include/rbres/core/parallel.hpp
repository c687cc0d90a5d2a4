#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <rbres/core/error.hpp>
#include <vector>

// Whether the standard library has threads here: not on a microcontroller, and not in a browser's default
// build.
#if !__has_include(<thread>) || (defined(__GLIBCXX__) && !defined(_GLIBCXX_HAS_GTHREADS)) || \
    defined(_LIBCPP_HAS_NO_THREADS) || (defined(__EMSCRIPTEN__) && !defined(__EMSCRIPTEN_PTHREADS__))
#define RBRES_HAS_THREADS 0
#else
#define RBRES_HAS_THREADS 1
#include <thread>
#endif
#if defined(__linux__) && RBRES_HAS_THREADS
#include <sched.h>
#endif

namespace rbres::RBRES_ABI {

/// Threads that parallel work uses unless told otherwise: as many as there are processors for this program;
/// 1 where the standard library has no threads.
inline int default_threads() noexcept {
#if RBRES_HAS_THREADS
#if defined(__linux__) && defined(CPU_COUNT)
  cpu_set_t mine;  // hardware_concurrency() counts those, too, that taskset or a container keeps from us
  if (sched_getaffinity(0, sizeof mine, &mine) == 0) return std::max(1, CPU_COUNT(&mine));
#endif
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
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

#if RBRES_HAS_THREADS
/// Until `value` is no longer `before`. Spins for some microseconds, which short pieces of work need, and
/// then sleeps: where other work holds a processor, the thread that it keeps waiting must not be kept from it
/// by those that wait for it.
inline void wait_for_change(const std::atomic<int>& value, int before) noexcept {
  for (int spin = 0; spin < 2000; ++spin) {
    if (value.load(std::memory_order_acquire) != before) return;
#if defined(__x86_64__)
    __builtin_ia32_pause();
#endif
  }
  value.wait(before, std::memory_order_acquire);
}
#endif

}  // namespace detail

/// One of several threads that do many short pieces of work together, as parallel_team() gives it; by default
/// a thread alone.
class Team {
 public:
  /// What the threads share.
  struct Shared {
    std::atomic<int> size{0};          ///< of the team; 0 until all threads that it gets have begun
    std::atomic<std::size_t> next{0};  ///< task; beyond the last it counts on, and has room for it
    std::atomic<int> arrived{0};       ///< threads that wait
    std::atomic<int> passed{0};        ///< how often all have arrived
    std::atomic<bool> failed{false};   ///< whether a task had thrown when all had arrived
    /// The first that a task threw.
    detail::FirstException exception;
  };

  Team() noexcept = default;
  /// Thread `index` of `size` that share `shared`, which must outlive it.
  Team(int index, int size, Shared& shared) noexcept : index_(index), size_(size), shared_(&shared) {}

  /// Which thread of the team this is, from 0.
  int index() const noexcept { return index_; }
  /// Threads of the team.
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
    const auto tasks = static_cast<std::size_t>(std::max<std::ptrdiff_t>(count, 0));
    detail::attempt(
        [&] {
          for (std::size_t i = 0; (i = shared_->next.fetch_add(1, std::memory_order_relaxed)) < tasks;)
            task(static_cast<std::ptrdiff_t>(i));
        },
        [&] {
          shared_->exception.keep();
          shared_->next.store(tasks, std::memory_order_relaxed);
        });
    wait();
    // Not whether one has thrown by now: a faster thread may be at the next piece of work already.
    if (shared_->failed.load(std::memory_order_relaxed)) shared_->exception.rethrow();
  }

 private:
  /// Until all threads are here.
  void wait() const noexcept {
#if RBRES_HAS_THREADS
    const int before = shared_->passed.load(std::memory_order_relaxed);
    if (shared_->arrived.fetch_add(1, std::memory_order_acq_rel) + 1 < size_)
      return detail::wait_for_change(shared_->passed, before);
    shared_->next.store(0, std::memory_order_relaxed);
    shared_->arrived.store(0, std::memory_order_relaxed);
    shared_->failed.store(shared_->exception.caught(), std::memory_order_relaxed);
    shared_->passed.store(before + 1, std::memory_order_release);
    shared_->passed.notify_all();
#endif
  }

  int index_ = 0, size_ = 1;
  Shared* shared_ = nullptr;
};

/// Calls body(team) on each of `threads` threads (0: default_threads()), or of fewer where the system gives
/// fewer. It may throw where all of them do, as share() does; the caller gets the first exception. Error for
/// others than 0 to 4096.
template <class Body>
void parallel_team(int threads, const Body& body) {
  detail::check_threads(threads);
#if RBRES_HAS_THREADS
  if (const int asked = threads > 0 ? threads : default_threads(); asked > 1) {
    Team::Shared shared;
    const auto run = [&](int index) {
      const auto work = [&] { body(Team(index, shared.size.load(std::memory_order_relaxed), shared)); };
      detail::attempt(work, [&] { shared.exception.keep(); });
    };
    std::vector<std::thread> others;
    others.reserve(static_cast<std::size_t>(asked - 1));
    const auto start = [&] {
      for (int index = 1; index < asked; ++index)
        others.emplace_back([&, index] {
          detail::wait_for_change(shared.size, 0);
          run(index);
        });
    };
    detail::attempt(start, [] {
      // The system gives no more threads: those that it gave do the work.
    });
    shared.size.store(1 + static_cast<int>(others.size()), std::memory_order_release);
    shared.size.notify_all();
    run(0);
    for (std::thread& other : others) other.join();
    shared.exception.rethrow();
    return;
  }
#endif
  body(Team());
}

/// Calls task(i) for i in [0, count), over `threads` threads (0: default_threads(); Error for others than 0
/// to 4096). Tasks must not share what they write: then the result cannot depend on the number of threads.
/// Where a task throws, no new ones begin, and the first exception goes to the caller.
template <class Task>
void parallel_for(std::ptrdiff_t count, int threads, const Task& task) {
  detail::check_threads(threads);
  const int asked = threads > 0 ? threads : default_threads();
  const int useful = static_cast<int>(std::clamp<std::ptrdiff_t>(count, 1, asked));
  parallel_team(useful, [&](const Team& team) { team.share(count, task); });
}

}  // namespace rbres::RBRES_ABI
