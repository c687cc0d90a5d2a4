#include <doctest/doctest.h>

#include <numeric>
#include <rbres/nn/nn.hpp>
#include <rbres/predict/decoded_loss.hpp>

using namespace rbres;

namespace {

using Net = Network<double, Sequential<Linear<3, 8>, Tanh, Linear<8, 2>>>;

/// Heights (m) and speeds (m/s) some time after a fall, from height, speed and time before; far from 0 and 1.
struct Falls {
  Eigen::MatrixXd x, y;
  Normalizer<double, 3> input;
  Normalizer<double, 2> output;

  explicit Falls(Eigen::Index count) : x(3, count), y(2, count) {
    Random random(1, 95);
    for (Eigen::Index i = 0; i < count; ++i) {
      const double height = random.uniform(50, 90), speed = random.uniform(-3, 3),
                   time = random.uniform(0.1, 1);
      x.col(i) << height, speed, time;
      y.col(i) << height + speed * time - 9.81 / 2 * time * time, speed - 9.81 * time;
    }
    const auto all = [](auto, auto) { return true; };
    input = input.fit(x, all), output = output.fit(y, all);
    for (Eigen::Index i = 0; i < count; ++i) {
      x.col(i) = input.normalize(x.col(i));
      y.col(i) = output.normalize(y.col(i));
    }
  }
  Samples<double> samples() const { return {columns(x), columns(y)}; }
  /// The square of how much energy per mass (J/kg) a prediction gains, times a factor.
  Loss<double> with_energy(double factor) const {
    Loss<double> loss;
    loss.extra =
        decoded_term(input, output, [=](Eigen::Index, const auto& from, const auto& to, auto& gradient) {
          const double gain = 9.81 * (to[0] - from[0]) + (to[1] * to[1] - from[1] * from[1]) / 2;
          gradient += 2 * factor * gain * Eigen::Vector2d(9.81, to[1]);
          return factor * gain * gain;
        });
    return loss;
  }
};

}  // namespace

TEST_CASE("a term in SI units sees what the normalised numbers mean, and its gradient is that of the loss") {
  const Falls falls(20);
  const Loss<double> loss = falls.with_energy(0.01);
  // The truth keeps its energy.
  Eigen::Vector2d truth = falls.y.col(7), gradient;
  CHECK(loss.evaluate(falls.samples(), 7, truth.data(), gradient.data()) < 1e-20);
  const double speed = falls.output.restore(truth)[1];
  truth[1] += 0.1;
  const double faster = falls.output.restore(truth)[1], gain = (faster * faster - speed * speed) / 2;
  CHECK(std::abs(gain) > 0.1);
  CHECK(loss.evaluate(falls.samples(), 7, truth.data(), gradient.data()) ==
        doctest::Approx(0.01 + 0.01 * gain * gain));

  Net net(1);
  Backpropagation<Net> pass(20);
  std::vector<std::uint32_t> order(20);
  std::iota(order.begin(), order.end(), 0u);
  const auto run = [&] { return pass.run(net, falls.samples(), loss, order, {}, {}); };
  run();
  ParameterGradient<Net> found;
  pass.parameter_gradient({}, [&](std::size_t at, const auto& g, bool) {
    std::memcpy(found.numbers().data() + at, &g, sizeof g);
  });
  for (const ParameterTensor& tensor : Net::tensors())
    for (int r = 0; r < tensor.rows; ++r) {
      double& w = net.parameters()[tensor.index(r)];
      const double at = w, h = 1e-5;
      w = at + h;
      const double more = run();
      w = at - h;
      const double less = run();
      w = at;
      CHECK(found.numbers()[tensor.index(r)] == doctest::Approx((more - less) / (2 * h)).epsilon(1e-5));
    }
}

TEST_CASE("training with an energy term gains less energy than training without") {
  const Falls falls(200);
  const auto gain = [&](double factor) {
    Trainer trainer(Net(1), falls.samples(), {},
                    {.epochs = 120, .batch_size = 20, .schedule = {.initial = 1e-2}, .l2 = 0, .threads = 1},
                    Adam{}, falls.with_energy(factor));
    trainer.train();
    return mean_loss(trainer.best(), falls.samples(), falls.with_energy(1)) -
           mean_loss(trainer.best(), falls.samples());
  };
  CHECK(gain(0.1) < 0.5 * gain(0));
}
