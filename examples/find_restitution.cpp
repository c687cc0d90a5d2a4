// Finds how a ball bounces from a recording of its path: Gauss-Newton steps, with derivatives by dual numbers
// that go through the simulator and its impacts.
#include <rbres/rbres.hpp>
#include <unsupported/Eigen/AutoDiff>

#include "common/command_line.hpp"

namespace {

using namespace rbres;

/// Where a ball of this restitution is, 100 times a second, when it is thrown at a floor (m).
template <class S>
std::vector<Vec3<S>> path(const S& restitution) {
  const Material<S> material{restitution, S(0.2)};
  const System<S, 1, Sphere<S>> system{{Body{Sphere<S>{S(0.1)}, S(1), material}}, {floor_plane(material)}};
  SystemState<S, 1> state;
  state[0].position.z = S(0.5);
  state[0].velocity = {S(1), S(0), S(-1)};
  state[0].angular_velocity = {S(2), S(-1), S(3)};
  std::vector<Vec3<S>> positions;
  simulate(system, state, Gravity{}, Rk4{}, {.duration = 0.4, .sample_rate = 100},
           [&](double, const auto& now) { positions.push_back(now[0].position); });
  return positions;
}

/// Prints every step. Throws Error where eight of them do not suffice.
void find_restitution(const std::vector<Vec3<double>>& recorded) {
  using Dual = Eigen::AutoDiffScalar<Eigen::Matrix<double, 1, 1>>;
  double guess = 0.5;
  std::printf("step  restitution  distance from the recording [m]\n");
  for (int step = 1; step <= 8; ++step) {
    const auto simulated = path(Dual(guess, 1, 0));
    double squares = 0, slope = 0, curvature = 0;
    for (std::size_t i = 0; i < recorded.size(); ++i) {
      const auto error = simulated[i] - Vec3<Dual>(recorded[i].x, recorded[i].y, recorded[i].z);
      for (const Dual& e : {error.x, error.y, error.z}) {
        squares += e.value() * e.value();
        slope += e.value() * e.derivatives()(0);
        curvature += e.derivatives()(0) * e.derivatives()(0);
      }
    }
    std::printf("%4d  %11.8f  %.3g\n", step, guess,
                std::sqrt(squares / static_cast<double>(recorded.size())));
    const double change = -slope / curvature;
    guess = std::clamp(guess + change, 0.0, 1.0);
    if (std::abs(change) < 1e-9) return void(std::printf("The restitution is %.6f.\n", guess));
  }
  throw Error("eight steps: expected a restitution to be found, found none");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Finds the restitution of a thrown ball from its recorded path, by derivatives through impacts."};
  double truth = 0.2;
  number(app, "--truth", truth, 0.0, 1.0, "the restitution of the ball that is recorded");
  return run_program("find_restitution", app, argc, argv, [&] { find_restitution(path(truth)); });
}
