#pragma once

#include "symmetry.hpp"

namespace validate {

/// Bodies that lie on the floor and on one another, for as long as asked (s): how far they go, and how far
/// they turn, over their size.
template <class Shape>
Figure at_rest(const Cases& cases, double duration) {
  Figure worst;
  each_case(cases, [&](long i, Random& r) {
    Cell cell(i % (Cell::count / 2));
    cell.mode = ContactMode::continuous;
    cell.friction = std::max(cell.friction, 0.3);  // nothing keeps smooth bodies in their place
    const Shape shape = any_shape<Shape>(r, 0.2);
    const auto system =
        World<Shape>::of(Body<double, Shape>(shape, 1.0, cell.material()), {floor_plane(cell.material())});
    States y = lying(system);
    // A ball on a ball would fall at the first rounding.
    if (std::holds_alternative<Box<double>>(AnyShape<double>(shape)))
      put_on(system, y, cell.partner(), cell.index);
    Runner<double, Shape> runner(system, {0, 0, -9.81}, 0.01, cell.mode);
    runner.start(0, y);
    runner.advance(std::lround(duration / 0.01));
    const States end = runner.state(0);
    for (int k = 0; k < bodies; ++k) {
      const Quat<double> turn = y[k].orientation.conjugate() * end[k].orientation;
      worst(norm(end[k].position - y[k].position) / system[k].bounding_radius() + 2 * norm(turn.imaginary()),
            i, cell.text());
    }
  });
  return worst;
}

}  // namespace validate
