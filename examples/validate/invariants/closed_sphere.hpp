#pragma once

#include "closed_forms.hpp"

namespace validate {

/// A ball on an incline: it rolls with 5/7 of the pull, or slides where friction is below 2/7 of the slope.
inline Figure ball_on_incline() {
  Figure worst;
  const Incline slope{0.3};
  const double g = 9.81, r = 0.1, time = 2, pull = g * std::sin(slope.angle),
               load = g * std::cos(slope.angle);
  for (const double friction : {0.0, 0.05, 0.085, 0.089, 0.3, 1.0}) {
    const Material<double> material{0, friction};
    OnPlane<Sphere<double>> ball(Body{Sphere{r}, 1.0, material}, slope.plane(material));
    ball.body().position = r * slope.normal;
    ball.run({.step = 1e-3, .duration = time});
    const bool rolls = friction >= 2.0 / 7 * std::tan(slope.angle);
    const double along = rolls ? 5.0 / 7 * pull : pull - friction * load,
                 turn = rolls ? along / r : 2.5 * friction * load / r;
    const auto where = rbres::detail::text("friction ", friction);
    worst(relative_error(dot(ball.body().velocity, slope.down), along * time), 0, where);
    worst(relative_error(dot(ball.body().position, slope.down), along * time * time / 2), 0, where);
    worst(std::abs(ball.body().angular_velocity_world().y - turn * time) * r / (pull * time), 0, where);
    worst(std::abs(dot(ball.body().position, slope.normal) / r - 1), 0, where);
  }
  return worst;
}

/// A ball that is dropped has bounced for the last time after v (1 + e) / (g (1 - e)), where v is the speed
/// of its first impact.
inline Figure end_of_bouncing() {
  Figure worst;
  const double g = 9.81, r = 0.1, height = 1, fall = std::sqrt(2 * height / g);
  for (const double e : {0.1, 0.5, 0.8}) {
    const Material<double> material{e, 0};
    OnPlane<Sphere<double>> ball(Body{Sphere{r}, 1.0, material}, floor_plane(material));
    ball.body().position.z = r + height;
    double last = 0;
    ball.run(
        {.step = 1e-3, .duration = 1.2 * fall * (1 + e) / (1 - e), .rest_speed = 1e-4},
        [](double, const auto&) {}, [&](double time) { last = time; });
    const auto where = rbres::detail::text("e = ", e);
    worst(relative_error(last, fall * (1 + e) / (1 - e)), 0, where);
    worst(std::abs(ball.body().position.z / r - 1) + norm(ball.body().velocity), 0, where);
  }
  return worst;
}

}  // namespace validate
