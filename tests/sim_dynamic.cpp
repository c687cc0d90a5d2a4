// Systems whose number of bodies is known when the program runs: the same bits as those of a fixed number.
#include <doctest/doctest.h>

#include <rbres/rbres.hpp>
#include <variant>

#include "../examples/common/count_allocations.hpp"
#include "error_of.hpp"

using namespace rbres;

namespace {

constexpr std::array modes{ContactMode::continuous, ContactMode::discrete};

/// Bodies of a shape, all different, in a room in which they meet often.
template <class S, class Shape, int N>
struct Crowd {
  using Fixed = System<S, N, Shape>;
  using Free = System<S, dynamic, Shape>;

  static Body<S, Shape> body(int i) {
    const S size = as<S>(0.06 + 0.005 * (i % 5)), mass = as<S>(0.5 + 0.25 * (i % 4));
    const Material<S> material{as<S>(0.3 * (i % 3)), as<S>(0.2 * (i % 4))};
    if constexpr (std::is_same_v<Shape, Sphere<S>>) {
      return {Sphere<S>(size), mass, material};
    } else {
      if (i % 3 == 0) return {Sphere<S>(size), mass, material};
      if (i % 3 == 1) return {Box<S>(size, as<S>(0.05), as<S>(0.08)), mass, material};
      return {Capsule<S>(as<S>(0.04), size), mass, material};
    }
  }
  static std::vector<Plane<S>> walls() { return room<S>(as<S>(0.5), as<S>(3), {as<S>(0.6), as<S>(0.3)}); }
  static std::vector<Body<S, Shape>> bodies() {
    std::vector<Body<S, Shape>> all;
    for (int i = 0; i < N; ++i) all.push_back(body(i));
    return all;
  }
  static Fixed fixed() {
    return [&]<std::size_t... I>(std::index_sequence<I...>) { return Fixed({body(int(I))...}, walls()); }
    (std::make_index_sequence<std::size_t(N)>{});
  }
  static Free free() { return {bodies(), walls()}; }
  static RigidState<S> start(int i) {
    RigidState<S> y;
    y.position = {as<S>(0.3 * (i % 3) - 0.3), as<S>(0.3 * (i / 3 % 3) - 0.3), as<S>(0.25 + 0.3 * (i / 9))};
    y.orientation = normalized(Quat<S>{as<S>(0.1 * i), as<S>(0.3), as<S>(-0.2), as<S>(0.9)});
    y.velocity = {as<S>(1.5 - 0.7 * (i % 4)), as<S>(0.4 * (i % 3) - 0.5), as<S>(-1)};
    y.angular_velocity = {as<S>(1), as<S>(2.0 - i), as<S>(-3)};
    return y;
  }
  template <class State>
  static void set(State& y) {
    for (int i = 0; i < N; ++i) y[i] = start(i);
  }
};

template <class State, class Other>
bool same_bits(const State& a, const Other& b) {
  return std::equal(a.body.begin(), a.body.end(), b.body.begin(), b.body.end());
}

/// Whether both take the same bits to the same bits, and how many impacts or touches there were.
template <class S, class Shape, int N, class Forces>
long check_same(const Forces& forces, ContactMode mode, double seconds) {
  using World = Crowd<S, Shape, N>;
  const auto fixed = World::fixed();
  const auto free = World::free();
  typename World::Fixed::State a;
  typename World::Free::State b{std::vector<RigidState<S>>(N)};
  World::set(a);
  World::set(b);
  const SimulationOptions options{.step = 4e-3, .duration = seconds, .contacts = mode};
  const auto ran = simulate(fixed, a, forces, Rk4{}, options);
  const auto report = simulate(free, b, forces, Rk4{}, options);
  CHECK(same_bits(a, b));
  CHECK(report.steps == ran.steps);
  CHECK(report.impacts == ran.impacts);
  CHECK(report.touching == ran.touching);
  CHECK(report.overruns == ran.overruns);
  const Vec3<double> g{0, 0, -9.81};
  CHECK(energy(free, b, g) == energy(fixed, a, g));
  CHECK(linear_momentum(free, b) == linear_momentum(fixed, a));
  CHECK(angular_momentum(free, b) == angular_momentum(fixed, a));
  return ran.impacts;
}

/// Notes all impacts, when they are and what they do.
struct Listener {
  std::vector<double> heard;

  template <class State>
  void impact(double time, const State& before, const State& after) {
    heard.push_back(time);
    for (const State* y : {&before, &after}) {
      for (const auto& body : y->body) {
        for (Eigen::Index k = 0; k < 13; ++k) heard.push_back(body.vector()(k));
      }
    }
  }
};

}  // namespace

TEST_CASE_TEMPLATE("bodies move to the same bits in both modes", Shape, Sphere<double>, AnyShape<double>,
                   Sphere<float>) {
  using S = std::conditional_t<std::is_same_v<Shape, Sphere<float>>, float, double>;
  for (const auto mode : modes) CHECK(check_same<S, Shape, 7>(Gravity{}, mode, 0.6) > 5);
}

TEST_CASE("one body alone moves to the same bits") {
  for (const auto mode : modes) CHECK(check_same<double, Sphere<double>, 1>(Gravity{}, mode, 0.6) > 0);
}

TEST_CASE("as many bodies as are no crowd move to the same bits, and more with discrete contacts") {
  for (const auto mode : modes) CHECK(check_same<double, AnyShape<double>, 12>(Gravity{}, mode, 0.4) > 10);
  CHECK(check_same<double, AnyShape<double>, 20>(Gravity{}, ContactMode::discrete, 0.4) > 20);
}

TEST_CASE("forces between bodies give the same bits") {
  const auto attract = [](const auto& system, const auto& y, int i, double) requires requires {
    y[0];
    system.planes();
  }
  {
    Wrench<double> wrench;
    for (int j = 0; j < system.size(); ++j) wrench.force += 2.0 * (y[j].position - y[i].position);
    return wrench;
  };
  for (const auto mode : modes) {
    CHECK(check_same<double, Sphere<double>, 4>(attract, mode, 0.5) > 0);
  }
}

TEST_CASE("lanes give the bits of single runs") {
  using World = Crowd<double, Sphere<double>, 5>;
  for (const auto mode : modes) {
    const auto free = World::free();
    const SimulationOptions options{.step = 4e-3, .duration = 0.5, .contacts = mode};
    const auto start = [](std::ptrdiff_t scenario) {
      World::Free::State y{std::vector<RigidState<double>>(5)};
      World::set(y);
      y[2].velocity.x += 0.3 * double(scenario);
      return y;
    };
    std::vector<World::Free::State> ends(3);
    simulate_batch<Pack<double, 4>>(
        free, 3, start, [](const auto&) { return Gravity{}; }, Rk4{}, options,
        [&](const auto& sample) { ends[std::size_t(sample.scenario)] = sample.state; });
    for (int scenario = 0; scenario < 3; ++scenario) {
      auto y = start(scenario);
      simulate(free, y, Gravity{}, Rk4{}, options);
      for (int i = 0; i < 5; ++i)
        CHECK((ends[std::size_t(scenario)][i].vector() - y[i].vector()).cwiseAbs().maxCoeff() < 1e-8);
    }
  }
}

TEST_CASE("a step allocates nothing") {
  using World = Crowd<double, AnyShape<double>, 20>;
  for (const auto mode : modes) {
    const auto free = World::free();
    World::Free::State y{std::vector<RigidState<double>>(20)};
    World::set(y);
    Stepper stepper(free, Gravity{}, Rk4{}, SimulationOptions{.contacts = mode});
    const long before = allocations;
    for (int i = 0; i < 500; ++i) stepper.step(y, 2e-3 * i, 2e-3);
    CHECK(allocations == before);
    CHECK(stepper.tally().impacts > 20);
  }
}

TEST_CASE("a copy of a stepper goes on to the same bits, and so does one that is assigned") {
  using World = Crowd<double, AnyShape<double>, 6>;
  const auto free = World::free();
  for (const auto mode : modes) {
    World::Free::State y{std::vector<RigidState<double>>(6)};
    World::set(y);
    const SimulationOptions options{.contacts = mode};
    Stepper first(free, Gravity{}, Rk4{}, options), assigned(free, Gravity{}, Rk4{}, options);
    for (int i = 0; i < 300; ++i) first.step(y, 0.0, 2e-3);
    auto copy = first;
    assigned = first;
    auto by_copy = y, by_assigned = y;
    for (int i = 0; i < 300; ++i) {
      first.step(y, 0.0, 2e-3);
      copy.step(by_copy, 0.0, 2e-3);
      assigned.step(by_assigned, 0.0, 2e-3);
    }
    CHECK(by_copy == y);
    CHECK(by_assigned == y);
  }
}

TEST_CASE("an observer hears of the same impacts") {
  using World = Crowd<double, Sphere<double>, 5>;
  Listener by_fixed, by_free;
  World::Fixed::State a;
  World::Free::State b{std::vector<RigidState<double>>(5)};
  World::set(a);
  World::set(b);
  const SimulationOptions options{.step = 4e-3, .duration = 0.5};
  simulate(World::fixed(), a, Gravity{}, Rk4{}, options, by_fixed);
  simulate(World::free(), b, Gravity{}, Rk4{}, options, by_free);
  CHECK(by_fixed.heard.size() > 100);
  CHECK(by_fixed.heard == by_free.heard);
}

TEST_CASE("a crowd may have as many events in a step for each 12 bodies as others for all") {
  using World = System<double, dynamic, Sphere<double>>;
  constexpr int count = 48;
  const World world(std::vector(count, Body<double, Sphere<double>>{Sphere{0.1}, 1.0, {0.5, 0.0}}),
                    {floor_plane<double>()});
  World::State y;
  for (int i = 0; i < count; ++i) {
    RigidState<double> ball;
    ball.position = {0.5 * i, 0, 0.1 + 0.001 * (i + 1)};
    ball.velocity = {0, 0, -1};
    y.body.push_back(ball);
  }
  int heard = 0;
  const auto overruns = [&](int events) {
    heard = 0;
    World::State end = y;
    struct {
      int* heard;
      void operator()(double, const World::State&) const {}
      void impact(double, const World::State&, const World::State&) { ++*heard; }
    } observer{&heard};  // which keeps all bodies at one time
    return simulate(world, end, Gravity<double>{{0, 0, 0}}, Rk4{},
                    {.step = 0.05, .duration = 0.05, .max_events = events}, observer)
        .overruns;
  };
  // Each impact is one event, and the way to it another.
  CHECK(overruns(25) == 0);
  CHECK(heard == count);
  CHECK(overruns(23) == 1);
}

TEST_CASE("kinematic bodies and pairs without contact are as in a system of a fixed number") {
  using One = Body<double>;
  const std::vector<One> bodies{One::kinematic(Box{0.5, 0.5, 0.1}), {Sphere{0.1}, 1.0}, {Sphere{0.1}, 1.0}};
  const System<double, dynamic> world(bodies, {floor_plane<double>()}, {{0, 2}});
  SystemState<double, dynamic> y{std::vector<RigidState<double>>(3)};
  y[0].position = {0, 0, 1};
  y[1].position = {0.2, 0, 1.3};
  y[2].position = {-0.2, 0, 1.3};
  simulate(world, y, Gravity{}, Rk4{}, {.duration = 3});
  CHECK(y[1].position.z == doctest::Approx(1.2).epsilon(1e-4));
  CHECK(y[2].position.z < 0.9);
  CHECK(world.collides(0, 1));
  CHECK(!world.collides(0, 2));
  CHECK(!world.collides(-1, 0));
}

TEST_CASE("systems are made in the same ways") {
  using Balls = System<double, dynamic, Sphere<double>>;
  const auto balls = Balls::of(3, {Sphere{0.1}, 2.0}, {floor_plane<double>()});
  CHECK(balls.size() == 3);
  CHECK(System<double, 4>::of({Sphere{0.1}, 2.0}).size() == 4);
  const System<double, dynamic> any = balls;
  CHECK(any.size() == 3);
  CHECK(any[2].mass() == 2.0);
  CHECK(any.planes().size() == 1);
  const auto narrow = any.cast<float>();
  CHECK(narrow.size() == 3);
  CHECK(narrow[1].mass() == 2.0f);
  SystemState<double, dynamic> y{{{{1, 2, 3}, {}, {}, {}}, {{4, 5, 6}, {}, {}, {7, 8, 9}}}};
  CHECK(y.size() == 2);
  CHECK(y.vector().size() == 26);
  CHECK(y.vector()(13) == 4);
  CHECK(y.vector()(25) == 9);
  y.vector()(14) = -1;
  CHECK(y[1].position.y == -1);
}

TEST_CASE("what does not fit is refused") {
  using Balls = System<double, dynamic, Sphere<double>>;
  CHECK(error_of([] { Balls({}); }) == "system: expected a body or more, found none");
  CHECK(error_of([] { Balls::of(0, {Sphere{0.1}, 1.0}); }) == "system: expected a body or more, found 0");
  CHECK(error_of([] { Balls::of(-5, {Sphere{0.1}, 1.0}); }) == "system: expected a body or more, found -5");
  const auto balls = Balls::of(3, {Sphere{0.1}, 1.0});
  CHECK(error_of([] {
          Balls(std::vector<Body<double, Sphere<double>>>(2, {Sphere{0.1}, 1.0}), {}, {{0, 2}});
        }) ==
        "pair without contact: expected two bodies from 0 to 1, or a plane from 0 to -1 and a body, found "
        "0 and 2");
  for (const std::size_t bodies : {0u, 2u, 4u}) {
    SystemState<double, dynamic> y{std::vector<RigidState<double>>(bodies)};
    const std::string message =
        "state: expected 3 bodies, as the system has, found " + std::to_string(bodies);
    CHECK(error_of([&] { simulate(balls, y, Gravity{}, Rk4{}, {}); }) == message);
    CHECK(error_of([&] { check_state(balls, y); }) == message);
    CHECK(error_of([&] { Stepper(balls, Gravity{}, Rk4{}, {}).step(y, 0.0, 1e-3); }) == message);
    CHECK(error_of([&] { contacts(balls, y); }) == message);
    CHECK(error_of([&] { energy(balls, y, Vec3<double>{}); }) == message);
    CHECK(error_of([&] { linear_momentum(balls, y); }) == message);
    CHECK(error_of([&] { angular_momentum(balls, y); }) == message);
    CHECK(error_of([&] {
            simulate_batch<double>(
                balls, 2, [&](std::ptrdiff_t) { return y; }, [](const auto&) { return Gravity{}; }, Rk4{}, {},
                [](const auto&) {});
          }) == "scenario 0: " + message);
  }
}
