// One's own world, from its bodies to a predictor: two boxes are pushed about on a table, and a small network
// learns where they are a fifth of a second later. Prints how far it and others are off (mean square position
// error on 300 unseen starts) and how long each takes (for one of them, on one thread).
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

  std::vector<Boxes::State> ends(test.starts.size());
  const auto measure = [&](const char* name, const std::function<void()>& predict_all) {
    const double took = time_side_by_side({{predict_all, 300}}, 5)[0].median;
    double sum = 0;
    for (std::size_t i = 0; i < ends.size(); ++i)
      for (int b = 0; b < 2; ++b) sum += squared_norm(ends[i][b].position - test.ends[i][b].position) / 6;
    std::printf("%-34s %.1e m^2 %8.2f us\n", name, sum / 300, took);
    return sum / 300;
  };
  const auto one_by_one = [&](const auto& predict) {
    return [&] { std::ranges::transform(test.starts, ends.begin(), predict); };
  };
  const auto discrete = [&](const Start<2>& s) {
    auto y = s.state;
    simulate(world, y, Forces{Gravity{}, ConstantWrench<double, 2>{s.wrench}}, Rk4{},
             {.step = 2e-2, .duration = 0.2, .contacts = ContactMode::discrete});
    return y;
  };
  measure("contact-free flow", one_by_one([&](auto& s) { return predictor.flow(s.state, s.wrench, 0.2); }));
  measure("discrete contacts, 20 ms", one_by_one(discrete));
  const auto network = [&](auto& s) { return predictor.predict(s.state, s.wrench); };
  return measure("network", one_by_one(network)) < 1e-4 ? finish(argv) : 1;
}
