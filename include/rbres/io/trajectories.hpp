#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <string>
#include <system_error>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include <rbres/io/json_file.hpp>
#include <rbres/io/npy.hpp>
#include <rbres/io/trajectory_folder.hpp>
#include <rbres/learn/trajectory.hpp>

/// @file
/// Trajectory sets as folders:
///
///     world.json    {"frame_time": s, "gravity": [x, y, z], "planes": [...]}, each plane as {"normal":
///                   [x, y, z], "offset": m}; its free side is dot(normal, p) >= offset
///     states.npy    (scenes, frames, bodies, 13): position (m), orientation (x, y, z, w), velocity (m/s,
///                   world frame), angular velocity (rad/s, body frame)
///     kind.npy      (scenes, bodies): 0 sphere, 1 box, 2 capsule along z
///     size.npy      (scenes, bodies, 3), m: radius; half extents; radius and half length; others are ignored
///     mass.npy      (scenes, bodies), kg
///
/// and, where they are there,
///
///     length.npy    (scenes): how many frames are valid; otherwise all. What follows them is ignored.
///     inertia.npy   (scenes, bodies, 3): principal moments, kg m^2; otherwise those of uniform solids
///     material.npy  (scenes, bodies, 2): restitution and friction; otherwise those of Material
///     wrench.npy    (scenes, bodies, 6): force (N, world frame) and torque (N m, body frame) on each body at
///                   all times; otherwise none
///
/// In world.json may also stand what slows bodies (see Resistance), otherwise nothing does:
/// "fluid_friction": {"density": kg/m^3, "drag": number, "rotational_drag": number} and "damping":
/// {"linear": 1/s, "angular": 1/s}.
///
/// Arrays are <f4 or <f8, kind and length <i8. Planes have the restitution and friction of Material.
namespace rbres::RBRES_ABI {
namespace detail {

inline Vec3<double> vector_at(const Json& object, const char* key, const std::string& what) {
  const Json& numbers = array_at(object, key, what);
  const bool fits = numbers.size() == 3 &&
                    std::all_of(numbers.begin(), numbers.end(), [](const Json& x) { return x.is_number(); });
  if (!fits) refuse(text(what, ", ", key), "three numbers", "something else");
  return {numbers[0].get<double>(), numbers[1].get<double>(), numbers[2].get<double>()};
}

/// The object under a key, or nullptr where there is none.
inline const Json* object_at(const Json& object, const char* key, const std::string& what) {
  const auto found = object.find(key);
  if (found == object.end()) return nullptr;
  if (!found->is_object()) refuse(text(what, ", ", key), "an object", found->type_name());
  return &*found;
}

inline Resistance read_resistance(const Json& world, const std::string& what) {
  Resistance resistance;
  if (const Json* fluid = object_at(world, "fluid_friction", what)) {
    const std::string name = what + ", fluid_friction";
    resistance.friction = {.density = number_at(*fluid, "density", name),
                           .drag = number_at(*fluid, "drag", name),
                           .rotational_drag = number_at(*fluid, "rotational_drag", name)};
  }
  if (const Json* damping = object_at(world, "damping", what)) {
    const std::string name = what + ", damping";
    resistance.damping = {number_at(*damping, "linear", name), number_at(*damping, "angular", name)};
  }
  return resistance;
}

/// Writes one number or more of every body of every scene: of(scene, number of the body).
template <class Numbers>
void write_bodies(const std::filesystem::path& path, const TrajectorySet& set,
                  std::vector<Eigen::Index> sample_shape, const Numbers& of) {
  using Scalar = typename decltype(of(set[0], 0))::Scalar;
  NpyWriter<Scalar> writer(path, std::move(sample_shape));
  for (const Trajectory& scene : set) {
    typename NpyWriter<Scalar>::Columns column(writer.features(), 1);
    const Eigen::Index each = writer.features() / scene.bodies();
    for (int i = 0; i < scene.bodies(); ++i) column.middleRows(i * each, each) = of(scene, i);
    writer.append(column);
  }
  writer.commit();
}

inline void write_states(const std::filesystem::path& path, const TrajectorySet& set, int frames) {
  const Eigen::Index bodies = set[0].bodies();
  NpyWriter<double> writer(path, {frames, bodies, 13});
  Eigen::MatrixXd column(writer.features(), 1);
  for (const Trajectory& scene : set) {
    column.setZero();
    for (int t = 0; t < scene.frames(); ++t)
      for (int i = 0; i < scene.bodies(); ++i)
        column.middleRows<13>(13 * (t * bodies + i)) = scene.state(t, i).vector();
    writer.append(column);
  }
  writer.commit();
}

inline void write_world(const std::filesystem::path& path, const TrajectorySet& set) {
  const auto array = [](const Vec3<double>& v) { return Json{v.x, v.y, v.z}; };
  Json planes = Json::array();
  for (const Plane<double>& plane : set.planes())
    planes.push_back({{"normal", array(plane.normal)}, {"offset", plane.offset}});
  Json world{{"frame_time", set.frame_time()}, {"gravity", array(set.gravity())}, {"planes", planes}};
  if (const auto& [fluid, damping] = set.resistance(); set.resistance().any()) {
    world["fluid_friction"] = {
        {"density", fluid.density}, {"drag", fluid.drag}, {"rotational_drag", fluid.rotational_drag}};
    world["damping"] = {{"linear", damping.linear}, {"angular", damping.angular}};
  }
  write_text(path, world.dump(1) + "\n");
}

inline std::int64_t kind_of(const Body<double>& body) {
  return static_cast<std::int64_t>(body.shape().index());
}
inline Eigen::Vector3d size_of(const Body<double>& body) {
  struct {
    Eigen::Vector3d operator()(const Sphere<double>& s) const { return {s.radius, 0, 0}; }
    Eigen::Vector3d operator()(const Box<double>& s) const { return {s.half.x, s.half.y, s.half.z}; }
    Eigen::Vector3d operator()(const Capsule<double>& s) const { return {s.radius, s.half_length, 0}; }
  } size;
  return std::visit(size, body.shape());
}

/// Makes a folder where there is none; refuses one that holds anything.
inline void make_empty_folder(const std::filesystem::path& folder) {
  make_folder(folder);
  std::error_code problem;
  const bool empty = std::filesystem::is_empty(folder, problem);
  refuse_problem(folder, "be looked at", problem);
  if (!empty) refuse(folder.string(), "an empty folder", "one with files in it");
}

}  // namespace detail

/// Reads a folder of trajectories. Where files are missing or truncated, do not fit together, or hold what no
/// world can (see Trajectory and TrajectorySet), throws an Error that names the place.
inline TrajectorySet read_trajectories(const std::filesystem::path& folder) {
  using detail::text;
  const std::string world_path = (folder / "world.json").string();
  const detail::Json world = detail::read_json(world_path);
  std::vector<Plane<double>> planes;
  for (const detail::Json& plane : detail::array_at(world, "planes", world_path)) {
    const std::string what = text(world_path, ", plane ", planes.size());
    if (!plane.is_object()) detail::refuse(what, "an object", plane.type_name());
    planes.push_back(
        {detail::vector_at(plane, "normal", what), detail::number_at(plane, "offset", what), {}});
  }
  const double frame_time = detail::number_at(world, "frame_time", world_path);
  const Vec3<double> gravity = detail::vector_at(world, "gravity", world_path);

  const Resistance resistance = detail::read_resistance(world, world_path);

  const detail::TrajectoryFolder arrays(folder);
  std::vector<Trajectory> scenes;
  for (Eigen::Index s = 0; s < arrays.scenes(); ++s) {
    scenes.push_back(detail::naming([&] { return text(folder.string(), ", scene ", s, ", "); },
                                    [&] { return arrays.scene(s); }));
  }
  return detail::naming(
      [&] { return world_path + ", "; },
      [&] { return TrajectorySet(frame_time, gravity, planes, std::move(scenes), resistance); });
}

/// Writes a set as such a folder, which is made where there is none. Throws Error where the folder holds
/// anything, for scenes of different numbers of bodies, and for what the format cannot say: bodies whose
/// shapes stand askew in their principal axes, planes of another than the default material.
inline void write_trajectories(const std::filesystem::path& folder, const TrajectorySet& set) {
  const auto differs = [](const Material<double>& m) {
    return m.restitution != Material<double>{}.restitution || m.friction != Material<double>{}.friction;
  };
  bool lengths = false, moments = false, materials = false, wrenches = false;
  int frames = 0;
  for (const Trajectory& scene : set) {
    if (scene.bodies() != set[0].bodies())
      detail::refuse("scenes to write", detail::text(set[0].bodies(), " bodies, as in the first"),
                     scene.bodies());
    frames = std::max(frames, scene.frames());
    lengths = lengths || scene.frames() != set[0].frames();
    wrenches = wrenches || !scene.wrenches().empty();
    for (int i = 0; i < scene.bodies(); ++i) {
      const Body<double>& body = scene.body(i);
      if (!(body.shape_rotation() == Quat<double>{}))
        detail::refuse("bodies to write", "shapes along their principal axes", "one askew");
      moments = moments || !(body.inertia() == Body<double>(body.shape(), body.mass()).inertia());
      materials = materials || differs(body.material());
    }
  }
  for (const Plane<double>& plane : set.planes())
    if (differs(plane.material)) detail::refuse("planes to write", "the default material", "another");

  detail::make_empty_folder(folder);
  using Integer = Eigen::Matrix<std::int64_t, 1, 1>;
  using Number = Eigen::Matrix<double, 1, 1>;
  const Eigen::Index bodies = set[0].bodies();
  detail::write_states(folder / "states.npy", set, frames);
  detail::write_bodies(folder / "kind.npy", set, {bodies},
                       [](const Trajectory& s, int i) { return Integer(detail::kind_of(s.body(i))); });
  detail::write_bodies(folder / "size.npy", set, {bodies, 3},
                       [](const Trajectory& s, int i) { return detail::size_of(s.body(i)); });
  detail::write_bodies(folder / "mass.npy", set, {bodies},
                       [](const Trajectory& s, int i) { return Number(s.body(i).mass()); });
  if (moments) {
    detail::write_bodies(folder / "inertia.npy", set, {bodies, 3}, [](const Trajectory& s, int i) {
      const Vec3<double>& moment = s.body(i).inertia();
      return Eigen::Vector3d(moment.x, moment.y, moment.z);
    });
  }
  if (materials) {
    detail::write_bodies(folder / "material.npy", set, {bodies, 2}, [](const Trajectory& s, int i) {
      return Eigen::Vector2d(s.body(i).material().restitution, s.body(i).material().friction);
    });
  }
  if (wrenches) {
    detail::write_bodies(folder / "wrench.npy", set, {bodies, 6}, [](const Trajectory& s, int i) {
      Eigen::Matrix<double, 6, 1> numbers = Eigen::Matrix<double, 6, 1>::Zero();
      if (!s.wrenches().empty()) {
        const auto& [f, t] = s.wrenches()[static_cast<std::size_t>(i)];
        numbers << f.x, f.y, f.z, t.x, t.y, t.z;
      }
      return numbers;
    });
  }
  if (lengths) {
    NpyWriter<std::int64_t> writer(folder / "length.npy", {});
    for (const Trajectory& scene : set) writer.append(Integer(scene.frames()));
    writer.commit();
  }
  detail::write_world(folder / "world.json", set);
}

}  // namespace rbres::RBRES_ABI
