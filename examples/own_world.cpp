// One's own world, from its bodies to a predictor: two boxes are pushed about on a table, and a small network
// learns where they are 0.2 s later, three times, from other starts and weights. Prints how far each and a
// cheap simulation are off on 300 unseen starts (mean square position error, mean rotation), and how long
// they take for one on one thread: alone, and of all 300.
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
  const auto simulated = [&](std::uint64_t seed, std::ptrdiff_t count, const SimulationOptions& how,
                             int threads = 0) {
    return simulate_transitions(
        world, Gravity{}, Rk4{}, count, [&](auto i) { return start(seed, i); }, how, threads);
  };
  const SimulationOptions truth{.step = 2e-3, .duration = 0.2};
  const auto test = simulated(0, 300, truth);
  const auto row = [&](const char* name, const auto& predict, const TimedCall& many) {
    const auto took = time_side_by_side({one_by_one(test, 300, predict), many}, 5);
    const Metrics m = measure(test, 0, predict_all(test, 0, 300, predict), world);
    std::printf("%-26s %.1e m^2 %5.1f deg %8.2f us %8.2f us\n", name, m.position, m.angle, took[0].median,
                took[1].median);
    return m.position;
  };
  const SimulationOptions coarse{.step = 2e-2, .duration = 0.2, .contacts = ContactMode::discrete};
  row("discrete contacts, 20 ms", Simulated{world, Gravity{}, coarse},
      {[&] { simulated(0, 300, coarse, 1); }, 300});

  using Net = Network<float, Sequential<Linear<38, 128>, Relu, Linear<128, 128>, Relu, Linear<128, 26>>>;
  using Boxes = Predictor<Net, 2>;
  std::vector<Boxes::State> states(300), ends(300);
  std::vector<Boxes::Wrenches> wrenches(300);
  for (std::size_t i = 0; i < 300; ++i) states[i] = test.starts[i].state, wrenches[i] = test.starts[i].wrench;
  Boxes::Batch batch(300);
  double error = 0;
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    Boxes predictor{Net(seed), {}, {}, {world, Gravity{}, {.density = 0}}};
    train_predictor(predictor, simulated(seed, 6000, truth),
                    {.epochs = 60, .schedule = {.kind = Schedule::Kind::cosine, .initial = 3e-3}, .l2 = 0});
    error += row("network", predictor, {[&] { predictor.predict(states, wrenches, ends, batch); }, 300}) / 3;
  }
  return error < 1.1e-5 ? finish(argv) : 1;
}
