// rbres_contacts as a program: what it prints, and what it refuses.
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

#include <rbres/body/mechanics.hpp>
#include <rbres/core/philox.hpp>
#include <rbres/io/contact_law.hpp>
#include <rbres/io/trajectories.hpp>
#include <rbres/learn/contact_law_simulator.hpp>
#include <rbres/learn/spring_damper.hpp>

#include "program_support.hpp"

using namespace rbres;

namespace {

/// Balls thrown onto a floor of springs.
TrajectorySet throws(int count, int frames, std::uint64_t seed, double frame_time = 0.01) {
  const Vec3<double> gravity{0, 0, -9.81};
  const std::vector<Body<double>> bodies{{Sphere{0.1}, 0.7}};
  std::vector<Trajectory> scenes;
  for (int s = 0; s < count; ++s) {
    Random random(seed, static_cast<std::uint64_t>(s));
    RigidState<double> ball;
    ball.position = {0, 0, 0.12 + 0.1 * random.uniform()};
    ball.velocity = {1 + random.uniform(), 0, -1 - random.uniform()};
    const TrajectorySet set(frame_time, gravity, {floor_plane<double>()}, {{bodies, {ball, ball}}});
    SpringDamperSimulator step(set, set[0], {.stiffness = 4000, .damping = 12, .friction = 0.2});
    SceneState state{{ball}};
    std::vector<RigidState<double>> states{ball};
    while (std::ssize(states) <= frames) {
      step(state);
      states.push_back(state[0]);
    }
    scenes.push_back({bodies, states});
  }
  return {frame_time, gravity, {floor_plane<double>()}, scenes};
}

}  // namespace

TEST_CASE("a row for each predictor and horizon") {
  const TemporaryFolder folder;
  write_trajectories(folder / "set/train", throws(10, 30, 1));
  write_trajectories(folder / "set/test", throws(4, 30, 2));
  const Outcome outcome =
      run(folder, RBRES_CONTACTS, "set --json --minutes 3 --seed 3 --model law.safetensors");
  CAPTURE(outcome.err);
  REQUIRE(outcome.status == 0);
  const auto rows = nlohmann::json::parse(outcome.out, nullptr, false);
  REQUIRE(rows.is_array());
  REQUIRE(rows.size() == 15);
  const char* names[] = {"contact-free flow", "fitted simulator", "fitted spring-damper", "learned law",
                         "hybrid"};
  const double ahead[] = {0.05, 0.1, 0.25};
  for (std::size_t k = 0; k < 15; ++k) {
    CHECK(rows[k].size() == 5);
    CHECK(rows[k].at("predictor") == names[k / 3]);
    CHECK(rows[k].at("seconds_ahead").get<double>() == doctest::Approx(ahead[k % 3]));
    CHECK(rows[k].at("rotation_rad").get<double>() >= 0);
    CHECK(rows[k].at("us_per_frame").get<double>() > 0);
  }
  const auto error = [&](std::size_t k) { return rows[3 * k + 2].at("position_m").get<double>(); };
  CHECK(error(0) > 0.3);              // what falls through the floor is far below it
  CHECK(error(1) < 0.1 * error(0));   // a bounce without depth is nearer
  CHECK(error(2) < 0.01 * error(0));  // the law that made them is found
  CHECK(error(3) < 0.3 * error(0));   // a moment's learning knows that there is a floor
  CHECK(error(4) < 0.3 * error(0));   // and so does the simulator that it corrects
  CHECK(contains(outcome.err, "training loss"));
  CHECK(contains(outcome.err, "left"));

  // The law that is saved is the one that was measured.
  const auto law = load<ContactLaw<>>(folder / "law.safetensors");
  CHECK(law.scales.frame_time == 0.01);
  const TrajectorySet test = read_trajectories(folder / "set/test");
  double sum = 0;
  for (const Trajectory& scene : test) {
    ContactLawSimulator step(test, scene, law);
    SceneState state{{scene.state(0, 0)}};
    for (int t = 0; t < 25; ++t) step(state);
    sum += norm(state[0].position - scene.state(25, 0).position);
  }
  CHECK(sum / test.size() == doctest::Approx(error(3)).epsilon(1e-4));
  // Ten seconds on, balls still lie on the floor, with no more energy than they began with.
  for (const Trajectory& scene : test) {
    const auto energy = [&](const RigidState<double>& y) {
      return kinetic_energy(scene.body(0), y) - scene.body(0).mass() * dot(test.gravity(), y.position);
    };
    ContactLawSimulator step(test, scene, law);
    SceneState state{{scene.state(0, 0)}};
    double most = 0;
    for (int t = 0; t < 1000; ++t) {
      step(state);
      most = std::max(most, energy(state[0]));
    }
    CHECK(most < 1.02 * energy(scene.state(0, 0)));
    CHECK(state[0].position.z == doctest::Approx(0.1).epsilon(0.1));
  }
}

TEST_CASE("folders that do not fit are refused on one line") {
  const TemporaryFolder folder;
  CHECK(contains(refusal(folder, RBRES_CONTACTS, "set"), "set/train/world.json: cannot read"));
  write_trajectories(folder / "set/train", throws(10, 8, 1));
  CHECK(contains(refusal(folder, RBRES_CONTACTS, "set"), "set/test"));
  CHECK(contains(refusal(folder, RBRES_CONTACTS, "set --scenes 11"),
                 "expected some within 10, found 11 from 0"));
  write_trajectories(folder / "set/test", throws(2, 8, 2, 0.02));
  CHECK(contains(refusal(folder, RBRES_CONTACTS, "set"),
                 "set/test, frame time: expected 0.01 s, as in train, found 0.02\n"));
  write_trajectories(folder / "short/train", throws(10, 4, 1));
  CHECK(contains(refusal(folder, RBRES_CONTACTS, "short"), "expected scenes of at least 6 frames"));
  CHECK(contains(refusal(folder, RBRES_CONTACTS, "set --scenes 1"),
                 "set/train: expected at least 2 scenes, found 1"));
  CHECK(contains(refusal(folder, RBRES_CONTACTS, "set --minutes 0"), "--minutes"));
  // Balls that nothing stops.
  const TrajectorySet thrown = throws(4, 8, 1);
  write_trajectories(folder / "apart/train", {0.01, thrown.gravity(), {}, {thrown.begin(), thrown.end()}});
  CHECK(contains(refusal(folder, RBRES_CONTACTS, "apart"),
                 "apart/train, contacts of a trajectory set: expected at least one, found none"));
  // One number that is none.
  write_trajectories(folder / "broken/train", throws(4, 8, 1));
  std::string bytes = read_bytes(folder / "broken/train/states.npy");
  const double none = std::numeric_limits<double>::quiet_NaN();
  std::memcpy(bytes.data() + bytes.size() - sizeof none, &none, sizeof none);
  write_bytes(folder / "broken/train/states.npy", bytes);
  CHECK(contains(refusal(folder, RBRES_CONTACTS, "broken"), "broken/train, scene 3, frame 8, body 0, "));
  // Where the law could not be saved, nothing is learned.
  write_trajectories(folder / "good/train", throws(4, 8, 1));
  write_trajectories(folder / "good/test", throws(2, 8, 2));
  CHECK(
      contains(refusal(folder, RBRES_CONTACTS, "good --model none/law.safetensors"), "none/law.safetensors"));
  write_bytes(folder / "mine.npy", "mine");
  CHECK(contains(refusal(folder, RBRES_CONTACTS, "good --model mine.npy"),
                 "--model: mine.npy exists and would be overwritten; --force overwrites it"));
  CHECK(read_bytes(folder / "mine.npy") == "mine");
  // Test scenes that are broken are so before anything is learned, too.
  bytes = read_bytes(folder / "good/test/states.npy");
  bytes.resize(bytes.size() - 8);
  write_bytes(folder / "good/test/states.npy", bytes);
  CHECK(contains(refusal(folder, RBRES_CONTACTS, "good --minutes 1000"), "good/test/states.npy"));
}

#ifdef RBRES_CONTACTS_MUJOCO
TEST_CASE("folders made by rbres with a law of its own") {
  const TemporaryFolder folder;
  const std::string options = " --rbres --bodies 3 --train 2 --test 1 --frames 60";
  const Outcome outcome = run(folder, RBRES_CONTACTS_MUJOCO, "balls" + options);
  CAPTURE(outcome.err);
  REQUIRE(outcome.status == 0);
  CHECK(contains(outcome.err, "us a frame of 20 steps"));
  run(folder, RBRES_CONTACTS_MUJOCO, "boxes --boxes --seed 2" + options);
  double slow = 0, fast = 1;
  for (const char* name : {"balls/train", "balls/test", "boxes/train", "boxes/test"}) {
    const TrajectorySet set = read_trajectories(folder / name);
    CHECK(set.size() == (std::string(name).ends_with("train") ? 2 : 1));
    for (const Trajectory& scene : set) {
      const auto energy = [&](int t) {
        double sum = 0;
        for (int i = 0; i < scene.bodies(); ++i)
          sum += kinetic_energy(scene.body(i), scene.state(t, i)) -
                 scene.body(i).mass() * dot(set.gravity(), scene.state(t, i).position);
        return sum;
      };
      const double first = energy(0);
      CHECK(scene.frames() == 61);
      for (int t = 1; t < scene.frames(); ++t) {
        CHECK(energy(t) < energy(t - 1) + 2e-3 * first);
        for (int i = 0; i < scene.bodies(); ++i) {
          const Vec3<double>&before = scene.state(t - 1, i).velocity, &after = scene.state(t, i).velocity;
          CHECK(scene.state(t, i).position.z > 0.02);
          // Balls that bounce from the floor: the faster, the less of the speed is left.
          const bool bounce = std::string(name).starts_with("balls") && before.z < -0.5 && after.z > 0.1 &&
                              norm(Vec3<double>{after.x - before.x, after.y - before.y, 0}) < 0.3;
          if (!bounce) continue;
          const double left = -after.z / before.z;
          (before.z > -1.5 ? slow : fast) = before.z > -1.5 ? std::max(slow, left) : std::min(fast, left);
        }
      }
    }
  }
  CAPTURE(slow);
  CAPTURE(fast);
  CHECK(slow > fast + 0.1);
}
#endif
