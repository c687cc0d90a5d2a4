#include <cmath>

#include <rbres/learn/trajectory.hpp>

#include "io_support.hpp"

using namespace rbres;

namespace {

using State = RigidState<double>;

const std::vector<Body<double>> two{{Sphere{0.1}, 1.0}, {Box{0.1, 0.2, 0.3}, 2.0}};
std::vector<State> still(int states) { return std::vector<State>(static_cast<std::size_t>(states)); }

std::string refusal_of(const std::vector<Body<double>>& bodies, const std::vector<State>& states) {
  return error_of([&] { Trajectory(bodies, states); });
}
std::string refusal_of(double frame_time, const Vec3<double>& gravity, const Plane<double>& plane,
                       int scenes = 1) {
  return error_of([&] {
    TrajectorySet(frame_time, gravity, {plane},
                  std::vector<Trajectory>(static_cast<std::size_t>(scenes), {two, still(4)}));
  });
}

}  // namespace

TEST_CASE("a trajectory gives its states frame by frame") {
  auto states = still(6);
  for (int k = 0; k < 6; ++k) states[static_cast<std::size_t>(k)].position.x = k;
  const Trajectory scene(two, states);
  CHECK(scene.bodies() == 2);
  CHECK(scene.frames() == 3);
  CHECK(scene.body(1).mass() == 2);
  CHECK(scene.frame(2).size() == 2);
  for (int k = 0; k < 6; ++k) CHECK(scene.state(k / 2, k % 2).position.x == k);
}

TEST_CASE("quaternions become unit, and those that are keep their bits") {
  auto states = still(4);
  states[0].orientation = {0, 0, 0, 1.0005};
  states[1].orientation = normalized(Quat<double>{0.1, 0.2, 0.3, 0.4});
  const Trajectory scene(two, states);
  CHECK(scene.state(0, 0).orientation == Quat<double>{0, 0, 0, 1});
  CHECK(scene.state(0, 1) == states[1]);
}

TEST_CASE("trajectories that make no sense are refused, and the message names the place") {
  CHECK(refusal_of(two, still(4)) == "");
  CHECK(refusal_of({}, still(4)) == "bodies of a trajectory: expected at least one, found none");
  CHECK(refusal_of(two, still(5)) ==
        "states of a trajectory: expected whole frames of 2 bodies, found 5 states");
  CHECK(refusal_of(two, still(2)) == "frames of a trajectory: expected at least 2, found 1");
  CHECK(refusal_of(two, {}) == "frames of a trajectory: expected at least 2, found 0");
  auto states = still(6);
  states[3].velocity.y = NAN;
  CHECK(refusal_of(two, states) == "frame 1, body 1, velocity y: expected a finite number, found nan");
  states[3].velocity.y = 0;
  states[4].orientation = {0, 0, 0, 0};
  CHECK(refusal_of(two, states) ==
        "frame 2, body 0, orientation: expected a unit quaternion, found one of length 0");
  states[4].orientation = {0, 0, 0, 1.01};
  CHECK(refusal_of(two, states) ==
        "frame 2, body 0, orientation: expected a unit quaternion, found one of length 1.01");
  const auto pushed = [&](const std::vector<Wrench<double>>& wrenches) {
    return error_of([&] { Trajectory(two, still(4), wrenches); });
  };
  CHECK(pushed({{}, {}}) == "");
  CHECK(pushed({{}}) == "wrenches of a trajectory: expected one for each of 2 bodies, found 1");
  CHECK(pushed({{}, {{}, {0, 0, NAN}}}) == "wrench on body 1: expected finite numbers, found nan");
}

TEST_CASE("sets that make no sense are refused") {
  const Vec3<double> down{0, 0, -9.81};
  const Plane<double> floor;
  CHECK(refusal_of(0.01, down, floor) == "");
  for (const double time : {0.0, -1.0, double(NAN), double(INFINITY)})
    CHECK(refusal_of(time, down, floor).starts_with("frame time: expected a positive time in s, found "));
  CHECK(refusal_of(0.01, {0, 0, INFINITY}, floor) ==
        "gravity: expected three finite numbers (m/s^2), found inf");
  CHECK(refusal_of(0.01, down, {{0, 0, 2}, 0, {}}) ==
        "plane 0, normal: expected a unit vector, found one of length 2");
  CHECK(refusal_of(0.01, down, {{0, 0, 1}, NAN, {}}) ==
        "plane 0, offset: expected a finite number, found nan");
  const auto slowed = [&](const Resistance& resistance) {
    return error_of([&] { TrajectorySet(0.01, down, {floor}, {{two, still(4)}}, resistance); });
  };
  CHECK(slowed({{1.2, 0.5, 0.01}, {0.1, 0.2}}) == "");
  CHECK(slowed({{.density = -1}, {}}) == "density of the fluid: expected 0 or more, found -1");
  CHECK(slowed({{.drag = NAN}, {}}) == "drag of the fluid: expected 0 or more, found nan");
  CHECK(slowed({{.rotational_drag = -1}, {}}) ==
        "rotational drag of the fluid: expected 0 or more, found -1");
  CHECK(slowed({{}, {-1, 0}}) == "linear damping: expected 0 or more, found -1");
  CHECK(slowed({{}, {0, INFINITY}}) == "angular damping: expected 0 or more, found inf");
  CHECK(refusal_of(0.01, down, floor, 0) == "scenes of a trajectory set: expected at least one, found none");
}

TEST_CASE("a part of a set") {
  auto states = still(2);
  std::vector<Trajectory> scenes;
  for (int s = 0; s < 4; ++s) {
    states[0].position.x = s;
    scenes.push_back({{two[0]}, states});
  }
  const TrajectorySet set(0.01, {0, 0, -9.81}, {{}}, scenes, {{}, {0.5, 0}});
  const TrajectorySet part = set.subset(1, 2);
  CHECK(part.size() == 2);
  CHECK(part.frame_time() == 0.01);
  CHECK(part.gravity() == set.gravity());
  CHECK(part.planes().size() == 1);
  CHECK(part.resistance().damping.linear == 0.5);
  CHECK(part[0].state(0, 0).position.x == 1);
  CHECK(part[1].state(0, 0).position.x == 2);
  CHECK(error_of([&] { set.subset(3, 2); }) == "scenes: expected some within 4, found 2 from 3");
  CHECK_THROWS_AS(set.subset(-1, 1), Error);
  CHECK_THROWS_AS(set.subset(0, 0), Error);
}
