// What runs take and refuse: time steps, starts, counts, observers. The physics is tested elsewhere.
#include <doctest/doctest.h>

#include <limits>
#include <rbres/rbres.hpp>
#include <unsupported/Eigen/AutoDiff>

#include "error_of.hpp"

using namespace rbres;

namespace {

constexpr double infinite = std::numeric_limits<double>::infinity(), unknown = NAN;
using Ball = System<double, 2, Sphere<double>>;
using State = Ball::State;

const Ball balls{{Body{Sphere{0.1}, 1.0}, Body{Sphere{0.1}, 2.0}}, {floor_plane<double>()}};

State falling() {
  State y;
  y[0].position = {0, 0, 0.5};
  y[1].position = {1, 0, 0.7};
  y[1].angular_velocity = {1, 2, 3};
  return y;
}

}  // namespace

TEST_CASE("a step of no length that time has moves nothing, and says so") {
  for (const auto mode : {ContactMode::continuous, ContactMode::discrete}) {
    const SimulationOptions options{.contacts = mode};
    for (const auto& [at, span] : {std::pair{0.0, -1e-3},
                                   {0.0, -infinite},
                                   {0.0, infinite},
                                   {0.0, unknown},
                                   {unknown, 1e-3},
                                   {infinite, 1e-3}}) {
      const double t = at, h = span;  // names that CAPTURE can take
      CAPTURE(t);
      CAPTURE(h);
      Stepper stepper(balls, Gravity{}, Rk4{}, options);
      State y = falling();
      CHECK(stepper.step(y, t, h) == 0);
      CHECK(y == falling());
      CHECK(!stepper.finite());
    }
    Stepper stepper(balls, Gravity{}, Rk4{}, options);
    State y = falling();
    CHECK(stepper.step(y, 0.0, 0.0) == -1);
    CHECK(y == falling());
    CHECK(stepper.step(y, 0.0, 1e-3) == -1);
    CHECK(y[0].velocity.z < 0);
    CHECK(stepper.finite());
  }
}

TEST_CASE("however short a step is, bodies that rest on one another stay finite") {
  constexpr Material<double> rough{.restitution = 0.2, .friction = 0.5};
  const auto tower =
      System<double, 2, Box<double>>::of(Body(Box{0.1, 0.1, 0.1}, 1.0, rough), {floor_plane(rough)});
  for (const auto mode : {ContactMode::continuous, ContactMode::discrete}) {
    for (int exponent = -320; exponent < -3; ++exponent) {
      CAPTURE(exponent);
      SystemState<double, 2> y;
      y[0].position.z = 0.1;
      y[1].position = {0.02, 0, 0.3};
      const SimulationOptions options{.step = 1e-3, .contacts = mode};
      Stepper stepper(tower, Gravity{}, Rk4{}, options);
      const double h = std::pow(10.0, exponent);
      for (int k = 0; k < 3; ++k) CHECK(stepper.step(y, k * h, h) == -1);
      CHECK(std::abs(y[1].position.z - 0.3) < 1e-6);
    }
  }
}

TEST_CASE("in lanes, those with such a step stay and the others go on") {
  using S = Pack<double, 4>;
  const auto lanes = balls.cast<S>();
  SystemState<S, 2> y;
  for (int l = 0; l < 4; ++l) set_lane(y, l, falling());
  S h(1e-3);
  ScalarTraits<S>::set_lane(h, 1, -1e-3);
  ScalarTraits<S>::set_lane(h, 2, unknown);
  Stepper stepper(lanes, Gravity{}, Rk4{}, SimulationOptions{});
  CHECK(stepper.step(y, S(0.0), h) == 0);
  for (const int l : {1, 2}) {
    CHECK(lane(y, l) == falling());
    CHECK(!stepper.finite()[l]);
  }
  for (const int l : {0, 3}) {
    CHECK(lane(y, l)[0].velocity.z == doctest::Approx(-9.81e-3));
    CHECK(stepper.finite()[l]);
  }
}

TEST_CASE("a start's orientations are made unit before anyone sees them, and unit ones keep their bits") {
  const Quat<double> q = normalized(Quat<double>{0.1, 0.2, -0.3, 0.9});
  const auto length = [](const Quat<double>& found) { return std::sqrt(squared_norm(found)); };
  for (const double factor : {1 - 9e-4, 1 + 9e-4, 1 + 1e-8}) {
    CAPTURE(factor);
    State y = falling();
    y[1].orientation = {factor * q.x, factor * q.y, factor * q.z, factor * q.w};
    const State start = y;
    int heard = 0;
    simulate(balls, y, Gravity{}, Rk4{}, {.duration = 2e-3}, [&](double, const State& now) {
      CHECK(std::abs(length(now[1].orientation) - 1) < 1e-15);
      ++heard;
    });
    simulate_batch<Pack<double, 2>>(
        balls, 3, [&](std::ptrdiff_t) { return start; }, [](const auto&) { return Gravity{}; }, Rk4{},
        {.duration = 2e-3},
        [&](const auto& sample) {
          CHECK(std::abs(length(sample.state[1].orientation) - 1) < 1e-15);
          ++heard;
        },
        1);
    CHECK(heard == 3 + 3 * 3);
  }
  State y = falling();
  y[1].orientation = q;
  simulate(balls, y, Gravity{}, Rk4{}, {.duration = 0},
           [&](double, const State& now) { CHECK(now[1].orientation == q); });
  // So a run that stops and goes on is the run that does not stop.
  State whole = falling(), parts = falling();
  simulate(balls, whole, Gravity{}, Rk4{}, {.step = 0x1p-10, .duration = 0x1p-5});
  for (int k = 0; k < 4; ++k) simulate(balls, parts, Gravity{}, Rk4{}, {.step = 0x1p-10, .duration = 0x1p-7});
  CHECK(whole == parts);
}

TEST_CASE("counts and threads that are none are refused") {
  const auto refusal = [](std::ptrdiff_t count, int threads) {
    return error_of([&] {
      simulate_batch<double>(
          balls, count, [](std::ptrdiff_t) { return falling(); }, [](const auto&) { return Gravity{}; },
          Rk4{}, {.duration = 0.01}, [](const auto&) { FAIL("observed"); }, threads);
    });
  };
  CHECK(refusal(-1, 1) == "scenarios: expected 0 or more, found -1");
  CHECK(refusal(std::numeric_limits<std::ptrdiff_t>::min(), 1) != "");
  CHECK(refusal(2, -1) == "threads: expected 0 to 4096, found -1");
  CHECK(refusal(2, 2'000'000'000) == "threads: expected 0 to 4096, found 2000000000");
  CHECK(refusal(0, 1) == "");
  CHECK(error_of([] { parallel_for(3, -2, [](std::ptrdiff_t) {}); }) != "");
  CHECK(error_of([] { parallel_team(5000, [](const Team&) {}); }) != "");
}

TEST_CASE("observers of samples, of impacts, of both; a bool stops the run, whatever else does not compile") {
  // What does not is in compile_fail/observer.cpp.
  State y = falling();
  struct Impacts {
    int heard = 0;
    void impact(double, const State& before, const State& after) {
      CHECK(before[0].velocity.z <= after[0].velocity.z);
      ++heard;
    }
  } impacts;
  const auto report = simulate(balls, y, Gravity{}, Rk4{}, {.duration = 0.4}, impacts);
  CHECK(report.status == SimulationStatus::finished);
  CHECK(impacts.heard == report.impacts);
  CHECK(impacts.heard > 0);
  y = falling();
  const auto stopped =
      simulate(balls, y, Gravity{}, Rk4{}, {.duration = 0.4}, [](double time, const auto&) -> const bool& {
        static constexpr bool on = true, off = false;
        return time < 0.1 ? on : off;
      });
  CHECK(stopped.status == SimulationStatus::stopped);
  CHECK(stopped.time == doctest::Approx(0.1));
}
