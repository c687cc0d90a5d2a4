// Built without rbres::io: the exported headers need the core and Eigen only.
#include <cstring>

#include <doctest/doctest.h>

#include "exported_double.hpp"
#include "exported_float.hpp"
#include "io_export_models.hpp"

namespace {

template <class Network>
void check_same_bits(const Network& exported, const Network& original) {
  using Input = typename Network::Input;
  for (int i = 0; i < 20; ++i) {
    const Input x = Input::Random();
    const auto a = exported.forward(x), b = original.forward(x);
    CHECK(std::memcmp(a.data(), b.data(), sizeof a) == 0);
    CHECK(b.norm() > 0);
  }
}

}  // namespace

TEST_CASE("an exported network gives the same bits") {
  check_same_bits(exported_f::network(), exported_float());
  check_same_bits(exported_d::network(), exported_double());
  static_assert(exported_f::weights[0] != 0);
}
