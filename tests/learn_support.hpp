#pragma once

#include <doctest/doctest.h>

#include <rbres/body/mechanics.hpp>
#include <rbres/learn/contact_law.hpp>
#include <rbres/learn/trajectory.hpp>

/// Worlds in which bodies of every shape are about to touch.
namespace learn_support {

using namespace rbres;

inline const std::vector<AnyShape<double>> shapes{Sphere{0.1}, Box{0.12, 0.1, 0.08}, Capsule{0.07, 0.1}};

inline Vec3<double> random_vector(Random& r, double deviation) {
  const double x = r.normal(), y = r.normal(), z = r.normal();
  return {deviation * x, deviation * y, deviation * z};
}
inline Quat<double> random_orientation(Random& r) {
  const double x = r.normal(), y = r.normal(), z = r.normal(), w = r.normal();
  return normalized(Quat<double>{x, y, z, w});
}

/// A law that knows nothing, with impulses of any kind, but no larger than those of contacts.
template <class Law>
Law random_law(std::uint64_t seed, double margin) {
  Law law;
  using Network = typename Law::Network;
  law.network = Network(seed);
  for (auto& weight : law.network.parameters().subspan(Network::offset(Network::rounds)))
    weight *= static_cast<typename Law::Scalar>(0.1);
  law.scales = {.frame_time = 0.01, .speed = 0.5, .margin = margin};
  return law;
}
/// Every other one looks at impacts, from which bodies bounce somehow.
template <class Law>
Law law_of_some_moment(std::uint64_t seed, double margin) {
  Law law = random_law<Law>(seed, margin);
  if (seed % 2 == 0) return law;
  law.scales.moment = ContactMoment::impact;
  law.network.parameters()[Law::Network::tensors().back().index(0, 0)] = 1.7F;
  return law;
}

/// A sphere, a box, a capsule and a second box, close together; none has the mass of another.
inline System<double, 4> heap(std::vector<Plane<double>> planes = {}) {
  return {{Body<double>{shapes[0], 1.3}, Body<double>{shapes[1], 0.7}, Body<double>{shapes[2], 1.1},
           Body<double>{Box{0.1, 0.1, 0.15}, 2.0}},
          std::move(planes)};
}
inline SystemState<double, 4> close_together(std::uint64_t seed) {
  Random r(seed);
  SystemState<double, 4> y;
  for (int i = 0; i < 4; ++i) {
    y[i].position = Vec3<double>{0.18 * (i % 2), 0.17 * (i / 2), 0.15} + random_vector(r, 0.02);
    y[i].orientation = random_orientation(r);
    y[i].velocity = random_vector(r, 0.5);
    y[i].angular_velocity = random_vector(r, 3);
  }
  return y;
}

inline double distance(const RigidState<double>& a, const RigidState<double>& b) {
  return (a.vector() - b.vector()).norm();
}
/// The same bodies in a world that is turned, then shifted.
inline SystemState<double, 4> turned(SystemState<double, 4> y, const Quat<double>& turn,
                                     const Vec3<double>& shift) {
  for (int i = 0; i < 4; ++i) {
    y[i].position = rotate(turn, y[i].position) + shift;
    y[i].orientation = turn * y[i].orientation;
    y[i].velocity = rotate(turn, y[i].velocity);
  }
  return y;
}

/// Checks that a law's impulses, for random networks, keep linear and angular momentum beside what the system
/// does without them. `without(y)` is a frame of that, `with(seed, y)` one of the law. Returns the change of
/// all velocities.
template <class Without, class With>
double check_momentum(const System<double, 4>& system, const Without& without, const With& with) {
  double moved = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    auto y = close_together(seed);
    for (int i = 0; i < 4; ++i) y[i].position.x += 3;  // far from the origin
    const SystemState<double, 4> before = without(y), after = with(seed, y);
    double size = 0, linear = 0;
    for (int i = 0; i < 4; ++i) {
      linear += system[i].mass() * norm(after[i].velocity);
      moved += norm(after[i].velocity - before[i].velocity);
      size += norm(angular_momentum(system[i], after[i]));
    }
    CHECK(norm(linear_momentum(system, after) - linear_momentum(system, before)) < 1e-13 * linear);
    CHECK(norm(angular_momentum(system, after) - angular_momentum(system, before)) < 1e-13 * size);
  }
  return moved;
}

/// One frame of a law after free flight under gravity.
template <class Law, int N>
SystemState<double, N> one_frame(const System<double, N>& system, SystemState<double, N> y, const Law& law,
                                 const Gravity<double>& gravity = {}) {
  simulate(system, y, gravity, Rk4{}, law,
           {.step = law.scales.frame_time, .duration = law.scales.frame_time});
  return y;
}

}  // namespace learn_support
