#include <doctest/doctest.h>

#include <rbres/rbres.hpp>

using namespace rbres;

TEST_CASE_TEMPLATE("a part that is to be shorter is, wherever the one before has ended", S, double, float,
                   Pack<double, 4>) {
  Random random(1);
  const auto any_share = [&] {
    S share(0);
    if constexpr (Packed<S>) {
      for (std::size_t lane = 0; lane < 4; ++lane) share.v[lane] = random.uniform(0, 1);
    } else {
      share = S(random.uniform(0, 1));
    }
    return share;
  };
  const MaskOf<S> all_lanes(true);
  int shortened = 0;
  for (const bool in_crowd : {false, true}) {
    for (int run = 0; run < 200; ++run) {
      detail::StepClock<S> clock(S(2e-3f), in_crowd);
      int looks = 0;
      for (; any(clock.next().running); ++looks) {
        REQUIRE(looks < 4000);
        const auto part = clock.next();
        const bool deep = random.uniform(0, 1) < 0.6;
        if (deep ? clock.shorten_where(all_lanes, part)
                 : clock.shorten_for(S(S(4e3f) * square(any_share())), part)) {
          const MaskOf<S> shorter = clock.next().seconds < part.seconds;
          REQUIRE(any(shorter));
          ++shortened;
          continue;
        }
        // An impact ends it, or none does.
        clock.pass(part, random.uniform(0, 1) < 0.5
                             ? part.seconds
                             : maximum(S(part.seconds * any_share()), clock.least(part)));
      }
    }
  }
  CHECK(shortened > 1000);
}
