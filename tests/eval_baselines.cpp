#include "../examples/scenarios/compiled.hpp"

#include <doctest/doctest.h>
#include <rbres/eval/metrics.hpp>
#include <rbres/sim/transitions.hpp>

using namespace rbres;

namespace {

using State = SystemState<double, 5>;
using Wrenches = std::array<Wrench<double>, 5>;

/// Bodies that fly far from each other and turn.
State apart() {
  State y;
  for (int b = 0; b < 5; ++b) {
    y[b].position = {3.0 * b, 0, 1};
    y[b].velocity = {0.5, -1, 2};
    y[b].angular_velocity = {1, 2, -0.5};
  }
  return y;
}

double distance(const State& a, const State& b) { return (a.vector() - b.vector()).cwiseAbs().maxCoeff(); }

}  // namespace

TEST_CASE("constant velocity keeps velocities, and turns about a fixed axis") {
  State y = apart();
  y[0].angular_velocity = {0, 0, std::numbers::pi};
  y[1].angular_velocity = {0, 0, 0};
  const State next = ConstantVelocity{0.5}(y, Wrenches{}, 4);
  CHECK(norm(next[0].position - Vec3<double>{0.25, -0.5, 2}) < 1e-14);
  CHECK(next[0].velocity == y[0].velocity);
  CHECK(next[0].orientation.z == doctest::Approx(std::sqrt(0.5)));
  CHECK(next[0].orientation.w == doctest::Approx(std::sqrt(0.5)));
  CHECK(next[1].orientation == y[1].orientation);
  CHECK(next[4] == y[4]);
}

TEST_CASE("without contacts, flow and simulation of either kind agree") {
  const auto check = [](auto set) {
    constexpr BodySet Set = set();
    const State y = apart();
    Wrenches w{};
    w[2] = {{1, -2, 0.5}, {0.01, 0.02, -0.01}};
    for (const int present : {3, 4, 5}) {
      const State flown = ContactFree{free_flow<Set>(), 0.4}(y, w, present);
      for (const ContactMode mode : {ContactMode::discrete, ContactMode::continuous}) {
        const SimulatedScenario<Set> simulated{World::free_space,
                                               {.step = 0.02, .duration = 0.4, .contacts = mode}};
        CHECK(distance(simulated(y, w, present), flown) < 1e-12);
      }
      for (int b = present; b < 5; ++b) CHECK(flown[b] == y[b]);
    }
    CHECK(norm(ContactFree{free_flow<Set>(), 0.4}(y, w, 5)[2].velocity - y[2].velocity) > 1);
  };
  check(std::integral_constant<BodySet, BodySet::standard>{});
  check(std::integral_constant<BodySet, BodySet::box>{});
}

TEST_CASE("simulations meet the room's walls, the flow does not") {
  State y = apart();
  for (int b = 0; b < 3; ++b) y[b].position = {1.0 * b - 1, 0, 0.4}, y[b].velocity = {0, 0, -3};
  const SimulatedScenario<BodySet::standard> room{World::room, {.step = 1e-3, .duration = 0.2}};
  const SimulatedScenario<BodySet::standard> nowhere{World::free_space, {.step = 1e-3, .duration = 0.2}};
  CHECK(room(y, Wrenches{}, 3)[0].velocity.z > 0);
  CHECK(nowhere(y, Wrenches{}, 3)[0].velocity.z < -3);
}

TEST_CASE("a simulation of one's own world leads where its transitions do") {
  const Material<double> rubber{0.5, 0.4};
  const System<double, 2, Box<double>> world{
      {Body{Box{0.1, 0.2, 0.3}, 2.0, rubber}, Body{Box{0.2, 0.2, 0.1}, 1.0, rubber}}, {floor_plane(rubber)}};
  const SimulationOptions options{.step = 2e-3, .duration = 0.3};
  const auto start = [](std::ptrdiff_t i) {
    Start<2> s;
    s.state[0].position = {0, 0, 0.5};
    s.state[1].position = {0.1, 0, 1 + 0.1 * static_cast<double>(i)};
    s.wrench[0].force.x = 3;
    return s;
  };
  const auto transitions = simulate_transitions(world, Gravity{}, Rk4{}, 5, start, options);
  const Eigen::MatrixXd ends = predict_all(transitions, 0, 5, Simulated{world, Gravity{}, options});
  for (Eigen::Index c = 0; c < 5; ++c)
    CHECK((ends.col(c) - transitions.end(c).vector()).cwiseAbs().maxCoeff() < 1e-9);
  CHECK(transitions.had_impact(0));
  CHECK(measure(transitions, 0, ends, world).position < 1e-18);
  const Eigen::MatrixXd flown =
      predict_all(transitions, 0, 5, ContactFree{FreeFlow<2>{world, Gravity{}, {.density = 0}}, 0.3});
  CHECK(measure(transitions, 0, flown, world).position > 1e-4);
}

TEST_CASE("a rollout of a simulation is one run on, through contacts") {
  State y = apart();
  for (int b = 0; b < 3; ++b) y[b].position = {1.0 * b - 1, 0, 0.4}, y[b].velocity = {0, 0, -3};
  const SimulatedScenario<BodySet::standard> once{
      World::room, {.step = 0.02, .duration = 1.5, .contacts = ContactMode::discrete}};
  SimulatedScenario<BodySet::standard> pieces = once;
  pieces.options.duration = 0.1;
  std::array<State, 15> states;
  pieces.rollout(y, Wrenches{}, states, 3);
  CHECK(states[0] == pieces(y, Wrenches{}, 3));
  CHECK(distance(states[14], once(y, Wrenches{}, 3)) < 1e-12);
  CHECK(states[3][4] == y[4]);
  for (const int present : {2, 6})
    CHECK_THROWS_WITH_AS(once(y, Wrenches{}, present),
                         doctest::Contains("bodies of a scenario: expected 3 to 5"), Error);
  pieces.options.duration = 0;
  CHECK_THROWS_WITH_AS(pieces(y, Wrenches{}, 3), doctest::Contains("duration of a simulation that predicts"),
                       Error);
}

TEST_CASE("all predictions are those one by one, and the data count impacts by horizon") {
  const ScenarioSampler<BodySet::standard> sampler(World::room, 3);
  const ScenarioData data = generate(sampler, 0, 40, {0.2, 1});
  const ScenarioTransitions transitions(data, 0);
  const ContactFree predict{free_flow<BodySet::standard>(), 0.2};
  const Eigen::MatrixXd all = predict_all(transitions, 5, 35, predict);
  REQUIRE(all.cols() == 35);
  for (Eigen::Index c = 0; c < 35; ++c) {
    const int present = data.body_count[static_cast<std::size_t>(c + 5)];
    const State one = predict(state_of(data.initial, c + 5, present), wrench_of(data, c + 5), present);
    CHECK((all.col(c) - one.vector()).cwiseAbs().maxCoeff() == 0);
  }

  REQUIRE(data.impacts.rows() == 2);
  REQUIRE(data.impacts.cols() == 40);
  int several = 0;
  for (Eigen::Index c = 0; c < 40; ++c) {
    const double first = static_cast<double>(data.first_contact[static_cast<std::size_t>(c)]);
    CHECK((data.impacts(0, c) > 0) == (first <= 0.2 + 1e-6));
    CHECK((data.impacts(1, c) > 0) == (first <= 1 + 1e-6));
    CHECK(data.impacts(0, c) <= data.impacts(1, c));
    several += data.impacts(1, c) > 1;
  }
  CHECK(several > 0);

  int calls = 0;
  const TimedCall timed =
      one_by_one(transitions, 7, [&](const State& y, const auto&, int) { return ++calls, y; });
  timed.run();
  CHECK(calls == 7);
  CHECK(timed.scenarios == 7);
}
