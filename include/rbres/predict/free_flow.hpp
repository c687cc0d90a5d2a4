#pragma once

#include <limits>
#include <rbres/dynamics/forces.hpp>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/dynamics/integrators.hpp>

namespace rbres {

/// Where bodies would be if nothing were in their way: gravity, fluid friction, damping and each body's own
/// wrench, without contacts. The base that a predictor of residuals corrects, and the trivial predictor that
/// any other must beat.
template <int N>
struct FreeFlow {
  using System = rbres::System<double, N>;

  System system;
  Gravity<double> gravity{};
  FluidFriction<double> friction{};
  Damping<double> damping{};

  /// Step of the fourth-order integration, s.
  static constexpr double step = 0.02;
  /// The longest time that is followed, s.
  static constexpr double longest = 3600;

  /// The states after `duration` (s, at most `longest`); NaN for any other duration.
  SystemState<double, N> operator()(SystemState<double, N> y, const std::array<Wrench<double>, N>& wrench,
                                    double duration) const noexcept {
    const Forces forces{gravity, friction, damping, ConstantWrench<double, N>{wrench}};
    if (!(duration >= 0 && duration <= longest)) {
      for (auto& body : y.body) body.vector().setConstant(std::numeric_limits<double>::quiet_NaN());
      return y;
    }
    const long steps = std::max(1L, std::lround(std::ceil(duration / step - 1e-9)));
    const double h = duration / static_cast<double>(steps);
    for (long k = 0; k < steps; ++k) y = fly(system, forces, Rk4{}, y, static_cast<double>(k) * h, h);
    return y;
  }
};

}  // namespace rbres
