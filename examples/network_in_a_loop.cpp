// Trains a network to predict the next state of a pendulum, then runs it in a loop. Prints how long a step
// takes, how far the angle is off at most, and that the loop allocates nothing, which is proven by counting.
#include <rbres/nn/nn.hpp>

#include <chrono>
#include <cmath>
#include <cstdio>

#include "common/count_allocations.hpp"
#include "common/help.hpp"

using namespace rbres;

int main(int argc, char** argv) {
  if (argc > 1)
    return answer(
        argc, argv,
        "Trains a network to predict a pendulum, runs it in a loop, and counts what that allocates.");

  constexpr float step = 0.05f;
  const auto next =
      [](Eigen::Vector2f s) {  // angle in rad, angular velocity in rad/s; semi-implicit Euler in small steps
        for (int i = 0; i < 50; ++i) {
          s[1] -= step / 50 * 9.81f * std::sin(s[0]);
          s[0] += step / 50 * s[1];
        }
        return s;
      };
  constexpr int count = 4000;
  Eigen::MatrixXf states(2, count), changes(2, count);
  Random random(1);
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector2f s(static_cast<float>(random.uniform(-1, 1)),
                            static_cast<float>(random.uniform(-3, 3)));
    const Eigen::Vector2f change = next(s) - s;
    for (int r = 0; r < 2; ++r) states(r, i) = s[r], changes(r, i) = change[r];
  }
  using Net = Network<float, Sequential<Linear<2, 32>, Tanh, Linear<32, 32>, Tanh, Linear<32, 2>>>;
  Trainer trainer(Net(1), {columns(states), columns(changes)}, {},
                  {.epochs = 100, .schedule = {.kind = Schedule::Kind::cosine, .initial = 3e-3}, .l2 = 0});
  trainer.train();
  const Net net = trainer.best();

  constexpr int steps = 100;
  Eigen::Vector2f predicted(0.5f, 0.0f), truth = predicted;
  float worst = 0;
  const long before = allocations;
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < steps; ++i) {
    predicted += net.forward(predicted);
    truth = next(truth);
    worst = std::max(worst, std::abs(predicted[0] - truth[0]));
  }
  const std::chrono::duration<double, std::micro> passed = std::chrono::steady_clock::now() - start;
  std::printf("%d steps of a pendulum, %.2f us each; angle wrong by at most %.4f rad\n", steps,
              passed.count() / steps, static_cast<double>(worst));
  std::printf("allocations in the loop: %ld\n", allocations - before);
  return allocations == before ? finish(argv) : 1;
}
