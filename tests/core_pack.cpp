#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <rbres/core/pack.hpp>
#include <rbres/core/philox.hpp>

using namespace rbres;

TEST_CASE_TEMPLATE("a pack computes lane by lane what a number computes", P, Pack<float, 4>, Pack<float, 8>,
                   Pack<float, 16>, Pack<float, 32>, Pack<double, 2>, Pack<double, 4>, Pack<double, 8>,
                   Pack<double, 16>) {
  using T = typename ScalarTraits<P>::Value;
  constexpr int lanes = ScalarTraits<P>::lanes;
  static_assert(std::is_trivially_copyable_v<P> && sizeof(P) == lanes * sizeof(T));
  Random random(1, lanes);
  for (int round = 0; round < 100; ++round) {
    P a, b;
    for (int i = 0; i < lanes; ++i) {
      ScalarTraits<P>::set_lane(a, i, T(random.uniform(-3.0, 3.0)));
      ScalarTraits<P>::set_lane(b, i, round % 3 ? T(random.uniform(-3.0, 3.0)) : a[i]);
    }
    const auto same = [&](const P& packed, auto&& of_lane) {
      for (int i = 0; i < lanes; ++i) CHECK(packed[i] == of_lane(a[i], b[i]));
    };
    same(a + b, [](T x, T y) { return x + y; });
    same(a - b, [](T x, T y) { return x - y; });
    same(a * b, [](T x, T y) { return x * y; });
    same(a / b, [](T x, T y) { return x / y; });
    same(-a, [](T x, T) { return -x; });
    same(abs(a), [](T x, T) { return std::abs(x); });
    same(sqrt(abs(a)), [](T x, T) { return std::sqrt(std::abs(x)); });
    same(minimum(a, b), [](T x, T y) { return std::min(x, y); });
    same(maximum(a, b), [](T x, T y) { return std::max(x, y); });
    same(P(T(0.1)), [](T, T) { return T(0.1); });
    P sum = a;
    sum += b;
    same(sum, [](T x, T y) { return x + y; });
    sum -= b;
    same(sum, [](T x, T y) { return (x + y) - y; });
    sum = a;
    sum *= b;
    same(sum, [](T x, T y) { return x * y; });

    const auto same_mask = [&](const MaskOf<P>& mask, auto&& of_lane) {
      bool some = false, every = true;
      for (int i = 0; i < lanes; ++i) {
        const bool expected = of_lane(a[i], b[i]);
        CHECK(mask[i] == expected);
        CHECK(select(mask, a, b)[i] == (expected ? a[i] : b[i]));
        some = some || expected;
        every = every && expected;
      }
      CHECK(any(mask) == some);
      CHECK(all(mask) == every);
    };
    same_mask(a < b, [](T x, T y) { return x < y; });
    same_mask(a > b, [](T x, T y) { return x > y; });
    same_mask(a <= b, [](T x, T y) { return x <= y; });
    same_mask(a >= b, [](T x, T y) { return x >= y; });
    same_mask(a == b, [](T x, T y) { return x == y; });
    same_mask((a < b) & (a > P(0)), [](T x, T y) { return x < y && x > 0; });
    same_mask((a < b) | (a > P(0)), [](T x, T y) { return x < y || x > 0; });
    same_mask(!(a < b), [](T x, T y) { return !(x < y); });
    same_mask(true, [](T, T) { return true; });
    same_mask(false, [](T, T) { return false; });
  }
}

TEST_CASE_TEMPLATE("any and all see a single lane", P, Pack<float, 4>, Pack<float, 8>, Pack<float, 16>,
                   Pack<float, 32>, Pack<double, 2>, Pack<double, 4>, Pack<double, 8>, Pack<double, 16>) {
  using T = typename ScalarTraits<P>::Value;
  for (int i = 0; i < ScalarTraits<P>::lanes; ++i) {
    P one(T(0));
    ScalarTraits<P>::set_lane(one, i, T(1));
    CHECK(any(one > P(T(0))));
    CHECK_FALSE(all(one < P(T(1))));
    ScalarTraits<P>::set_lane(one, i, std::numeric_limits<T>::quiet_NaN());
    CHECK_FALSE(all(is_finite(one)));
    CHECK(any(is_finite(one)) == (ScalarTraits<P>::lanes > 1));
  }
}

TEST_CASE_TEMPLATE("inverses and roots are right to two units in the last place", P, Pack<float, 16>,
                   Pack<float, 4>, Pack<double, 8>, float, double) {
  using T = typename ScalarTraits<P>::Value;
  Random random(2, 0);
  for (int round = 0; round < 1000; ++round) {
    P x;
    for (int i = 0; i < ScalarTraits<P>::lanes; ++i)
      ScalarTraits<P>::set_lane(x, i, T(std::exp(random.uniform(-80.0, 80.0))));
    for (int i = 0; i < ScalarTraits<P>::lanes; ++i) {
      const auto near = [&](const P& found, double expected) {
        const double unit = expected * double(std::numeric_limits<T>::epsilon());
        return std::abs(double(ScalarTraits<P>::lane(found, i)) - expected) <= 2 * unit;
      };
      const double exact = double(ScalarTraits<P>::lane(x, i));
      CHECK(near(inverse(x), 1 / exact));
      CHECK(near(root(x), std::sqrt(exact)));
      CHECK(near(positive_root(x), std::sqrt(exact)));
      CHECK(near(inverse_root(x), 1 / std::sqrt(exact)));
    }
  }
}
