// Weights of half the size: what they round to, and that a network computes with them what a float network
// of the same numbers does.
#include <doctest/doctest.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <rbres/nn/nn.hpp>
#include <vector>

using namespace rbres;

namespace {

static_assert(sizeof(bfloat16) == 2 && std::is_trivially_copyable_v<bfloat16>);
static_assert(WeightOf<bfloat16, float> && !WeightOf<bfloat16, double> && !WeightOf<float, double>);
static_assert(float(bfloat16(1.0f)) == 1 && float(bfloat16(-0.15625f)) == -0.15625f);
static_assert(bfloat16(1.00390625f).bits == 0x3f80 && bfloat16(1.01171875f).bits == 0x3f82, "ties to even");

/// A float network of numbers that a bfloat16 has, and the same with half the memory.
template <class Half>
struct Pair {
  using Whole = Network<float, typename Half::Architecture>;
  Half half{Whole(3)};
  Whole whole{half};
};

/// To rounding: compilers may fuse multiplications and additions in either.
template <class A, class B>
bool same(const A& a, const B& b) {
  return (a - b).norm() <= 1e-6f * b.norm();
}

}  // namespace

TEST_CASE("every half is read as the float that it is half of, and rounds to itself") {
  for (std::uint32_t bits = 0; bits < 65536; ++bits) {
    const bfloat16 half = bfloat16::of_bits(static_cast<std::uint16_t>(bits));
    const float x = half;
    std::uint32_t whole;
    std::memcpy(&whole, &x, sizeof whole);
    REQUIRE(whole == bits << 16);
    if (!std::isnan(x)) REQUIRE(bfloat16(x).bits == bits);
  }
}

TEST_CASE("a float becomes the nearest half, with ties to even") {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  Random random(4);
  for (int i = 0; i < 200'000; ++i) {
    const float x = static_cast<float>(random.normal() * std::pow(2.0, random.uniform(-140.0, 120.0)));
    const bfloat16 near = bfloat16(x);
    const auto distance = [x](std::uint16_t bits) {
      return std::abs(static_cast<double>(float(bfloat16::of_bits(bits))) - static_cast<double>(x));
    };
    for (const int step : {-1, 1}) {
      const auto other = static_cast<std::uint16_t>(near.bits + step);
      if ((near.bits & 0x7fff) == 0 && step < 0) continue;  // of the other sign
      const double d = distance(other);
      REQUIRE(distance(near.bits) <= d);
      if (distance(near.bits) == d) REQUIRE(near.bits % 2 == 0);
    }
  }
  CHECK(float(bfloat16(infinity)) == infinity);
  CHECK(float(bfloat16(-std::numeric_limits<float>::max())) == -infinity);
  CHECK(std::isnan(float(bfloat16(std::numeric_limits<float>::quiet_NaN()))));
  std::uint32_t bits = 0x7f800001;  // a NaN whose upper half is infinity
  float x;
  std::memcpy(&x, &bits, sizeof x);
  CHECK(std::isnan(float(bfloat16(x))));
}

TEST_CASE_TEMPLATE(
    "half the memory, and what the float network of the same numbers says", Half,
    ResidualNetwork<float, 95, 256, 4, 65, bfloat16>, ResidualNetwork<float, 3, 20, 2, 5, bfloat16>,
    FeedForwardNetwork<float, 7, 33, 1, 2, bfloat16>,
    Network<float,
            Sequential<Linear<17, 40>, LayerNorm<40>, Silu, Residual<Linear<40, 40>, Tanh>, Linear<40, 1>>,
            bfloat16>,
    Network<float, Sequential<Linear<1, 1>>, bfloat16>) {
  const Pair<Half> pair;
  using Whole = typename Pair<Half>::Whole;
  static_assert(Half::block_size == Whole::block_size);
  CHECK(2 * pair.half.parameters().size_bytes() == pair.whole.parameters().size_bytes());
  const typename Half::Input x = Half::Input::Random(), v = Half::Input::Random();
  const typename Half::Output w = Half::Output::Random();
  CHECK(same(pair.half.forward(x), pair.whole.forward(x)));
  typename Half::Workspace half_scratch;
  typename Whole::Workspace whole_scratch;
  CHECK(same(pair.half.jvp(x, v, half_scratch), pair.whole.jvp(x, v, whole_scratch)));
  CHECK(same(pair.half.vjp(x, w, half_scratch), pair.whole.vjp(x, w, whole_scratch)));
  for (int batch = 0; batch < 40; ++batch) {
    const Eigen::MatrixXf in = Eigen::MatrixXf::Random(Half::input_size, batch);
    Eigen::MatrixXf half(int(Half::output_size), batch), whole(int(Half::output_size), batch);
    pair.half.forward(in, half, half_scratch);
    pair.whole.forward(in, whole, whole_scratch);
    CHECK(same(half, whole));
  }
  const auto wide = x.template cast<double>().eval();
  CHECK((pair.half.forward(wide) - pair.whole.forward(wide)).norm() <=
        1e-12 * pair.whole.forward(wide).norm());
}

TEST_CASE_TEMPLATE("every number of a tensor has a place of its own, and the rest of the block is filling",
                   Net, ResidualNetwork<float, 95, 256, 1, 65, bfloat16>,
                   ResidualNetwork<float, 3, 20, 2, 5, bfloat16>, ResidualNetwork<float, 3, 100, 1, 49>,
                   ResidualNetwork<double, 5, 20, 1, 9>) {
  std::vector<int> used(Net::block_size);
  for (const ParameterTensor& tensor : Net::tensors())
    for (int row = 0; row < tensor.rows; ++row)
      for (int column = 0; column < tensor.columns; ++column) ++used.at(tensor.index(row, column));
  CHECK(std::ranges::count(used, 1) == static_cast<std::ptrdiff_t>(Net::parameter_count));
  CHECK(std::ranges::count(used, 0) == static_cast<std::ptrdiff_t>(Net::block_size - Net::parameter_count));
}

TEST_CASE("rounding the weights changes what a network says by little") {
  using Net = ResidualNetwork<float, 95, 256, 4, 65>;
  const Net whole(5);
  const ResidualNetwork<float, 95, 256, 4, 65, bfloat16> half(whole);
  const auto halves = half.tensors(), wholes = whole.tensors();
  for (std::size_t i = 0; i < wholes.size(); ++i)
    for (int row = 0; row < wholes[i].rows; ++row)
      for (int column = 0; column < wholes[i].columns; ++column)
        REQUIRE(half.parameters()[halves[i].index(row, column)].bits ==
                bfloat16(whole.parameters()[wholes[i].index(row, column)]).bits);
  const Net::Input x = Net::Input::Random();
  const float difference = (half.forward(x) - whole.forward(x)).norm();
  CHECK(difference > 0);
  CHECK(difference < 0.02f * whole.forward(x).norm());
}
