#include <cmath>

#include <rbres/io/trajectories.hpp>

#include "io_support.hpp"

using namespace rbres;
using Eigen::Index;

namespace {

using Columns = Eigen::MatrixXd;

/// Two bodies in three scenes of four frames.
TrajectorySet some(const std::vector<Body<double>>& bodies, const std::vector<int>& frames = {4, 4, 4},
                   const std::vector<Wrench<double>>& wrenches = {}, const Resistance& resistance = {}) {
  std::vector<Trajectory> scenes;
  double x = 0;
  for (const int count : frames) {
    std::vector<RigidState<double>> states(static_cast<std::size_t>(count) * bodies.size());
    for (auto& state : states) {
      state.position = {x, 2 * x, 1 / (1 + x)};
      state.orientation = normalized(Quat<double>{x, 0.3, -0.2, 0.9});
      state.velocity = {-x, 1 + x, 0.1};
      state.angular_velocity = {3, x, x * x};
      x += 0.25;
    }
    scenes.push_back({bodies, states, wrenches});
  }
  return {1.0 / 148, {0.1, 0, -9.81}, {{{0, 0, 1}, -0.5, {}}, {{0.6, 0, 0.8}, 2, {}}}, scenes, resistance};
}

const Material<double> ice{0.25, 0.0625};
const std::vector<Body<double>> uniform{{Sphere{0.1}, 1.5}, {Box{0.1, 0.2, 0.3}, 2.5}};
const std::vector<Body<double>> other{{Capsule{0.1, 0.2}, 1.5, Vec3<double>{0.1, 0.2, 0.15}, ice},
                                      {Box{0.1, 0.2, 0.3}, 2.5, ice}};

void check_equal(const TrajectorySet& a, const TrajectorySet& b) {
  CHECK(a.frame_time() == b.frame_time());
  CHECK(a.gravity() == b.gravity());
  CHECK(a.resistance().friction.density == b.resistance().friction.density);
  CHECK(a.resistance().friction.drag == b.resistance().friction.drag);
  CHECK(a.resistance().friction.rotational_drag == b.resistance().friction.rotational_drag);
  CHECK(a.resistance().damping.linear == b.resistance().damping.linear);
  CHECK(a.resistance().damping.angular == b.resistance().damping.angular);
  REQUIRE(a.planes().size() == b.planes().size());
  for (std::size_t p = 0; p < a.planes().size(); ++p) {
    CHECK(a.planes()[p].normal == b.planes()[p].normal);
    CHECK(a.planes()[p].offset == b.planes()[p].offset);
  }
  REQUIRE(a.size() == b.size());
  for (int s = 0; s < a.size(); ++s) {
    REQUIRE(a[s].bodies() == b[s].bodies());
    REQUIRE(a[s].frames() == b[s].frames());
    CHECK(a[s].wrenches() == b[s].wrenches());
    for (int i = 0; i < a[s].bodies(); ++i) {
      const Body<double>&x = a[s].body(i), &y = b[s].body(i);
      CHECK(x.shape().index() == y.shape().index());
      CHECK(x.bounding_radius() == y.bounding_radius());
      CHECK(x.mass() == y.mass());
      CHECK(x.inertia() == y.inertia());
      CHECK(x.material().restitution == y.material().restitution);
      CHECK(x.material().friction == y.material().friction);
      for (int t = 0; t < a[s].frames(); ++t) CHECK(a[s].state(t, i) == b[s].state(t, i));
    }
  }
}

/// A valid folder, one file of which a test replaces.
struct Folder {
  TemporaryFolder temporary;
  std::filesystem::path path = temporary / "set";

  Folder() { write_trajectories(path, some(other, {4, 3, 2})); }
  std::string refusal() const {
    return error_of([&] { read_trajectories(path); });
  }
  /// Says nothing of the folder's own name.
  std::string refusal_within() const {
    const std::string all = refusal(), name = path.string();
    return all.starts_with(name) ? all.substr(name.size()) : "elsewhere: " + all;
  }
  template <class Scalar>
  void put(const char* name, std::vector<Index> sample_shape, Index scenes,
           const std::vector<double>& numbers) {
    NpyWriter<Scalar> writer(path / name, std::move(sample_shape));
    for (Index s = 0; s < scenes; ++s) {
      Columns column(writer.features(), 1);
      for (Index k = 0; k < column.size(); ++k)
        column(k) = numbers[static_cast<std::size_t>(s * column.size() + k) % numbers.size()];
      writer.append(column.template cast<Scalar>());
    }
    writer.commit();
  }
};

}  // namespace

TEST_CASE("sets come back as they were written, and hold no array that says nothing") {
  const TemporaryFolder folder;
  const auto optional = {"inertia.npy", "material.npy", "length.npy", "wrench.npy"};
  write_trajectories(folder / "uniform", some(uniform));
  check_equal(read_trajectories(folder / "uniform"), some(uniform));
  for (const char* name : optional) CHECK(!std::filesystem::exists(folder / "uniform" / name));
  CHECK(!contains(read_bytes(folder / "uniform" / "world.json"), "damping"));
  const std::vector<Wrench<double>> wrenches{{{1, 2, 3}, {4, 5, 6}}, {{0.1, 0.2, 0.3}, {}}};
  const Resistance resistance{{1.25, 0.4, 0.02}, {0.1, 0.3}};
  write_trajectories(folder / "other", some(other, {4, 3, 2}, wrenches, resistance));
  check_equal(read_trajectories(folder / "other"), some(other, {4, 3, 2}, wrenches, resistance));
  for (const char* name : optional) CHECK(std::filesystem::exists(folder / "other" / name));
}

TEST_CASE("float arrays, and numbers that nothing uses") {
  Folder folder;
  folder.put<float>("states.npy", {2, 1, 13}, 1,
                    {1, 2, 3, 0, 0, 0, 1, 4, 5, 6, 7, 8, 9, 2, 2, 3, 0, 0, 0, 1, 4, 5, 6, 7, 8, 9});
  folder.put<std::int64_t>("kind.npy", {1}, 1, {0});
  folder.put<float>("size.npy", {1, 3}, 1, {0.5, NAN, -1});
  folder.put<float>("mass.npy", {1}, 1, {2});
  for (const char* name : {"length.npy", "inertia.npy", "material.npy"})
    std::filesystem::remove(folder.path / name);
  const TrajectorySet set = read_trajectories(folder.path);
  CHECK(set.size() == 1);
  CHECK(set[0].frames() == 2);
  CHECK(set[0].state(1, 0).position == Vec3<double>{2, 2, 3});
  CHECK(set[0].body(0).inertia() == Body<double>(Sphere{0.5}, 2.0).inertia());
}

TEST_CASE("what stands behind a scene's length is ignored") {
  Folder folder;
  std::vector<double> numbers;
  for (int t = 0; t < 4; ++t)
    for (int i = 0; i < 2 * 13; ++i) numbers.push_back(t >= 2 ? NAN : i % 13 == 6 ? 1 : 0);
  folder.put<double>("states.npy", {4, 2, 13}, 3, numbers);
  CHECK(folder.refusal_within() ==
        ", scene 0, frame 2, body 0, position x: expected a finite number, found nan");
  folder.put<std::int64_t>("length.npy", {}, 3, {2});
  CHECK(read_trajectories(folder.path)[2].frames() == 2);
  for (const double length : {1, 5, -1}) {
    folder.put<std::int64_t>("length.npy", {}, 3, {2, length, 2});
    CHECK(folder.refusal_within() ==
          detail::text(", scene 1, length: expected 2 to 4 frames, found ", length));
  }
}

TEST_CASE("folders whose files do not fit together are refused with the place") {
  Folder folder;
  const auto refused = [&](const std::string& expected) {
    CHECK(folder.refusal_within() == expected);
    std::filesystem::remove_all(folder.path);
    write_trajectories(folder.path, some(other, {4, 3, 2}));
  };
  for (const char* name : {"world.json", "states.npy", "kind.npy", "size.npy", "mass.npy"}) {
    std::filesystem::remove(folder.path / name);
    refused(detail::text("/", name, ": cannot read: No such file or directory"));
  }
  folder.put<double>("states.npy", {4, 26}, 3, {1});
  refused("/states.npy: expected shape (any, any, any, 13), found (3, 4, 26)");
  folder.put<double>("states.npy", {4, 2, 13}, 0, {1});
  refused("/states.npy: expected shape (any, any, any, 13), found (0, 4, 2, 13)");
  folder.put<std::int64_t>("states.npy", {4, 2, 13}, 3, {1});
  refused("/states.npy: expected dtype <f4 or <f8, found <i8");
  folder.put<double>("kind.npy", {2}, 3, {1});
  refused("/kind.npy: expected dtype <i8, found <f8");
  folder.put<std::int64_t>("kind.npy", {2}, 4, {1});
  refused("/kind.npy: expected shape (3, 2), found (4, 2)");
  folder.put<std::int64_t>("kind.npy", {2}, 3, {2, 1, 2, 3});
  refused(", scene 1, body 1: kind: expected 0 (sphere), 1 (box) or 2 (capsule), found 3");
  folder.put<double>("size.npy", {2, 2}, 3, {1});
  refused("/size.npy: expected shape (3, 2, 3), found (3, 2, 2)");
  folder.put<double>("size.npy", {2, 3}, 3, {0.5, -0.5, 0.5});
  refused(
      ", scene 0, body 0: body (capsule of radius 0.5 m and half length -0.5 m, 1.5 kg), capsule half "
      "length: "
      "expected a length of 0 or more, found -0.5");
  folder.put<double>("mass.npy", {3}, 3, {1});
  refused("/mass.npy: expected shape (3, 2), found (3, 3)");
  folder.put<double>("mass.npy", {2}, 3, {1, 1, 1, -1});
  refused(
      ", scene 1, body 1: body (box of half extents (0.1, 0.2, 0.3) m, -1 kg), mass: expected a positive "
      "number of kg, found -1");
  folder.put<double>("inertia.npy", {2, 3}, 3, {1, 1, 3});
  refused(
      ", scene 0, body 0: body (capsule of radius 0.1 m and half length 0.2 m, 1.5 kg), inertia: expected no "
      "moment larger than the sum of the other two, found (1, 1, 3)");
  folder.put<double>("material.npy", {2, 2}, 3, {0.5, -0.1});
  refused(
      ", scene 0, body 0: body (capsule of radius 0.1 m and half length 0.2 m, 1.5 kg), friction: expected a "
      "number of 0 or more, found -0.1");
  folder.put<std::int64_t>("length.npy", {}, 2, {4});
  refused("/length.npy: expected shape (3), found (2)");
  folder.put<double>("states.npy", {4, 2, 13}, 3, {0});
  refused(", scene 0, frame 0, body 0, orientation: expected a unit quaternion, found one of length 0");
}

TEST_CASE("descriptions of no world are refused") {
  Folder folder;
  const auto refusal = [&](const std::string& world) {
    write_bytes(folder.path / "world.json", world);
    return folder.refusal_within();
  };
  const std::string gravity = R"("gravity": [0, 0, -9.81])", planes = R"("planes": [])";
  CHECK(refusal("{\"frame_time\": 0.01, " + gravity + ", " + planes + "}") == "elsewhere: ");
  CHECK(refusal("[]") == "/world.json: expected a JSON object, found something else");
  CHECK(refusal("{\"frame_time\": 1e999, " + gravity + ", " + planes + "}") ==
        "/world.json: expected a JSON object, found something else");
  CHECK(refusal("{" + gravity + ", " + planes + "}") ==
        "/world.json, frame_time: expected a number, found none");
  CHECK(refusal("{\"frame_time\": \"1\", " + gravity + ", " + planes + "}") ==
        "/world.json, frame_time: expected a number, found string");
  CHECK(refusal("{\"frame_time\": -1, " + gravity + ", " + planes + "}") ==
        "/world.json, frame time: expected a positive time in s, found -1");
  CHECK(refusal("{\"frame_time\": 1, \"gravity\": [1, 2], " + planes + "}") ==
        "/world.json, gravity: expected three numbers, found something else");
  CHECK(refusal("{\"frame_time\": 1, " + gravity + "}") ==
        "/world.json, planes: expected an array, found none");
  CHECK(refusal("{\"frame_time\": 1, " + gravity + ", \"planes\": [3]}") ==
        "/world.json, plane 0: expected an object, found number");
  CHECK(refusal("{\"frame_time\": 1, " + gravity + ", \"planes\": [{\"normal\": [0, 0, 1]}]}") ==
        "/world.json, plane 0, offset: expected a number, found none");
  CHECK(refusal("{\"frame_time\": 1, " + gravity + R"(, "planes": [{"normal": [0, 0, 2], "offset": 0}]})") ==
        "/world.json, plane 0, normal: expected a unit vector, found one of length 2");
  const auto with = [&](const std::string& more) {
    return refusal("{\"frame_time\": 1, " + gravity + ", " + planes + ", " + more + "}");
  };
  CHECK(with(R"("damping": 1)") == "/world.json, damping: expected an object, found number");
  CHECK(with(R"("damping": {"linear": 1})") ==
        "/world.json, damping, angular: expected a number, found none");
  CHECK(with(R"("damping": {"linear": 1, "angular": -1})") ==
        "/world.json, angular damping: expected 0 or more, found -1");
  CHECK(with(R"("fluid_friction": {"density": 1, "drag": 1})") ==
        "/world.json, fluid_friction, rotational_drag: expected a number, found none");
}

TEST_CASE("what the format cannot say is not written") {
  const TemporaryFolder folder;
  const auto refusal = [&](const TrajectorySet& set) {
    return error_of([&] { write_trajectories(folder / "set", set); });
  };
  const auto scene = [](const std::vector<Body<double>>& bodies) { return some(bodies, {2})[0]; };
  CHECK(refusal({1, {}, {}, {scene(uniform), scene({uniform[0]})}}) ==
        "scenes to write: expected 2 bodies, as in the first, found 1");
  CHECK(refusal({1, {}, {{{0, 0, 1}, 0, ice}}, {scene(uniform)}}) ==
        "planes to write: expected the default material, found another");
  Eigen::Matrix3d askew;
  askew << 2, 0.3, 0, 0.3, 3, 0, 0, 0, 4;
  CHECK(refusal({1, {}, {}, {scene({{Box{1.0, 1.0, 1.0}, 1.0, askew}})}}) ==
        "bodies to write: expected shapes along their principal axes, found one askew");
  CHECK(!std::filesystem::exists(folder / "set"));
  write_trajectories(folder / "set", some(uniform));
  CHECK(contains(refusal(some(uniform)), "set: expected an empty folder, found one with files in it"));
}

TEST_CASE("files that were cut or changed are refused, or still mean a set") {
  Folder folder;
  std::filesystem::remove_all(folder.path);
  write_trajectories(folder.path, some({other[0]}, {3, 2}));
  for (const auto& entry : std::filesystem::directory_iterator(folder.path)) {
    CAPTURE(entry.path());
    const std::string bytes = read_bytes(entry.path());
    const auto read = [&](const auto&) { read_trajectories(folder.path); };
    if (entry.path().extension() == ".npy") check_other_lengths_refused(entry.path(), bytes, read);
    CHECK(check_changed_bytes(entry.path(), bytes, read) > 100);
    write_bytes(entry.path(), bytes);
  }
}
