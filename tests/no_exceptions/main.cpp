// rbres without exceptions and without run-time types: it simulates, learns and loads as ever, and what it
// refuses ends in the program's own handler, or where there is none, or one that returns, in abort().
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <rbres/io.hpp>
#include <rbres/rbres.hpp>
#include <string_view>

#if RBRES_HAS_EXCEPTIONS || defined(__GXX_RTTI)
#error "this file is about -fno-exceptions -fno-rtti"
#endif

namespace {

using namespace rbres;

void check(bool holds, const char* what) {
  if (holds) return;
  std::printf("does not hold: %s\n", what);
  std::_Exit(1);
}

void simulate_and_learn() {
  const System<double, 2, Sphere<double>> system{
      {Body(Sphere<double>{0.1}, 1.0), Body(Sphere<double>{0.1}, 1.0)}, {floor_plane<double>()}};
  SystemState<double, 2> state;
  state[0].position = {0, 0, 1};
  state[1].position = {0, 0, 2};
  const auto report = simulate(system, state, Gravity{}, Rk4{}, {.step = 1e-2, .duration = 1});
  check(report.status == SimulationStatus::finished, "the simulation finishes");
  check(state[0].position.z > 0.0999, "the sphere stays on the floor");

  const ResidualNetwork<float, 3, 8, 1, 2> network(1);
  check(network.forward(Eigen::Vector3f::Ones()).allFinite(), "a network's outputs are finite");
  double sum = 0;
  std::array<double, 4> parts{};
  parallel_for(4, 2, [&](std::ptrdiff_t i) { parts[static_cast<std::size_t>(i)] = double(i); });
  for (const double part : parts) sum += part;
  check(sum == 6, "threads do all tasks");
}

constexpr std::string_view refusal = "sphere radius";

void refuse() { Body(Sphere<double>{-1}, 1.0); }

}  // namespace

int main(int argc, char** argv) {
  const std::string_view mode = argc > 1 ? argv[1] : "";
  simulate_and_learn();
  if (mode == "handler") {
    error_handler = [](const char* what) {
      std::printf("%s\n", what);
      std::exit(std::strstr(what, refusal.data()) == nullptr);
    };
    refuse();
  } else if (mode == "file") {
    error_handler = [](const char* what) {
      std::printf("%s\n", what);
      std::exit(std::strstr(what, "no_such_model") == nullptr);
    };
    load<ResidualNetwork<float, 3, 8, 1, 2>>("no_such_model");
  } else {
    std::signal(SIGABRT, [](int) { std::_Exit(0); });
    if (mode == "returns") error_handler = [](const char*) {};
    refuse();
  }
  return 1;
}
