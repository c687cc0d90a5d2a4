#pragma once

#include <cmath>
#include <tuple>

#include <rbres/body/compound.hpp>
#include <rbres/body/convex_hull.hpp>
#include <rbres/body/system.hpp>
#include <rbres/dynamics/forces.hpp>
#include <rbres/io/json_file.hpp>

/// @file
/// A world in JSON, so that a data set says what it was made in. Numbers read back to the same bits.
namespace rbres::RBRES_ABI::detail {

template <class T>
Json vector_setting(const Vec3<T>& v) {
  return Json::array({v.x, v.y, v.z});
}

template <class S>
Json shape_setting(const Sphere<S>& shape) {
  return Json::object({{"sphere", shape.radius}});
}
template <class S>
Json shape_setting(const Box<S>& shape) {
  return Json::object({{"box", vector_setting(shape.half)}});
}
template <class S>
Json shape_setting(const Capsule<S>& shape) {
  return Json::object({{"capsule", Json::array({shape.radius, shape.half_length})}});
}
template <class S>
Json shape_setting(const ConvexHull<S>& shape) {
  Json vertices = Json::array();
  for (const Vec3<S>& vertex : shape.vertices()) vertices.push_back(vector_setting(vertex));
  return Json::object({{"convex_hull", vertices}});
}

template <class S, int M, class Shape>
Json shape_setting(const Compound<S, M, Shape>& shape) {
  Json parts = Json::array();
  for (const auto& part : shape.parts()) {
    const Quat<S>& turn = part.orientation;
    parts.push_back(
        Json::object({{"shape", with_shape(part.shape, [](const auto& own) { return shape_setting(own); })},
                      {"position", vector_setting(part.position)},
                      {"orientation", Json::array({turn.x, turn.y, turn.z, turn.w})},
                      {"density", part.density}}));
  }
  return Json::object({{"compound", parts}});
}

template <class S>
Json material_setting(const Material<S>& material) {
  return Json::array({material.restitution, material.friction});
}

/// Adds what a force model says of itself: of the user's own ones, only that they are there.
template <class Model>
void add_forces(Json& all, const Model&) {
  all.push_back(Json::object({{"force", "own"}}));
}
template <class T>
void add_forces(Json& all, const Gravity<T>& gravity) {
  all.push_back(Json::object({{"force", "gravity"}, {"g", vector_setting(gravity.g)}}));
}
template <class T>
void add_forces(Json& all, const FluidFriction<T>& friction) {
  all.push_back(Json::object({{"force", "fluid friction"},
                              {"density", friction.density},
                              {"drag", friction.drag},
                              {"rotational_drag", friction.rotational_drag}}));
}
template <class T>
void add_forces(Json& all, const Damping<T>& damping) {
  all.push_back(
      Json::object({{"force", "damping"}, {"linear", damping.linear}, {"angular", damping.angular}}));
}
template <class... Models>
void add_forces(Json& all, const Forces<Models...>& forces) {
  std::apply([&](const auto&... models) { (add_forces(all, models), ...); }, forces.models);
}

/// Refuses numbers that JSON does not have, by their place.
inline void check_numbers(const Json& setting) {
  const Json flat = setting.flatten();
  for (const auto& entry : flat.items())
    if (entry.value().is_number_float() && !std::isfinite(entry.value().get<double>()))
      refuse("setting of a data set: " + entry.key(), "a finite number", entry.value().get<double>());
}

/// The bodies, planes and forces of a world.
template <class S, int N, class Shape, int P, class Model>
Json world_setting(const System<S, N, Shape, P>& system, const Model& forces) {
  Json bodies = Json::array(), planes = Json::array(), models = Json::array();
  for (int b = 0; b < N; ++b) {
    const auto& body = system[b];
    const Quat<S>& turn = body.shape_rotation();
    bodies.push_back(Json::object(
        {{"shape", with_shape(body.shape(), [](const auto& shape) { return shape_setting(shape); })},
         {"mass", body.mass()},
         {"inertia", vector_setting(body.inertia())},
         {"shape_rotation", Json::array({turn.x, turn.y, turn.z, turn.w})},
         {"restitution_friction", material_setting(body.material())},
         {"kinematic", body.is_kinematic()}}));
  }
  for (const Plane<S>& plane : system.planes())
    planes.push_back(Json::object({{"normal", vector_setting(plane.normal)},
                                   {"offset", plane.offset},
                                   {"restitution_friction", material_setting(plane.material)}}));
  add_forces(models, forces);
  return Json::object({{"body_count", N},
                       {"bodies", bodies},
                       {"planes", planes},
                       {"without_contact", system.without_contact()},
                       {"forces", models}});
}

}  // namespace rbres::RBRES_ABI::detail
