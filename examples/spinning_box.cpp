// The Dzhanibekov effect: a box spun about its middle axis, with nothing touching it, keeps flipping over.
// Prints its spin about that axis over 20 s.
#include <cstdio>
#include <rbres/rbres.hpp>

#include "common/help.hpp"

using namespace rbres;

int main(int argc, char** argv) {
  if (argc > 1) return answer(argc, argv, "Spins a box about its middle axis for 20 s and prints its spin.");

  // One box of 2 kg, 40 x 20 x 10 cm, and no force at all.
  const System<double, 1> system{{Body{Box{0.20, 0.10, 0.05}, 2.0}}};
  const auto nothing = [](const auto&, const auto&) { return Wrench<double>{}; };

  SystemState<double, 1> state;
  state[0].angular_velocity = {0.002, 5.0,
                               0.001};  // rad/s, in the box's own axes: about the middle one, nearly

  std::printf("time [s]   spin about the middle axis [rad/s]\n");
  simulate(system, state, nothing, Rk4{}, {.step = 1e-3, .duration = 20, .sample_rate = 2},
           [](double time, const auto& now) {
             const double spin = now[0].angular_velocity.y;
             std::printf("%8.1f   %+5.2f  %*s\n", time, spin, 20 + static_cast<int>(3 * spin), "o");
           });
  return finish(argv);
}
