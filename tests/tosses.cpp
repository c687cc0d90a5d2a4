#include "../examples/tosses/simulator.hpp"
#include "../examples/tosses/training.hpp"

#include <doctest/doctest.h>

#include <cstdlib>
#include <fstream>
#include <limits>
#include <rbres/io/npy.hpp>

using namespace rbres;
using namespace rbres::tosses;

namespace {

using Net =
    Network<double,
            Sequential<Linear<36, 16>, Tanh, Residual<Linear<16, 16>, Tanh, Linear<16, 16>>, Linear<16, 5>>>;

State falling(std::uint64_t seed) {
  Random random(seed);
  const auto vector = [&](double size) {
    return Vec3<double>{size * random.normal(), size * random.normal(), size * random.normal()};
  };
  State state{vector(0.1), quaternion_exp(vector(1)), vector(0.5), vector(2)};
  state.position.z = 0.07;
  return state;
}

/// A folder of its own for the test's files.
std::filesystem::path scratch(const char* name) {
  const auto folder = std::filesystem::temp_directory_path() / "rbres_test_tosses";
  std::filesystem::create_directories(folder);
  return folder / name;
}

/// Rows of a well-formed file: `tosses` tosses of 20 frames.
Eigen::MatrixXd rows_of(const std::vector<Toss>& tosses) {
  Eigen::MatrixXd rows(14, 0);
  for (std::size_t i = 0; i < tosses.size(); ++i) {
    for (const State& s : tosses[i]) {
      rows.conservativeResize(14, rows.cols() + 1);
      rows.col(rows.cols() - 1) << static_cast<double>(7 + i), s.position.x, s.position.y, s.position.z,
          s.orientation.w, s.orientation.x, s.orientation.y, s.orientation.z, s.velocity.x, s.velocity.y,
          s.velocity.z, s.angular_velocity.x, s.angular_velocity.y, s.angular_velocity.z;
    }
  }
  return rows;
}

/// Tosses that a step makes from random starts.
template <class Step>
std::vector<Toss> tosses_of(const Step& step, int count, int frames) {
  std::vector<Toss> tosses;
  for (int i = 0; i < count; ++i) {
    tosses.push_back({falling(static_cast<std::uint64_t>(100 + i))});
    tosses.back()[0].position.z = 0.15;
    for (int t = 1; t < frames; ++t) tosses.back().push_back(step(tosses.back().back()));
  }
  return tosses;
}

void check_refused(const std::filesystem::path& path, const char* what) {
  CAPTURE(what);
  try {
    read_tosses(path);
    FAIL_CHECK("was read");
  } catch (const Error& error) {
    CHECK(std::string(error.what()).find(path.string()) != std::string::npos);
    CHECK_MESSAGE(std::string(error.what()).find(what) != std::string::npos, error.what());
  }
}

}  // namespace

TEST_CASE("tosses are read as they were written") {
  const auto tosses = tosses_of(free_flight, 3, 20);
  const auto path = scratch("good.npy");
  write_npy(path, rows_of(tosses));
  const auto found = read_tosses(path);
  REQUIRE(found.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    REQUIRE(found[i].size() == 20);
    CHECK((found[i][19].vector() - tosses[i][19].vector()).norm() < 1e-12);
  }
}

TEST_CASE("a missing or broken file is refused, and the error says where") {
  const Eigen::MatrixXd good = rows_of(tosses_of(free_flight, 2, 20));
  const auto path = scratch("broken.npy");
  const auto broken = [&](Eigen::Index row, Eigen::Index column, double value) {
    Eigen::MatrixXd rows = good;
    rows(column, row) = value;
    write_npy(path, rows);
  };
  check_refused(scratch("not there.npy"), "No such file");
  broken(23, 9, std::numeric_limits<double>::quiet_NaN());
  check_refused(path, "row 23, column 9");
  broken(5, 0, std::numeric_limits<double>::infinity());
  check_refused(path, "row 5, column 0");
  broken(31, 4, 2.0);
  check_refused(path, "row 31: expected a unit quaternion");
  broken(10, 0, 99.0);  // a toss of one frame in the midst of another
  check_refused(path, "row 10: expected a toss of two frames");
  write_npy(path, Eigen::MatrixXd(good.topRows(13)));
  check_refused(path, "rows of 14 numbers");
  write_npy(path, Eigen::MatrixXd(14, 0));
  check_refused(path, "at least one toss");
  write_npy(path, Eigen::MatrixXf(good.cast<float>()));
  check_refused(path, "dtype");
  write_npy(path, good);
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 8);
  check_refused(path, "bytes of data");
  std::ofstream(path) << "not an array";
  check_refused(path, "");
}

TEST_CASE("rollout errors are those of known displacements") {
  auto tosses = tosses_of(free_flight, 2, 100);
  tosses[1].resize(41);
  CHECK(score(free_flight, tosses).position < 1e-12);
  // Frames 1 to 80 of the first toss and 1 to 40 of the second.
  for (Toss& toss : tosses) {
    for (std::size_t t = 1; t < toss.size(); ++t) {
      toss[t].position.y += t <= 80 ? 0.03 : 9.0;
      toss[t].orientation =
          toss[t].orientation * quaternion_exp(Vec3<double>{0, &toss == &tosses[0] ? 0.3 : 0.6, 0});
    }
  }
  const Score found = score(free_flight, tosses);
  CHECK(found.position == doctest::Approx(0.03));
  CHECK(found.rotation == doctest::Approx((80 * 0.3 + 40 * 0.6) / 120));
}

TEST_CASE("a prediction knows neither place, heading nor the names of the cube's axes") {
  const CornerPredictor<Net> predictor{Net(5), free_flight, -0.002};
  State state = falling(3);
  state.position.z = 0.04;
  const State next = predictor(state);
  REQUIRE(std::sqrt(squared_norm(next.velocity - free_flight(state).velocity)) > 1e-3);

  const Quat<double> heading = quaternion_exp(Vec3<double>{0, 0, 1.1});
  const Quat<double> relabelled = quaternion_exp(Vec3<double>{std::numbers::pi / 2, 0, 0});
  State other{rotate(heading, state.position) + Vec3<double>{3, -2, 0},
              heading * state.orientation * relabelled, rotate(heading, state.velocity),
              rotate_back(relabelled, state.angular_velocity)};
  other = predictor(other);
  CHECK(std::sqrt(squared_norm(other.velocity - rotate(heading, next.velocity))) < 1e-9);
  CHECK(std::sqrt(squared_norm(other.angular_velocity - rotate_back(relabelled, next.angular_velocity))) <
        1e-9);
  const Vec3<double> place = rotate(heading, next.position) + Vec3<double>{3, -2, 0};
  CHECK(std::sqrt(squared_norm(other.position - place)) < 1e-9);
}

TEST_CASE("the fit finds the friction and the floor that made the tosses") {
  const Simulator truth({.restitution = 0.1, .friction = 0.27}, -0.01);
  const auto tosses = tosses_of(truth, 12, 150);
  CHECK(floor_height(tosses) == doctest::Approx(-0.01).epsilon(0.01));
  const auto material = fit_material(tosses, -0.01);
  CHECK(material.friction == doctest::Approx(0.27).epsilon(0.05));
}

TEST_CASE(
    "training on rollouts learns the contacts of simulated tosses, with the same bits on one thread and "
    "two") {
  const Simulator truth({.restitution = 0.1, .friction = 0.2}, 0);
  const auto tosses = tosses_of(truth, 30, 60);
  const RolloutTraining options{.frames = 4, .batch = 64, .steps = 60, .rate = 5e-3};
  CornerPredictor<Net> one{Net(1), free_flight, 0};
  for (double& number : one.network.parameters()) number *= 0.3;
  auto two = one;
  std::vector<double> errors;
  train(
      one, tosses, options, [&](int, double error) { errors.push_back(error); }, 1);
  train(
      two, tosses, options, [](int, double) {}, 2);
  REQUIRE(errors.size() == 20);
  CHECK(errors.back() < 0.7 * errors.front());
  CHECK(std::ranges::equal(one.network.parameters(), two.network.parameters()));
  CHECK_THROWS_AS(train(one, tosses_of(truth, 3, 4), options, [](int, double) {}), Error);
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
  const Score free = score(free_flight, tosses), simulated = score(Simulator({0.125, 0.18}, floor), tosses);
  CHECK(free.position == doctest::Approx(0.43).epsilon(0.05));
  CHECK(simulated.position < 0.02);
  CHECK(simulated.rotation < 0.3);
}

TEST_CASE("the pose error's gradient is that of central differences") {
  const State a = falling(1), b = falling(2);
  Adjoint gradient = Adjoint::Zero(), unused;
  pose_error(a, b, 1, gradient);
  for (int k = 0; k < 12; ++k) {
    const double h = 1e-6;
    const double slope =
        (pose_error(moved(a, k, h), b, 1, unused) - pose_error(moved(a, k, -h), b, 1, unused)) / (2 * h);
    CAPTURE(k);
    CHECK(gradient[k] == doctest::Approx(slope).epsilon(1e-6));
  }
}

TEST_CASE("the gradient through a rollout is that of central differences") {
  constexpr int frames = 6, count = 3;
  const double floor = -0.002;
  Prior prior = free_flight;
  SUBCASE("over free flight") {}
  SUBCASE("over the simulator") { prior = Simulator({.restitution = 0.1, .friction = 0.2}, floor); }
  CornerPredictor<Net> predictor{Net(5), prior, floor};
  for (double& number : predictor.network.parameters())
    number *= 0.3;  // far from where the way back is damped
  std::vector<State> measured;
  std::vector<const State*> starts;
  for (int i = 0; i < count; ++i) {
    for (int t = 0; t <= frames; ++t) measured.push_back(falling(static_cast<std::uint64_t>(10 * i + t)));
  }
  for (int i = 0; i < count; ++i) starts.push_back(&measured[static_cast<std::size_t>(i * (frames + 1))]);
  const std::vector<int> turns{0, 1, 2};
  Rollouts<Net> rollouts(count, frames);
  rollouts.run(predictor, starts, turns);
  const auto adjoints = rollouts.adjoints();
  const auto gradient = rollouts.gradient();
  REQUIRE(std::ranges::any_of(gradient, [](double g) { return std::abs(g) > 1e-3; }));

  const double h = 1e-6;
  for (int i = 0; i < count; ++i) {
    State& start = measured[static_cast<std::size_t>(i * (frames + 1))];
    const State kept = start;
    for (int k = 0; k < 12; ++k) {
      start = moved(kept, k, h);
      const double above = rollouts.run(predictor, starts, turns);
      start = moved(kept, k, -h);
      const double below = rollouts.run(predictor, starts, turns);
      start = kept;
      CAPTURE(i);
      CAPTURE(k);
      CHECK(adjoints[static_cast<std::size_t>(i)][k] ==
            doctest::Approx((above - below) / (2 * h)).epsilon(1e-5));
    }
  }
  for (const ParameterTensor& tensor : Net::tensors()) {
    const std::size_t place = tensor.index(tensor.rows / 2, tensor.columns / 2);
    double& number = predictor.network.parameters()[place];
    const double kept = number;
    number = kept + h;
    const double above = rollouts.run(predictor, starts, turns);
    number = kept - h;
    const double below = rollouts.run(predictor, starts, turns);
    number = kept;
    CAPTURE(tensor.name);
    CHECK(gradient[place] == doctest::Approx((above - below) / (2 * h)).epsilon(1e-5));
  }
}
