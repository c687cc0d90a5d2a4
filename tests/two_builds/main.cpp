// One program of files compiled for two instruction sets: both give the same, and an Error passes between
// them.
#include "work.hpp"

#include <doctest/doctest.h>

#include <rbres/core/error.hpp>

TEST_CASE("files for two instruction sets stand in one program") {
  const Results one = plain::work(), other = wide::work();
  CHECK(one.network > 0);
  CHECK(one.network == doctest::Approx(other.network).epsilon(1e-5));
  CHECK(one.norm == 7);
  CHECK(other.norm == 7);
  CHECK(one.sum == 6);
  CHECK(other.sum == 6);
  CHECK_THROWS_AS(plain::refuse(), rbres::Error);
  CHECK_THROWS_AS(wide::refuse(), rbres::Error);
}
