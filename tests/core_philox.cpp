#include <doctest/doctest.h>

#include <rbres/core/philox.hpp>

using rbres::philox4x32;
using rbres::Random;

TEST_CASE("Philox 4x32-10 gives the published known answers") {
  // Random123 1.14, kat_vectors, "philox4x32 10".
  CHECK(philox4x32({0, 0, 0, 0}, {0, 0}) ==
        std::array<std::uint32_t, 4>{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8});
  CHECK(philox4x32({0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff}, {0xffffffff, 0xffffffff}) ==
        std::array<std::uint32_t, 4>{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd});
  CHECK(philox4x32({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}) ==
        std::array<std::uint32_t, 4>{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1});
}

TEST_CASE("a stream is a function of seed, stream and position") {
  Random all(7, 3);
  for (int i = 0; i < 9; ++i) all.word();
  Random late(7, 3, 9);
  CHECK(all.word() == late.word());
  CHECK(Random(7, 3).word() != Random(7, 4).word());
  CHECK(Random(7, 3).word() != Random(8, 3).word());
}

TEST_CASE("moments of the distributions") {
  constexpr int n = 200'000;
  Random random(1);
  double mean = 0, square = 0, fourth = 0, uniform = 0, low = 1, high = 0;
  std::array<int, 5> counts{};
  for (int i = 0; i < n; ++i) {
    const double x = random.normal();
    mean += x / n;
    square += x * x / n;
    fourth += x * x * x * x / n;
    const double u = random.uniform();
    uniform += u / n;
    low = std::min(low, u);
    high = std::max(high, u);
    ++counts[random.below(5)];
  }
  CHECK(mean == doctest::Approx(0).epsilon(0.01));
  CHECK(std::abs(square - 1) < 0.02);
  CHECK(std::abs(fourth - 3) < 0.12);
  CHECK(std::abs(uniform - 0.5) < 0.005);
  CHECK(low >= 0);
  CHECK(high < 1);
  for (const int count : counts) CHECK(std::abs(count - n / 5) < 1000);
}
