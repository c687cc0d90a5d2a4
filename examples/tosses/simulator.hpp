#pragma once

#include <memory>
#include <rbres/rbres.hpp>

#include "predictor.hpp"

namespace rbres::tosses {

/// rbres's simulator on one cube over the floor, as a step from frame to frame.
class Simulator {
  using CubeSystem = System<double, 1, Box<double>>;

 public:
  Simulator(const Material<double>& material, double floor, int substeps = 1, ContactMode mode = ContactMode::discrete)
      : system_(std::make_shared<const CubeSystem>(
            std::array{Body<double, Box<double>>(Box<double>(half_width, half_width, half_width), mass, Vec3<double>{inertia, inertia, inertia}, material)},
            std::vector<Plane<double>>{{{0, 0, 1}, floor, material}})), substeps_(substeps) { options_.contacts = mode; options_.step = frame_time/substeps;}

  State operator()(const State& state) const {
    SystemState<double, 1> y{{state}};
    Stepper stepper(*system_, Gravity{}, SemiImplicitEuler{}, options_);
    for (int i = 0; i < substeps_; ++i) stepper.step(y, 0, frame_time / substeps_);
    return y[0];
  }

 private:
  std::shared_ptr<const CubeSystem> system_;
  SimulationOptions options_; int substeps_;
};

}  // namespace rbres::tosses
