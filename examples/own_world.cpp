// One's own world, from its bodies to a predictor: two boxes are pushed about on a table, and a small network
// learns where they are 0.2 s later. Prints how far it and a cheap simulation are off on 300 unseen starts
// (mean square position error, mean rotation), and how long each takes for one on one thread: alone, and of
// all 300.
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

  const auto row = [&](const char* name, const Eigen::MatrixXd& ends, const TimedCall& one,
                       const TimedCall& many) {
    const auto took = time_side_by_side({one, many}, 5);
    const Metrics m = measure(test, 0, ends, world);
    std::printf("%-26s %.1e m^2 %5.1f deg %8.2f us %8.2f us\n", name, m.position, m.angle, took[0].median,
                took[1].median);
    return m.position;
  };
  const SimulationOptions coarse{.step = 2e-2, .duration = 0.2, .contacts = ContactMode::discrete};
  const Simulated discrete{world, Gravity{}, coarse};
  const auto at = [&](auto i) { return test.starts[std::size_t(i)]; };
  row("discrete contacts, 20 ms", predict_all(test, 0, 300, discrete), one_by_one(test, 300, discrete),
      {[&] { simulate_transitions(world, Gravity{}, Rk4{}, 300, at, coarse, 1); }, 300});

  std::vector<Boxes::State> states(300), ends(300);
  std::vector<Boxes::Wrenches> wrenches(300);
  for (std::size_t i = 0; i < 300; ++i) states[i] = test.starts[i].state, wrenches[i] = test.starts[i].wrench;
  Boxes::Batch batch(300);
  const double error = row("network", predict_all(test, 0, 300, predictor), one_by_one(test, 300, predictor),
                           {[&] { predictor.predict(states, wrenches, ends, batch); }, 300});
  return error < 1e-4 ? finish(argv) : 1;
}
