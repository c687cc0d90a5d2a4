// One's own world, from its bodies to a predictor: two boxes are pushed about on a table, and a small network
// learns where they are a fifth of a second later. Prints how far it and others are off on 300 unseen starts
// (mean square position error, mean rotation) and how long each takes (for one of them, on one thread).
#include <cstdio>
#include <rbres/rbres.hpp>
#include "common/help.hpp"

using namespace rbres;

int main(int argc, char** argv) {
  if (argc > 1) return answer(argc, argv, "Learns where two boxes that are pushed about on a table will be.");
  const Material<double> wood{.restitution = 0.2, .friction = 0.4};
  const Body brick{Box{0.1, 0.08, 0.05}, 1.0, wood};
  const System<double, 2, Box<double>> world{{brick, brick}, {floor_plane(wood)}};
  const auto start = [](std::uint64_t seed, std::ptrdiff_t i) {
    Random random(seed, static_cast<std::uint64_t>(i));
    Start<2> s;
    for (int b = 0; b < 2; ++b) {
      const double side = b == 0 ? -1 : 1, angle = random.uniform(-0.3, 0.3);
      s.state[b].position = {side * random.uniform(0.14, 0.25), random.uniform(-0.05, 0.05), 0.05};
      s.state[b].orientation = {0, 0, std::sin(angle / 2), std::cos(angle / 2)};
      s.state[b].velocity = {-side * random.uniform(0, 0.6), random.uniform(-0.2, 0.2), 0};
      s.wrench[static_cast<std::size_t>(b)].force = {-side * random.uniform(0, 8), random.uniform(-2, 2), 0};
    }
    return s;
  };
  const SimulationOptions truth{.step = 2e-3, .duration = 0.2};
  const auto train = simulate_transitions(
      world, Gravity{}, Rk4{}, 6000, [&](auto i) { return start(1, i); }, truth);
  const auto test = simulate_transitions(
      world, Gravity{}, Rk4{}, 300, [&](auto i) { return start(2, i); }, truth);

  using Net = Network<float, Sequential<Linear<38, 128>, Relu, Linear<128, 128>, Relu, Linear<128, 26>>>;
  using Boxes = Predictor<Net, 2>;
  Boxes predictor{Net(1), {}, {}, {world, Gravity{}, {.density = 0}}};
  train_predictor(predictor, train, {.epochs = 60, .l2 = 0});

  const auto compare = [&](const char* name, const auto& predict) {
    const double took = time_side_by_side({one_by_one(test, 300, predict)}, 5)[0].median;
    const Metrics m = measure(test, 0, predict_all(test, 0, 300, predict), world);
    std::printf("%-26s %.1e m^2 %5.1f deg %8.2f us\n", name, m.position, m.angle, took);
    return m.position;
  };
  compare("contact-free flow", ContactFree{predictor.flow, 0.2});
  compare("discrete contacts, 20 ms",
          Simulated{world, Gravity{},
                    SimulationOptions{.step = 2e-2, .duration = 0.2, .contacts = ContactMode::discrete}});
  return compare("network", predictor) < 1e-4 ? finish(argv) : 1;
}
