#pragma once

#include <memory>
#include <rbres/sim/simulate.hpp>

#include "predictor.hpp"

namespace rbres::tosses {

/// rbres's simulator of the cube over the floor, as a step from frame to frame. One discrete step a frame: on
/// train.npy finer steps and continuous contacts come no closer to the data, and cost more.
class Simulator {
  using CubeSystem = System<double, 1, Box<double>>;
  using Cube = CubeSystem::BodyType;

 public:
  Simulator(const Material<double>& material, double floor)
      : system_(std::make_shared<const CubeSystem>(
            std::array{Cube(Box<double>(half_width, half_width, half_width), mass,
                            Vec3<double>{inertia, inertia, inertia}, material)},
            std::vector{Plane<double>{{0, 0, 1}, floor, material}})) {}

  State operator()(const State& state) const {
    const SimulationOptions options{.step = frame_time, .contacts = ContactMode::discrete};
    Stepper stepper(*system_, Gravity{Vec3<double>{0, 0, -gravity}}, SemiImplicitEuler{}, options);
    SystemState<double, 1> next{{state}};
    stepper.step(next, 0, frame_time);
    return next[0];
  }

 private:
  std::shared_ptr<const CubeSystem> system_;  ///< shared, because a Prior is copied
};

/// The friction and restitution with which the simulator's rollouts come closest to the tosses: the least
/// position error plus half width times rotation error (m), by compass search (Kolda, Lewis, Torczon 2003,
/// section 1.2) from the data's own estimates, to 1e-3.
inline Material<double> fit_material(const std::vector<Toss>& tosses, double floor) {
  const auto error = [&](const Material<double>& material) {
    const Score s = score(Simulator(material, floor), tosses);
    return s.position + half_width * s.rotation;
  };
  Material<double> best{.restitution = 0.125, .friction = 0.18};
  double least = error(best);
  for (double step = 0.064; step > 0.75e-3;) {
    bool better = false;
    for (const auto& [restitution, friction] :
         {std::pair{0.0, step}, {0.0, -step}, {step, 0.0}, {-step, 0.0}}) {
      const Material<double> other{std::clamp(best.restitution + restitution, 0.0, 1.0),
                                   std::max(best.friction + friction, 0.0)};
      if (const double e = error(other); e < least) {
        best = other;
        least = e;
        better = true;
      }
    }
    if (!better) step /= 2;
  }
  return best;
}

}  // namespace rbres::tosses
