#pragma once

#include "follow.hpp"

namespace validate {

/// Three bodies thrown at one another above a floor, under gravity.
template <class Shape>
struct Crowd {
  World<Shape> system;
  States start;
  Vector gravity;
  double step, size, speed;
  long steps;
};

/// Body i of a system, or whatever body stands for it in another.
template <class Shape, class Pick>
World<Shape> with_bodies(const Pick& pick, const std::vector<Plane<double>>& planes) {
  return [&]<std::size_t... I>(std::index_sequence<I...>) {
    return World<Shape>({pick(static_cast<int>(I))...}, planes);
  }
  (std::make_index_sequence<bodies>{});
}

template <class Shape>
Crowd<Shape> any_crowd(Random& r, const Cell& cell) {
  const auto free = any_system<Shape>(r, cell.material(), {}, 1.5);
  double size = 0;
  for (int i = 0; i < bodies; ++i) size = std::max(size, free[i].bounding_radius());
  std::vector<Plane<double>> planes;
  if (cell.plane)
    planes = {{{0, 0, 1}, -2.2 * size, cell.material()}, {{1, 0, 0}, -4 * size, cell.material()}};
  const double speed = cell.plane ? std::sqrt(9.81 * size) : size;
  Crowd<Shape> crowd{with_bodies<Shape>([&](int i) { return free[i]; }, planes), {}, {}, 0, size, speed, 0};
  if (cell.plane) crowd.gravity = {0, 0, -9.81};
  const Quat<double> turn = any_orientation(r);
  for (int i = 0; i < bodies; ++i) {
    const double angle = 2 * std::numbers::pi * i / bodies;
    const Vector out = Vector{std::cos(angle), std::sin(angle), 0};
    auto& y = crowd.start[i];
    y.position = (1.3 * size) * (cell.plane ? out : rotate(turn, out)) + normal_vector(r, 0.02 * size);
    y.orientation = any_orientation(r);
    y.velocity = (-r.uniform(0.5, 1) * speed / size) * y.position + normal_vector(r, 0.1 * speed);
    y.angular_velocity = normal_vector(r, speed / size);
  }
  const double duration = 2 * size / speed;
  crowd.steps = 100 + static_cast<long>(r.below(200));
  crowd.step = duration / static_cast<double>(crowd.steps);
  return crowd;
}

/// Bodies that lie on the floor z = 0, apart from one another: boxes on a face, capsules on their side.
template <class Shape>
States lying(const World<Shape>& system) {
  double apart = 0;
  for (int k = 0; k < bodies; ++k) apart += 10 * system[k].bounding_radius();
  States y;
  for (int k = 0; k < bodies; ++k) {
    y[k].orientation = normalized(Quat<double>{0, std::sqrt(0.5), 0, std::sqrt(0.5)} *
                                  system[k].shape_rotation().conjugate());
    y[k].position.z -= separation(system, y, -1, k);
    y[k].position.x = apart * k;
  }
  return y;
}
/// Puts body b on body a.
template <class Shape>
void put_on(const World<Shape>& system, States& y, int b, int a) {
  y[b].position = y[a].position;
  y[b].position.z += system[a].bounding_radius() + system[b].bounding_radius();
  y[b].position.z -= separation(system, y, std::min(a, b), std::max(a, b));
}

template <class Shape>
States end_of(const Crowd<Shape>& crowd, ContactMode mode) {
  Runner<double, Shape> runner(crowd.system, crowd.gravity, crowd.step, mode);
  runner.start(0, crowd.start);
  runner.advance(crowd.steps);
  return runner.state(0);
}
/// How far two ends are apart, over the size of the bodies and their speed.
template <class Shape>
double apart(const Crowd<Shape>& crowd, const States& a, const States& b) {
  double worst = 0;
  for (int i = 0; i < bodies; ++i) {
    worst = std::max(
        {worst, norm(a[i].position - b[i].position) / crowd.size,
         norm(a[i].velocity - b[i].velocity) / crowd.speed,
         norm(a[i].angular_velocity_world() - b[i].angular_velocity_world()) * crowd.size / crowd.speed});
  }
  return worst;
}

/// What must not depend on how a world is written down.
struct SymmetryFigures {
  Figure permutation, planes, rotation, translation, mirror, boost, nudge;

  /// The largest of all.
  Figure all() const {
    Figure worst;
    for (const Figure& f : {permutation, planes, rotation, translation, mirror, boost, nudge}) worst(f);
    return worst;
  }
};
/// Bodies that bounce, and bodies that come to rest at once (e = 0) or whose friction is so large that the
/// law of impact need not have one solution.
struct SplitSymmetry {
  SymmetryFigures bouncing, resting;
};

template <class Shape>
SplitSymmetry symmetry(const Cases& cases) {
  SplitSymmetry split;
  each_case(cases, [&](long i, Random& r) {
    const Cell cell(i);
    SymmetryFigures& worst = cell.restitution == 0 || cell.friction == 1 ? split.resting : split.bouncing;
    const auto crowd = any_crowd<Shape>(r, cell);
    const States end = end_of(crowd, cell.mode);
    const auto where = cell.text();
    auto other = crowd;

    // Every order of the bodies, and the planes the other way round.
    for (const std::array<int, 3>& order : {std::array{0, 2, 1}, std::array{1, 0, 2}, std::array{2, 1, 0},
                                            std::array{1, 2, 0}, std::array{2, 0, 1}}) {
      const auto from = [&](int k) { return order[static_cast<std::size_t>(k)]; };
      other.system = with_bodies<Shape>([&](int k) { return crowd.system[from(k)]; }, crowd.system.planes());
      for (int k = 0; k < bodies; ++k) other.start[k] = crowd.start[from(k)];
      const States found = end_of(other, cell.mode);
      States back;
      for (int k = 0; k < bodies; ++k) back[from(k)] = found[k];
      worst.permutation(apart(crowd, end, back), i, where);
    }
    /// The same bodies between planes that each went through f.
    const auto with_planes = [&](const auto& f) {
      auto planes = crowd.system.planes();
      for (auto& plane : planes) f(plane);
      return with_bodies<Shape>([&](int k) { return crowd.system[k]; }, planes);
    };
    /// Runs what f makes of the start, and takes the end back.
    const auto compare = [&](Figure& figure, const auto& there, const auto& back) {
      other.start = crowd.start;
      for (auto& body : other.start.body) there(body);
      States found = end_of(other, cell.mode);
      for (auto& body : found.body) back(body);
      figure(apart(crowd, end, found), i, where);
    };
    const auto nothing = [](auto&) {};

    auto planes = crowd.system.planes();
    std::reverse(planes.begin(), planes.end());
    other.system = with_bodies<Shape>([&](int k) { return crowd.system[k]; }, planes);
    compare(worst.planes, nothing, nothing);

    const Quat<double> turn = any_orientation(r), unturn = turn.conjugate();
    const auto turned = [](const Quat<double>& q) {
      return [&q](RigidState<double>& y) {
        y = {rotate(q, y.position), normalized(q * y.orientation), rotate(q, y.velocity), y.angular_velocity};
      };
    };
    other.gravity = rotate(turn, crowd.gravity);
    other.system = with_planes([&](auto& plane) { plane.normal = rotate(turn, plane.normal); });
    compare(worst.rotation, turned(turn), turned(unturn));
    other.gravity = crowd.gravity;

    const Vector way = normal_vector(r, 10 * crowd.size);
    other.system = with_planes([&](auto& plane) { plane.offset += dot(plane.normal, way); });
    compare(
        worst.translation, [&](auto& y) { y.position += way; }, [&](auto& y) { y.position -= way; });

    // In the mirror of y, of what is not turned against the axes of its inertia.
    const auto mirrored = [](RigidState<double>& y) {
      y.position.y = -y.position.y;
      y.velocity.y = -y.velocity.y;
      y.orientation = {-y.orientation.x, y.orientation.y, -y.orientation.z, y.orientation.w};
      y.angular_velocity = {-y.angular_velocity.x, y.angular_velocity.y, -y.angular_velocity.z};
    };
    const bool straight = std::all_of(crowd.start.body.begin(), crowd.start.body.end(), [&](const auto& y) {
      return crowd.system[static_cast<int>(&y - crowd.start.body.data())].shape_rotation() == Quat<double>{};
    });
    if (straight) {
      other.system = with_planes([](auto& plane) { plane.normal.y = -plane.normal.y; });
      compare(worst.mirror, mirrored, mirrored);
    }

    other.system = crowd.system;
    if (!cell.plane) {
      const Vector speed = normal_vector(r, crowd.speed);
      const double time = crowd.step * static_cast<double>(crowd.steps);
      compare(
          worst.boost, [&](auto& y) { y.velocity += speed; },
          [&](auto& y) { y.velocity -= speed, y.position -= time * speed; });
    }
    compare(
        worst.nudge, [&](auto& y) { y.position += normal_vector(r, 1e-13 * crowd.size); }, nothing);
  });
  return split;
}

}  // namespace validate
