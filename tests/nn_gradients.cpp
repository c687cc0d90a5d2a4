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
      for (int r = 0; r < tensor.rows; ++r) net.parameters()[tensor.index(r)] += draw();
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
  check_gradients<Sequential<Linear<4, 9>, LayerNorm<9>, Linear<9, 2>>>();
  check_gradients<Sequential<LayerNorm<4>, Tanh, Linear<4, 19>, Silu, LayerNorm<19>>>();
  check_gradients<
      Sequential<Linear<4, 9>, Residual<LayerNorm<9>, Linear<9, 9>, Tanh, LayerNorm<9>>, Linear<9, 2>>>();
  check_gradients<Sequential<Linear<4, 9>, FixedDropout<40>, Tanh, Dropout, Linear<9, 2>>>();
  check_gradients<Sequential<Sequential<Linear<4, 9>, Sequential<Tanh, Linear<9, 9>>>,
                             Residual<Sequential<Linear<9, 9>, Silu>>, Sequential<Linear<9, 2>>>>();
  check_gradients<ResidualNetwork<double, 7, 20, 2, 3>::Architecture>();
  check_gradients<FeedForwardNetwork<double, 7, 20, 2, 3>::Architecture>();
}

TEST_CASE_TEMPLATE(
    "forward passes agree, and derivatives by the input with automatic differentiation", Net,
    ResidualNetwork<double, 19, 24, 2, 13>, FeedForwardNetwork<double, 19, 24, 2, 13>,
    Network<double, Sequential<Residual<Linear<5, 5>, Silu>, Tanh, Linear<5, 33>>>,
    Network<double, Sequential<Linear<5, 9>, Residual<Residual<Linear<9, 9>>, Silu>, Dropout>>,
    Network<double,
            Sequential<Linear<5, 9>, LayerNorm<9>, Tanh, Residual<Sequential<Linear<9, 9>, LayerNorm<9>>>,
                       FixedDropout<50>, Linear<9, 3>>>) {
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

TEST_CASE("a layer norm gives mean 0 and variance 1, whatever the scale, and starts so") {
  using Net = Network<float, Sequential<LayerNorm<21>>>;
  const Net net(1);
  Random random(7);
  for (const double scale : {1.0, 100.0}) {
    const Net::Input x =
        Net::Input::NullaryExpr([&] { return static_cast<float>(scale * random.normal() + 3); });
    const Eigen::VectorXd y = net.forward(x).cast<double>();
    CHECK(std::abs(y.mean()) < 1e-6);
    CHECK((y.array() - y.mean()).square().mean() == doctest::Approx(1).epsilon(1e-4));
  }
}

TEST_CASE("a Dropout with a rate of its own has that, in training alone") {
  using Fixed = Network<double, Sequential<Linear<1, 4000>, FixedDropout<30>>>;
  using Shared = Network<double, Sequential<Linear<1, 4000>, Dropout>>;
  const auto share = [](const auto& net, const DropoutMask& mask) {
    using Net = std::decay_t<decltype(net)>;
    Tape<Net> tape(2);
    Matrix x = Matrix::Ones(1, 2), y(4000, 2);
    tape.record(net, x, y, mask);
    CHECK((mask.rate < 0 || y.col(0) != y.col(1)));
    return (y.col(0).array() == 0).cast<double>().mean();
  };
  CHECK(share(Fixed(1), {0.8, 1, 2}) == doctest::Approx(0.3).epsilon(0.08));
  CHECK(share(Fixed(1), {0, 1, 2}) == doctest::Approx(0.3).epsilon(0.08));
  CHECK(share(Fixed(1), {}) == 0);
  CHECK(share(Shared(1), {0.8, 1, 2}) == doctest::Approx(0.8).epsilon(0.08));
}

TEST_CASE("names are those of nested nn.Sequential") {
  using Net = Network<float, Sequential<Sequential<Linear<4, 9>, Sequential<Tanh, Linear<9, 9>>>,
                                        LayerNorm<9>, Residual<Sequential<LayerNorm<9>, Linear<9, 9>>>>>;
  std::vector<std::string> names;
  for (const ParameterTensor& tensor : Net::tensors())
    if (names.empty() || !tensor.name.ends_with("bias")) names.push_back(tensor.name);
  CHECK(names ==
        std::vector<std::string>{"0.0.weight", "0.1.1.weight", "1.weight", "2.0.0.weight", "2.0.1.weight"});
  CHECK(Net::parameter_count == 9 * 5 + 9 * 10 + 18 + 18 + 9 * 10);
}
