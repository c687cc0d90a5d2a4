#pragma once

#include <rbres/body/mechanics.hpp>
#include <rbres/contact/detect.hpp>
#include <rbres/core/philox.hpp>
#include <rbres/sim/simulate.hpp>

#include "figure.hpp"

namespace validate {

using namespace rbres;

using Vector = Vec3<double>;

/// Every world has three bodies, so that one of them is neither first nor last.
inline constexpr int bodies = 3;
using States = SystemState<double, bodies>;
template <class Shape>
using World = System<double, bodies, Shape>;

/// Calls f with the number of each case and the random numbers that are its own.
template <class F>
void each_case(const Cases& cases, const F& f) {
  for (long i = cases.first; i < cases.first + cases.count; ++i) {
    Random r(cases.seed, static_cast<std::uint64_t>(i));
    f(i, r);
  }
}

inline Vector normal_vector(Random& r, double size = 1) {
  return {size * r.normal(), size * r.normal(), size * r.normal()};
}
inline Quat<double> any_orientation(Random& r) {
  return normalized(Quat<double>{r.normal(), r.normal(), r.normal(), r.normal()});
}
inline Vector any_direction(Random& r) { return rotate(any_orientation(r), Vector{0, 0, 1}); }
/// Uniform on a logarithmic scale.
inline double log_uniform(Random& r, double from, double to) {
  return from * std::pow(to / from, r.uniform());
}

/// A shape of about this size (m).
template <class Shape>
Shape any_shape(Random& r, double size) {
  const auto around = [&] { return size * r.uniform(0.5, 1.5); };
  if constexpr (std::is_same_v<Shape, Sphere<double>>) {
    return Sphere<double>{around()};
  } else if constexpr (std::is_same_v<Shape, Box<double>>) {
    const double x = around(), y = around();
    return Box<double>{x, y, around()};
  } else if constexpr (std::is_same_v<Shape, Capsule<double>>) {
    const double radius = 0.5 * around();
    return Capsule<double>{radius, around()};
  } else if constexpr (std::is_same_v<Shape, ConvexHull<double>>) {
    const double radius = around();
    if (r.below(3) == 0) return Shape::cylinder(radius, around(), 3 + static_cast<int>(r.below(14)));
    if (r.below(2) == 0) return Shape::cone(radius, 2 * around(), 3 + static_cast<int>(r.below(14)));
    std::vector<Vector> points(4 + r.below(12));
    for (;;) {  // until it is thick enough for float, too
      for (Vector& p : points) p = normal_vector(r, radius / 1.5);
      const Shape hull(points);
      if (hull.inner_radius() > 0.02 * hull.bounding_radius()) return hull;
    }
  } else if constexpr (rbres::detail::PartsOf<Shape>::compound) {
    std::vector<typename Shape::Part> parts;
    const auto count = 1 + static_cast<std::size_t>(r.below(Shape::most_parts));
    while (parts.size() < count) {
      const Vector at = normal_vector(r, 0.6 * size);
      parts.push_back(
          {any_shape<typename Shape::PartShape>(r, 0.6 * size), at, any_orientation(r), r.uniform(0.2, 2)});
    }
    return Shape(parts);
  } else {
    switch (r.below(3)) {
      case 0:
        return any_shape<Sphere<double>>(r, size);
      case 1:
        return any_shape<Box<double>>(r, size);
      default:
        return any_shape<Capsule<double>>(r, size);
    }
  }
}

/// One cell of the grid that the random cases go through, again and again.
struct Cell {
  static constexpr int count = 2 * 3 * 4 * 3 * 2;

  ContactMode mode;
  int index;  ///< of the body that meets a plane, or its next one
  double restitution, friction;
  bool plane;

  explicit Cell(long number) {
    const auto digit = [&](int base) { return std::exchange(number, number / base) % base; };
    constexpr double restitutions[] = {0, 0.5, 0.9, 1}, frictions[] = {0, 0.3, 1};
    mode = digit(2) == 0 ? ContactMode::continuous : ContactMode::discrete;
    index = static_cast<int>(digit(3));
    restitution = restitutions[digit(4)];
    friction = frictions[digit(3)];
    plane = digit(2) == 0;
  }
  int partner() const { return (index + 1) % bodies; }
  Material<double> material() const { return {restitution, friction}; }
  std::string text() const {
    return detail::text("body ", index, plane ? " and planes" : detail::text(" and body ", partner()),
                        ", e = ", restitution, ", friction ", friction,
                        mode == ContactMode::continuous ? ", continuous" : ", discrete");
  }
};

/// Three bodies of all sizes and masses. A third of them are turned in their principal axes, a third have
/// three equal moments, so that free flight keeps their energy to rounding.
template <class Shape>
World<Shape> any_system(Random& r, const Material<double>& material, std::vector<Plane<double>> planes = {},
                        double spread = 5) {
  const double size = log_uniform(r, 0.03, 1), mass = log_uniform(r, 0.1, 10);
  const auto body = [&](std::size_t) {
    const Shape shape = any_shape<Shape>(r, size * log_uniform(r, 1 / spread, spread));
    const double m = mass * log_uniform(r, 1 / (spread * spread), spread * spread);
    const Body<double, Shape> uniform(shape, m, material);
    const Vector moments = uniform.inertia();
    switch (r.below(3)) {
      case 0:
        return uniform;
      case 1: {
        const double equal = (moments.x + moments.y + moments.z) / 3;
        return Body<double, Shape>(shape, m, Vector{equal, equal, equal}, material);
      }
      default: {
        const Eigen::Matrix3d turn = Eigen::Quaterniond(any_orientation(r)).toRotationMatrix();
        const Eigen::Matrix3d tensor = turn * Eigen::Vector3d(moments).asDiagonal() * turn.transpose();
        return Body<double, Shape>(shape, m, Eigen::Matrix3d(0.5 * (tensor + tensor.transpose())), material);
      }
    }
  };
  return [&]<std::size_t... I>(std::index_sequence<I...>) {
    return World<Shape>({body(I)...}, std::move(planes));
  }
  (std::make_index_sequence<bodies>{});
}

/// The signed distance (m) of two surfaces; `first` is a body, or -1 - p for plane p.
template <class System>
double separation(const System& system, const typename System::State& y, int first, int second) {
  const Candidate who{first, second};
  double least = INFINITY;
  for (std::size_t k = 0; k < rbres::detail::part_pairs(system, who); ++k) {
    rbres::detail::with_part_manifold(
        system, y, first, second, rbres::detail::part_pair(system, who, k),
        [&](const auto& m, auto) { least = std::min(least, static_cast<double>(m.separation)); });
  }
  return least;
}

/// The deepest overlap, as a share of the smaller body's bounding radius; minus infinity: none.
template <class System>
double overlap(const System& system, const typename System::State& y) {
  double worst = -INFINITY;
  for (const auto& contact : contacts(system, y)) {
    double size = static_cast<double>(system[contact.second].bounding_radius());
    if (!contact.with_plane())
      size = std::min(size, static_cast<double>(system[contact.first].bounding_radius()));
    worst = std::max(worst, -static_cast<double>(contact.gap) / size);
  }
  return worst;
}

/// Where a case of a cell starts: nothing pulls, one body flies into the corner of two planes or at another
/// body, and what is not meant to meet anything is far away.
template <class Shape>
States cell_start(const World<Shape>& system, const Cell& cell, Random& r) {
  States y;
  const int a = cell.index, b = cell.partner();
  const double ra = system[a].bounding_radius(), rb = system[b].bounding_radius();
  const Vector away = cell.plane ? system.planes()[0].normal + system.planes()[1].normal : any_direction(r);
  double size = 0;
  for (int i = 0; i < bodies; ++i) size = std::max(size, system[i].bounding_radius());
  for (int i = 0; i < bodies; ++i) {
    y[i].position = (20 * size * (i + 1)) * away;
    y[i].orientation = any_orientation(r);
  }
  y[a].angular_velocity = normal_vector(r, r.uniform(0, 3));
  if (cell.plane) {
    const Vector in =
        r.uniform(0, 3) * system.planes()[1].normal + r.uniform(0.3, 3) * system.planes()[0].normal;
    y[a].position = (1.05 * ra) * away;
    y[a].velocity = normal_vector(r, ra) - ra * in;
    return y;
  }
  const Vector way = (1.05 * (ra + rb)) * any_direction(r);
  y[a].position = {};
  y[b].position = way;
  y[a].velocity = normal_vector(r, 0.3 * (ra + rb));
  y[b].velocity = normal_vector(r, 0.3 * (ra + rb)) - r.uniform(0.3, 1) * way;
  y[b].angular_velocity = normal_vector(r, r.uniform(0, 3));
  return y;
}
/// The planes of a case: a floor and a wall, any way round.
inline std::vector<Plane<double>> cell_planes(const Cell& cell, Random& r) {
  if (!cell.plane) return {};
  const Quat<double> turn = any_orientation(r);
  return {{rotate(turn, Vector{0, 0, 1}), 0, cell.material()},
          {rotate(turn, Vector{1, 0, 0}), 0, cell.material()}};
}
/// A step (s) that sees little of any body's turn, whatever its impacts add to its spin.
template <class Shape>
double cell_step(const World<Shape>& system, const Cell& cell, Random& r) {
  const double a = system[cell.index].bounding_radius(),
               b = cell.plane ? a : system[cell.partner()].bounding_radius();
  return log_uniform(r, 1e-3, 1e-2) / (1 + (a + b) / std::min(a, b));
}

}  // namespace validate
