#include <doctest/doctest.h>

#include <rbres/nn/nn.hpp>

#include "../examples/common/count_allocations.hpp"

using namespace rbres;

namespace {

using Paper = ResidualNetwork<float, 95, 256, 10, 65>;
using Plain = FeedForwardNetwork<float, 95, 256, 10, 65>;

static_assert(Paper::input_size == 95 && Paper::output_size == 65);
static_assert(Paper::parameter_count == 95 * 256 + 256 + 20 * (256 * 256 + 256) + 256 * 65 + 65);
static_assert(Plain::parameter_count == Paper::parameter_count);
static_assert(Paper::block_size == Paper::parameter_count + 15 * 257, "65 outputs fill 80 places");
static_assert(std::is_copy_constructible_v<Paper> && std::is_nothrow_move_constructible_v<Paper>);
static_assert(noexcept(std::declval<const Paper&>().forward(std::declval<const Paper::Input&>())));
static_assert(noexcept(std::declval<const Paper&>().vjp(std::declval<const Paper::Input&>(),
                                                        std::declval<const Paper::Output&>(),
                                                        std::declval<Paper::Workspace&>())));
static_assert(std::is_empty_v<Paper::Architecture>, "layers have no state");

// A skip is added in place, so that the paper's network needs two buffers at any depth.
static_assert(Paper::Compiled::slot_count == 2 && Paper::Compiled::stage_count == 22);
static_assert(detail::Compiled<Sequential<Residual<Residual<Linear<3, 3>, Linear<3, 3>>>>>::slot_count == 3);

}  // namespace

TEST_CASE("forward passes and derivatives by the input allocate nothing") {
  const Paper net(1);
  Paper::Workspace workspace;
  const Paper::Input x = Paper::Input::Random(), v = Paper::Input::Random();
  const Paper::Output w = Paper::Output::Random();
  const Eigen::MatrixXf inputs = Eigen::MatrixXf::Random(95, 200);
  Eigen::MatrixXf outputs(65, 200);

  const long before = allocations;
  Paper::Output y = net.forward(x);
  net.forward(inputs, outputs, workspace);
  net.forward(inputs.leftCols(8), outputs.leftCols(8), workspace);
  y += net.jvp(x, v, workspace);
  const Paper::Input g = net.vjp(x, w, workspace);
  CHECK(allocations == before);
  CHECK(std::isfinite(y.sum() + g.sum() + outputs.sum()));

  const Paper copy = net;
  CHECK(allocations == before + 1);
}

TEST_CASE("a copy is a copy") {
  const Paper::Input x = Paper::Input::Random();
  Paper net(1);
  const Paper copy = net;
  CHECK(copy.parameters().data() != net.parameters().data());
  const Paper::Output before = net.forward(x);
  for (float& p : net.parameters()) p *= 2;
  CHECK(net.forward(x) != before);
  CHECK(copy.forward(x) == before);
  net = copy;
  CHECK(net.forward(x) == before);
}

TEST_CASE("tensors have PyTorch's names, and cover the block without a gap or an overlap") {
  using Net = ResidualNetwork<float, 3, 20, 2, 5>;
  std::vector<std::string> names;
  std::vector<int> uses(Net::block_size, 0);
  std::size_t numbers = 0;
  for (const ParameterTensor& tensor : Net::tensors()) {
    names.push_back(tensor.name);
    for (int r = 0; r < tensor.rows; ++r)
      for (int c = 0; c < tensor.columns; ++c, ++numbers) ++uses.at(tensor.index(r, c));
  }
  CHECK(names == std::vector<std::string>{"0.weight", "0.bias", "2.0.weight", "2.0.bias", "2.3.weight",
                                          "2.3.bias", "3.0.weight", "3.0.bias", "3.3.weight", "3.3.bias",
                                          "4.weight", "4.bias"});
  CHECK(numbers == Net::parameter_count);
  CHECK(std::count(uses.begin(), uses.end(), 1) == static_cast<std::ptrdiff_t>(numbers));
  CHECK(std::count(uses.begin(), uses.end(), 0) == static_cast<std::ptrdiff_t>(Net::block_size - numbers));
}

TEST_CASE("a network computes what its definition says") {
  using Net = ResidualNetwork<double, 3, 20, 1, 5>;
  Net net(1);
  Random random(2);
  std::vector<Eigen::MatrixXd> p;  // W, b of each Linear
  for (const ParameterTensor& tensor : Net::tensors()) {
    p.emplace_back(tensor.rows, tensor.columns);
    for (int r = 0; r < tensor.rows; ++r)
      for (int c = 0; c < tensor.columns; ++c)
        net.parameters()[tensor.index(r, c)] = p.back()(r, c) = random.normal();
  }
  const Net::Input x(0.3, -1.2, 0.7);
  const Eigen::VectorXd h = (p[0] * x + p[1]).cwiseMax(0);
  const Eigen::VectorXd g = h + p[4] * (p[2] * h + p[3]).cwiseMax(0) + p[5];
  CHECK((net.forward(x) - (p[6] * g + p[7])).norm() < 1e-12 * g.norm());
}

TEST_CASE("He initialisation: moments, zero biases, a function of the seed") {
  const Paper net(1);
  CHECK(std::ranges::equal(net.parameters(), Paper(1).parameters()));
  CHECK(!std::ranges::equal(net.parameters(), Paper(2).parameters()));
  for (const ParameterTensor& tensor : Paper::tensors()) {
    double mean = 0, square = 0;
    for (int r = 0; r < tensor.rows; ++r)
      for (int c = 0; c < tensor.columns; ++c) {
        const double p = static_cast<double>(net.parameters()[tensor.index(r, c)]);
        mean += p / (tensor.rows * tensor.columns);
        square += p * p / (tensor.rows * tensor.columns);
      }
    CHECK(std::abs(mean) < (tensor.is_bias ? 1e-30 : 0.005));
    CHECK(square == doctest::Approx(tensor.is_bias ? 0 : 2.0 / tensor.columns).epsilon(0.05));
  }
}

TEST_CASE("a NaN in the input is not hidden by a ReLU") {
  Paper::Input x = Paper::Input::Random();
  x[7] = std::numeric_limits<float>::quiet_NaN();
  CHECK(std::isnan(Paper(1).forward(x)[0]));
}

TEST_CASE("matrices of another shape are refused") {
  const Paper net(1);
  Paper::Workspace workspace;
  const Eigen::MatrixXf inputs = Eigen::MatrixXf::Random(95, 4);
  Eigen::MatrixXf outputs(65, 3);
  CHECK_THROWS_WITH_AS(net.forward(inputs, outputs, workspace),
                       "Network::forward: outputs: expected 65 x 4, found 65 x 3", Error);
  CHECK_THROWS_WITH_AS(net.forward(outputs, outputs, workspace),
                       "Network::forward: inputs: expected 95 x 3, found 65 x 3", Error);
}
