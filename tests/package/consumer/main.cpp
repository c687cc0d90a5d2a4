// What a user's program does first: drops a ball, and runs a network on where it ends.
#include <cmath>
#include <cstdio>
#include <rbres/rbres.hpp>

int main() {
  using namespace rbres;
  const System<double, 1> system{{Body{Sphere{0.1}, 1.0}}};
  SystemState<double, 1> state;
  state[0].position = {0, 0, 10};
  simulate(system, state, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 1.0});
  const double fallen = 10 - state[0].position.z;

  const ResidualNetwork<float, 13, 16, 1, 13> network(1);
  const auto output = network.forward(state[0].vector().cast<float>().eval());

  int threads = 0;  // linking rbres::rbres is all that several threads take
  parallel_team(2, [&](const Team& team) {
    if (team.index() == 0) threads = team.size();
  });

  std::printf("fallen %.4f m, network output of norm %.3f, %d threads\n", fallen,
              static_cast<double>(output.norm()), threads);
  return std::abs(fallen - 0.5 * 9.81) < 1e-2 && output.allFinite() && threads == 2 ? 0 : 1;
}
