#include <doctest/doctest.h>

#include <rbres/eval/baselines.hpp>
#include <rbres/eval/metrics.hpp>
#include <rbres/paper/scenario_transitions.hpp>

using namespace rbres;

namespace {

constexpr double mass = 2;
const auto bodies = System<double, 5, Sphere<double>>::of({Sphere{0.3}, mass, Vec3<double>{0.1, 0.2, 0.3}});

/// Scenarios of three bodies, all at rest at (1, 2, 2) and upright, none of which had a contact.
ScenarioData at_rest(Eigen::Index n) {
  ScenarioData data;
  data.horizons = {0.1, 1};
  data.states.assign(2, ScenarioData::Columns::Zero(65, n));
  for (auto& states : data.states) {
    for (int b = 0; b < 3; ++b) {
      states.middleRows(13 * b, 3).colwise() = Eigen::Vector3f(1, 2, 2);
      states.row(13 * b + 6).setOnes();
    }
  }
  data.initial = ScenarioData::Columns::Zero(65, n);
  data.wrench = ScenarioData::Columns::Zero(30, n);
  data.body_count.assign(static_cast<std::size_t>(n), 3);
  data.first_contact.assign(static_cast<std::size_t>(n), std::numeric_limits<float>::infinity());
  return data;
}

Metrics compare(const ScenarioData& data, const Eigen::MatrixXd& predicted, std::size_t h = 0,
                Eigen::Index first = 0) {
  return measure(ScenarioTransitions(data, h), first, predicted, bodies);
}

Eigen::MatrixXd truth(const ScenarioData& data) { return data.states[0].cast<double>(); }

}  // namespace

TEST_CASE("truth itself has no error; a quaternion's sign is none") {
  const ScenarioData data = at_rest(2);
  Eigen::MatrixXd guess = truth(data);
  guess.middleRows(3, 4) *= -1;
  const Metrics m = compare(data, guess);
  CHECK(m.bodies == 6);
  for (const double x : {m.position, m.orientation, m.velocity, m.angular_velocity, m.angle, m.energy,
                         m.relative[0], m.relative[1], m.elementwise[0], m.elementwise[1]})
    CHECK(x == 0);
}

TEST_CASE("truth that is no state is refused, and predictions that are not finite are not hidden") {
  const ScenarioData good = at_rest(2);
  for (const auto& [row, wrong] : {std::pair{0, std::numeric_limits<float>::quiet_NaN()},
                                   {20, std::numeric_limits<float>::infinity()},
                                   {6, 0.0f}}) {
    ScenarioData data = good;
    data.states[0](row, 1) = wrong;
    const std::string name = row < 13 ? "truth of transition 1, body 0: " : "truth of transition 1, body 1: ";
    CHECK_THROWS_WITH_AS(compare(data, truth(good)),
                         doctest::Contains((name + "expected finite numbers and an orientation").c_str()),
                         Error);
  }
  Eigen::MatrixXd guess = truth(good);
  guess(0, 1) = std::numeric_limits<double>::quiet_NaN();
  const Metrics m = compare(good, guess);
  CHECK(std::isnan(m.position));
  CHECK(std::isnan(m.relative_median[0]));
  CHECK(m.velocity == 0);
  CHECK(std::isnan(
      position_quartiles(ScenarioTransitions(good, 0), 0, guess, [](std::size_t) { return true; }).median));
}

TEST_CASE("predictions may be any matrix: a block of rows, rows first, in floats") {
  const ScenarioData data = at_rest(2);
  Eigen::MatrixXd guess = truth(data);
  guess(0, 0) += 3, guess(13, 1) -= 1;
  const double position = compare(data, guess).position;
  const auto all = [](std::size_t) { return true; };
  const ScenarioTransitions transitions(data, 0);
  const double median = position_quartiles(transitions, 0, guess, all).median;
  Eigen::MatrixXd larger = Eigen::MatrixXd::Constant(70, 2, 1e3);
  larger.topRows(65) = guess;
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows_first = guess;
  const auto check = [&](const auto& predicted) {
    CHECK(measure(transitions, 0, predicted, bodies).position == position);
    CHECK(position_quartiles(transitions, 0, predicted, all).median == median);
  };
  check(larger.topRows(65));
  check(rows_first);
  check(Eigen::MatrixXf(guess.cast<float>()));
}

TEST_CASE("transitions that are not there, and data whose parts do not fit together, are refused") {
  const auto refused = [](const auto& f, const char* what) {
    CHECK_THROWS_WITH_AS(f(), doctest::Contains(what), Error);
  };
  const Transitions<1> good{0.1, std::vector<Start<1>>(20), std::vector<SystemState<double, 1>>(20)};
  const ConstantVelocity predict{0.1};
  for (const auto& [first, count] : {std::pair{0, 40}, {-1, 5}, {21, 0}, {0, -1}, {15, 6}})
    refused([&, f = first, n = count] { (void)predict_all(good, f, n, predict); }, "expected some of 20");
  CHECK(predict_all(good, 20, 0, predict).cols() == 0);
  refused([&] { (void)one_by_one(good, 21, predict); }, "expected some of 20");
  const System<double, 1> world{{Body{Sphere{0.1}, 1.0}}};
  const Eigen::MatrixXd guess = predict_all(good, 0, 20, predict);
  Transitions<1> data = good;
  data.collided.resize(12);
  refused([&] { (void)measure(data, 0, guess, world); }, "impacts of transitions: expected 20");
  data = good;
  data.ends.pop_back();
  refused([&] { (void)measure(data, 0, guess, world); }, "ends of transitions: expected 20");
  refused([&] { (void)predict_all(data, 0, 20, predict); }, "ends of transitions: expected 20");

  const auto wrong = [&](const auto& change, const char* what) {
    ScenarioData scenarios = at_rest(2);
    change(scenarios);
    refused([&] { ScenarioTransitions(scenarios, 0); }, what);
  };
  wrong([](auto& d) { d.body_count[1] = 200; }, "bodies of scenario 1: expected 1 to 5, found 200");
  wrong([](auto& d) { d.body_count[0] = 0; }, "bodies of scenario 0");
  wrong([](auto& d) { d.body_count.pop_back(); }, "body counts: expected 2, found 1");
  wrong([](auto& d) { d.first_contact.pop_back(); }, "first contacts");
  wrong([](auto& d) { d.states.pop_back(); }, "lists of states");
  wrong([](auto& d) { d.states[0].conservativeResize(64, 2); }, "rows of states: expected 65, found 64");
  wrong([](auto& d) { d.initial.conservativeResize(65, 1); }, "initial states");
  wrong([](auto& d) { d.initial.resize(64, 2); }, "rows of initial states");
  wrong([](auto& d) { d.wrench.conservativeResize(30, 1); }, "wrenches");
  wrong([](auto& d) { d.wrench.resize(29, 2); }, "rows of wrenches");
}

TEST_CASE("mean squares are per component and over present bodies") {
  const ScenarioData data = at_rest(2);
  Eigen::MatrixXd guess = truth(data);
  guess(0, 0) += 3;       // body 0 of scenario 0
  guess(13 + 7, 1) += 6;  // body 1 of scenario 1
  guess(13 + 10, 1) -= 3;
  guess.bottomRows(26).setConstant(100);  // absent
  const Metrics m = compare(data, guess);
  CHECK(m.position == doctest::Approx(9.0 / 3 / 6));
  CHECK(m.velocity == doctest::Approx(36.0 / 3 / 6));
  CHECK(m.angular_velocity == doctest::Approx(9.0 / 3 / 6));
  CHECK(m.orientation == 0);
}

TEST_CASE("angles are in degrees, also small ones, whatever the quaternion's sign and length") {
  const ScenarioData data = at_rest(1);
  for (const double degrees : {1e-7, 0.5, 90.0, 179.0}) {
    const double half = degrees * std::numbers::pi / 360;
    Eigen::MatrixXd guess = truth(data);
    guess.col(0).segment<4>(3) << -2 * std::sin(half), 0, 0, -2 * std::cos(half);
    CHECK(compare(data, guess).angle == doctest::Approx(degrees / 3).epsilon(1e-8));  // of three bodies
  }
  Eigen::MatrixXd quarter = truth(data);
  quarter.col(0).segment<4>(3) << 0, std::sqrt(0.5), 0, std::sqrt(0.5);
  CHECK(compare(data, quarter).orientation == doctest::Approx((2 - std::sqrt(2.0)) / 4 / 3));
  quarter(3, 0) = std::numeric_limits<double>::quiet_NaN();
  CHECK(std::isnan(compare(data, quarter).angle));
}

TEST_CASE("relative errors: by norm, and element by element without the components that are zero") {
  const ScenarioData data = at_rest(1);
  Eigen::MatrixXd guess = truth(data);
  guess.col(0).segment<3>(0) += Eigen::Vector3d(0.3, 0.6, 0.6);  // truth (1, 2, 2): 30 %
  guess.col(0).segment<3>(13) += Eigen::Vector3d(0.1, 0, 0);
  const Metrics m = compare(data, guess);
  CHECK(m.relative[0] == doctest::Approx((0.3 + 0.1 / 3) / 3));
  CHECK(m.relative_median[0] == doctest::Approx(0.1 / 3));
  CHECK(m.elementwise[0] == doctest::Approx((3 * 0.3 + 0.1) / 9));
  guess(7, 0) = 1;  // truth has no velocity: nothing to divide by
  CHECK(compare(data, guess).elementwise[2] == 0);
}

TEST_CASE("the energy error is that of kinetic and potential energy, over truth's") {
  ScenarioData data = at_rest(1);
  Eigen::MatrixXd guess = truth(data);
  const double energy = 3 * 9.81 * mass * 2;
  guess(2, 0) += 0.5;
  CHECK(compare(data, guess).energy == doctest::Approx(9.81 * mass * 0.5 / energy));
  guess = truth(data);
  guess(13 + 8, 0) = 3;   // 1/2 m v^2 = 9
  guess(26 + 12, 0) = 2;  // 1/2 I_z w^2 = 0.6
  CHECK(compare(data, guess).energy == doctest::Approx((9 + 0.6) / energy));
}

TEST_CASE("r and the share within half a metre per second look at scenarios that had a contact") {
  ScenarioData data = at_rest(3);
  Eigen::MatrixXd guess = truth(data);
  CHECK(compare(data, guess).collided == 0);
  data.first_contact[1] = 0.1f;
  data.first_contact[2] = 0.5f;
  // Truth's components are 0, 1, ... 8 and the guess is a straight line of them: r = 1 at any slope.
  for (int i = 0; i < 9; ++i) {
    const int row = 13 * (i / 3) + 7 + i % 3;
    for (auto& states : data.states) states(row, 1) = static_cast<float>(i);
    guess(row, 1) = 0.9 * i + 0.2;  // off by 0.2 - 0.1 i: within 0.5 up to i = 7
    guess(row, 0) = 50;             // no contact: not looked at
    guess(row, 2) = -50;            // not yet
  }
  Metrics m = compare(data, guess);
  CHECK(m.collided == 3);
  CHECK(m.pearson == doctest::Approx(1));
  CHECK(m.within_half == doctest::Approx(8.0 / 9));
  CHECK(compare(data, guess, 1).collided == 6);
  // Nothing is said where either does not vary.
  for (int i = 0; i < 9; ++i) guess(13 * (i / 3) + 7 + i % 3, 1) = 0.3;
  CHECK(compare(data, guess).pearson == 0);
  guess(7, 1) = std::numeric_limits<double>::quiet_NaN();
  m = compare(data, guess);
  CHECK(std::isnan(m.pearson));
  CHECK(std::isnan(m.within_half));
  // (0, 1, 2) against (0, 2, 1), the others equal: the covariance over the deviations' product, by hand.
  for (int i = 0; i < 9; ++i) guess(13 * (i / 3) + 7 + i % 3, 1) = i;
  guess(8, 1) = 2, guess(9, 1) = 1;
  CHECK(compare(data, guess).pearson == doctest::Approx(59.0 / 60));
}

TEST_CASE("a first scenario counts from there") {
  ScenarioData data = at_rest(3);
  data.states[0](0, 2) = 4;
  CHECK(compare(data, truth(data).rightCols(1), 0, 2).position == 0);
  CHECK(compare(data, truth(data).rightCols(1), 0, 1).position == doctest::Approx(9.0 / 3 / 3));
}

TEST_CASE("quartiles are between neighbours, over those chosen") {
  const ScenarioData data = at_rest(6);
  Eigen::MatrixXd guess = truth(data);
  for (int c = 0; c < 6; ++c) guess(1, c) += 3 * std::sqrt(c);  // error per scenario: 9 c / 3 / 3 = c
  const Quartiles five =
      position_quartiles(ScenarioTransitions(data, 0), 0, guess, [](std::size_t s) { return s < 5; });
  CHECK(five.count == 5);
  CHECK(five.low == doctest::Approx(1));
  CHECK(five.median == doctest::Approx(2));
  CHECK(five.high == doctest::Approx(3));
  const Quartiles all =
      position_quartiles(ScenarioTransitions(data, 0), 0, guess, [](std::size_t) { return true; });
  CHECK(all.low == doctest::Approx(1.25));
  CHECK(all.median == doctest::Approx(2.5));
  CHECK(position_quartiles(ScenarioTransitions(data, 0), 0, guess, [](std::size_t) { return false; }).count ==
        0);
}

TEST_CASE("methods are timed in turns") {
  std::string order;
  const auto call = [&](char name) { return TimedCall{[&order, name] { order += name; }, 10}; };
  const auto spreads = time_side_by_side({call('a'), call('b')}, 3, 0);
  CHECK(order ==
        "ababab"
        "ab");  // once to warm up, then three rounds
  REQUIRE(spreads.size() == 2);
  for (const Spread& s : spreads) {
    CHECK(s.low >= 0);
    CHECK(s.low <= s.median);
    CHECK(s.median <= s.high);
  }
  CHECK_THROWS_WITH_AS(time_side_by_side({call('a')}, 0), "rounds of timing: expected at least 1, found 0",
                       Error);
  CHECK_THROWS_AS(time_side_by_side({{{}, 1}}, 1), Error);
  CHECK_THROWS_AS(time_side_by_side({{[] {}, 0}}, 1), Error);
}

TEST_CASE("transitions of one's own world are measured with its masses and gravity") {
  const Vec3<double> gravity{0, 0.5, -1.62};
  const System<double, 3> world{
      {Body{Sphere{0.1}, 1.0}, Body{Box{0.1, 0.2, 0.3}, 3.0}, Body<double>::kinematic(Box{1.0, 1.0, 0.1})}};
  Transitions<3> data{0.1, std::vector<Start<3>>(4), std::vector<SystemState<double, 3>>(4)};
  for (auto& end : data.ends)
    for (int b = 0; b < 3; ++b) end[b].position = {0, 2, 1.0 + b};
  Eigen::MatrixXd guess = predict_all(data, 0, 4, ConstantVelocity{0.1});
  CHECK(guess.rows() == 39);
  CHECK(guess.col(1) == data.starts[1].state.vector());
  for (Eigen::Index c = 0; c < 4; ++c) guess.col(c) = data.ends[static_cast<std::size_t>(c)].vector();
  guess(13 + 2, 3) += 0.5;  // the box
  guess(26 + 7, 2) = 100;   // a kinematic body has no energy
  const double energy = 4 * (std::abs(-1.0 + 1.62) + 3 * std::abs(-1.0 + 2 * 1.62));
  CHECK(measure(data, 0, guess, world, gravity).energy == doctest::Approx(3 * 1.62 * 0.5 / energy));
  CHECK(measure(data, 0, guess, world, gravity).position == doctest::Approx(0.25 / 3 / 12));
  CHECK(measure(data, 0, guess, world, gravity).collided == 0);
  data.collided = {0, 0, 0, 1};
  CHECK(measure(data, 0, guess, world, gravity).collided == 3);
  CHECK(position_quartiles(data, 0, guess, [](std::size_t c) { return c == 3; }).median ==
        doctest::Approx(0.25 / 3 / 3));

  CHECK_THROWS_WITH_AS(measure(data, 1, guess, world),
                       "predictions: expected those of transitions 0 to 3, found 1 to 4", Error);
  CHECK_THROWS_WITH_AS(measure(data, 0, guess.topRows(26).eval(), world),
                       "rows of predictions: expected 13 for each of 3 bodies, found 26", Error);
}
