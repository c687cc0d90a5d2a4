#include <doctest/doctest.h>

#include <rbres/nn/nn.hpp>

#include <unsupported/Eigen/AutoDiff>

#include <numeric>

using namespace rbres;

namespace {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

/// (4 D(h) - D(2h)) / 3 with central differences D: the error falls with h^4.
template <class F>
double slope(double& x, const F& f) {
  const double h = 1e-4, at = x;
  const auto value = [&](double shift) { return x = at + shift, f(); };
  const double difference = (8 * (value(h) - value(-h)) - (value(2 * h) - value(-2 * h))) / (12 * h);
  x = at;
  return difference;
}

/// Gradients of the weighted loss with a user's term, dropout mask fixed, against differences: by every
/// parameter and input.
template <class Layers>
void check_gradients() {
  using Net = Network<double, Layers>;
  constexpr Eigen::Index count = 5;
  Net net(3);
  Random random(4);
  const auto draw = [&] { return random.normal(); };
  for (const ParameterTensor& tensor : Net::tensors())
    if (tensor.is_bias)
      for (int r = 0; r < tensor.rows; ++r) net.parameters()[tensor.index(r)] = draw();
  Matrix x = Matrix::NullaryExpr(Net::input_size, count, draw);
  const Matrix targets = Matrix::NullaryExpr(Net::output_size, count, draw);
  const Matrix weights = Matrix::NullaryExpr(Net::output_size, count, draw).cwiseAbs();
  const Samples<double> samples{columns(x), columns(targets), columns(weights)};
  Loss<double> loss;
  loss.output_weights.resize(Net::output_size);
  for (double& w : loss.output_weights) w = random.uniform(0.5, 2);
  loss.extra = [](Eigen::Index, auto, auto output, auto gradient) {
    gradient += 0.3 * output.array().cos().matrix();
    return 0.3 * output.array().sin().sum();
  };

  std::vector<std::uint32_t> order(count);
  std::iota(order.begin(), order.end(), 0u);
  Backpropagation<Net> pass(count);
  const auto run = [&] { return pass.run(net, samples, loss, order, {0.3, 5, 6}, {}, true); };
  run();
  const Matrix by_input = pass.input_gradient();
  AlignedBuffer<double> by_parameters(Net::block_size);
  pass.parameter_gradient(
      {}, [&](std::size_t at, const auto& g, bool) { detail::store(by_parameters.data() + at, g); });

  double worst = 0;
  const auto compare = [&](double& number, double gradient) {
    const double expected = slope(number, run);
    worst = std::max(worst, std::abs(gradient - expected) / std::max(1.0, std::abs(expected)));
  };
  for (const ParameterTensor& tensor : Net::tensors())
    for (int r = 0; r < tensor.rows; ++r)
      for (int c = 0; c < tensor.columns; ++c) {
        const std::size_t at = tensor.index(r, c);
        compare(net.parameters()[at], by_parameters[at]);
      }
  for (Eigen::Index i = 0; i < x.size(); ++i) compare(x.data()[i], by_input.data()[i]);
  CHECK(worst < 1e-7);
  CHECK(by_input.norm() > 1e-3);
}

}  // namespace

TEST_CASE("gradients of each layer and of whole networks agree with central differences") {
  check_gradients<Sequential<Linear<5, 3>>>();
  check_gradients<Sequential<Linear<9, 17>>>();
  check_gradients<Sequential<Linear<4, 9>, Relu, Linear<9, 2>>>();
  check_gradients<Sequential<Linear<4, 9>, Tanh, Linear<9, 2>>>();
  check_gradients<Sequential<Linear<4, 9>, Silu>>();
  check_gradients<Sequential<Linear<4, 9>, Dropout, Linear<9, 2>>>();
  check_gradients<Sequential<Tanh, Linear<4, 9>, Tanh, Dropout, Silu, Dropout, Linear<9, 2>>>();
  check_gradients<Sequential<Linear<4, 9>, Residual<Linear<9, 9>>, Linear<9, 2>>>();
  check_gradients<Sequential<Residual<Linear<4, 9>, Tanh, Linear<9, 4>>, Tanh>>();
  check_gradients<Sequential<Linear<4, 9>, Tanh, Residual<Tanh, Linear<9, 9>, Silu>, Linear<9, 2>>>();
  check_gradients<
      Sequential<Linear<4, 9>, Residual<Residual<Linear<9, 9>>, Tanh, Linear<9, 9>>, Linear<9, 2>>>();
  check_gradients<Sequential<Linear<4, 9>, Residual<Residual<Tanh>>, Linear<9, 2>>>();
  check_gradients<ResidualNetwork<double, 7, 20, 2, 3>::Architecture>();
  check_gradients<FeedForwardNetwork<double, 7, 20, 2, 3>::Architecture>();
}

TEST_CASE_TEMPLATE(
    "forward passes agree, and derivatives by the input with automatic differentiation", Net,
    ResidualNetwork<double, 19, 24, 2, 13>, FeedForwardNetwork<double, 19, 24, 2, 13>,
    Network<double, Sequential<Residual<Linear<5, 5>, Silu>, Tanh, Linear<5, 33>>>,
    Network<double, Sequential<Linear<5, 9>, Residual<Residual<Linear<9, 9>>, Silu>, Dropout>>) {
  using Dual = Eigen::AutoDiffScalar<Vector>;
  const Net net(1);
  typename Net::Workspace workspace;
  Random random(2);
  const auto draw = [&] { return random.normal(); };
  for (const Eigen::Index count : {1, 2, 8, 13, 96, 97, 200}) {
    const Matrix x = Matrix::NullaryExpr(Net::input_size, count, draw);
    Matrix y(Net::output_size, count);
    net.forward(x, y, workspace);
    for (Eigen::Index c = 0; c < count; ++c)
      CHECK((net.forward(typename Net::Input(x.col(c))) - y.col(c)).norm() < 1e-13 * y.col(c).norm());
  }

  const typename Net::Input x = Net::Input::NullaryExpr(draw), v = Net::Input::NullaryExpr(draw);
  const typename Net::Output w = Net::Output::NullaryExpr(draw);
  Eigen::Matrix<Dual, Net::input_size, 1> dual;
  for (int i = 0; i < Net::input_size; ++i) dual[i] = Dual(x[i], Net::input_size, i);
  const auto y = net.forward(dual);
  Matrix jacobian(Net::output_size, Net::input_size);
  for (int o = 0; o < Net::output_size; ++o) {
    CHECK(y[o].value() == doctest::Approx(net.forward(x)[o]).epsilon(1e-12));
    jacobian.row(o) = y[o].derivatives();
  }
  CHECK((net.jvp(x, v, workspace) - jacobian * v).norm() < 1e-12 * jacobian.norm());
  CHECK((net.vjp(x, w, workspace) - jacobian.transpose() * w).norm() < 1e-12 * jacobian.norm());
}
