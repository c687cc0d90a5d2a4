#include <doctest/doctest.h>

#include <numeric>
#include <rbres/rbres.hpp>
#include <vector>

using namespace rbres;

TEST_CASE("sort and sweep finds every pair whose balls overlap and no other, planes first, in order") {
  constexpr int N = 40;  // few are compared one by one
  const auto system = System<double, N, Sphere<double>>::of(Body{Sphere{0.1}, 1.0}, {floor_plane<double>()});
  BroadPhase<double, N> broad(1);
  Random random(1);
  SystemState<double, N> y;
  std::array<double, N> reach;
  std::size_t overlaps = 0;
  for (int call = 0; call < 100; ++call) {
    CAPTURE(call);
    for (int i = 0; i < N; ++i) {
      y[i].position = {random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(0, 2)};
      reach[static_cast<std::size_t>(i)] = random.uniform(0.05, 0.4);
    }
    std::vector<std::pair<int, int>> expected, found;
    for (int first = -1; first < N; ++first) {
      for (int i = first + 1; i < N; ++i) {
        const double least = reach[static_cast<std::size_t>(i)];
        const bool overlap = first < 0 ? y[i].position.z < least
                                       : norm(y[i].position - y[first].position) <
                                             least + reach[static_cast<std::size_t>(first)];
        if (overlap) expected.push_back({first, i});
      }
    }
    for (const Candidate& pair : broad.find(system, y, reach)) found.push_back({pair.first, pair.second});
    CHECK(found == expected);
    overlaps += found.size();
  }
  CHECK(overlaps > 1000);
}

TEST_CASE("the pairs of some bodies are those of all that have one of them in it, while bodies wander") {
  using Crowd = System<double, dynamic, Sphere<double>>;
  constexpr int count = 60;
  const Crowd system(std::vector(count, Body{Sphere{0.1}, 1.0}), {floor_plane<double>()});
  BroadPhase<double, dynamic> broad(1, count), reference(1, count);
  double grown = 0;
  SUBCASE("found anew often, among few") { grown = 1.1; }
  SUBCASE("found anew seldom, among many") { grown = 1.5; }
  broad.reserve_for_some(grown);
  Random random(2);
  Crowd::State y;
  y.body.resize(count);
  auto reach = detail::per_body<double>(system);
  std::vector<int> all(count), few;
  std::iota(all.begin(), all.end(), 0);
  for (const int i : all) {
    if (i % 3 != 0) few.push_back(i);
  }
  const auto listed = [](const auto& pairs) {
    std::vector<std::pair<int, int>> list;
    for (const Candidate& pair : pairs) list.push_back({pair.first, pair.second});
    return list;
  };
  std::size_t overlaps = 0;
  for (int round = 0; round < 20; ++round) {
    for (const int i : all) {
      y[i].position = {random.uniform(-0.6, 0.6), random.uniform(-0.6, 0.6), random.uniform(0, 1.2)};
      reach[static_cast<std::size_t>(i)] = random.uniform(0.1, 0.2);
    }
    for (const auto& bodies : {all, few}) {
      broad.find(system, y, reach, bodies);
      for (int call = 0; call < 20; ++call) {
        CAPTURE(bodies.size());
        CAPTURE(round);
        CAPTURE(call);
        const double share = call % 4 == 0 ? 1 : 0.3;
        std::vector<bool> is_one(count, false);
        std::vector<int> some;
        for (const int i : bodies) {
          // Now and then one goes far, or grows: most calls find all near where they were.
          const double far = random.uniform(0, 1) < 0.002 ? 0.5 : 1e-3;
          for (double* x : {&y[i].position.x, &y[i].position.y, &y[i].position.z})
            *x += random.uniform(-far, far);
          reach[static_cast<std::size_t>(i)] += far * random.uniform(-0.2, 0.5);
          is_one[static_cast<std::size_t>(i)] = random.uniform(0, 1) < share;
          if (is_one[static_cast<std::size_t>(i)]) some.push_back(i);
        }
        const auto is = [&](int i) { return i >= 0 && is_one[static_cast<std::size_t>(i)]; };
        auto expected = listed(reference.find(system, y, reach, bodies));
        std::erase_if(expected, [&](const auto& pair) { return !is(pair.first) && !is(pair.second); });
        CHECK(listed(broad.find(system, y, reach, bodies, some, is)) == expected);
        overlaps += expected.size();
      }
    }
  }
  CHECK(overlaps > 10000);
}
