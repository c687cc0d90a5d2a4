// A small simulation and a predictor in a program without operating system, heap, exceptions and run-time
// types. The same file is built for the host, whose numbers must be the same bits: see `run`.
#include <rbres/predict/predictor.hpp>
#include <rbres/sim/simulate.hpp>

#include "console.hpp"
#include "model.hpp"

namespace {

using namespace rbres;
using Shape = AnyShape<float>;
/// Two bodies and room for one plane: all that a run needs has its size in this type.
using World = System<float, 2, Shape, 1>;

/// A box and a ball fall on the floor, for one second.
void simulate_a_second() {
  static const World world{
      {Body<float, Shape>(Box<float>{Vec3<float>{0.1f, 0.15f, 0.05f}}, 1.0f,
                          {.restitution = 0.3f, .friction = 0.5f}),
       Body<float, Shape>(Sphere<float>{0.1f}, 0.5f, {.restitution = 0.5f, .friction = 0.3f})},
      {floor_plane<float>()}};
  World::State state;
  state[0].position = {0, 0, 0.3f};
  state[0].angular_velocity = {1, 0.5f, 0};
  state[1].position = {0.02f, 0.01f, 0.8f};
  check_state(world, state);
  static Stepper stepper(world, Gravity<float>{}, Rk4{}, SimulationOptions{.step = 2e-3});
  const std::uint64_t before = instructions();
  for (int k = 0; k < 500; ++k) {
    if (stepper.step(state, 2e-3f * static_cast<float>(k), 2e-3f) >= 0) stop(2);
  }
  const std::uint64_t after = instructions();
  for (int i = 0; i < 2; ++i) {
    print_bits("position", state[i].position);
    print_bits("velocity", state[i].velocity);
    print_bits("angular_velocity", state[i].angular_velocity);
  }
  print("impacts", static_cast<std::uint64_t>(stepper.tally().impacts));
  print("#instructions_per_step", (after - before) / 500);
}

void predict() {
  static const model::Predictor predictor = model::predictor();
  model::Predictor::State state;
  state[0].position = {0, 0, 0.3};
  state[1].position = {0.3, 0, 0.5};
  model::Predictor::Wrenches wrench{};
  wrench[0].force = {1, 0, 0};
  const std::uint64_t before = instructions();
  for (int k = 0; k < 10; ++k) state = predictor.predict(state, wrench);
  const std::uint64_t after = instructions();
  for (int i = 0; i < 2; ++i) {
    print_bits("predicted_position", state[i].position);
    print_bits("predicted_velocity", state[i].velocity);
  }
  print("#instructions_per_prediction", (after - before) / 10);
}

}  // namespace

void run() {
  error_handler = [](const char* what) {
    print(what);
    print("\n");
    stop(1);
  };
  simulate_a_second();
  print("#stack_of_simulation", stack_used());
  predict();
  print("#stack", stack_used());

  // The last thing that it does is what no body can have: the handler says so, and ends the program.
  error_handler = [](const char* what) {
    print(what);
    print("\n");
    stop(0);
  };
  Body<float, Shape>(Sphere<float>{-0.1f}, 1.0f);
}
