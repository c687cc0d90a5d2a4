#include <doctest/doctest.h>

#include <rbres/eval/train_predictor.hpp>
#include <rbres/paper/paper.hpp>

#include "../examples/common/count_allocations.hpp"
#include "predict_states.hpp"

using namespace rbres;

namespace {

using Small = Predictor<ResidualNetwork<float, 95, 16, 1, 65>, 5>;
using State = Small::State;

static_assert(noexcept(std::declval<const Small&>().predict(std::declval<const State&>(), Small::Wrenches{},
                                                            4)));
static_assert(noexcept(std::declval<const Small&>().rollout(State{}, Small::Wrenches{},
                                                            std::declval<std::array<State, 2>&>())));

FreeFlow<5> flow() {
  FreeFlow<5> f{System<double, 5>::of(Body{Box{0.2, 0.1, 0.15}, 2.0})};
  f.damping = {0.1, 0.1};
  return f;
}

Small predictor(Target target) {
  Small p{Small::Network(7), {}, {}, flow(), target, 0.3};
  Random random(8);
  for (float& x : p.input.mean.reshaped()) x = static_cast<float>(random.normal());
  for (float& x : p.output.mean.reshaped()) x = static_cast<float>(random.normal());
  p.input.deviation.setConstant(2);
  p.output.deviation.setConstant(0.5f);
  return p;
}

Small::Wrenches random_wrenches() {
  Random random(9);
  Small::Wrenches w;
  for (auto& one : w) one = {{random.normal(), random.normal(), random.normal()}, {0.1, -0.1, 0.2}};
  return w;
}

}  // namespace

TEST_CASE("a prediction allocates nothing and has unit quaternions") {
  for (const Target target : {Target::state, Target::residual}) {
    const Small p = predictor(target);
    const State y = random_state<State>(1);
    const auto w = random_wrenches();
    std::array<State, 4> states;
    const long before = allocations;
    State next = p.predict(y, w, 4);
    p.rollout(y, w, states);
    CHECK(allocations == before);
    for (const auto& body : next.body)
      CHECK(squared_norm(body.orientation) == doctest::Approx(1).epsilon(1e-12));
    CHECK(allocations > 0);  // they are counted
  }
}

TEST_CASE("absent bodies stay as they are and change nothing") {
  for (const Target target : {Target::state, Target::residual}) {
    const Small p = predictor(target);
    State y = random_state<State>(2);
    const auto w = random_wrenches();
    const State next = p.predict(y, w, 3);
    CHECK(next[3] == y[3]);
    CHECK(next[4] == y[4]);
    y[4] = random_state<State>(3)[0];
    const State again = p.predict(y, w, 3);
    for (int b = 0; b < 3; ++b) CHECK(again[b] == next[b]);
    CHECK_FALSE(p.predict(y, w, 5)[0] == next[0]);
  }
}

TEST_CASE("a number of bodies that cannot be present is the nearest, and refused where many are predicted") {
  const Small p = predictor(Target::residual);
  const State y = random_state<State>(1);
  const Small::Wrenches w = random_wrenches();
  for (const int present : {6, 300, std::numeric_limits<int>::max()})
    CHECK(p.predict(y, w, present) == p.predict(y, w));
  for (const int present : {-1, -300, std::numeric_limits<int>::min()})
    CHECK(p.predict(y, w, present) == p.predict(y, w, 0));
  CHECK(p.predict(y, w, 0) == y);
  Small::Batch batch(1);
  std::vector<State> next{y};
  const std::vector<Small::Wrenches> wrenches{w};
  for (const int present : {-1, 6}) {
    CHECK_THROWS_WITH_AS(p.predict(y, wrenches, next, batch, present),
                         detail::text("bodies present: expected 0 to 5, found ", present).c_str(), Error);
    CHECK(next[0] == y);
  }
}

TEST_CASE("a flow that is not finite is not trained on") {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), HUGE_VAL}) {
    Small p = predictor(Target::residual);
    p.flow.gravity.g.z = bad;
    const double horizon = p.horizon;
    Transitions<5> data{0.5, std::vector<Start<5>>(2), std::vector<State>(2), {}};
    CHECK_THROWS_WITH_AS(
        (TrainingSet<Small>(p, data, 0, 2)),
        detail::text("forces of the predictor's flow: expected finite numbers, found ", bad).c_str(), Error);
    CHECK(p.horizon == horizon);
  }
}

TEST_CASE("a residual network that says nothing gives the contact-free flow") {
  Small p = predictor(Target::residual);
  std::fill(p.network.parameters().begin(), p.network.parameters().end(), 0.0f);
  p.output.mean.setZero();
  const State y = random_state<State>(4);
  const auto w = random_wrenches();
  const State flown = flow()(y, w, 0.3), predicted = p.predict(y, w);
  CHECK((predicted.vector() - flown.vector()).cwiseAbs().maxCoeff() < 1e-15);
  p.target = Target::state;
  CHECK((p.predict(y, w).vector() - flown.vector()).norm() > 1);
}

TEST_CASE("what the network is to say, decoded, is the truth") {
  for (const Target target : {Target::state, Target::residual}) {
    const Small p = predictor(target);
    const State y = random_state<State>(5);
    const State truth = random_state<State>(6);
    const auto w = random_wrenches();
    const auto said = p.wanted(y, w, truth, 5);
    const State decoded = p.decode(y, w, p.output.normalize(said.cast<float>()), 5);
    for (int b = 0; b < 5; ++b) {
      const double cosine = decoded[b].vector().segment<4>(3).dot(truth[b].vector().segment<4>(3));
      CHECK(std::abs(cosine) == doctest::Approx(1).epsilon(1e-6));
      CHECK(norm(decoded[b].position - truth[b].position) < 1e-5);
      CHECK(norm(decoded[b].velocity - truth[b].velocity) < 1e-5);
    }
    // The same from either quaternion of truth, and of the start.
    CHECK(p.wanted(y, w, turned(truth), 5) == said);
    CHECK(p.encode(turned(y), w, 5) == p.encode(y, w, 5));
  }
}

TEST_CASE("a rollout is prediction after prediction") {
  const Small p = predictor(Target::residual);
  State y = random_state<State>(7);
  const auto w = random_wrenches();
  std::array<State, 5> states;
  p.rollout(y, w, states, 4);
  for (const State& state : states) CHECK(state == (y = p.predict(y, w, 4)));
}

TEST_CASE("many predictions at once are those one by one, and allocate nothing") {
  constexpr std::size_t n = 21;  // no whole number of registers
  Small::Batch batch(n);
  for (const Target target : {Target::state, Target::residual}) {
    for (const int present : {5, 3}) {
      const Small p = predictor(target);
      std::vector<State> states, next(n);
      std::vector<Small::Wrenches> wrenches;
      for (std::size_t i = 0; i < n; ++i) {
        states.push_back(random_state<State>(i));
        wrenches.push_back(random_wrenches());
        wrenches.back()[1].force.x = 0.1 * static_cast<double>(i);
      }
      const auto check = [&](std::size_t i, const State& from) {
        const State expected = p.predict(from, wrenches[i], present);
        CHECK((next[i].vector() - expected.vector()).norm() < 1e-5);
        for (int b = present; b < 5; ++b) CHECK(next[i][b] == from[b]);
      };
      const long before = allocations;
      p.predict(states, wrenches, next, batch, present);
      CHECK(allocations == before);
      for (std::size_t i = 0; i < n; ++i) check(i, states[i]);
      p.predict(states[0], wrenches, next, batch, present);
      for (std::size_t i = 0; i < n; ++i) check(i, states[0]);
      next = states;  // in place
      p.predict(next, wrenches, next, batch, present);
      for (std::size_t i = 0; i < n; ++i) check(i, states[i]);
      p.predict(std::span(states).first(0), std::span(wrenches).first(0), std::span(next).first(0), batch);
    }
  }
  const Small p = predictor(Target::residual);
  std::vector<State> states(22), next(22);
  std::vector<Small::Wrenches> wrenches(22);
  CHECK_THROWS_AS(p.predict(states, wrenches, next, batch), Error);
  CHECK_THROWS_AS(p.predict(std::span(states).first(3), wrenches, std::span(next).first(4), batch), Error);
  CHECK_THROWS_AS(p.predict(states[0], std::span(wrenches).first(3), std::span(next).first(4), batch), Error);
  CHECK_THROWS_AS(Small::Batch(0), Error);
  CHECK_THROWS_WITH_AS(
      p.predict(std::span(next).first(9), std::span(wrenches).first(9), std::span(next).subspan(1, 9), batch),
      doctest::Contains("room for predictions"), Error);
  states[0] = random_state<State>(3);
  const State expected = p.predict(states[0], wrenches[0]);
  p.predict(states[0], std::span(wrenches).first(9), std::span(states).first(9), batch);
  for (std::size_t i = 0; i < 9; ++i) CHECK((states[i].vector() - expected.vector()).norm() < 1e-5);
}

namespace {

/// Made-up columns of 3 to 5 bodies.
ScenarioData made_up(Eigen::Index n) {
  Random random(10);
  ScenarioData data{{0.1, 0.3},
                    ScenarioData::Columns::Zero(65, n),
                    ScenarioData::Columns::Zero(30, n),
                    {2, ScenarioData::Columns::Zero(65, n)},
                    std::vector<std::uint8_t>(static_cast<std::size_t>(n)),
                    {},
                    {},
                    {}};
  for (Eigen::Index c = 0; c < n; ++c) {
    const int bodies = 3 + static_cast<int>(c % 3);
    data.body_count[static_cast<std::size_t>(c)] = static_cast<std::uint8_t>(bodies);
    for (auto* columns : {&data.initial, &data.wrench, &data.states[0], &data.states[1]})
      for (float& x : columns->col(c).head(columns->rows() / 5 * bodies))
        x = static_cast<float>(random.normal());
  }
  return data;
}

}  // namespace

TEST_CASE("the normalisation comes from the training columns alone") {
  const Eigen::Index n = 30, first_train = 6;
  ScenarioData data = made_up(n);
  Small p = predictor(Target::state);
  const TrainingSet<Small> set(p, ScenarioTransitions(data, 1), first_train, n);
  CHECK(p.horizon == 0.3);
  const Small fitted = p;

  const auto train = set.samples(first_train, n - first_train);
  for (Eigen::Index r = 0; r < 95; ++r) {
    double sum = 0, squares = 0, count = 0;
    for (Eigen::Index c = 0; c < train.count(); ++c) {
      if (r >= 19 * data.body_count[static_cast<std::size_t>(first_train + c)]) continue;
      sum += train.inputs(r, c), squares += train.inputs(r, c) * train.inputs(r, c), ++count;
    }
    CHECK(sum / count == doctest::Approx(0).epsilon(1e-4));
    CHECK(squares / count == doctest::Approx(1).epsilon(1e-4));
  }

  for (auto* columns : {&data.initial, &data.wrench, &data.states[1]})
    columns->leftCols(first_train) = 3 * columns->leftCols(first_train).array() + 1;
  const TrainingSet<Small> other_tests(p, ScenarioTransitions(data, 1), first_train, n);
  CHECK(p.input.mean == fitted.input.mean);
  CHECK(p.input.deviation == fitted.input.deviation);
  CHECK(p.output.mean == fitted.output.mean);
  CHECK(p.output.deviation == fitted.output.deviation);
  data.states[1].col(first_train)[0] += 1;
  const TrainingSet<Small> other_training(p, ScenarioTransitions(data, 1), first_train, n);
  CHECK_FALSE(p.output.mean == fitted.output.mean);
}

TEST_CASE("samples are encoded, normalised, and without weight where a body is absent") {
  const ScenarioData data = made_up(12);
  Small p = predictor(Target::residual);
  const TrainingSet<Small> set(p, ScenarioTransitions(data, 0), 4, 12);
  for (const auto& [first, count] : {std::pair{0, 13}, {-1, 2}, {12, 1}, {13, 0}, {0, -1}})
    CHECK_THROWS_AS(set.samples(first, count), Error);
  CHECK(set.samples(12, 0).count() == 0);
  const auto samples = set.samples(0, 12);
  for (Eigen::Index c = 0; c < 12; ++c) {
    const int present = data.body_count[static_cast<std::size_t>(c)];
    const auto y = state_of(data.initial, c, present);
    const auto w = wrench_of(data, c);
    CHECK(samples.inputs.col(c) == p.encode(y, w, present));
    CHECK(samples.inputs.col(c).tail(19 * (5 - present)).isZero(0));
    const auto said = p.wanted(y, w, state_of(data.states[0], c, present), present);
    CHECK(samples.targets.col(c).head(13 * present) ==
          p.output.normalize(said.cast<float>()).head(13 * present));
    CHECK(samples.targets.col(c).tail(13 * (5 - present)).isZero(0));
    CHECK(samples.weights.col(c).sum() == 13 * present);
    CHECK(samples.weights.col(c).head(13 * present).isOnes(0));
  }
  CHECK_THROWS_AS(ScenarioTransitions(data, 2), Error);
  CHECK_THROWS_AS((TrainingSet<Small>(p, ScenarioTransitions(data, 0), 12, 12)), Error);
  CHECK_THROWS_AS((TrainingSet<Small>(p, ScenarioTransitions(data, 0), 4, 13)), Error);
  for (const float bad : {std::nanf(""), 1e30f}) {
    ScenarioData broken = data;
    broken.states[0](3, 1) = bad;  // of a scenario that only tests
    CHECK_THROWS_WITH_AS((TrainingSet<Small>(p, ScenarioTransitions(broken, 0), 4, 12)),
                         doctest::Contains("transition 1: state: number 3: expected a finite one"), Error);
    TrainingSet<Small>(p, ScenarioTransitions(broken, 1), 4, 12);
  }
}

TEST_CASE("what no transition varies is not left to what the network says of it") {
  Transitions<2> data{0.1, {}, {}};
  for (std::size_t i = 0; i < 20; ++i) {
    Random random(4, i);
    Start<2> start;
    SystemState<double, 2> end;
    for (int b = 0; b < 2; ++b) {
      end[b].position = {random.normal(), 1e-7 * random.normal(), 0.05};
      end[b].velocity = {2, random.normal(), 0};
    }
    data.starts.push_back(start);
    data.ends.push_back(end);
  }
  using Net = Network<float, Sequential<Linear<38, 26>>>;
  Predictor<Net, 2> p{Net(1), {}, {}, {System<double, 2>::of(Body{Sphere{0.1}, 1.0})}, Target::state};
  const TrainingSet<Predictor<Net, 2>> set(p, data, 0, 20);
  const auto& deviation = p.output.deviation;
  for (const int body : {0, 13}) {
    CHECK(deviation[body] > 0.5f);
    const float most = std::max(deviation[0], deviation[13]);
    for (const int i : {1, 2}) CHECK(deviation[body + i] == doctest::Approx(most / 1000));
    for (const int i : {3, 4, 5, 6, 10, 11, 12}) CHECK(deviation[body + i] == 1e-6f);
    CHECK(deviation[body + 7] == doctest::Approx(std::max(deviation[8], deviation[21]) / 1000));
  }
  CHECK(p.input.deviation == decltype(p.input.deviation)::Ones());  // another start stays of its size
  auto said = Net::Output::Constant(0.1f).eval();
  CHECK(std::abs(p.decode(data.starts[0].state, {}, said, 2)[0].position.z - 0.05) < 2e-4);
}

TEST_CASE("transitions of one's own world train a predictor") {
  const Material<double> rubber{.restitution = 0.9, .friction = 0.2};
  const System<double, 2, Sphere<double>> world{
      {Body{Sphere{0.1}, 1.0, rubber}, Body{Sphere{0.2}, 3.0, rubber}}, {floor_plane(rubber)}};
  const auto start = [](std::ptrdiff_t i) {
    Random random(3, static_cast<std::uint64_t>(i));
    Start<2> s;
    s.state[0].position = {random.uniform(-0.2, 0.2), 0, random.uniform(0.1, 0.12)};
    s.state[0].velocity.z = random.uniform(-3, -1);
    s.state[1].position = {1, 0, random.uniform(0.2, 0.3)};
    s.state[0].orientation = {0, 0, 0, 1 + 1e-4};  // made unit
    s.wrench[1].force.x = random.uniform(-3, 3);
    return s;
  };
  const SimulationOptions options{.step = 4e-3, .duration = 0.1};
  const auto data = simulate_transitions(world, Gravity{}, Rk4{}, 700, start, options, 1);
  CHECK(data.horizon == 0.1);
  CHECK(simulate_transitions(world, Gravity{}, Rk4{}, 700, start, options, 3).ends == data.ends);
  for (std::size_t i = 0; i < 700; i += 50) {
    auto y = data.starts[i].state;
    CHECK(y[0].orientation.w == 1);
    simulate(world, y, Forces{Gravity{}, ConstantWrench<double, 2>{data.starts[i].wrench}}, Rk4{}, options);
    CHECK((y.vector() - data.ends[i].vector()).norm() < 1e-9);
  }

  using Net = Network<float, Sequential<Linear<38, 24>, Relu, Linear<24, 26>>>;
  Predictor<Net, 2> p{Net(1), {}, {}, {world, Gravity{}, {.density = 0}}};
  const auto error = [&](const auto& predict) {
    double sum = 0;
    for (std::size_t i = 0; i < 70; ++i)  // those that do not train
      sum += squared_norm(predict(data.starts[i]).body[0].position - data.ends[i][0].position);
    return sum;
  };
  const double flow = error([&](const auto& s) { return p.flow(s.state, s.wrench, 0.1); });
  const auto progress = train_predictor(p, data, {.epochs = 60, .batch_size = 16, .l2 = 0});
  CHECK(progress.epoch == 60);
  CHECK(p.horizon == 0.1);
  CHECK(error([&](const auto& s) { return p.predict(s.state, s.wrench); }) < 0.05 * flow);

  auto short_of_ends = data;
  short_of_ends.ends.pop_back();
  CHECK_THROWS_WITH_AS(train_predictor(p, short_of_ends),
                       "ends of transitions: expected 700, as many as starts, found 699", Error);
  CHECK_THROWS_AS(train_predictor(p, {0.1, {9, data.starts[0]}, {9, data.ends[0]}}), Error);
  CHECK_THROWS_AS(train_predictor(p, {0, data.starts, data.ends}), Error);
  CHECK_THROWS_WITH_AS(train_predictor(p, {4000, data.starts, data.ends}), doctest::Contains("horizon"),
                       Error);
  CHECK_THROWS_AS(simulate_transitions(world, Gravity{}, Rk4{}, 0, start, options), Error);
  auto long_quaternion = data;
  long_quaternion.ends[3][1].orientation = {0, 0, 0, 5};
  CHECK_THROWS_WITH_AS(
      train_predictor(p, long_quaternion),
      "transition 3, end, body 1: orientation: expected a unit quaternion, found one of length 5", Error);
  // A predictor that could not be trained is as it was.
  const double mean = p.input.mean[0];
  CHECK_THROWS_AS(train_predictor(p, {0.05, data.starts, data.ends}, {.threads = -1}), Error);
  CHECK_THROWS_AS(train_predictor(p, {0.05, data.starts, data.ends}, {.epochs = -1}), Error);
  CHECK(p.horizon == 0.1);
  CHECK(p.input.mean[0] == mean);
  const auto refused = [&](const char* what, const auto& change) {
    const auto changed = [&](std::ptrdiff_t i) {
      Start<2> s = start(i);
      if (i == 2) change(s);
      return s;
    };
    CHECK_THROWS_WITH_AS(simulate_transitions(world, Gravity{}, Rk4{}, 4, changed, options), what, Error);
  };
  refused("start 2: wrench of body 1: expected finite numbers, found nan",
          [](Start<2>& s) { s.wrench[1].torque.y = NAN; });
  refused("start 2: body 0, orientation: expected a unit quaternion, found one of length 3",
          [](Start<2>& s) { s.state[0].orientation.w = 3; });
  const Gravity<double> endless{{0, 0, 1e308}};
  CHECK_THROWS_WITH_AS(simulate_transitions(world, endless, Rk4{}, 3, start, options),
                       doctest::Contains("expected finite numbers"), Error);
}

TEST_CASE("the contact-free flow of many is that of each") {
  const auto f = flow();
  std::vector<State> states;
  for (std::size_t i = 0; i < 11; ++i) states.push_back(random_state<State>(i));
  const auto w = random_wrenches();
  for (const double duration : {0.0, 0.31}) {
    int calls = 0;
    f.each(
        11, [&](std::ptrdiff_t i) { return states[static_cast<std::size_t>(i)]; },
        [&](std::ptrdiff_t) { return w; }, duration,
        [&](std::ptrdiff_t i, const State& y) {
          CHECK(i == calls++);
          CHECK((y.vector() - f(states[static_cast<std::size_t>(i)], w, duration).vector()).norm() < 1e-12);
        });
    CHECK(calls == 11);
  }
  f.each(
      1, [&](std::ptrdiff_t) { return states[0]; }, [&](std::ptrdiff_t) { return w; }, -1,
      [&](std::ptrdiff_t, const State& y) { CHECK(y.vector().hasNaN()); });
}

TEST_CASE("the contact-free flow of bodies of any kinds is that of each alone") {
  Eigen::Matrix3d tensor;
  tensor << 0.03, 0.002, 0, 0.002, 0.02, 0.001, 0, 0.001, 0.04;
  const std::array<Body<double>, 5> bodies{
      Body{Sphere{0.1}, 1.0}, Body<double>(Box{0.2, 0.1, 0.15}, 2.0), Body{Capsule{0.1, 0.2}, 3.0},
      Body<double>(Box{0.3, 0.2, 0.1}, 1.5, tensor), Body<double>::kinematic(Box{1.0, 1.0, 0.1})};
  const State start = random_state<State>(3);
  const auto w = random_wrenches();
  // Each resistance alone, with others, and none.
  const std::array<FluidFriction<double>, 2> fluids{{{.density = 0}, {.density = 50}}};
  const std::array<Damping<double>, 4> dampings{{{0, 0}, {0.1, 0}, {0, 0.2}, {0.1, 0.2}}};
  for (int k = 0; k < 8; ++k) {
    CAPTURE(k);
    const FluidFriction<double>& fluid = fluids[std::size_t(k / 4)];
    const Damping<double>& damping = dampings[std::size_t(k % 4)];
    const FreeFlow<5> all{System<double, 5>(bodies), Gravity{}, fluid, damping};
    const State together = all(start, w, 0.31);
    for (int b = 0; b < 5; ++b) {
      CAPTURE(b);
      const FreeFlow<1> flow{System<double, 1>({bodies[static_cast<std::size_t>(b)]}), Gravity{}, fluid,
                             damping};
      const std::array own{w[static_cast<std::size_t>(b)]};
      const SystemState<double, 1> from{{start[b]}};
      const auto alone = flow(from, own, 0.31);
      CHECK((alone[0].vector() - together[b].vector()).norm() < 1e-12);
      auto flown = from;
      const Forces forces{Gravity{}, fluid, damping, ConstantWrench<double, 1>{own}};
      for (int step = 0; step < 16; ++step) flown = fly(flow.system, forces, Rk4{}, flown, 0.0, 0.31 / 16);
      CHECK((flown.vector() - alone.vector()).norm() < 1e-12);
    }
  }
}

TEST_CASE("the contact-free flow ends for any horizon") {
  const FreeFlow<1> flow{System<double, 1>({Body<double, AnyShape<double>>(Sphere<double>{0.1}, 1.0)})};
  const std::array<Wrench<double>, 1> wrench{};
  SystemState<double, 1> start;
  start[0].velocity = {1, 2, 3};
  for (const double duration : {5e9, 3600.1, 1e300, std::numeric_limits<double>::infinity(),
                                std::numeric_limits<double>::quiet_NaN(), -1.0}) {
    CAPTURE(duration);
    CHECK(flow(start, wrench, duration).vector().array().isNaN().all());
  }
  CHECK(flow(start, wrench, 0) == start);
  CHECK(flow(start, wrench, FreeFlow<1>::longest).vector().allFinite());
}
