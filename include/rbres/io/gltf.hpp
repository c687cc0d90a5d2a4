#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <limits>
#include <numbers>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <rbres/body/system.hpp>
#include <rbres/io/gltf_file.hpp>
#include <rbres/io/gltf_mesh.hpp>
#include <rbres/io/utf8.hpp>

namespace rbres::RBRES_ABI {

/// Red, green, blue (linear) and opacity, each in [0, 1].
using GltfColour = std::array<double, 4>;

/// What is true.
inline constexpr GltfColour gltf_solid_blue{0.00, 0.17, 0.45, 1.0};
/// What is predicted, seen through.
inline constexpr GltfColour gltf_clear_orange{0.80, 0.20, 0.00, 0.55};

/// How a motion is shown.
struct GltfStyle {
  GltfColour colour = gltf_solid_blue;  ///< of half of each body; the other half is paler
  Vec3<double> offset{};                ///< moves the whole motion, world frame, m: two stand side by side
  int bodies = 0;                       ///< shows the first so many, where the rest are absent; 0: all
};

/// Motions to look at, as a glTF 2.0 animation in one file (.glb) that any viewer opens. The world's z points
/// up in the viewer, one unit is one metre, one second one second; between samples viewers interpolate
/// linearly (positions) and on the shortest arc (orientations). A camera sees all of the first motion and
/// where the others begin, obliquely from above.
class GltfScene {
 public:
  GltfScene() {
    file_.json["scene"] = 0;
    file_.json["scenes"][0]["nodes"][0] = 0;
    // From z up to y up, the format's own: a quarter turn about -x.
    const double half = std::sqrt(0.5);
    file_.append("nodes", {{"name", "world"}, {"rotation", {-half, 0.0, 0.0, half}}});
    file_.append("cameras",
                 {{"type", "perspective"}, {"perspective", {{"yfov", field_of_view}, {"znear", 0.1}}}});
    const Quat<double>& q = camera_rotation_;
    camera_ = file_.append("nodes", {{"name", "camera"}, {"camera", 0}, {"rotation", {q.x, q.y, q.z, q.w}}});
    file_.json["nodes"][0]["children"].push_back(camera_);
  }

  /// Adds the bodies of `system`, moving through states[k] at times[k] (s). Throws Error, and adds nothing,
  /// unless there is a state per time, at least one, the times increase from 0 or later (as floats), all
  /// lengths are at most 1e37 m (the file's numbers are floats), all orientations unit quaternions, and the
  /// name is UTF-8.
  template <class System>
  void add_motion(const std::string& name, const System& system, std::span<const double> times,
                  std::span<const typename System::State> states, const GltfStyle& style = {}) {
    if (!detail::is_utf8(name)) detail::refuse("glTF motion, name", "UTF-8", "bytes that are not");
    const std::string what = "glTF motion '" + name + "'";
    const std::vector<float> seconds = checked_times(what, times, states.size());
    check_style(what, style, System::bodies);
    const int bodies = style.bodies == 0 ? System::bodies : style.bodies;
    std::vector<Track> tracks;
    for (int i = 0; i < bodies; ++i)
      tracks.push_back(track<System>(detail::text(what, ", body ", i), states, i));

    const std::array<std::size_t, 2> materials = append_materials(style.colour);
    const std::size_t time = file_.append_accessor(seconds, 1, detail::GltfTarget::none);
    nlohmann::json children = nlohmann::json::array();
    for (int i = 0; i < bodies; ++i) {
      const auto& body = system[i];
      const Quat<double> rotation = quat(body.shape_rotation());
      const auto mesh = detail::with_shape(
          body.shape(), [&](const auto& shape) { return detail::mesh_of(shape, rotation); });
      const std::size_t node = file_.append(
          "nodes", {{"name", detail::text(name, " ", i)}, {"mesh", append_mesh(mesh, materials)}});
      Track& own = tracks[static_cast<std::size_t>(i)];
      animate(node, "translation", time, file_.append_accessor(own.positions, 3, detail::GltfTarget::none));
      animate(node, "rotation", time, file_.append_accessor(own.rotations, 4, detail::GltfTarget::none));
      children.push_back(node);
      for (std::size_t v = 0; v < mesh.positions.size(); v += 3)
        own.radius = std::max(own.radius, norm(vector(mesh.positions, v)));
    }
    append_group(name, style.offset, std::move(children));
    look_at(tracks, style.offset);
  }

  /// Adds the faces of planes (of a room, a floor) as far as `half_width` (m) from the world's origin along
  /// each. They are seen from their free side alone: a room is open to the eye from everywhere. Throws Error,
  /// and adds nothing, for planes that no System takes, and for lengths above 1e37 m.
  template <class S>
  void add_planes(const std::vector<Plane<S>>& planes, const Vec3<double>& offset = {},
                  double half_width = 10) {
    if (!(half_width > 0)) detail::refuse("glTF planes, half width", "a positive length", half_width);
    check_length("glTF planes, half width", half_width);
    check_offset("glTF planes", offset);
    const auto checked = detail::checked_planes(planes);
    for (const Plane<S>& plane : checked) check_length("glTF planes, offset", plane.offset);
    const detail::GltfMesh mesh = detail::mesh_of(checked, half_width);
    if (mesh.positions.empty()) return;
    const auto grey = append_material({0.55, 0.55, 0.55, 1});
    const std::size_t node = file_.append("nodes", {{"mesh", append_mesh(mesh, {grey, grey})}});
    append_group("planes", offset, nlohmann::json::array({node}));
  }

  /// Adds a horizontal grid of faint lines below all that the camera sees so far: where a world has no floor,
  /// it says which way is down and how far bodies go. Returns the width of its squares, m, a power of ten.
  /// Throws Error when the scene has no motion.
  double add_grid() {
    if (!(seen_low_.x <= seen_high_.x)) detail::refuse("glTF grid", "a scene with a motion", "none");
    const Vec3<double> size = seen_high_ - seen_low_;
    const double width = std::pow(10, std::floor(std::log10(std::max(size.x, size.y) / 5)));
    const std::vector<float> lines = detail::grid_lines(seen_low_, seen_high_, width);
    constexpr int pairs_of_ends = 1;  // a primitive's mode
    const nlohmann::json primitive = {
        {"attributes", {{"POSITION", file_.append_accessor(lines, 3, detail::GltfTarget::vertices)}}},
        {"mode", pairs_of_ends},
        {"material", append_material({0.5, 0.5, 0.5, 0.4})}};
    const std::size_t mesh = file_.append("meshes", {{"primitives", nlohmann::json::array({primitive})}});
    file_.json["nodes"][0]["children"].push_back(file_.append("nodes", {{"name", "grid"}, {"mesh", mesh}}));
    return width;
  }

  /// Writes the file (.glb). Throws Error when the scene has no motion; see AtomicFile for the other errors.
  void write(const std::filesystem::path& path) const {
    if (!file_.json.contains("animations")) detail::refuse(path.string(), "a scene with a motion", "none");
    file_.write(path);
  }

 private:
  struct Track {
    std::vector<float> positions, rotations;
    double radius = 0;  ///< of the body, m
  };

  static std::vector<float> checked_times(const std::string& what, std::span<const double> times,
                                          std::size_t states) {
    if (times.empty()) detail::refuse(what, "at least one state", "none");
    if (times.size() != states)
      detail::refuse(what, detail::text(times.size(), " states, one per time"), states);
    std::vector<float> seconds;
    for (std::size_t k = 0; k < times.size(); ++k) {
      const auto time = static_cast<float>(times[k]);
      if (!is_finite(time) || time < 0 || (k > 0 && !(time > seconds.back())))
        detail::refuse(detail::text(what, ", time ", k), "finite times that increase from 0 or later",
                       times[k]);
      seconds.push_back(time);
    }
    return seconds;
  }

  static void check_style(const std::string& what, const GltfStyle& style, int bodies) {
    for (const double component : style.colour)
      if (!(component >= 0 && component <= 1))
        detail::refuse(what + ", colour", "numbers in [0, 1]", component);
    if (style.bodies < 0 || style.bodies > bodies)
      detail::refuse(what + ", bodies shown", detail::text("a number from 0 to ", bodies), style.bodies);
    check_offset(what, style.offset);
  }

  static void check_offset(const std::string& what, const Vec3<double>& offset) {
    for (const double x : {offset.x, offset.y, offset.z}) check_length(what + ", offset", x);
  }

  /// Lengths of which the file's sums stay floats.
  template <class S>
  static void check_length(const std::string& what, const S& x) {
    using std::abs;
    if (!(abs(x) <= S(longest))) detail::refuse(what, detail::text("at most ", longest, " m"), x);
  }

  template <class S>
  static Quat<double> quat(const Quat<S>& q) {
    return {static_cast<double>(q.x), static_cast<double>(q.y), static_cast<double>(q.z),
            static_cast<double>(q.w)};
  }

  /// One body's positions and orientations, the latter each on its predecessor's side of q and -q, so that
  /// no viewer takes the long way round between them.
  template <class System>
  static Track track(const std::string& what, std::span<const typename System::State> states, int body) {
    Track result;
    Quat<double> previous;
    for (std::size_t k = 0; k < states.size(); ++k) {
      const auto& state = states[k][body];
      for (const auto& x : {state.position.x, state.position.y, state.position.z}) {
        check_length(detail::text(what, ", position at time ", k), x);
        result.positions.push_back(static_cast<float>(x));
      }
      Quat<double> q = quat(state.orientation);
      if (!(std::abs(std::sqrt(squared_norm(q)) - 1) < 1e-3))
        detail::refuse(detail::text(what, ", orientation at time ", k), "a unit quaternion",
                       detail::text("one of length ", std::sqrt(squared_norm(q))));
      q = normalized(q);
      if (q.x * previous.x + q.y * previous.y + q.z * previous.z + q.w * previous.w < 0)
        q = {-q.x, -q.y, -q.z, -q.w};
      for (const double x : {q.x, q.y, q.z, q.w}) result.rotations.push_back(static_cast<float>(x));
      previous = q;
    }
    return result;
  }

  std::size_t append_material(const GltfColour& colour) {
    nlohmann::json material = {
        {"pbrMetallicRoughness",
         {{"baseColorFactor", colour}, {"metallicFactor", 0}, {"roughnessFactor", 0.7}}}};
    if (colour[3] < 1) material["alphaMode"] = "BLEND";
    return file_.append("materials", std::move(material));
  }

  std::array<std::size_t, 2> append_materials(const GltfColour& colour) {
    GltfColour pale = colour;
    for (std::size_t i = 0; i < 3; ++i) pale[i] += 0.7 * (1 - pale[i]);
    const std::size_t full = append_material(colour);
    return {full, append_material(pale)};
  }

  std::size_t append_mesh(const detail::GltfMesh& mesh, const std::array<std::size_t, 2>& materials) {
    const nlohmann::json attributes = {
        {"POSITION", file_.append_accessor(mesh.positions, 3, detail::GltfTarget::vertices)},
        {"NORMAL", file_.append_accessor(mesh.normals, 3, detail::GltfTarget::vertices)}};
    nlohmann::json primitives = nlohmann::json::array();
    for (std::size_t i = 0; i < 2; ++i) {
      if (mesh.triangles[i].empty()) continue;
      primitives.push_back(
          {{"attributes", attributes},
           {"indices", file_.append_accessor(mesh.triangles[i], 1, detail::GltfTarget::indices)},
           {"material", materials[i]}});
    }
    return file_.append("meshes", {{"primitives", std::move(primitives)}});
  }

  static Vec3<double> vector(const std::vector<float>& numbers, std::size_t at) {
    return {static_cast<double>(numbers[at]), static_cast<double>(numbers[at + 1]),
            static_cast<double>(numbers[at + 2])};
  }

  /// Moves the camera back until it sees these, too: all of the first motion's positions, the first of
  /// another's.
  void look_at(const std::vector<Track>& tracks, const Vec3<double>& offset) {
    const bool is_first = !(seen_low_.x <= seen_high_.x);
    for (const Track& body : tracks) {
      const Vec3<double> reach{body.radius, body.radius, body.radius};
      for (std::size_t k = 0; k < (is_first ? body.positions.size() : 3); k += 3) {
        const Vec3<double> at = offset + vector(body.positions, k), low = at - reach, high = at + reach;
        seen_low_ = {std::min(seen_low_.x, low.x), std::min(seen_low_.y, low.y),
                     std::min(seen_low_.z, low.z)};
        seen_high_ = {std::max(seen_high_.x, high.x), std::max(seen_high_.y, high.y),
                      std::max(seen_high_.z, high.z)};
      }
    }
    const double distance = 0.5 * norm(seen_high_ - seen_low_) / std::sin(field_of_view / 2);
    const Vec3<double> eye =
        0.5 * (seen_low_ + seen_high_) + distance * rotate(camera_rotation_, Vec3<double>{0, 0, 1});
    file_.json["nodes"][camera_]["translation"] = {eye.x, eye.y, eye.z};
    file_.json["cameras"][0]["perspective"]["znear"] = 0.01 * distance;
  }

  void append_group(const std::string& name, const Vec3<double>& offset, nlohmann::json children) {
    const std::size_t group = file_.append(
        "nodes",
        {{"name", name}, {"translation", {offset.x, offset.y, offset.z}}, {"children", std::move(children)}});
    file_.json["nodes"][0]["children"].push_back(group);
  }

  void animate(std::size_t node, const char* path, std::size_t times, std::size_t values) {
    auto& animation = file_.json["animations"][0];
    animation["name"] = "motion";
    auto& samplers = animation["samplers"];
    samplers.push_back({{"input", times}, {"output", values}, {"interpolation", "LINEAR"}});
    animation["channels"].push_back(
        {{"sampler", samplers.size() - 1}, {"target", {{"node", node}, {"path", path}}}});
  }

  static constexpr double longest = 1e37;  ///< m
  static constexpr double infinity = std::numeric_limits<double>::infinity();
  static constexpr double field_of_view = 0.7;  ///< rad, from bottom to top

  detail::GltfFile file_;
  std::size_t camera_ = 0;  ///< its node
  /// From looking down along -z: raised by 60 degrees about x, then turned by 30 about z to see two sides.
  Quat<double> camera_rotation_ =
      Quat<double>{0, 0, std::sin(std::numbers::pi / 12), std::cos(std::numbers::pi / 12)} *
      Quat<double>{std::sin(std::numbers::pi / 6), 0, 0, std::cos(std::numbers::pi / 6)};
  Vec3<double> seen_low_{infinity, infinity, infinity}, seen_high_{-infinity, -infinity, -infinity};  ///< m
};

}  // namespace rbres::RBRES_ABI
