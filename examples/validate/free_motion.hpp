#pragma once

#include <numbers>
#include <rbres/rbres.hpp>

#include "nesc_case2.hpp"
#include "report.hpp"

namespace validate {

using namespace rbres;

inline constexpr auto no_force = [](const auto&, const auto&) { return Wrench<double>{}; };

inline double relative(double found, double expected) { return std::abs(found / expected - 1); }
inline double difference(const Vec3<double>& a, const Vec3<double>& b) {
  const Vec3<double> d = absolute(a - b);
  return std::max({d.x, d.y, d.z});
}

inline void drag(Rows& rows) {
  const double g = 9.81;
  const SimulationOptions options{.step = 1e-3, .duration = 5, .sample_rate = 10};
  const System<double, 1, Sphere<double>> ball{{Body{Sphere{0.1}, 0.5}}};

  {
    const double rate = 0.4, start = 3, terminal = -g / rate;
    SystemState<double, 1> y;
    y[0].velocity = {start, 0, start};
    Worst worst;
    simulate(ball, y, Forces{Gravity{}, Damping{rate, 0.0}}, Rk4{}, options, [&](double t, const auto& now) {
      if (t == 0) return;
      const double decay = std::exp(-rate * t), way = -std::expm1(-rate * t) / rate;
      worst(relative(now[0].velocity.x, start * decay));
      worst(relative(now[0].velocity.z, terminal + (start - terminal) * decay));
      worst(relative(now[0].position.x, start * way));
      worst(relative(now[0].position.z, terminal * t + (start - terminal) * way));
    });
    rows.push_back(
        {"drag_linear", worst.value(), 1e-10, "relative", "closed form: thrown ball, RK4, 1 ms, 5 s"});
  }
  {
    const FluidFriction friction{};
    const double drag = 0.5 * friction.density * friction.drag * std::numbers::pi * 0.1 * 0.1;
    const double terminal = std::sqrt(0.5 * g / drag);
    SystemState<double, 1> y;
    Worst worst;
    simulate(ball, y, Forces{Gravity{}, friction}, Rk4{}, options, [&](double t, const auto& now) {
      if (t == 0) return;
      worst(relative(now[0].velocity.z, -terminal * std::tanh(g * t / terminal)));
      worst(relative(now[0].position.z, -terminal * terminal / g * std::log(std::cosh(g * t / terminal))));
    });
    rows.push_back(
        {"drag_quadratic", worst.value(), 1e-10, "relative", "closed form: falling ball, RK4, 1 ms, 5 s"});
  }
}

/// Error of a free asymmetric top after 1 s in steps of h, over all 13 numbers.
template <class Integrator>
double top_error(const Integrator& integrator, double h) {
  const System<double, 1> top{{Body{Box{0.2, 0.1, 0.05}, 2.0}}};
  SystemState<double, 1> start;
  start[0].angular_velocity = {5, 1, 1};
  static const SystemState<double, 1> reference =
      fly(top, no_force, DormandPrince54{1e-14, 1e-15}, start, 0.0, 1.0);
  SystemState<double, 1> y = start;
  simulate(top, y, no_force, integrator, {.step = h, .duration = 1});
  return (y.vector() - reference.vector()).norm();
}

inline void orders(Rows& rows) {
  const auto add = [&](const char* name, const auto& integrator, double h) {
    const double slope = std::log2(top_error(integrator, h) / top_error(integrator, h / 2));
    rows.push_back({name, std::abs(slope - integrator.order), 0.1, "order",
                    detail::text("order ", integrator.order, ", measured ", slope,
                                 ", free asymmetric top; chosen: half extents (0.2, 0.1, 0.05) m, spin (5, "
                                 "1, 1) rad/s, 1 s, slope from h = ",
                                 h, " s to its half")});
  };
  add("order_explicit_euler", ExplicitEuler{}, 1e-3);
  add("order_semi_implicit_euler", SemiImplicitEuler{}, 1e-3);
  add("order_rk4", Rk4{}, 1.0 / 64);
  // Tolerances that every step meets make its steps as long as asked.
  add("order_dormand_prince", DormandPrince54{1e9, 1e9}, 1.0 / 32);
}

/// NASA's tumbling brick.
inline void nesc(Rows& rows) {
  constexpr double degree = std::numbers::pi / 180;
  const System<double, 1> brick{
      {Body{Box{0.1, 0.05, 0.03}, 1.0,
            Vec3<double>{nesc_case2::inertia[0], nesc_case2::inertia[1], nesc_case2::inertia[2]}}}};
  SystemState<double, 1> y;
  y[0].angular_velocity = degree * Vec3<double>{10, 20, 30};
  Worst rate;
  std::size_t next = 0;
  simulate(brick, y, no_force, DormandPrince54{1e-14, 1e-15}, {.step = 3, .duration = 30},
           [&](double, const auto& now) {
             const auto& w = nesc_case2::rates[next++];
             rate(difference((1 / degree) * now[0].angular_velocity, {w[0], w[1], w[2]}));
           });
  rows.push_back({"nesc_case2", rate.value(), 1e-9, "deg/s",
                  "NASA/TM-2015-218675 case 2, simulation 4: body rates every 3 s of 30 s; DormandPrince54, "
                  "tolerance 1e-14"});

  // From the local north-east-down frame, which turned with the Earth and moved along the equator.
  const auto about = [](int axis, double degrees) {
    Vec3<double> s{};
    (axis == 0 ? s.x : axis == 1 ? s.y : s.z) = std::sin(0.5 * degree * degrees);
    return Quat<double>{s.x, s.y, s.z, std::cos(0.5 * degree * degrees)};
  };
  // Turning east about the Earth's axis is turning about local north, the frame's x axis.
  const double east = nesc_case2::earth_rate / degree * 30 + nesc_case2::longitude;
  const Quat<double> reference =
      about(0, east) * about(2, nesc_case2::yaw) * about(1, nesc_case2::pitch) * about(0, nesc_case2::roll);
  const Quat<double> off = reference.conjugate() * y[0].orientation;
  rows.push_back({"nesc_case2_attitude", 2 * std::asin(std::min(1.0, norm(off.imaginary()))) / degree, 1e-7,
                  "deg", "the same, attitude at 30 s"});
}

/// Ten seconds of a thrown, spinning box.
inline void complex_box(Rows& rows) {
  const System<double, 1> box{{Body{Box{0.05, 0.2, 0.45}, 10.0}}};
  SystemState<double, 1> y;
  y[0].velocity = {-2, 2, 8};
  y[0].angular_velocity = {0.1, 5, 0.1};
  const Vec3<double> g{0, 0, -9.8};
  const double energy_start = energy(box, y, g);
  const Vec3<double> momentum_start = spin_angular_momentum(box[0], y[0]);
  simulate(box, y, Gravity{g}, Rk4{}, {.step = 1e-3, .duration = 10});
  const Vec3<double> change = spin_angular_momentum(box[0], y[0]) - momentum_start;
  rows.push_back({"complex_box_momentum", norm(change) / norm(momentum_start), 1e-10, "relative",
                  "kept; RK4, 1 ms, 10 s (Simbody 1.9e-3, Bullet 3.6e-3, ODE 3.8e-3)"});
  rows.push_back({"complex_box_energy", relative(energy(box, y, g), energy_start), 1e-10, "relative",
                  "kept; RK4, 1 ms, 10 s; rounding of 40 kJ gained and lost in falling, of 368 J in all: "
                  "truncation is 3e-14"});
  rows.push_back({"complex_box_omega",
                  difference(y[0].angular_velocity, {2.75584040, -3.73596352, -3.16180900}), 1e-7, "rad/s",
                  "SimBenchmark's scene at 10 s, body frame; RK4, 1 ms"});
}

/// A hundred flips of a box that spins about its middle axis.
inline void dzhanibekov(Rows& rows) {
  const System<double, 1> box{{Body{Box{0.20, 0.10, 0.05}, 2.0}}};
  SystemState<double, 1> y;
  // For this box equal parts would lie on the way into the unstable axis, and only rounding would make it
  // flip.
  y[0].angular_velocity = {0.002, 5, 0.001};
  const double energy = kinetic_energy(box[0], y[0]);
  const Vec3<double> momentum = spin_angular_momentum(box[0], y[0]);
  int flips = 0;
  double side = 1;
  Worst energy_error, momentum_error;
  simulate(box, y, no_force, Rk4{}, {.step = 1e-3, .duration = 2000}, [&](double, const auto& now) {
    if (now[0].angular_velocity.y * side < 0) {
      side = -side;
      ++flips;
    }
    energy_error(relative(kinetic_energy(box[0], now[0]), energy));
    momentum_error(norm(spin_angular_momentum(box[0], now[0]) - momentum) / norm(momentum));
    return flips < 100;
  });
  if (flips < 100) energy_error(NAN);
  rows.push_back({"dzhanibekov_energy", energy_error.value(), 1e-9, "relative",
                  "kept over 100 flips; RK4, 1 ms; chosen: half extents (0.2, 0.1, 0.05) m, spin (0.002, 5, "
                  "0.001) rad/s, near no "
                  "separatrix; at most 2,000 s"});
  rows.push_back({"dzhanibekov_momentum", momentum_error.value(), 1e-9, "relative",
                  "kept over 100 flips; RK4, 1 ms; chosen: half extents (0.2, 0.1, 0.05) m, spin (0.002, 5, "
                  "0.001) rad/s, near no "
                  "separatrix; at most 2,000 s"});
}

inline void free_motion(Rows& rows) {
  drag(rows);
  orders(rows);
  nesc(rows);
  complex_box(rows);
  dzhanibekov(rows);
}

}  // namespace validate
