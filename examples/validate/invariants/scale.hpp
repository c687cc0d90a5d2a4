#pragma once

#include "symmetry.hpp"

namespace validate {

inline Sphere<double> resized(const Sphere<double>& s, double factor) { return {factor * s.radius}; }
inline Box<double> resized(const Box<double>& s, double factor) { return Box<double>(factor * s.half); }
inline Capsule<double> resized(const Capsule<double>& s, double factor) {
  return {factor * s.radius, factor * s.half_length};
}
inline AnyShape<double> resized(const AnyShape<double>& shape, double factor) {
  return std::visit([&](const auto& s) { return AnyShape<double>(resized(s, factor)); }, shape);
}

/// The same world, its lengths times `factor` and its times times the root of it: what gravity does to it is
/// the same in its own units.
template <class Shape>
Crowd<Shape> resized(const Crowd<Shape>& crowd, double factor) {
  const double root = std::sqrt(factor), cube = factor * factor * factor;
  auto planes = crowd.system.planes();
  for (auto& plane : planes) plane.offset *= factor;
  Crowd<Shape> out = crowd;
  out.system = with_bodies<Shape>(
      [&](int k) {
        const auto& body = crowd.system[k];
        return Body<double, Shape>(resized(body.shape(), factor), cube * body.mass(), body.material());
      },
      planes);
  for (auto& body : out.start.body) {
    body.position = factor * body.position;
    body.velocity = root * body.velocity;
    body.angular_velocity = (1 / root) * body.angular_velocity;
  }
  out.step = root * crowd.step;
  out.size = factor * crowd.size;
  out.speed = root * crowd.speed;
  return out;
}

/// Falls of 0.1 mm to 10 km: powers of 4 keep the arithmetic the same to the bit.
template <class Shape>
Figure sizes(const Cases& cases) {
  Figure worst;
  each_case(cases, [&](long i, Random& r) {
    Cell cell(i % (Cell::count / 2));
    const double factor = std::pow(4.0, static_cast<int>(r.below(14)) - 7);
    auto crowd = any_crowd<Shape>(r, cell);
    crowd.steps *= 4;
    crowd = resized(crowd, 1);  // uniform bodies
    const auto other = resized(crowd, factor);
    const States here = end_of(crowd, cell.mode);
    States there = end_of(other, cell.mode);
    const double root = std::sqrt(factor);
    for (auto& body : there.body) {
      body.position = (1 / factor) * body.position;
      body.velocity = (1 / root) * body.velocity;
      body.angular_velocity = root * body.angular_velocity;
    }
    const auto where = detail::text(cell.text(), ", size ", factor);
    worst(apart(crowd, here, there), i, where);
  });
  return worst;
}

struct MassFigures {
  Figure moved;    ///< over the size
  Figure work;     ///< evaluations of the forces, over those of free motion
  Figure impacts;  ///< the most in one step
};

/// Piles at rest: a body on another on the floor, lying, up to a million times heavier or lighter.
template <class Shape>
MassFigures masses(const Cases& cases) {
  MassFigures worst;
  each_case(cases, [&](long i, Random& r) {
    Cell cell(i % (Cell::count / 2));
    cell.mode = ContactMode::continuous;
    // Without friction the heavy body squeezes the light one out: that balance is not stable.
    cell.friction = std::max(cell.friction, 0.3);
    const double ratio = log_uniform(r, 1, 1e6);
    const int a = cell.index, b = cell.partner();
    const Shape shape = any_shape<Shape>(r, 0.2);
    const auto system = with_bodies<Shape>(
        [&](int k) { return Body<double, Shape>(shape, k == b ? ratio : 1.0, cell.material()); },
        {floor_plane(cell.material())});
    Crowd<Shape> crowd{system, lying(system), {0, 0, -9.81}, 1e-3, system[0].bounding_radius(), 1, 200};
    put_on(system, crowd.start, b, a);
    Runner<double, Shape> runner(system, crowd.gravity, crowd.step, ContactMode::continuous);
    runner.start(0, crowd.start);
    long before = 0, most = 0;
    for (long k = 0; k < crowd.steps; ++k) {
      runner.advance(1);
      most = std::max(most, runner.impacts(0) - before);
      before = runner.impacts(0);
    }
    double moved = 0;
    const States end = runner.state(0);
    for (int k = 0; k < bodies; ++k)
      moved = std::max(moved, norm(end[k].position - crowd.start[k].position) / crowd.size);
    const auto where = detail::text(cell.text(), ", masses 1 to ", ratio);
    worst.moved(moved, i, where);
    worst.work(runner.work(), i, where);
    worst.impacts(static_cast<double>(most), i, where);
  });
  return worst;
}

}  // namespace validate
