// Threads: as many as are asked for, each task once, and what a task throws reaches the caller.
#include "error_of.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <rbres/core/parallel.hpp>
#include <set>
#include <thread>
#include <vector>

using namespace rbres;

namespace {

/// How often each of `count` tasks was called.
std::vector<int> calls(std::ptrdiff_t count, int threads) {
  std::vector<int> called(static_cast<std::size_t>(count));
  parallel_for(count, threads, [&](std::ptrdiff_t i) { ++called[static_cast<std::size_t>(i)]; });
  return called;
}

}  // namespace

TEST_CASE("eight threads are eight") {
  CHECK(default_threads() >= 1);
  std::array<std::thread::id, 8> ids;
  std::array<int, 8> sizes{};
  parallel_team(8, [&](const Team& team) {
    ids[static_cast<std::size_t>(team.index())] = std::this_thread::get_id();
    sizes[static_cast<std::size_t>(team.index())] = team.size();
  });
  CHECK(std::set(ids.begin(), ids.end()).size() == 8);
  CHECK(std::count(sizes.begin(), sizes.end(), 8) == 8);
  CHECK(ids[0] == std::this_thread::get_id());
}

TEST_CASE("each task is called once, whatever the number of threads") {
  for (const int threads : {0, 1, 2, 3, 8}) {
    for (const std::ptrdiff_t count : {0, 1, 2, 7, 1000}) {
      CAPTURE(threads);
      CAPTURE(count);
      CHECK(calls(count, threads) == std::vector<int>(static_cast<std::size_t>(count), 1));
    }
  }
}

TEST_CASE("each piece of a team's work begins when the one before has ended") {
  std::array<int, 64> numbers{};
  std::vector<int> sums(100);
  parallel_team(3, [&](const Team& team) {
    for (int& sum : sums) {
      team.share(64, [&](std::ptrdiff_t i) { ++numbers[static_cast<std::size_t>(i)]; });
      team.share(1, [&](std::ptrdiff_t) { sum = std::accumulate(numbers.begin(), numbers.end(), 0); });
    }
  });
  for (int k = 0; k < 100; ++k) CHECK(sums[static_cast<std::size_t>(k)] == 64 * (k + 1));
}

TEST_CASE("what a task throws reaches the caller, and the threads go on to other work") {
  for (const int threads : {1, 2, 8}) {
    CAPTURE(threads);
    CHECK(error_of([&] {
            parallel_for(100, threads, [](std::ptrdiff_t i) {
              if (i == 50) throw Error("task 50");
            });
          }) == "task 50");
    CHECK(error_of([&] { parallel_team(threads, [](const Team&) { throw Error("all"); }); }) == "all");
    CHECK(calls(10, threads) == std::vector<int>(10, 1));
  }
}

TEST_CASE("a task that throws in a later piece of work is waited for by all threads of the team") {
  for (int run = 0; run < 1000; ++run) {
    CHECK(error_of([] {
            parallel_team(2, [](const Team& team) {
              team.share(2, [](std::ptrdiff_t) {});
              team.share(2, [](std::ptrdiff_t) { throw Error("later"); });
            });
          }) == "later");
  }
}

TEST_CASE("a task has a number below the count, also of the largest count and after one that threw") {
  constexpr auto most = std::numeric_limits<std::ptrdiff_t>::max();
  std::atomic<bool> below_zero{false};
  CHECK(error_of([&] {
          parallel_for(most, 8, [&](std::ptrdiff_t i) {
            if (i < 0) below_zero = true;
            if (i >= 100) throw Error("far enough");
          });
        }) == "far enough");
  CHECK_FALSE(below_zero);
}
