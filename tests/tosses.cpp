#include "../examples/tosses/rollout_training.hpp"
#include "../examples/tosses/simulator.hpp"

#include <doctest/doctest.h>

using namespace rbres;
using namespace rbres::tosses;

namespace {

using Net = Network<double, Sequential<Linear<36, 16>, Tanh, Residual<Linear<16, 16>, Tanh, Linear<16, 16>>, Linear<16, 5>>>;

State falling(std::uint64_t seed) {
  Random random(seed);
  const auto vector = [&](double size) {
    return Vec3<double>{size * random.normal(), size * random.normal(), size * random.normal()};
  };
  State state{vector(0.1), rotation_of(vector(1)), vector(0.5), vector(2)};
  state.position.z = 0.07;
  return state;
}

}  // namespace

TEST_CASE("the pose error's gradient is that of central differences") {
  const State a = falling(1), b = falling(2);
  Adjoint gradient = Adjoint::Zero(), unused;
  pose_error(a, b, 1, gradient);
  for (int k = 0; k < 12; ++k) {
    const double h = 1e-6;
    const double slope = (pose_error(moved(a, k, h), b, 1, unused) - pose_error(moved(a, k, -h), b, 1, unused)) / (2 * h);
    CAPTURE(k);
    CHECK(gradient[k] == doctest::Approx(slope).epsilon(1e-6));
  }
}

TEST_CASE("the gradient through a rollout is that of central differences") {
  constexpr int frames = 6, count = 3;
  const double floor = -0.002;
  Prior prior = free_flight;
  SUBCASE("over free flight") {}
  SUBCASE("over the simulator") { prior = Simulator({.restitution = 0.1, .friction = 0.2}, floor); }
  CornerPredictor<Net> predictor{Net(5), prior, floor};
  std::vector<State> measured;
  std::vector<const State*> starts;
  for (int i = 0; i < count; ++i) {
    for (int t = 0; t <= frames; ++t) measured.push_back(falling(static_cast<std::uint64_t>(10 * i + t)));
  }
  for (int i = 0; i < count; ++i) starts.push_back(&measured[static_cast<std::size_t>(i * (frames + 1))]);
  const std::vector<int> turns{0, 1, 2};
  Rollouts<Net> rollouts(count, frames);
  rollouts.run(predictor, starts, turns);
  const auto adjoints = rollouts.adjoints();
  const auto gradient = rollouts.gradient();
  REQUIRE(adjoints[0].allFinite());

  const double h = 1e-6;
  for (int i = 0; i < count; ++i) {
    State& start = measured[static_cast<std::size_t>(i * (frames + 1))];
    const State kept = start;
    for (int k = 0; k < 12; ++k) {
      start = moved(kept, k, h);
      const double above = rollouts.run(predictor, starts, turns);
      start = moved(kept, k, -h);
      const double below = rollouts.run(predictor, starts, turns);
      start = kept;
      CAPTURE(i);
      CAPTURE(k);
      CHECK(adjoints[static_cast<std::size_t>(i)][k] == doctest::Approx((above - below) / (2 * h)).epsilon(1e-5));
    }
  }
  for (const ParameterTensor& tensor : Net::tensors()) {
    const std::size_t place = tensor.index(tensor.rows / 2, tensor.columns / 2);
    double& number = predictor.network.parameters()[place];
    const double kept = number;
    number = kept + h;
    const double above = rollouts.run(predictor, starts, turns);
    number = kept - h;
    const double below = rollouts.run(predictor, starts, turns);
    number = kept;
    CAPTURE(tensor.name);
    CHECK(gradient[place] == doctest::Approx((above - below) / (2 * h)).epsilon(1e-5));
  }
}
