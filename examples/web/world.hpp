// The world of the page: up to 32 bodies in an open room, which the pointer may pull. No part of it knows of
// the browser, so that a native program runs the same world.
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <rbres/core/philox.hpp>
#include <rbres/dynamics/forces.hpp>
#include <rbres/dynamics/integrators.hpp>
#include <rbres/sim/simulate.hpp>
#include <vector>

namespace web {

using namespace rbres;

/// What a scene is made from.
struct Scene {
  int bodies = 12;
  bool spheres = true, boxes = true, capsules = true;  ///< at least one of them
  double restitution = 0.5, friction = 0.3;            ///< of all surfaces
  double gravity = 9.81;                               ///< downwards, m/s^2
  int seed = 1;
};

inline constexpr int most_bodies = 32;     ///< a System's size is a type
inline constexpr double half_width = 1.6;  ///< of the room, m
inline constexpr double density = 500;     ///< kg/m^3
inline constexpr double step = 1.0 / 240;  ///< s
inline constexpr int steps_per_frame = 4;  ///< of the picture, of which there are 60 a second

using Room = System<double, most_bodies>;
using State = Room::State;

/// A spring from a point of a body to the pointer, with critical damping.
struct Grip {
  int body = -1;        ///< none
  Vec3<double> point;   ///< of the body, body frame, m
  Vec3<double> target;  ///< world frame, m
};

/// The force of a grip that someone else moves.
struct Pull {
  const Grip* grip;

  Wrench<double> operator()(const Body<double>& body, const RigidState<double>& now, int index,
                            double) const {
    if (index != grip->body) return {};
    constexpr double rate = 12;  // of the spring, 1/s
    const Vec3<double> arm = rotate(now.orientation, grip->point);
    const Vec3<double> speed = now.velocity + cross(now.angular_velocity_world(), arm);
    const Vec3<double> way = grip->target - now.position - arm;
    const Vec3<double> force = (0.5 * body.mass()) * (rate * rate * way - 2 * rate * speed);
    return {force, rotate_back(now.orientation, cross(arm, force))};
  }
};

/// The bodies of a scene: those that it has, then static ones far below the floor, where nothing comes.
class Cast {
 public:
  explicit Cast(const Scene& scene) : material_{scene.restitution, scene.friction} {
    if (scene.bodies < 1 || scene.bodies > most_bodies)
      detail::refuse("bodies", detail::text("1 to ", most_bodies), scene.bodies);
    std::vector<int> kinds;
    for (const auto& [wanted, kind] :
         {std::pair(scene.spheres, 0), std::pair(scene.boxes, 1), std::pair(scene.capsules, 2)})
      if (wanted) kinds.push_back(kind);
    if (kinds.empty()) detail::refuse("shapes", "one or more of spheres, boxes and capsules", "none");
    Random random(static_cast<std::uint64_t>(scene.seed));
    for (int i = 0; i < most_bodies; ++i) {
      if (i < scene.bodies) {
        bodies_.push_back(body(kinds[static_cast<std::size_t>(i) % kinds.size()], random));
        state_[i] = place(i, random);
      } else {
        bodies_.push_back(Body<double>::kinematic(Sphere{0.1}));
        state_[i].position = {0, 0, -1e3 - i};
      }
    }
  }

  /// The bodies among a floor and four walls.
  Room room() const {
    const double w = -half_width;
    std::array<Body<double>, most_bodies> all = array(std::make_index_sequence<most_bodies>{});
    return {all,
            {floor_plane(material_),
             {{1, 0, 0}, w, material_},
             {{-1, 0, 0}, w, material_},
             {{0, 1, 0}, w, material_},
             {{0, -1, 0}, w, material_}}};
  }
  /// Where they start.
  const State& state() const { return state_; }

 private:
  Body<double> body(int kind, Random& random) const {
    const double a = random.uniform(0.10, 0.18), b = random.uniform(0.07, 0.16),
                 c = random.uniform(0.07, 0.14);
    if (kind == 0) return Body<double>::of_density(Sphere{a}, density, material_);
    if (kind == 1) return Body<double>::of_density(Box{a, b, c}, density, material_);
    return Body<double>::of_density(Capsule{0.6 * a, b}, density, material_);
  }
  /// In layers of nine above the floor, too far apart to touch.
  static RigidState<double> place(int i, Random& random) {
    const auto some = [&](double most) { return random.uniform(-most, most); };
    RigidState<double> y;
    const double spacing = 0.75;
    y.position = {spacing * (i % 3 - 1) + some(0.08), spacing * (i / 3 % 3 - 1) + some(0.08),
                  0.6 + 0.65 * (i / 9) + some(0.04)};
    const Quat<double> q{some(1), some(1), some(1), random.uniform(0.1, 1)};
    const double size = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
    y.orientation = {q.x / size, q.y / size, q.z / size, q.w / size};
    y.velocity = {some(1.5), some(1.5), some(0.5)};
    y.angular_velocity = {some(4), some(4), some(4)};
    return y;
  }
  template <std::size_t... I>
  std::array<Body<double>, most_bodies> array(std::index_sequence<I...>) const {
    return {bodies_[I]...};
  }

  Material<double> material_;
  std::vector<Body<double>> bodies_;
  State state_;
};

/// A scene that runs.
class World {
 public:
  explicit World(const Scene& scene)
      : scene_(scene),
        cast_(scene),
        room_(cast_.room()),
        gravity_{{0, 0, -scene.gravity}},
        stepper_(room_, Forces{gravity_, Pull{&grip_}}, Rk4{}, {.step = step}),
        state_(cast_.state()) {
    check_state(room_, state_);
  }
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  /// So many steps on. False where a number is no longer finite.
  bool advance(int steps) {
    for (int k = 0; k < steps; ++k, ++steps_)
      if (stepper_.step(state_, time(), step) >= 0) return false;
    return true;
  }

  int bodies() const { return scene_.bodies; }
  double time() const { return step * static_cast<double>(steps_); }
  const Room& room() const { return room_; }
  const Gravity<double>& gravity() const { return gravity_; }
  State& state() { return state_; }
  const State& state() const { return state_; }
  Grip& grip() { return grip_; }
  long impacts() const { return stepper_.tally().impacts; }

  /// Mechanical energy, J; 0 for bodies at rest on the floor's height.
  double energy() const {
    double sum = 0;
    for (int i = 0; i < bodies(); ++i)
      sum += kinetic_energy(room_[i], state_[i]) - room_[i].mass() * dot(gravity_.g, state_[i].position);
    return sum;
  }
  /// Calls see(position) for every point where surfaces are closer than 0.1 mm.
  template <class See>
  void contact_points(const See& see) const {
    for (const auto& contact : contacts(room_, state_, 1e-4))
      for (const auto& point : contact.points()) see(point.position);
  }

 private:
  Scene scene_;
  Cast cast_;
  Room room_;
  Gravity<double> gravity_;
  Grip grip_;
  Stepper<Room, Forces<Gravity<double>, Pull>, Rk4> stepper_;
  State state_;
  long steps_ = 0;
};

}  // namespace web
