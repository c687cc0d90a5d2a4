#pragma once

#include <rbres/core/philox.hpp>
#include <rbres/sim/simulate.hpp>
#include <string_view>

namespace rbres::RBRES_ABI {

/// The scenarios of the paper's experiment, version "standard-3". Scenario i of a world is a pure function of
/// (seed, i). Results refer to this page by name and version; whoever changes a number here or what truth is
/// made of it changes the version. (standard-2 had the same starts; in its truth boxes gained energy where
/// they hit planes.)
///
/// Bodies. 3, 4 or 5 in equal shares. Standard set: balls of radius 0.25 m and 1 kg whose principal moments
/// are (0.0225, 0.0275, 0.0325) kg m^2 (an uneven mass inside, so that spin is gyroscopic). Box set: boxes of
/// half extents (0.30, 0.22, 0.15) m and 1 kg, uniform. Restitution 0.9, friction 0.3. Forces. Gravity 9.81
/// m/s^2; air of 1.2 kg/m^3 with C_d 0.47 (balls) or 1.05 (boxes); damping 0.05 1/s, linear and angular; on
/// each body a wrench that stays the same: force N(0, 2 N) and torque N(0, 0.02 N m) per component.
/// Orientation uniform over rotations. Bounding balls of two bodies are at least 2 cm apart at the start.
/// Free space. Families by i mod 3: `flight` (no bounding balls meet within 5 s), `pair` (bodies 0 and 1 are
/// aimed, under all forces, to meet after 0.2 to 2 s, off centre by up to 0.8 of the sum of their inscribed
/// radii, 0.25 m for balls and 0.15 m for boxes, unless others come between; the others as in flight, but
/// free to hit), `cluster` (all are aimed likewise at points within 0.3 m of a middle that falls from rest
/// with them, to arrive after 0.4 to 1.2 s). Positions uniform in
/// +-2 m; velocities N(0, 1 m/s) where not aimed; aimed bodies come no faster than 6 m/s. Spins N(0, 1.5
/// rad/s). Room. 5 x 5 x 5 m, floor at z = 0. Families by i mod 2: `drop` (let go 0.6 to 3 m above the floor:
/// velocities N(0, 0.5 m/s), spins N(0, 1 rad/s)), `scatter` (anywhere in the room, thrown at 2 to 6 m/s in
/// any direction, spins N(0, 3 rad/s)).
///
/// Share of scenarios, %, that have had a contact (the first impact of truth, to within a sample of 20 ms) by
/// each horizon; of seed 1, the first 10,000 scenarios of a world and set, in the room with boxes the first
/// 600:
///
///                             0.02 s  0.1 s  0.5 s    1 s    2 s    5 s
///     free, standard  flight    0       0      0       0      0      0
///                     pair      0.1     2.4   23.0    56.5  100    100
///                     cluster   0.3     2.7   51.2    99.3  100    100
///     free, box       flight    0       0      0       0      0      0
///                     pair      0       0.8   28.9    66.2  100    100
///                     cluster   0       1.7   66.8    99.9  100    100
///     room, standard  drop      0       4.2   88.9   100    100    100
///                     scatter   6.5    40.2   96.1   100    100    100
///     room, box       drop      0       0.7   88.3   100    100    100
///                     scatter   0.7    27.3   94.7   100    100    100
inline constexpr std::string_view scenario_version = "standard-3";

/// What is around the bodies: nothing, or a room of 5 m.
enum class World { free_space, room };
/// How starts are drawn.
enum class Family { flight, pair, cluster, drop, scatter };
/// What the bodies are: balls with unequal moments, or boxes.
enum class BodySet { standard, box };

/// As files and command lines name it.
/// @{
constexpr std::string_view name(World world) { return world == World::free_space ? "free" : "room"; }
constexpr std::string_view name(BodySet set) { return set == BodySet::standard ? "standard" : "box"; }
constexpr std::string_view name(Family family) {
  constexpr std::string_view names[] = {"flight", "pair", "cluster", "drop", "scatter"};
  return names[static_cast<int>(family)];
}
/// @}

/// Where and how bodies start, and the wrench on each; bodies from `bodies` on are absent.
struct Scenario {
  /// Room for so many.
  static constexpr int most_bodies = 5;
  /// How it was drawn.
  Family family;
  /// How many are there.
  int bodies;
  /// Where they start.
  SystemState<double, most_bodies> state;
  /// Constant, on each body: force in world frame, N; torque in body frame, N m.
  std::array<Wrench<double>, most_bodies> wrench;
};

/// The shape of the bodies of a set.
template <BodySet Set>
using ShapeOf = std::conditional_t<Set == BodySet::standard, Sphere<double>, Box<double>>;

/// A body of the set.
template <BodySet Set>
Body<double, ShapeOf<Set>> scenario_body() {
  const Material<double> material{0.9, 0.3};
  if constexpr (Set == BodySet::standard) {
    return {Sphere<double>{0.25}, 1.0, Vec3<double>{0.0225, 0.0275, 0.0325}, material};
  } else {
    return {Box<double>{0.30, 0.22, 0.15}, 1.0, material};
  }
}

/// N bodies of the set in the world.
template <BodySet Set, int N>
System<double, N, ShapeOf<Set>> scenario_system(World world) {
  const Material<double> material{0.9, 0.3};
  return System<double, N, ShapeOf<Set>>::of(
      scenario_body<Set>(), world == World::room ? room(2.5, 5.0, material) : std::vector<Plane<double>>{});
}

/// The forces without the scenario's own wrenches.
template <BodySet Set>
auto scenario_forces() {
  return Forces{Gravity{}, FluidFriction<double>{.drag = Set == BodySet::standard ? 0.47 : 1.05},
                Damping<double>{.linear = 0.05, .angular = 0.05}};
}

/// All forces of a scenario, or of the scenarios in S's lanes.
template <BodySet Set, class S, int N>
auto scenario_forces(const ConstantWrench<S, N>& wrench) {
  const auto [gravity, friction, damping] = scenario_forces<Set>().models;
  return Forces{gravity, friction, damping, wrench};
}

/// Draws scenarios of one world.
template <BodySet Set>
class ScenarioSampler {
 public:
  /// Scenarios of this world. Another seed gives others.
  ScenarioSampler(World world, std::uint64_t seed)
      : world_(world), seed_(seed), body_(scenario_body<Set>()) {}

  /// What is around the bodies.
  World world() const { return world_; }
  /// The seed that it was made with.
  std::uint64_t seed() const { return seed_; }

  /// Scenario i, which depends on world, seed and i alone.
  Scenario operator()(std::uint64_t i) const {
    Random random(seed_, i);
    const std::uint64_t families = world_ == World::free_space ? 3 : 2;
    Scenario s{};
    s.family = static_cast<Family>(i % families + (world_ == World::free_space ? 0 : 3));
    s.bodies = 3 + static_cast<int>(i / families % 3);
    // Redrawn whole until it is one of its family: a handful of times at most on average.
    do {
      do draw(s, random);
      while (!apart(s, s.state));
      aim(s, random);
      round(s);
    } while (!fits(s));
    return s;
  }

 private:
  static constexpr double gap = 0.02;  // m

  static Vec3<double> normal(Random& r, double deviation) {
    const double x = r.normal(), y = r.normal(), z = r.normal();
    return {deviation * x, deviation * y, deviation * z};
  }
  static Vec3<double> in_box(Random& r, const Vec3<double>& low, const Vec3<double>& high) {
    const double x = r.uniform(low.x, high.x), y = r.uniform(low.y, high.y), z = r.uniform(low.z, high.z);
    return {x, y, z};
  }
  static Vec3<double> in_ball(Random& r, double radius) {
    Vec3<double> v;
    do v = in_box(r, {-1, -1, -1}, {1, 1, 1});
    while (squared_norm(v) > 1);
    return radius * v;
  }

  void draw(Scenario& s, Random& r) const {
    const double radius = body_.bounding_radius(), wall = 2.5 - radius - gap;
    const double spin = s.family == Family::drop ? 1.0 : s.family == Family::scatter ? 3.0 : 1.5;
    for (int i = 0; i < s.bodies; ++i) {
      auto& b = s.state[i];
      auto& w = s.wrench[static_cast<std::size_t>(i)];
      w = {normal(r, 2), normal(r, 0.02)};
      const double qx = r.normal(), qy = r.normal(), qz = r.normal(), qw = r.normal();
      b.orientation = normalized(Quat<double>{qx, qy, qz, qw});
      b.angular_velocity = normal(r, spin);
      if (world_ == World::free_space) {
        b.position = in_box(r, {-2, -2, -2}, {2, 2, 2});
        b.velocity = normal(r, 1);
      } else if (s.family == Family::drop) {
        b.position = in_box(r, {-wall, -wall, 0.6}, {wall, wall, 3.0});
        b.velocity = normal(r, 0.5);
      } else {
        b.position = in_box(r, {-wall, -wall, radius + gap}, {wall, wall, 5 - radius - gap});
        const Vec3<double> direction = normalized_direction(r);  // compilers draw arguments in any order
        b.velocity = r.uniform(2, 6) * direction;
      }
    }
  }

  /// Gives aimed bodies their velocities.
  void aim(Scenario& s, Random& r) const {
    if (s.family == Family::pair) {
      const double when = r.uniform(0.2, 2);
      const Vec3<double> off = in_ball(r, 0.8 * 2 * inscribed_radius());
      send(s.state[1], s.wrench[1], when, flown(s.state[0], s.wrench[0], when).position + off);
    } else if (s.family == Family::cluster) {
      const double when = r.uniform(0.4, 1.2);
      const Vec3<double> middle = flown({}, {}, when).position;
      for (int i = 0; i < s.bodies; ++i) {
        send(s.state[i], s.wrench[static_cast<std::size_t>(i)], when, middle + in_ball(r, 0.3));
      }
    }
  }

  /// Radius of the largest ball within a body.
  double inscribed_radius() const {
    if constexpr (Set == BodySet::standard) {
      return body_.shape().radius;
    } else {
      const Vec3<double>& half = body_.shape().half;
      return std::min({half.x, half.y, half.z});
    }
  }

  /// A body after free flight, as if alone.
  static RigidState<double> flown(const RigidState<double>& body, const Wrench<double>& wrench, double time) {
    const auto system = scenario_system<Set, 1>(World::free_space);
    const auto forces = scenario_forces<Set>(ConstantWrench<double, 1>{{wrench}});
    const double steps = std::ceil(time / 0.1);
    SystemState<double, 1> y{{body}};
    for (int k = 0; k < steps; ++k) y = fly(system, forces, Rk4{}, y, 0.0, time / steps);
    return y[0];
  }

  /// Gives the body the velocity that takes it to within 1 cm of the target: fixed-point corrections, a
  /// little over-relaxed because drag shortens what a change of velocity moves the end.
  static void send(RigidState<double>& body, const Wrench<double>& wrench, double time,
                   const Vec3<double>& target) {
    for (int round = 0; round < 20; ++round) {
      const Vec3<double> miss = target - flown(body, wrench, time).position;
      if (squared_norm(miss) < 1e-4) return;
      body.velocity = body.velocity + (1.2 / time) * miss;
    }
  }

  /// To numbers that a float holds, so that data sets of floats lose nothing.
  static void round(Scenario& s) {
    for (double& x : s.state.vector().reshaped()) x = static_cast<double>(static_cast<float>(x));
    for (auto& w : s.wrench) {
      for (double* x : {&w.force.x, &w.force.y, &w.force.z, &w.torque.x, &w.torque.y, &w.torque.z}) {
        *x = static_cast<double>(static_cast<float>(*x));
      }
    }
  }

  static Vec3<double> normalized_direction(Random& r) {
    Vec3<double> v;
    do v = in_ball(r, 1);
    while (squared_norm(v) < 1e-4);
    return (1 / norm(v)) * v;
  }

  bool fits(const Scenario& s) const {
    if (!apart(s, s.state)) return false;
    for (int i = 0; i < s.bodies; ++i) {
      if (world_ == World::free_space && squared_norm(s.state[i].velocity) > 36) return false;
    }
    if (s.family != Family::flight) return true;
    // Flown once without contact, at steps in which no ball goes farther than a few centimetres against
    // another.
    const auto system = scenario_system<Set, Scenario::most_bodies>(World::free_space);
    const auto forces = scenario_forces<Set>(ConstantWrench<double, Scenario::most_bodies>{s.wrench});
    auto y = s.state;
    for (int k = 0; k < 250; ++k) {
      y = fly(system, forces, Rk4{}, y, 0.0, 0.02);
      if (!apart(s, y)) return false;
    }
    return true;
  }

  /// Whether all bounding balls are apart, with a margin in flight for what lies between two looks.
  bool apart(const Scenario& s, const SystemState<double, Scenario::most_bodies>& y) const {
    const double least = 2 * body_.bounding_radius() + (s.family == Family::flight ? 0.1 : gap);
    for (int i = 0; i < s.bodies; ++i) {
      for (int j = i + 1; j < s.bodies; ++j) {
        if (squared_norm(y[i].position - y[j].position) < least * least) return false;
      }
    }
    return true;
  }

  World world_;
  std::uint64_t seed_;
  Body<double, ShapeOf<Set>> body_;
};

}  // namespace rbres::RBRES_ABI
