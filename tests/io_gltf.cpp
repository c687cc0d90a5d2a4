#include "io_support.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <numbers>
#include <set>

#include <rbres/core/lie.hpp>
#include <rbres/io/gltf.hpp>

using namespace rbres;
using nlohmann::json;

namespace {

using ThreeBodies = System<double, 3>;
using State = ThreeBodies::State;

ThreeBodies three_bodies() {
  return {{Body<double>{AnyShape<double>{Sphere{0.25}}, 1.0},
           Body<double>{AnyShape<double>{Box{0.3, 0.2, 0.1}}, 1.0},
           Body<double>{AnyShape<double>{Capsule{0.1, 0.2}}, 1.0}},
          room(2.5, 5.0)};
}

struct Recording {
  std::vector<double> times;
  std::vector<State> states;
};

/// Bodies that turn about z by 0.8 rad a frame, whose quaternions stand on either side by turns; `size`
/// scales how far they go.
Recording turning(int frames, double size = 1) {
  Recording motion;
  for (int k = 0; k < frames; ++k) {
    motion.times.push_back(0.1 * k);
    State state;
    for (int i = 0; i < 3; ++i) {
      const double half = 0.4 * k + i, side = k % 2 ? -1 : 1;
      state[i].position = size * Vec3<double>{0.1 * k, -0.3 * i, 1.0 / 3 + k};
      state[i].orientation = {0, 0, side * std::sin(half), side * std::cos(half)};
    }
    motion.states.push_back(state);
  }
  return motion;
}

/// A .glb file, read by the rules of the glTF 2.0 specification, which it checks as it reads.
class GlbFile {
 public:
  explicit GlbFile(const std::filesystem::path& path) : bytes_(read_bytes(path)) {
    REQUIRE(bytes_.size() >= 20);
    CHECK(bytes_.substr(0, 4) == "glTF");
    CHECK(number(4) == 2);
    CHECK(number(8) == bytes_.size());
    const std::size_t text = number(12);
    CHECK(text % 4 == 0);
    CHECK(bytes_.substr(16, 4) == "JSON");
    document = json::parse(bytes_.substr(20, text));
    REQUIRE(bytes_.size() >= 28 + text);
    const std::size_t data = number(20 + text);
    CHECK(data % 4 == 0);
    CHECK(bytes_.substr(24 + text, 4) == std::string("BIN\0", 4));
    CHECK(bytes_.size() == 28 + text + data);
    data_ = 28 + text;
    CHECK(document["asset"]["version"] == "2.0");
    REQUIRE(document["buffers"].size() == 1);
    CHECK(document["buffers"][0]["byteLength"] == data);
    check_views(data);
    for (std::size_t i = 0; i < document["accessors"].size(); ++i) check_accessor(i);
    check_tree();
    check_meshes();
    check_animation();
  }

  /// The numbers of an accessor, element by element.
  std::vector<double> numbers(const json& index) const {
    const json& accessor = document["accessors"].at(index.get<std::size_t>());
    const std::size_t offset =
        data_ +
        document["bufferViews"][accessor["bufferView"].get<std::size_t>()]["byteOffset"].get<std::size_t>();
    std::vector<double> result(accessor["count"].get<std::size_t>() * width(accessor));
    for (std::size_t i = 0; i < result.size(); ++i) {
      if (accessor["componentType"] == 5126) {
        float value;
        std::memcpy(&value, bytes_.data() + offset + 4 * i, 4);
        result[i] = static_cast<double>(value);
      } else {
        std::uint16_t value;
        std::memcpy(&value, bytes_.data() + offset + 2 * i, 2);
        result[i] = value;
      }
    }
    return result;
  }

  const json& node(const std::string& name) const {
    for (const json& node : document["nodes"])
      if (node.value("name", "") == name) return node;
    FAIL("no node " << name);
    std::abort();
  }

  /// The sampler that moves ("translation") or turns ("rotation") a node.
  const json& sampler(const std::string& name, const std::string& path) const {
    const json& animation = document["animations"][0];
    for (const json& channel : animation["channels"])
      if (channel["target"]["path"] == path &&
          &document["nodes"][channel["target"]["node"].get<std::size_t>()] == &node(name))
        return animation["samplers"][channel["sampler"].get<std::size_t>()];
    FAIL("no channel for " << name);
    std::abort();
  }

  json document;

 private:
  std::uint32_t number(std::size_t offset) const {
    std::uint32_t value;
    std::memcpy(&value, bytes_.data() + offset, 4);
    return value;
  }
  static std::size_t width(const json& accessor) {
    return std::map<std::string, std::size_t>{{"SCALAR", 1}, {"VEC3", 3}, {"VEC4", 4}}.at(accessor["type"]);
  }

  void check_views(std::size_t data) const {
    std::size_t end = 0;
    for (const json& view : document["bufferViews"]) {
      CHECK(view["buffer"] == 0);
      CHECK(view["byteOffset"].get<std::size_t>() >= end);
      CHECK(view["byteLength"].get<std::size_t>() >= 1);
      end = view["byteOffset"].get<std::size_t>() + view["byteLength"].get<std::size_t>();
    }
    CHECK(end <= data);
  }

  void check_accessor(std::size_t index) const {
    const json& accessor = document["accessors"][index];
    const json& view = document["bufferViews"].at(accessor["bufferView"].get<std::size_t>());
    const std::size_t size = accessor["componentType"] == 5126 ? 4 : 2;
    CHECK((size == 4 || accessor["componentType"] == 5123));
    CHECK(view["byteOffset"].get<std::size_t>() % size == 0);
    CHECK(accessor["count"].get<std::size_t>() >= 1);
    CHECK(accessor["count"].get<std::size_t>() * width(accessor) * size <=
          view["byteLength"].get<std::size_t>());
    const auto values = numbers(index);
    for (std::size_t column = 0; column < width(accessor); ++column) {
      double low = std::numeric_limits<double>::infinity(), high = -low;
      for (std::size_t i = column; i < values.size(); i += width(accessor)) {
        low = std::min(low, values[i]);
        high = std::max(high, values[i]);
      }
      CHECK(accessor["min"].at(column) == low);
      CHECK(accessor["max"].at(column) == high);
    }
  }

  void check_tree() const {
    CHECK(document["scenes"][document["scene"].get<std::size_t>()]["nodes"] == json::array({0}));
    std::multiset<std::size_t> children;
    for (const json& node : document["nodes"])
      if (node.contains("children"))
        for (const json& child : node["children"]) children.insert(child.get<std::size_t>());
    CHECK(children.size() == document["nodes"].size() - 1);
    for (std::size_t i = 1; i < document["nodes"].size(); ++i) CHECK(children.count(i) == 1);
  }

  void check_meshes() const {
    for (const json& mesh : document["meshes"]) {
      for (const json& primitive : mesh["primitives"]) {
        const auto positions = numbers(primitive["attributes"]["POSITION"]);
        CHECK(primitive["material"].get<std::size_t>() < document["materials"].size());
        if (primitive.value("mode", 4) == 1) {  // lines
          CHECK(positions.size() % 6 == 0);
          continue;
        }
        const auto normals = numbers(primitive["attributes"]["NORMAL"]);
        const auto indices = numbers(primitive["indices"]);
        CHECK(normals.size() == positions.size());
        CHECK(indices.size() % 3 == 0);
        CHECK(*std::max_element(indices.begin(), indices.end()) < static_cast<double>(positions.size() / 3));
        const auto vector = [](const std::vector<double>& from, double i) {
          return Eigen::Map<const Eigen::Vector3d>(from.data() + 3 * static_cast<std::size_t>(i)).eval();
        };
        for (std::size_t i = 0; i < normals.size() / 3; ++i)
          CHECK(vector(normals, static_cast<double>(i)).norm() == doctest::Approx(1).epsilon(1e-6));
        for (std::size_t i = 0; i < indices.size(); i += 3) {
          const Eigen::Vector3d a = vector(positions, indices[i]), b = vector(positions, indices[i + 1]),
                                c = vector(positions, indices[i + 2]);
          const Eigen::Vector3d area = (b - a).cross(c - a);
          CHECK(area.norm() > 0);
          for (std::size_t k = 0; k < 3; ++k)
            CHECK(area.normalized().dot(vector(normals, indices[i + k])) > 0.9);
        }
      }
    }
  }

  void check_animation() const {
    REQUIRE(document["animations"].size() == 1);
    const json& animation = document["animations"][0];
    std::set<std::pair<std::size_t, std::string>> targets;
    for (const json& channel : animation["channels"]) {
      const json& sampler = animation["samplers"].at(channel["sampler"].get<std::size_t>());
      const auto path = channel["target"]["path"].get<std::string>();
      CHECK(targets.emplace(channel["target"]["node"].get<std::size_t>(), path).second);
      CHECK(sampler["interpolation"] == "LINEAR");
      const auto times = numbers(sampler["input"]), values = numbers(sampler["output"]);
      CHECK(times.front() >= 0);
      for (std::size_t k = 1; k < times.size(); ++k) CHECK(times[k] > times[k - 1]);
      const std::size_t components = path == "rotation" ? 4 : 3;
      CHECK(values.size() == components * times.size());
      if (path != "rotation") continue;
      for (std::size_t k = 0; k < times.size(); ++k) {
        const Eigen::Map<const Eigen::Vector4d> q(values.data() + 4 * k);
        CHECK(q.norm() == doctest::Approx(1).epsilon(1e-6));
        if (k > 0) CHECK(q.dot(Eigen::Map<const Eigen::Vector4d>(values.data() + 4 * (k - 1))) >= 0);
      }
    }
  }

  std::string bytes_;
  std::size_t data_ = 0;
};

}  // namespace

TEST_CASE("a motion reads back") {
  const TemporaryFolder folder;
  for (const int frames : {1, 2, 9}) {
    const Recording motion = turning(frames);
    GltfScene scene;
    scene.add_motion("truth", three_bodies(), motion.times, motion.states);
    scene.write(folder / "a.glb");
    const GlbFile file(folder / "a.glb");
    CHECK(file.document["meshes"].size() == 3);
    for (int i = 0; i < 3; ++i) {
      const std::string name = "truth " + std::to_string(i);
      const auto times = file.numbers(file.sampler(name, "translation")["input"]);
      const auto positions = file.numbers(file.sampler(name, "translation")["output"]);
      const auto rotations = file.numbers(file.sampler(name, "rotation")["output"]);
      REQUIRE(times.size() == static_cast<std::size_t>(frames));
      for (std::size_t k = 0; k < times.size(); ++k) {
        const auto& state = motion.states[k][i];
        CHECK(times[k] == static_cast<double>(static_cast<float>(motion.times[k])));
        CHECK(positions[3 * k] == static_cast<double>(static_cast<float>(state.position.x)));
        CHECK(positions[3 * k + 1] == static_cast<double>(static_cast<float>(state.position.y)));
        CHECK(positions[3 * k + 2] == static_cast<double>(static_cast<float>(state.position.z)));
        const auto& q = state.orientation;
        const double near = rotations[4 * k] * q.x + rotations[4 * k + 1] * q.y + rotations[4 * k + 2] * q.z +
                            rotations[4 * k + 3] * q.w;
        CHECK(std::abs(near) == doctest::Approx(1).epsilon(1e-6));
      }
    }
  }
}

TEST_CASE("a compound is drawn by its parts, where they stand in the body") {
  const TemporaryFolder folder;
  // Two cubes of a metre, whose centres are at y = 1 and -1 in the body's frame.
  using Cubes = Compound<double, 2>;
  const double quarter = std::sqrt(0.5);
  const Cubes cubes{{Box{0.5, 0.5, 0.5}, {3, 1, 0}},
                    {Box{0.5, 0.5, 0.5}, {3, -1, 0}, {0, 0, quarter, quarter}}};
  const System<double, 1, Cubes> system{{Body(cubes, 1.0)}};
  GltfScene scene;
  scene.add_motion("cubes", system, std::vector<double>{0.0}, std::vector<SystemState<double, 1>>(1));
  scene.write(folder / "a.glb");
  const GlbFile file(folder / "a.glb");
  std::size_t triangles = 0, far = 0;
  for (const json& primitive : file.document["meshes"][0]["primitives"]) {
    triangles += file.numbers(primitive["indices"]).size() / 3;
    const auto numbers = file.numbers(primitive["attributes"]["POSITION"]);
    for (std::size_t i = 0; i < numbers.size(); i += 3) {
      const double along = std::abs(numbers[i + 1]);
      CHECK(std::abs(numbers[i]) == doctest::Approx(0.5));
      CHECK(std::abs(numbers[i + 2]) == doctest::Approx(0.5));
      CHECK(std::min(std::abs(along - 0.5), std::abs(along - 1.5)) < 1e-6);
      far += along > 1;
    }
  }
  CHECK(triangles == 24);
  CHECK(far > 0);
}

TEST_CASE("a convex hull is drawn by its faces, where they stand in the body") {
  const TemporaryFolder folder;
  // A prism whose own axes are turned, and away from where its points were given.
  const auto prism = ConvexHull<double>::cylinder(0.1, 0.4, 6);
  std::vector<Vec3<double>> points;
  for (const auto& v : prism.vertices())
    points.push_back(rotate(quaternion_exp(Vec3<double>{0.5, 0.2, 0.1}), v) + Vec3<double>{1, 2, 3});
  using Hulls = System<double, 1, ConvexHull<double>>;
  const Hulls system{{Body<double, ConvexHull<double>>(ConvexHull<double>(points), 1.0)}};
  GltfScene scene;
  scene.add_motion("hull", system, std::vector<double>{0.0}, std::vector<Hulls::State>(1));
  scene.write(folder / "a.glb");
  const GlbFile file(folder / "a.glb");
  std::size_t triangles = 0;
  for (const json& primitive : file.document["meshes"][0]["primitives"]) {
    triangles += file.numbers(primitive["indices"]).size() / 3;
    // In the body frame: principal axes, of which the first and least is the prism's own.
    const auto numbers = file.numbers(primitive["attributes"]["POSITION"]);
    for (std::size_t i = 0; i < numbers.size(); i += 3) {
      CHECK(std::abs(numbers[i]) == doctest::Approx(0.4).epsilon(1e-5));
      CHECK(std::hypot(numbers[i + 1], numbers[i + 2]) == doctest::Approx(0.1).epsilon(1e-5));
    }
  }
  CHECK(triangles == 6 * 2 + 2 * 4);
}

TEST_CASE("the world's z is the viewer's up, and offsets move whole motions") {
  const TemporaryFolder folder;
  const Recording motion = turning(2);
  GltfScene scene;
  scene.add_motion("a", three_bodies(), motion.times, motion.states);
  scene.add_motion("b", three_bodies(), motion.times, motion.states,
                   {.colour = gltf_clear_orange, .offset = {6, 0, 1}, .bodies = 2});
  scene.write(folder / "a.glb");
  const GlbFile file(folder / "a.glb");
  const json& r = file.document["nodes"][0]["rotation"];
  const Eigen::Quaterniond root(r[3].get<double>(), r[0].get<double>(), r[1].get<double>(),
                                r[2].get<double>());
  CHECK((root * Eigen::Vector3d::UnitZ() - Eigen::Vector3d::UnitY()).norm() < 1e-12);
  CHECK((root * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitX()).norm() < 1e-12);
  CHECK(file.node("b")["translation"] == json{6.0, 0.0, 1.0});
  CHECK(file.node("a")["children"].size() == 3);
  CHECK(file.node("b")["children"].size() == 2);
  const json& materials = file.document["materials"];
  CHECK(!materials[0].contains("alphaMode"));
  CHECK(materials[2]["alphaMode"] == "BLEND");
  CHECK(materials[2]["pbrMetallicRoughness"]["baseColorFactor"] == json(gltf_clear_orange));
}

namespace {
/// One box whose shape stands turned in its principal frame.
struct TurnedBox {
  static constexpr int bodies = 1;
  using State = SystemState<double, 1>;
  struct BodyType {
    Quat<double> rotation;
    Box<double> shape() const { return {0.3, 0.2, 0.1}; }
    Quat<double> shape_rotation() const { return rotation; }
  };
  BodyType body;
  const BodyType& operator[](int) const { return body; }
};
}  // namespace

namespace {
/// Where the file's camera sees a point of the world: in units of half the picture's height, and how far
/// away.
Eigen::Vector3d seen(const GlbFile& file, const Eigen::Vector3d& point) {
  REQUIRE(file.document["cameras"].size() == 1);
  const json& camera = file.document["cameras"][0];
  CHECK(camera["type"] == "perspective");
  const double half = camera["perspective"]["yfov"].get<double>() / 2;
  CHECK((half > 0 && half < std::numbers::pi / 2));
  CHECK(camera["perspective"]["znear"].get<double>() > 0);
  const json& node = file.node("camera");
  CHECK(node["camera"] == 0);
  const auto r = node["rotation"].get<std::vector<double>>(),
             t = node["translation"].get<std::vector<double>>();
  const Eigen::Quaterniond turned(r[3], r[0], r[1], r[2]);
  CHECK(turned.norm() == doctest::Approx(1).epsilon(1e-12));
  const Eigen::Vector3d p = turned.conjugate() * (point - Eigen::Vector3d(t[0], t[1], t[2]));
  CHECK(-p.z() > camera["perspective"]["znear"].get<double>());
  return {p.x() / (-p.z() * std::tan(half)), p.y() / (-p.z() * std::tan(half)), -p.z()};
}
}  // namespace

TEST_CASE("a camera sees all of the first motion and where others begin, from above") {
  const TemporaryFolder folder;
  for (const double size : {1.0, 1e-3, 1e5}) {
    const Recording motion = turning(9, size);
    const Vec3<double> offset{6 * size, 0, size};
    GltfScene scene;
    scene.add_motion("a", three_bodies(), motion.times, motion.states);
    scene.add_motion("b", three_bodies(), motion.times, motion.states, {.offset = offset});
    scene.write(folder / "a.glb");
    const GlbFile file(folder / "a.glb");
    double farthest = 0;
    const auto look = [&](const Vec3<double>& at) {
      const Eigen::Vector3d found = seen(file, {at.x, at.y, at.z});
      farthest = std::max({farthest, std::abs(found.x()), std::abs(found.y())});
    };
    for (const auto& state : motion.states)
      for (const auto& body : state.body) look(body.position);
    for (const auto& body : motion.states.front().body) look(offset + body.position);
    CHECK(farthest < 1);
    if (size >= 1)
      CHECK(farthest > 0.2);  // and from no farther than that needs, bodies of half a metre included
    const Eigen::Vector3d middle{4 * size, 0, 4 * size}, up{0, 0, size};
    CHECK(seen(file, middle + up).y() > seen(file, middle).y());  // the picture stands upright,
    CHECK(seen(file, middle + up).z() < seen(file, middle).z());  // and is seen from above
    CHECK(std::abs(seen(file, middle + up).x() - seen(file, middle).x()) < 0.05);
  }
}

TEST_CASE("meshes have their bodies' sizes, in the body's own frame") {
  const TemporaryFolder folder;
  const auto extent = [&](const auto& system, const Eigen::Vector3d& half) {
    const std::vector<double> times{0};
    const std::vector<SystemState<double, 1>> states(1);
    GltfScene scene;
    scene.add_motion("one", system, times, states);
    scene.write(folder / "a.glb");
    const GlbFile file(folder / "a.glb");
    const json& primitives = file.document["meshes"][0]["primitives"];
    CHECK(primitives.size() == 2);
    const json& positions =
        file.document["accessors"][primitives[0]["attributes"]["POSITION"].get<std::size_t>()];
    for (int i = 0; i < 3; ++i) {
      CHECK(positions["max"][static_cast<std::size_t>(i)].get<double>() == doctest::Approx(half(i)));
      CHECK(positions["min"][static_cast<std::size_t>(i)].get<double>() == doctest::Approx(-half(i)));
    }
  };
  using Single = System<double, 1>;
  extent(Single{{Body{Sphere{0.25}, 1.0}}}, {0.25, 0.25, 0.25});
  extent(Single{{Body{Box{0.3, 0.2, 0.1}, 1.0}}}, {0.3, 0.2, 0.1});
  extent(Single{{Body{Capsule{0.1, 0.2}, 1.0}}}, {0.1, 0.1, 0.3});
  const double angle = std::numbers::pi / 6, c = std::cos(angle), s = std::sin(angle);
  extent(TurnedBox{{{0, 0, std::sin(angle / 2), std::cos(angle / 2)}}},
         {0.3 * c + 0.2 * s, 0.3 * s + 0.2 * c, 0.1});
}

TEST_CASE("the planes of a room meet at its edges, a floor is a square") {
  const TemporaryFolder folder;
  const Recording motion = turning(1);
  const auto planes_mesh = [&](const std::vector<Plane<double>>& planes, double half_width) {
    GltfScene scene;
    scene.add_planes(planes, {}, half_width);
    scene.add_motion("truth", three_bodies(), motion.times, motion.states);
    scene.write(folder / "a.glb");
    const GlbFile file(folder / "a.glb");
    return file.document["accessors"][0];
  };
  for (const double half_width : {5.0, 10.0}) {
    const json box = planes_mesh(room(2.5, 5.0), half_width);
    CHECK(box["count"] == 6 * 4);
    CHECK(box["min"] == json{-2.5, -2.5, 0.0});
    CHECK(box["max"] == json{2.5, 2.5, 5.0});
  }
  const json floor = planes_mesh({floor_plane<double>()}, 3);
  CHECK(floor["count"] == 4);
  CHECK(floor["min"] == json{-3.0, -3.0, 0.0});
  CHECK(floor["max"] == json{3.0, 3.0, 0.0});
  // Planes that leave each other no free side have no surface, and a scene without planes has no mesh of
  // them.
  const std::vector<Plane<double>> nothing_free{{{0, 0, 1}, 1.0, {}}, {{0, 0, -1}, 0.0, {}}};
  CHECK(planes_mesh(nothing_free, 3)["count"] == planes_mesh({}, 3)["count"]);
}

TEST_CASE("a grid of whole squares lies below all bodies, where the camera sees it") {
  const TemporaryFolder folder;
  for (const double size : {1.0, 1e-3, 1e5}) {
    const Recording motion = turning(9, size);
    GltfScene scene;
    CHECK(contains(error_of([&] { scene.add_grid(); }), "glTF grid: expected a scene with a motion"));
    scene.add_motion("a", three_bodies(), motion.times, motion.states);
    const double width = scene.add_grid();
    scene.write(folder / "a.glb");
    const GlbFile file(folder / "a.glb");
    CHECK(std::log10(width) == doctest::Approx(std::round(std::log10(width))));
    const json& mesh = file.document["meshes"][file.node("grid")["mesh"].get<std::size_t>()];
    const auto ends = file.numbers(mesh["primitives"][0]["attributes"]["POSITION"]);
    CHECK((ends.size() / 6 > 8 && ends.size() / 6 < 120));
    Eigen::Vector2d low(1e30, 1e30), high = -low;
    for (std::size_t i = 0; i < ends.size(); i += 6) {
      const Eigen::Map<const Eigen::Vector3d> from(ends.data() + i), to(ends.data() + i + 3);
      CHECK(from.z() == to.z());
      CHECK((from.x() == to.x()) != (from.y() == to.y()));
      for (const double x : {from.x(), from.y(), to.x(), to.y()})
        CHECK(std::abs(x / width - std::round(x / width)) < 1e-4);
      low = low.cwiseMin(from.head(2)).cwiseMin(to.head(2));
      high = high.cwiseMax(from.head(2)).cwiseMax(to.head(2));
    }
    const double z = ends[2],
                 reach[] = {0.249, 0.37, 0.299};  // of the three bodies, to their outermost points
    for (const auto& state : motion.states)
      for (int i = 0; i < 3; ++i) {
        const Vec3<double>& at = state[i].position;
        CHECK(at.z - reach[i] - 0.9 * width > z);
        CHECK((at.x - reach[i] >= low.x() && at.x + reach[i] <= high.x()));
        CHECK((at.y - reach[i] >= low.y() && at.y + reach[i] <= high.y()));
      }
    const Eigen::Vector3d middle = seen(file, {(low.x() + high.x()) / 2, (low.y() + high.y()) / 2, z});
    CHECK(middle.head(2).cwiseAbs().maxCoeff() < 1);
  }
}

TEST_CASE("bad input is refused, adds nothing and writes nothing") {
  const TemporaryFolder folder;
  const auto path = folder / "a.glb";
  const ThreeBodies system = three_bodies();
  GltfScene scene;
  CHECK(contains(error_of([&] { scene.write(path); }),
                 path.string() + ": expected a scene with a motion, found none"));
  scene.add_planes(system.planes());
  CHECK(contains(error_of([&] { scene.write(path); }), "found none"));
  CHECK(!std::filesystem::exists(path));
  const auto error = [&](const auto& change, const GltfStyle& style = {}) {
    Recording motion = turning(3);
    change(motion);
    const std::string message =
        error_of([&] { scene.add_motion("truth", system, motion.times, motion.states, style); });
    CHECK(message.starts_with("glTF motion 'truth'"));
    return message;
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(contains(error([](Recording& m) { m = {}; }), "expected at least one state, found none"));
  CHECK(
      contains(error([](Recording& m) { m.times.pop_back(); }), "expected 2 states, one per time, found 3"));
  CHECK(
      contains(error([](Recording& m) { m.times[0] = -1; }), "time 0: expected finite times that increase"));
  CHECK(contains(error([](Recording& m) { m.times[2] = m.times[1]; }), "time 2"));
  CHECK(contains(error([](Recording& m) { m.times[2] = m.times[1] + 1e-12; }), "time 2"));
  CHECK(contains(error([&](Recording& m) { m.times[1] = nan; }), "found nan"));
  CHECK(contains(error([](Recording& m) { m.times[2] = 1e300; }), "found 1e+300"));
  CHECK(contains(error([&](Recording& m) { m.states[1][2].position.y = nan; }),
                 "body 2, position at time 1: expected at most 1e+37 m, found nan"));
  CHECK(contains(error([](Recording& m) { m.states[1][2].position.z = 1e300; }), "found 1e+300"));
  CHECK(contains(error([](Recording& m) {
                   m.states[2][0].orientation = {0, 0, 0, 0};
                 }),
                 "body 0, orientation at time 2: expected a unit quaternion, found one of length 0"));
  CHECK(
      contains(error([&](Recording& m) { m.states[2][1].orientation.w = nan; }), "found one of length nan"));
  const auto same = [](const Recording&) {};
  CHECK(contains(error(same, {.colour = {0, 0, 1.5, 1}}), "colour: expected numbers in [0, 1], found 1.5"));
  CHECK(contains(error(same, {.offset = {0, nan, 0}}), "offset: expected at most 1e+37 m, found nan"));
  CHECK(contains(error(same, {.bodies = 4}), "bodies shown: expected a number from 0 to 3, found 4"));
  CHECK(contains(error(same, {.bodies = -1}), "found -1"));
  CHECK_THROWS_AS(scene.add_planes(system.planes(), {}, 0), Error);
  CHECK_THROWS_AS(scene.add_planes(system.planes(), {nan, 0, 0}), Error);
  CHECK_THROWS_AS(scene.add_planes(system.planes(), {}, 1e200), Error);
  CHECK_THROWS_AS(scene.add_planes(system.planes(), {1e38, 0, 0}), Error);
  for (const Plane<double>& plane : {Plane<double>{{0, 0, 0}, 0, {}}, Plane<double>{{0, nan, 1}, 0, {}},
                                     Plane<double>{{0, 0, 1}, 1e300, {}}})
    CHECK_THROWS_AS(scene.add_planes(std::vector{plane}), Error);
  CHECK(contains(error(same, {.offset = {1e308, 0, 0}}), "found 1e+308"));
  const Recording named = turning(3);
  CHECK(contains(error_of([&] { scene.add_motion("\xff", system, named.times, named.states); }),
                 "expected UTF-8"));

  const Recording motion = turning(3);
  scene.add_motion("truth", system, motion.times, motion.states);
  scene.write(path);
  CHECK(GlbFile(path).document["meshes"].size() == 4);
  CHECK(contains(error_of([&] { scene.write(folder / ""); }), "expected a regular file to replace"));
}
