// The measured cube tosses: how they are read and scored, and rbres_tosses as a program.
#include "../examples/common/scenes.hpp"
#include "../examples/tosses/score.hpp"
#include "../examples/tosses/toss.hpp"

#include <cstdlib>
#include <limits>
#include <nlohmann/json.hpp>
#include <rbres/core/philox.hpp>
#include <rbres/learn/scene_simulator.hpp>

#include "program_support.hpp"

using namespace rbres;
using namespace rbres::tosses;

namespace {

State thrown(std::uint64_t seed) {
  Random random(seed);
  const auto vector = [&](double size) {
    return Vec3<double>{size * random.normal(), size * random.normal(), size * random.normal()};
  };
  State state{vector(0.1), quaternion_exp(vector(1)), vector(0.5), vector(2)};
  state.position.z = 0.15;
  return state;
}

auto make_free_flight(const TrajectorySet& set) {
  return [&](const Trajectory& toss) { return FreeFlight(set, toss, SceneStep::Velocity::mean); };
}
WorldNumbers numbers(double restitution, double friction) {
  WorldNumbers all;
  all[Unknown::restitution] = restitution;
  all[Unknown::friction] = friction;
  return all;
}
auto make_simulator(const TrajectorySet& set, const WorldNumbers& all) {
  return [&set, all](const Trajectory& toss) {
    return SceneSimulator(set, toss, all, {.velocity = SceneStep::Velocity::mean});
  };
}

/// Tosses that `make` makes from random starts.
template <class Make>
std::vector<Trajectory> made_tosses(const Make& make, int count, int frames) {
  std::vector<Trajectory> tosses;
  for (int i = 0; i < count; ++i) {
    std::vector<State> states{thrown(static_cast<std::uint64_t>(100 + i))};
    auto step = make(cube_toss({states[0], states[0]}));
    SceneState state{states};
    while (std::ssize(states) < frames) {
      step(state);
      states.push_back(state[0]);
    }
    tosses.push_back(cube_toss(states));
  }
  return tosses;
}

/// Rows of a well-formed file.
Eigen::MatrixXd rows_of(const std::vector<Trajectory>& tosses) {
  Eigen::MatrixXd rows(14, 0);
  for (std::size_t i = 0; i < tosses.size(); ++i) {
    for (int t = 0; t < tosses[i].frames(); ++t) {
      const State& s = tosses[i].state(t, 0);
      rows.conservativeResize(14, rows.cols() + 1);
      rows.col(rows.cols() - 1) << static_cast<double>(7 + i), s.position.x, s.position.y, s.position.z,
          s.orientation.w, s.orientation.x, s.orientation.y, s.orientation.z, s.velocity.x, s.velocity.y,
          s.velocity.z, s.angular_velocity.x, s.angular_velocity.y, s.angular_velocity.z;
    }
  }
  return rows;
}

const TrajectorySet world = toss_set({cube_toss({thrown(1), thrown(1)})}, 0);

}  // namespace

TEST_CASE("tosses are read as they were written") {
  const TemporaryFolder folder;
  const auto tosses = made_tosses(make_free_flight(world), 3, 20);
  write_npy(folder / "good.npy", rows_of(tosses));
  const auto found = read_tosses(folder / "good.npy");
  REQUIRE(found.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    REQUIRE(found[i].frames() == 20);
    CHECK((found[i].state(19, 0).vector() - tosses[i].state(19, 0).vector()).norm() < 1e-12);
  }
}

TEST_CASE("a missing or broken file is refused, and the error says where") {
  const TemporaryFolder folder;
  const Eigen::MatrixXd good = rows_of(made_tosses(make_free_flight(world), 2, 20));
  const auto path = folder / "broken.npy";
  const auto check_refused = [&](const std::filesystem::path& file, const char* what) {
    CAPTURE(what);
    const std::string message = error_of([&] { read_tosses(file); });
    CHECK(contains(message, file.string()));
    CHECK_MESSAGE(contains(message, what), message);
  };
  const auto broken = [&](Eigen::Index row, Eigen::Index column, double value) {
    Eigen::MatrixXd rows = good;
    rows(column, row) = value;
    write_npy(path, rows);
  };
  check_refused(folder / "not there.npy", "No such file");
  broken(23, 9, std::numeric_limits<double>::quiet_NaN());
  check_refused(path, "row 23, column 9");
  broken(5, 0, std::numeric_limits<double>::infinity());
  check_refused(path, "row 5, column 0");
  broken(31, 4, 2.0);
  check_refused(path, "row 31: expected a unit quaternion");
  broken(10, 0, 99.0);  // a toss of one frame in the midst of another
  check_refused(path, "row 10: expected a toss of two frames");
  broken(39, 0, 99.0);  // and at the end
  check_refused(path, "row 39: expected a toss of two frames");
  write_npy(path, Eigen::MatrixXd(good.topRows(13)));
  check_refused(path, "rows of 14 numbers");
  write_npy(path, Eigen::MatrixXd(14, 0));
  check_refused(path, "at least one toss");
  write_npy(path, Eigen::MatrixXf(good.cast<float>()));
  check_refused(path, "dtype");
  write_npy(path, good);
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 8);
  check_refused(path, "bytes of data");
  write_bytes(path, "not an array");
  check_refused(path, "");
}

TEST_CASE("rollout errors are those of known displacements") {
  auto tosses = made_tosses(make_free_flight(world), 2, 100);
  const auto score_of = [](const std::vector<Trajectory>& all) {
    const TrajectorySet set = toss_set(all, 0);
    return score(set, make_free_flight(set));
  };
  CHECK(score_of(tosses).position < 1e-12);
  // Frames 1 to 80 of the first toss and 1 to 40 of the second.
  for (std::size_t i = 0; i < 2; ++i) {
    std::vector<State> frames;
    for (int t = 0; t < (i == 0 ? 100 : 41); ++t) {
      frames.push_back(tosses[i].state(t, 0));
      if (t == 0) continue;
      frames.back().position.y += t <= 80 ? 0.03 : 9.0;
      frames.back().orientation =
          frames.back().orientation * quaternion_exp(Vec3<double>{0, i == 0 ? 0.3 : 0.6, 0});
    }
    tosses[i] = cube_toss(frames);
  }
  const Score found = score_of(tosses);
  CHECK(found.position == doctest::Approx(0.03));
  CHECK(found.rotation == doctest::Approx((80 * 0.3 + 40 * 0.6) / 120));
}

TEST_CASE("the floor is where cubes come to rest, and there tosses end") {
  const TrajectorySet floor = toss_set({cube_toss({thrown(1), thrown(1)})}, -0.01);
  const auto tosses = made_tosses(make_simulator(floor, numbers(0.1, 0.27)), 12, 150);
  CHECK(floor_height(tosses) == doctest::Approx(-0.01).epsilon(0.01));
  const TrajectorySet cut = until_rest(toss_set(tosses, -0.01), 30);
  REQUIRE(cut.size() == 12);
  int shorter = 0;
  for (int i = 0; i < 12; ++i) {
    CHECK(cut[i].frames() >= 30);
    shorter += cut[i].frames() < 150;
    const State& last = cut[i].state(cut[i].frames() - 1, 0);
    if (cut[i].frames() < 150)
      CHECK(norm(last.position - tosses[static_cast<std::size_t>(i)].state(149, 0).position) < 0.005);
  }
  CHECK(shorter > 6);
}

TEST_CASE("the program prints a row for each predictor, and refuses what it does not know") {
  const TemporaryFolder folder;
  const auto write = [&](const char* file, int count) {
    write_npy(folder / file, rows_of(made_tosses(make_simulator(world, numbers(0.1, 0.2)), count, 82)));
  };
  write("train.npy", 8);
  write("validation.npy", 2);
  const Outcome outcome = run(folder, RBRES_TOSSES_PROGRAM, ". --json");
  CAPTURE(outcome.err);
  REQUIRE(outcome.status == 0);
  const auto rows = nlohmann::json::parse(outcome.out, nullptr, false);
  REQUIRE(rows.is_array());
  REQUIRE(rows.size() == 4);
  const char* names[] = {"contact-free flow", "fitted simulator", "network alone", "hybrid"};
  for (std::size_t k = 0; k < 4; ++k) {
    CHECK(rows[k].size() == 3);
    CHECK(rows[k].at("predictor") == names[k]);
    CHECK(rows[k].at("rotation_rad").get<double>() > 0);
  }
  const auto error = [&](std::size_t k) { return rows[k].at("position_m").get<double>(); };
  CHECK(error(0) > 0.2);
  CHECK(error(1) < 0.01);  // the simulator that made them
  CHECK(error(2) < 0.5 * error(0));
  CHECK(error(3) < 0.05);
  for (const char* unknown : {"friction", "restitution", "gravity", "inertia", "size"})
    CHECK(contains(outcome.err, unknown));
  const Outcome table = run(folder, RBRES_TOSSES_PROGRAM, ".");
  for (const char* name :
       {"fitted simulator  ", "network alone  ", "network alone, bfloat16", "hybrid, bfloat16"})
    CHECK(contains(table.out, name));
  CHECK(contains(refusal(folder, RBRES_TOSSES_PROGRAM, ""), "FOLDER is required"));
  CHECK(contains(refusal(folder, RBRES_TOSSES_PROGRAM, ". --fast"), "--fast"));
  CHECK(contains(refusal(folder, RBRES_TOSSES_PROGRAM, "elsewhere"), "elsewhere/train.npy"));
}

TEST_CASE("the measured tosses: the fitted simulator is far closer than free flight") {
  const char* given = std::getenv("RBRES_TOSSES");
  const std::filesystem::path folder =
      given != nullptr ? given : std::filesystem::path(RBRES_SOURCE_DIR) / "../shared/data/contactnets";
  if (!std::filesystem::exists(folder / "train.npy")) {
    MESSAGE("skipped: no tosses in " << folder.string() << "; set RBRES_TOSSES");
    return;
  }
  const auto tosses = read_tosses(folder / "train.npy");
  CHECK(tosses.size() == 400);
  CHECK(read_tosses(folder / "validation.npy").size() == 85);
  const double floor = floor_height(tosses);
  CHECK(std::abs(floor) < 0.005);
  const TrajectorySet set = toss_set(tosses, floor);
  const Score free = score(set, make_free_flight(set)),
              simulated = score(set, make_simulator(set, numbers(0.125, 0.18)));
  CHECK(free.position == doctest::Approx(0.43).epsilon(0.05));
  CHECK(simulated.position < 0.02);
  CHECK(simulated.rotation < 0.3);
}
