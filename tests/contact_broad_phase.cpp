#include <doctest/doctest.h>

#include <rbres/rbres.hpp>

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
