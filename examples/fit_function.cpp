// Fits a network to a function of two variables. Prints the loss as it falls, and a value beside the
// network's.
#include <rbres/nn/nn.hpp>

#include <cmath>
#include <cstdio>

#include "common/help.hpp"

using namespace rbres;

int main(int argc, char** argv) {
  if (argc > 1)
    return answer(argc, argv, "Fits a network to a function of two variables and prints its loss.");

  constexpr int count = 2000;
  Eigen::MatrixXf inputs(2, count), targets(1, count);
  Random random(1);
  for (int i = 0; i < count; ++i) {
    const double x = random.uniform(-2, 2), y = random.uniform(-2, 2);
    inputs.col(i) << static_cast<float>(x), static_cast<float>(y);
    targets(0, i) = static_cast<float>(std::sin(2 * x) * std::exp(-y * y));
  }
  const Eigen::MatrixXf validation = inputs.rightCols(400), expected = targets.rightCols(400);
  const Eigen::MatrixXf train = inputs.leftCols(1600), wanted = targets.leftCols(1600);

  using Net =
      Network<float,
              Sequential<Linear<2, 64>, Silu, Residual<Linear<64, 64>, Silu, Linear<64, 64>>, Linear<64, 1>>>;
  Trainer trainer(Net(1), {columns(train), columns(wanted)}, {columns(validation), columns(expected)},
                  {.epochs = 60, .schedule = {.kind = Schedule::Kind::cosine, .initial = 3e-3}, .l2 = 1e-7});
  std::printf("epoch  training loss  validation loss\n");
  trainer.train([](const EpochReport& report) {
    if (report.epoch % 5 == 0 || report.epoch == 1)
      std::printf("%5d  %13.6f  %15.6f\n", static_cast<int>(report.epoch), report.train_loss,
                  report.validation_loss);
    return true;
  });
  const float y = trainer.best().forward({0.5f, 0.5f})[0];
  std::printf("f(0.5, 0.5) = %.4f, the network says %.4f\n", std::sin(1.0) * std::exp(-0.25),
              static_cast<double>(y));
  return finish(argv);
}
