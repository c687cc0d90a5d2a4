// Spheres, boxes and capsules fall on a floor, bounce, and settle. Prints the height of each and the greatest
// speed, ten times a second.
#include <cstdio>
#include <rbres/rbres.hpp>

#include "common/help.hpp"

using namespace rbres;

int main(int argc, char** argv) {
  if (argc > 1)
    return answer(
        argc, argv,
        "Drops six bodies on a floor and prints ten times a second how high each is, and their speed.");

  const Material<double> rubber{0.6, 0.5};  // restitution, friction
  const Body<double> sphere = Body{Sphere{0.10}, 1.0, rubber};
  const Body<double> box = Body{Box{0.20, 0.15, 0.10}, 2.0, rubber};
  const Body<double> capsule = Body{Capsule{0.08, 0.15}, 1.0, rubber};
  const System<double, 6> system{{sphere, box, capsule, sphere, box, capsule}, room(0.8, 10.0, rubber)};

  SystemState<double, 6> state;
  for (int i = 0; i < 6; ++i) {
    state[i].position = {0.05 * i, -0.04 * i, 0.5 + 0.5 * i};
    state[i].orientation = normalized(Quat<double>{0.1, 0.2 * i, 0.3, 1.0});
    state[i].angular_velocity = {1.0, 0.5 * i, -1.0};
  }

  std::puts("time [s]   height of the centres [m]                           fastest [m/s]");
  const Forces forces{Gravity{}, FluidFriction{}, Damping{0.0, 0.2}};
  const auto report = simulate(system, state, forces, Rk4{}, {.step = 1e-3, .duration = 6, .sample_rate = 10},
                               [](double time, const auto& now) {
                                 double fastest = 0;
                                 std::printf("%7.1f  ", time);
                                 for (const auto& body : now.body) {
                                   std::printf("%8.3f", body.position.z);
                                   fastest = std::max(fastest, norm(body.velocity));
                                 }
                                 std::printf("   %8.3f\n", fastest);
                               });
  std::printf("%ld steps, %ld impacts\n", report.steps, report.impacts);
  return finish(argv);
}
