#pragma once

#include "follow.hpp"

namespace validate {

/// A compound of two parts that share their middle.
template <class Shape, class Part>
Shape crossed(Random& r, const Part& part) {
  const auto first = part(), second = part();
  return {{first}, {second, {}, any_orientation(r)}};
}

/// A shape that is solid in its middle.
template <class Shape>
Shape solid_shape(Random& r, double size) {
  if constexpr (rbres::detail::PartsOf<Shape>::compound) {
    return crossed<Shape>(r, [&] { return any_shape<typename Shape::PartShape>(r, size); });
  } else {
    return any_shape<Shape>(r, size);
  }
}

/// A plate, a needle or a ball: as thin as the shape can be.
template <class Shape>
Shape thin_shape(Random& r, double size) {
  const double thin = size * log_uniform(r, 1e-3, 1e-1);
  if constexpr (std::is_same_v<Shape, Sphere<double>>) {
    return Sphere<double>{size};
  } else if constexpr (std::is_same_v<Shape, Box<double>>) {
    return r.below(2) == 0 ? Box<double>{size, size, thin} : Box<double>{thin, thin, size};
  } else if constexpr (std::is_same_v<Shape, Capsule<double>>) {
    return Capsule<double>{thin, size};
  } else if constexpr (std::is_same_v<Shape, ConvexHull<double>>) {
    const int sides = 3 + static_cast<int>(r.below(14));
    return r.below(2) == 0 ? Shape::cylinder(size, thin, sides) : Shape::cylinder(thin, size, sides);
  } else if constexpr (rbres::detail::PartsOf<Shape>::compound) {
    return crossed<Shape>(r, [&] { return thin_shape<typename Shape::PartShape>(r, size); });
  } else {
    return r.below(2) == 0 ? Shape(thin_shape<Box<double>>(r, size))
                           : Shape(thin_shape<Capsule<double>>(r, size));
  }
}

/// What fast and spinning bodies do to a continuous run.
struct TunnellingFigures {
  Figure overlap;  ///< the deepest at the end of a step, over the smaller body's bounding radius; e > 0
  Figure plastic;  ///< the same with e = 0, where a body that spins fast leans on what it hit
  Figure missed;   ///< bodies that must have met something and did not
  Figure work, overruns;
};

/// Runs in which something must be met in the first few steps: shots at a thin target's centre, or thin
/// bodies that spin near a plane, in steps in which they go far and turn far.
template <class Shape>
TunnellingFigures tunnelling(const Cases& cases) {
  TunnellingFigures worst;
  each_case(cases, [&](long i, Random& r) {
    const Cell cell(i);
    const double step = log_uniform(r, 1e-4, 1e-2), size = log_uniform(r, 0.01, 1);
    const int target = cell.index, shot = cell.partner();
    // Free flight keeps the spin of bodies with equal moments, however fast it is.
    const auto body = [&](int k) {
      const Shape shape =
          k == target ? thin_shape<Shape>(r, size) : solid_shape<Shape>(r, size * log_uniform(r, 0.01, 0.3));
      const double mass = log_uniform(r, 0.01, 1), moment = Body<double, Shape>(shape, mass).inertia().x;
      return Body<double, Shape>(shape, mass, Vector{moment, moment, moment}, cell.material());
    };
    std::vector<Plane<double>> planes;
    if (cell.plane) planes = room(4 * size, 8 * size, cell.material());
    const World<Shape> system = [&]<std::size_t... I>(std::index_sequence<I...>) {
      return World<Shape>({body(static_cast<int>(I))...}, planes);
    }
    (std::make_index_sequence<bodies>{});
    States y;
    for (int k = 0; k < bodies; ++k) {
      y[k].position = {1.2 * size * (k - 1), 2 * size, 4 * size};
      y[k].orientation = any_orientation(r);
    }
    const auto spin = [&] { return (log_uniform(r, 0.01, 1) / step) * any_direction(r); };
    const double ways = log_uniform(r, 0.1, 100);  // sizes that the shot goes in a step
    y[target].position = {0, 0, 4 * size};
    y[target].angular_velocity = spin();
    long steps = 20;
    if (cell.plane) {
      // Thrown about in a room, and a body that spins so near the floor that it must touch it.
      y[shot].position.z = 0.5 * size;
      y[shot].velocity = (ways * size / step) * any_direction(r);
      y[shot].position.z = 2 * system[shot].bounding_radius();
      y[target].velocity = {0, 0, -std::min(1.0, ways) * size / step};
      steps = 20 + std::lround(8 / std::min(1.0, ways));
    } else {
      const Vector from = any_direction(r);
      const double distance =
          system[target].bounding_radius() + system[shot].bounding_radius() + ways * size * r.uniform();
      y[shot].position = y[target].position + distance * from;
      y[shot].velocity = (-ways * size / step) * from;
      y[shot].angular_velocity = spin();
      for (int k = 0; k < bodies; ++k) {
        if (k != target && k != shot) y[k].position += (1e3 * size) * any_direction(r);
      }
      steps = 3 + std::lround(2 * distance / (ways * size));
    }
    Runner<double, Shape> runner(system, {}, step, ContactMode::continuous);
    runner.start(0, y);
    double deepest = -1;
    Ear<double, Shape> ear;
    for (long k = 0; k < steps; ++k) {
      runner.advance(ear);
      // Impacts can spin a body up to several turns in a step, which no integrator follows.
      const States now = runner.state(0);
      double turn = 0;
      for (const auto& state : now.body) turn = std::max(turn, step * norm(state.angular_velocity));
      if (!(turn < 1.5)) break;
      deepest = std::max(deepest, overlap(system, now));
    }
    const auto where = detail::text(cell.text(), ", step ", step, " s, ", ways, " sizes in a step");
    (cell.restitution > 0 ? worst.overlap : worst.plastic)(deepest, i, where);
    worst.missed(worst.missed.value() + (runner.impacts(0) == 0), i, where);
    worst.work(runner.work(), i, where);
    worst.overruns(static_cast<double>(runner.overruns(0)) / static_cast<double>(steps), i, where);
  });
  return worst;
}

}  // namespace validate
