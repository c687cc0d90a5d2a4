// The world of the page as functions of plain numbers, which page.js calls. Everything stands in SI units, as
// in rbres.
#include <emscripten.h>

#include <rbres/io/contact_law.hpp>

#include "ghost.hpp"

#define WEB_EXPORT extern "C" EMSCRIPTEN_KEEPALIVE

// What rbres refuses becomes an exception of JavaScript.
EM_JS(void, web_refuse, (const char* what), { throw new Error(UTF8ToString(what)); });

namespace {

using namespace web;

constexpr int most_points = 1024;

std::unique_ptr<World> world;
std::unique_ptr<ContactLaw<>> law;
std::unique_ptr<Ghost> ghost;
std::array<double, 3 * most_points> points;
std::array<double, 3> sizes;

}  // namespace

int main() { error_handler = web_refuse; }

/// Makes a scene. Where it is refused, the scene before stays.
WEB_EXPORT void web_start(int bodies, bool spheres, bool boxes, bool capsules, double restitution,
                          double friction, double gravity, int seed) {
  auto next =
      std::make_unique<World>(Scene{bodies, spheres, boxes, capsules, restitution, friction, gravity, seed});
  ghost = law ? std::make_unique<Ghost>(*law, *next) : nullptr;
  world = std::move(next);
}

/// One frame on: false where a number is no longer finite.
WEB_EXPORT bool web_step() { return world->advance(steps_per_frame); }

/// The file of a learned contact law, which must be there; from here on its ghost begins.
WEB_EXPORT void web_load_law(const char* path) {
  auto next = std::make_unique<ContactLaw<>>(load<ContactLaw<>>(path));
  ghost = std::make_unique<Ghost>(*next, *world);
  law = std::move(next);
}
/// Puts the ghost where the bodies are.
WEB_EXPORT void web_restart_ghost() { ghost->restart(); }
/// The ghost follows to the time of the world.
WEB_EXPORT void web_follow() { ghost->follow(); }
/// As web_states().
WEB_EXPORT const double* web_ghost_states() { return &ghost->states()->position.x; }
/// Mean distance of the ghost's bodies from the world's, m.
WEB_EXPORT double web_error() { return ghost->error(); }

/// 13 numbers a body: position 3, orientation x y z w, velocity 3, angular velocity 3.
WEB_EXPORT const double* web_states() { return &world->state()[0].position.x; }
WEB_EXPORT int web_bodies() { return world->bodies(); }
WEB_EXPORT double web_time() { return world->time(); }
WEB_EXPORT double web_energy() { return world->energy(); }
WEB_EXPORT int web_impacts() { return static_cast<int>(world->impacts()); }

/// The shape of a body: 0 sphere (radius), 1 box (half extents), 2 capsule (radius, half length along z). The
/// numbers stand in web_sizes().
WEB_EXPORT int web_shape(int body) {
  const auto set = [&](double a, double b, double c) { sizes = {a, b, c}; };
  return rbres::detail::with_shape(world->room()[body].shape(), [&](const auto& shape) {
    using Shape = std::decay_t<decltype(shape)>;
    if constexpr (std::is_same_v<Shape, Sphere<double>>) {
      set(shape.radius, 0, 0);
      return 0;
    } else if constexpr (std::is_same_v<Shape, Box<double>>) {
      set(shape.half.x, shape.half.y, shape.half.z);
      return 1;
    } else {
      set(shape.radius, shape.half_length, 0);
      return 2;
    }
  });
}

WEB_EXPORT const double* web_sizes() { return sizes.data(); }

/// Finds the contact points, and returns how many: web_points() are their positions.
WEB_EXPORT int web_find_points() {
  int count = 0;
  world->contact_points([&](const Vec3<double>& p) {
    if (count == most_points) return;
    double* to = &points[static_cast<std::size_t>(3 * count++)];
    to[0] = p.x, to[1] = p.y, to[2] = p.z;
  });
  return count;
}
WEB_EXPORT const double* web_points() { return points.data(); }

/// Grips a body at a point (world frame); -1 lets go.
WEB_EXPORT void web_grip(int body, double x, double y, double z) {
  Grip& grip = world->grip();
  grip.body = body < world->bodies() ? body : -1;
  if (grip.body < 0) return;
  const auto& now = world->state()[body];
  grip.target = {x, y, z};
  grip.point = rotate_back(now.orientation, grip.target - now.position);
}
/// Where the pointer pulls the grip to.
WEB_EXPORT void web_pull(double x, double y, double z) { world->grip().target = {x, y, z}; }
/// Adds to a body's velocity, m/s.
WEB_EXPORT void web_kick(int body, double x, double y, double z) {
  if (body >= 0 && body < world->bodies()) world->state()[body].velocity += Vec3<double>{x, y, z};
}
