// Bodies that cannot meet in a step are stepped in groups of their own: the same physics as together.
#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>
#include <rbres/rbres.hpp>
#include <type_traits>
#include <vector>

using namespace rbres;

namespace {

using Crowd = System<double, dynamic>;
using State = SystemState<double, dynamic>;

/// Asks for the states around impacts, so that all bodies are at one time.
struct Together {
  void impact(double, const State&, const State&) {}
};

/// Clusters of `each` bodies, far apart from one another, that fall onto a floor and onto one another.
struct Clusters {
  std::vector<Body<double>> bodies;
  State y;

  Clusters(int count, int each, const Material<double>& material) {
    for (int c = 0; c < count; ++c) {
      for (int k = 0; k < each; ++k) {
        const int i = c * each + k;
        if (i % 3 == 0) bodies.push_back({Sphere{0.1}, 0.5 + 0.1 * (i % 4), material});
        if (i % 3 == 1) bodies.push_back({Box{0.12, 0.08, 0.1}, 0.5 + 0.1 * (i % 5), material});
        if (i % 3 == 2) bodies.push_back({Capsule{0.06, 0.08}, 0.5 + 0.1 * (i % 2), material});
        RigidState<double> body;
        body.position = {2.0 * (c % 8) + 0.02 * k, 2.0 * (c / 8) - 0.01 * k, 0.3 + 0.32 * k};
        body.orientation = normalized(Quat<double>{0.1 * (i % 7), 0.3, -0.2, 0.9});
        body.angular_velocity = {0.3 * (i % 5), 0.2, -0.4};
        y.body.push_back(body);
      }
    }
  }
  Crowd system(std::vector<Plane<double>> planes) const { return {bodies, std::move(planes)}; }
};

RigidState<double> at(double x, double y, double z) {
  RigidState<double> body;
  body.position = {x, y, z};
  return body;
}

double farthest(const State& a, const State& b) {
  double worst = 0;
  for (int i = 0; i < a.size(); ++i) worst = std::max(worst, norm(a[i].position - b[i].position));
  return worst;
}

}  // namespace

TEST_CASE("groups move as they do together") {
  const Material<double> material{0.5, 0.4};
  const Clusters clusters(20, 2, material);
  const Crowd world = clusters.system({floor_plane(material)});
  const SimulationOptions options{.step = 2e-3, .duration = 0.3};
  auto apart = clusters.y, together = clusters.y;
  const auto report = simulate(world, apart, Gravity{}, Rk4{}, options);
  simulate(world, together, Gravity{}, Rk4{}, options, Together{});
  CHECK(report.impacts > 60);
  CHECK(farthest(apart, together) < 1e-8);  // impacts make differences of rounding grow
  CHECK(!(apart == together));              // or nothing was stepped in groups
}

TEST_CASE("what happens to one group changes no bit of another") {
  const Material<double> material{0.5, 0.4};
  const Clusters clusters(20, 2, material);
  const Crowd world = clusters.system({floor_plane(material)});
  const SimulationOptions options{.step = 2e-3, .duration = 0.6};
  auto y = clusters.y, pushed = clusters.y;
  pushed[0].velocity = {0.2, 0.1, -1};
  simulate(world, y, Gravity{}, Rk4{}, options);
  simulate(world, pushed, Gravity{}, Rk4{}, options);
  CHECK(!(pushed[0] == y[0]));
  for (int i = 2; i < y.size(); ++i) CHECK(pushed[i] == y[i]);
}

TEST_CASE("what happens far away changes no bit of a heap") {
  const Clusters heap(1, 18, {0.5, 0.4});
  const int count = heap.y.size();
  // A heavy ball hands on more than its speed to a light one, which gets farther than the group was thought
  // to.
  auto bodies = heap.bodies;
  for (const double mass : {100.0, 1.0, 0.01, 1.0}) bodies.push_back({Sphere{0.1}, mass, {1.0, 0.0}});
  const Crowd world(bodies, {floor_plane(Material<double>{0.5, 0.4})});
  const auto heap_after = [&](const std::array<double, 4>& x, double speed) {
    State y = heap.y;
    for (const double ball : x) y.body.push_back(at(100 + ball, 0, 50));
    y[count].velocity = {speed, 0, 0};
    const auto report = simulate(world, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 0.8});
    CHECK(report.overruns == 0);
    y.body.resize(std::size_t(count));
    return y;
  };
  const State alone = heap_after({0, 1, 2, 3}, 0);
  CHECK(alone == heap_after({0, 1, 2, 3}, 10));
  for (const double speed : {3.0, 30.0, 100.0}) {
    const double hit = 0.2 + 0.4 * speed;
    CHECK(alone == heap_after({0, hit, hit + 0.21, hit + 1}, speed));
  }
}

/// Hears impulses.
struct Heard {
  std::vector<Impact<double>> impulses;
  void impact(const Impact<double>& impulse) { impulses.push_back(impulse); }
  bool in_order() const {
    return std::is_sorted(impulses.begin(), impulses.end(),
                          [](const auto& a, const auto& b) { return a.time < b.time; });
  }
  friend bool operator==(const Heard& a, const Heard& b) {
    return std::equal(a.impulses.begin(), a.impulses.end(), b.impulses.begin(), b.impulses.end(),
                      [](const auto& i, const auto& k) {
                        return i.time == k.time && i.second == k.second && i.impulse == k.impulse;
                      });
  }
};

TEST_CASE("few bodies take a step in groups, too, to the same bits in a system of any type") {
  const Material<double> material{0.5, 0.4};
  const Clusters clusters(3, 2, material);
  const Plane<double> floor = floor_plane(material);
  const SimulationOptions options{.step = 2e-3, .duration = 0.8};
  const auto& b = clusters.bodies;
  const std::array<Body<double>, 6> six{b[0], b[1], b[2], b[3], b[4], b[5]};
  const auto run = [&](const auto& system, const Vec3<double>& push, auto&& observer) {
    auto y = clusters.y;
    y[0].velocity += push;
    typename std::remove_cvref_t<decltype(system)>::State state;
    if constexpr (std::is_same_v<decltype(state), State>) state = y;
    for (int i = 0; i < 6; ++i) state[i] = y[i];
    const auto report = simulate(system, state, Gravity{}, Rk4{}, options, observer);
    CHECK(report.impacts > 10);
    for (int i = 0; i < 6; ++i) y[i] = state[i];
    return y;
  };
  const System<double, 6> fixed(six, {floor});
  const System<double, 6, AnyShape<double>, 1> with_room(six, {floor});
  const Crowd crowd = clusters.system({floor});
  const auto still = [](auto&&...) {};

  const State y = run(fixed, {}, still), pushed = run(fixed, {0.2, 0.1, -1}, still);
  CHECK(!(pushed[0] == y[0]));
  for (int i = 2; i < 6; ++i) CHECK(pushed[i] == y[i]);

  Heard heard, heard_with_room, heard_in_crowd;
  CHECK(run(fixed, {}, heard) == y);
  CHECK(run(with_room, {}, heard_with_room) == y);
  CHECK(run(crowd, {}, heard_in_crowd) == y);
  CHECK(heard.impulses.size() > 20);
  CHECK(heard.in_order());
  CHECK(heard == heard_with_room);
  CHECK(heard == heard_in_crowd);
}

TEST_CASE("more impulses in a step than a system has room for change no bit, and are all heard") {
  const Material<double> elastic{1.0, 0.0};
  const Plane<double> floor = floor_plane(elastic), ceiling{{0, 0, -1}, -0.5, elastic};
  const Body<double, Box<double>> box(Box<double>{0.1, 0.1, 0.1}, 1.0, elastic);
  SystemState<double, 2> start;
  for (int i = 0; i < 2; ++i) {
    start[i].position = {200.0 * i, 0, 0.25};  // they cannot meet
    start[i].velocity.z = 40 + i;
  }
  const auto run = [&](const auto& system, Heard& observer) {
    auto y = start;
    Stepper stepper(system, Gravity{}, Rk4{}, {.step = 0.5});
    stepper.step(y, 0.0, 0.5, observer);
    CHECK(stepper.tally().impacts > 100);
    return y;
  };
  const System<double, 2, Box<double>> heap({box, box}, {floor, ceiling});
  const System<double, 2, Box<double>, 2> with_room({box, box}, {floor, ceiling});
  Heard heard, heard_with_room;
  const auto y = run(heap, heard);
  CHECK(run(with_room, heard_with_room) == y);
  auto unheard = start;
  Stepper(heap, Gravity{}, Rk4{}, {.step = 0.5}).step(unheard, 0.0, 0.5);
  CHECK(unheard == y);
  CHECK(heard.impulses.size() > 400);  // four points each
  CHECK(heard.in_order());
  CHECK(heard == heard_with_room);
}

TEST_CASE("no order of bodies is preferred") {
  const Material<double> material{0.6, 0.3};
  const Clusters clusters(20, 2, material);
  std::vector<int> order(clusters.bodies.size());
  std::iota(order.begin(), order.end(), 0);
  std::reverse(order.begin(), order.end());
  std::vector<Body<double>> bodies;
  State turned;
  for (const int i : order) {
    bodies.push_back(clusters.bodies[std::size_t(i)]);
    turned.body.push_back(clusters.y[i]);
  }
  const SimulationOptions options{.step = 2e-3, .duration = 0.4};
  auto y = clusters.y;
  const Crowd world = clusters.system({floor_plane(material)}), other(bodies, {floor_plane(material)});
  simulate(world, y, Gravity{}, Rk4{}, options);
  simulate(other, turned, Gravity{}, Rk4{}, options);
  for (int i = 0; i < y.size(); ++i)
    CHECK(norm(y[order[std::size_t(i)]].position - turned[i].position) < 1e-9);
}

/// Sees how energy rises from sample to sample, and how deep bodies overlap.
struct Watch {
  const Crowd& world;
  Vec3<double> gravity;
  double last;
  double rise = 0, deepest = 0;

  void operator()(double, const State& now) {
    const double e = energy(world, now, gravity);
    rise = std::max(rise, e - last);
    last = e;
    for (const auto& contact : contacts(world, now)) deepest = std::min(deepest, contact.gap);
  }
};

TEST_CASE("energy never rises, and a heap of clusters comes to rest") {
  for (const double restitution : {0.0, 0.5, 1.0}) {
    CAPTURE(restitution);
    const Material<double> material{restitution, 0.4};
    const Clusters clusters(14, 3, material);
    const Crowd world = clusters.system({floor_plane(material)});
    const Vec3<double> g{0, 0, -9.81};
    auto y = clusters.y;
    const double start = energy(world, y, g);
    Watch watch{world, g, start};
    const auto report = simulate(world, y, Gravity{}, Rk4{},
                                 {.step = 2e-3, .duration = 2, .sample_rate = 100}, std::ref(watch));
    CHECK(report.impacts > 50);
    CHECK(report.overruns == 0);
    CHECK(watch.rise < 1e-10 * start);
    CHECK(watch.deepest > -1e-4);
  }
}

TEST_CASE("overlaps of heaps open as far as motion pays for it, and at any cost where they are deep") {
  // A ball as deep as heaps let bodies sink, with one that lies on it; and one that was put deeper.
  for (const double depth : {1.5e-4, 8e-4}) {
    CAPTURE(depth);
    const bool deep = depth > 2e-4;
    const Material<double> material{0, 0.5};
    std::vector<Body<double>> bodies;
    State y;
    for (int k = 0; k < 7; ++k) {
      bodies.push_back({Sphere{0.1}, 1.0, material});
      y.body.push_back(at(k, 0, 0.1 * (1 - depth)));
      bodies.push_back({Sphere{0.1}, 1.0, material});
      y.body.push_back(at(k, 0, 0.1 * (3 - depth)));
    }
    const Crowd world{bodies, {floor_plane(material)}};
    const Vec3<double> g{0, 0, -9.81};
    const double start = energy(world, y, g);
    Watch watch{world, g, start};
    simulate(world, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 0.5, .sample_rate = 500},
             std::ref(watch));
    if (deep) {
      for (int k = 0; k < 7; ++k) CHECK(y[2 * k].position.z > 0.1 * (1 - 2.1e-4));
    } else {
      CHECK(watch.rise < 1e-14 * start);
    }
  }
}

TEST_CASE("an impact in a crowd costs as much as the bodies that it reaches, but for one flight of all") {
  // Twenty pairs of balls that meet one after the other in a step in which all may meet.
  constexpr int pairs = 20;
  const std::vector bodies(2 * pairs, Body(Sphere{0.1}, 1.0, Material<double>{1.0, 0.0}));
  const System<double, dynamic, Sphere<double>> world{bodies};
  System<double, dynamic, Sphere<double>>::State y;
  for (int k = 0; k < pairs; ++k) {
    const double gap = 4e-3 + 4e-4 * k;
    for (const double side : {-1.0, 1.0}) {
      y.body.push_back(at(0.43 * k + side * (0.1 + 0.5 * gap), 0, 0));
      y.body.back().velocity.x = -5 * side;
    }
  }
  long calls = 0;
  const auto forces = [&](const auto&, const RigidState<double>&, int, double) {
    ++calls;
    return Wrench<double>{};
  };
  Stepper<std::decay_t<decltype(world)>, std::decay_t<decltype(forces)>, Rk4> stepper(world, forces, Rk4{},
                                                                                      {.step = 2e-3});
  stepper.step(y, 0.0, 2e-3);
  CHECK(stepper.tally().impacts == pairs);
  for (int k = 0; k < pairs; ++k) {
    const double after = 2e-3 - (4e-4 + 4e-5 * k);
    for (const int side : {-1, 1}) {
      const auto& body = y[2 * k + (side > 0)];
      CHECK(body.velocity.x == 5 * side);
      CHECK(std::abs(body.position.x - (0.43 * k + side * (0.1 + 5 * after))) < 1e-8);
    }
  }
  const long flight = 4 * 2 * pairs;  // of all bodies: an evaluation for each stage
  CHECK(calls > pairs * flight);
  CHECK(calls < (pairs + 6) * flight);
}

TEST_CASE("a ball that lands on a table that moves, after an impact in the same step, moves with it") {
  const Material<double> plastic{0, 0.3};
  std::vector<Body<double>> bodies(13, Body<double>(Sphere{0.1}, 1.0, plastic));
  bodies.push_back(Body<double>::kinematic(Box{10.0, 10.0, 0.5}, plastic));
  const Vec3<double> speed{0.5, 0, -3};
  State y;
  for (int k = 0; k < 13; ++k) y.body.push_back(at(k < 3 ? 0.21 * k : 1.0 * k, 0, k == 0 ? 0.101 : 0.2));
  y.body.push_back(at(0, 0, -0.5));
  for (auto& body : y.body) body.velocity = speed;
  y[0].velocity.z -= 1;   // lands after 1 ms
  y[1].velocity.x += 20;  // hits the third after 0.5 ms
  const Crowd world{bodies};
  Stepper<Crowd, Gravity<double>, Rk4> stepper(world, Gravity{}, Rk4{}, {.step = 2e-3});
  stepper.step(y, 0.0, 2e-3);
  CHECK(stepper.tally().impacts == 2);
  CHECK(std::abs(y[0].velocity.z - speed.z) < 1e-9);
  CHECK(y[0].velocity.x == doctest::Approx(speed.x).epsilon(1e-9));
}

TEST_CASE("a ball lands where it flies, not where it was foreseen before an impact elsewhere") {
  // Euler's flights differ as steps are cut.
  const Material<double> material{0.5, 0};
  const Crowd world{std::vector(13, Body<double>(Sphere{0.1}, 1.0, material)), {floor_plane(material)}};
  constexpr double step = 1e-2;
  for (int hit = 1; hit < 20; ++hit) {
    for (int land = 1; land < 20; ++land) {
      State y;
      for (int k = 0; k < 13; ++k) y.body.push_back(at(10 + 3 * k, 0, 5));
      y[0] = at(0, 0, 0.1 + 0.05 * step * land / 20);
      y[0].velocity.z = -0.05;
      y[1] = at(0.3, 0, 0.5);
      y[2] = at(0.5 + step * hit, 0, 0.5);
      y[2].velocity.x = -20;
      Stepper<Crowd, Gravity<double>, ExplicitEuler> stepper(world, Gravity{}, ExplicitEuler{},
                                                             {.step = step});
      stepper.step(y, 0.0, step);
      CHECK(y[0].position.z > 0.1 - 1e-5);
    }
  }
}

TEST_CASE("smooth heaps make no energy, in a crowd") {
  // What impacts do to islands that keep their forces, and islands that slide, whose bodies are lifted.
  const Material<double> smooth{0, 0};
  const auto check = [&](const std::vector<Body<double>>& bodies, State y,
                         const std::vector<Plane<double>>& planes, double step) {
    const Crowd world{bodies, planes};
    const Vec3<double> g{0, 0, -9.81};
    const double start = energy(world, y, g);
    Watch watch{world, g, start};
    simulate(world, y, Gravity{}, Rk4{}, {.step = step, .duration = 1.5, .sample_rate = std::round(1 / step)},
             std::ref(watch));
    CHECK(watch.rise < 1e-13 * start);
    CHECK(watch.deepest > (step > 2e-3 ? -3e-4 : -1e-4));
  };
  SUBCASE("in a pit") {
    int thrown = 0;  // how: whatever spins on the floor when it hits a wall does not turn on into it
    double step = 2e-3;
    SUBCASE("from rest") {}
    SUBCASE("thrown") {
      thrown = 21;
      step = 5e-3;
    }
    SUBCASE("thrown otherwise") {
      thrown = 22;
      step = 5e-3;
    }
    std::vector<Plane<double>> planes{floor_plane(smooth)};
    for (const auto& [x, y] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}})
      planes.push_back({{double(x), double(y), 0}, -0.66, smooth});
    std::vector<Body<double>> bodies;
    State y;
    for (int k = 0; k < 30; ++k) {
      if (k % 3 == 0) bodies.push_back({Sphere{0.1}, 1.0, smooth});
      if (k % 3 == 1) bodies.push_back({Box{0.12, 0.08, 0.1}, 1.0 + 0.1 * (k % 5), smooth});
      if (k % 3 == 2) bodies.push_back({Capsule{0.06, 0.08}, 1.0, smooth});
      const int row = k / 3 % 3;
      auto body =
          at(0.4 * (k % 3 - 1) + 0.01 * (k % 4), 0.4 * (row - 1) - 0.01 * (k % 5), 0.3 + 0.45 * (k / 9));
      body.orientation = normalized(Quat<double>{0.1 * (k % 7), 0.3, -0.2, 0.9});
      body.angular_velocity = {0.3 * (k % 5), 0.2, -0.4};
      if (thrown > 0)
        body.velocity = {0.3 * ((k * 7 + thrown) % 5 - 2), 0.2 * ((k * 3 + thrown * 5) % 7 - 3), 0};
      y.body.push_back(body);
    }
    check(bodies, y, planes, step);
  }
  SUBCASE("on a floor") {
    const Clusters clusters(21, 2, smooth);
    check(clusters.bodies, clusters.y, {floor_plane(smooth)}, 2e-3);
  }
}

TEST_CASE("a capsule that rocks on two nearly parallel ones neither sinks in nor gains energy, in a crowd") {
  // Where it touches them runs along the axes by the tilt over the square of the skew.
  double rise = 0;
  for (const double skew : {0.005, 0.011, 0.015, 0.02, 0.03, 0.04}) {
    CAPTURE(skew);
    const Material<double> material{0, 0.5};
    std::vector<Body<double>> bodies;
    State y;
    const auto lie = [&](double x, double z, double about_z, double tilt) {
      bodies.push_back({Capsule{0.07, 0.1}, 1.0, material});
      auto body = at(x, 0, z);
      body.orientation = quaternion_exp(Vec3<double>{0, 0, about_z}) *
                         quaternion_exp(Vec3<double>{std::numbers::pi / 2 + tilt, 0, 0});
      y.body.push_back(body);
    };
    lie(-0.08, 0.07, skew, 0);
    lie(0.08, 0.07, -skew, 0);
    lie(0, 0.2, 0, 0.02);
    for (int k = 0; k < 12; ++k) {
      bodies.push_back({Sphere{0.1}, 1.0, material});
      y.body.push_back(at(0, 1 + 0.5 * k, 0.1));
    }
    const double half = 0.15 + 0.1 * skew;
    const Plane<double> left{{1, 0, 0}, -half, material}, right{{-1, 0, 0}, -half, material};
    const Crowd world{bodies, {floor_plane(material), left, right}};
    const Vec3<double> g{0, 0, -9.81};
    const double start = energy(world, y, g);
    Watch watch{world, g, start};
    const auto report = simulate(world, y, Gravity{}, Rk4{},
                                 {.step = 2e-3, .duration = 2, .sample_rate = 500}, std::ref(watch));
    CHECK(report.overruns == 0);
    CHECK(watch.deepest > -5e-5);
    rise += watch.rise / start;
  }
  CHECK(rise < 1e-13);  // it was 3e-6 where they touched in a point
}

TEST_CASE("boxes whose edges overlap where a face has no point any more do not stop time, in a crowd") {
  // From a heap of 60 bodies: they overlap by 1.2e-4 of their size, deeper and deeper, and touch in no point.
  const Material<double> material{0.2, 0.5};
  std::vector<Body<double>> bodies;
  State y;
  for (int k = 0; k < 12; ++k) {  // rest
    bodies.push_back({Sphere{0.1}, 1.0, material});
    y.body.push_back(at(1 + k, 0, 0.1));
  }
  bodies.push_back({Box{0.12, 0.08, 0.1}, 1.0, material});
  y.body.push_back({{-0.052757885303752, 0.22170570255142563, 0.90145220307889273},
                    {-0.93487908279212617, -0.010838374050363118, -0.028642840553588775, 0.35364278289075685},
                    {0.0012617666248483188, -0.0035218653737927484, 0.0062510825753325696},
                    {-0.012060993433916704, -0.027568066631804593, -0.00085146226515502195}});
  bodies.push_back(bodies.back());
  y.body.push_back({{-0.040147033491217725, 0.47393351114900845, 0.85761777380107063},
                    {0.35187752944656853, -0.028854199545599635, 0.010863968324473915, 0.93553814119543355},
                    {0.00045999152321347394, 0.00073399969912236606, 0.0030060618332820423},
                    {-0.032647602360757186, 0.00048066820034886376, -0.00042442312215855806}});
  {  // a ball that rests on the back of the first: so the boxes are part of a heap
    const auto& box = y[12];
    const Vec3<double> back = rotate(box.orientation, Vec3<double>{0, -1, 0});
    auto ball = at(0, 0, 0);
    ball.position = box.position + 0.18 * back;
    ball.velocity = box.velocity + cross(box.angular_velocity_world(), 0.18 * back);
    bodies.push_back({Sphere{0.1}, 1.0, material});
    y.body.push_back(ball);
  }
  const Crowd world{bodies, {floor_plane(material)}};
  const auto report = simulate(world, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 0.2});
  CHECK(report.overruns == 0);
  for (const auto& contact : contacts(world, y)) CHECK(contact.gap > -5e-5);
}

TEST_CASE("a clump that spins keeps its momentum where its bodies roll on one another") {
  std::vector<Body<double>> bodies;
  State y;
  for (int k = 0; k < 18; ++k) {
    const Material<double> material{0.2, 0.6};
    if (k % 2 == 0) bodies.push_back({Sphere{0.08 + 0.002 * k}, 0.5 + 0.1 * k, material});
    if (k % 2 == 1) bodies.push_back({Capsule{0.06, 0.1}, 1.0 + 0.05 * k, material});
    auto body = at(0.4 * (k % 3), 0.4 * (k / 3 % 3), 0.4 * (k / 9));
    body.orientation = normalized(Quat<double>{0.1 * (k % 7), 0.3, -0.2, 0.9});
    body.velocity = cross(Vec3<double>{0, 0, 1}, body.position);
    body.angular_velocity = {0.3 * (k % 5), 0.2, -0.4};
    y.body.push_back(body);
  }
  const Crowd world{bodies, {}};
  // Towards the origin: no torque about it.
  const auto pull = [&](const auto& body, const RigidState<double>& state) {
    return Wrench<double>{(-20 * body.mass()) * state.position, {}};
  };
  const auto before = angular_momentum(world, y);
  const auto report = simulate(world, y, pull, Rk4{}, {.step = 2e-3, .duration = 2, .sample_rate = 50});
  CHECK(report.overruns == 0);
  const auto after = angular_momentum(world, y);
  int touching = 0;
  for (const auto& contact : contacts(world, y)) touching += contact.gap < 1e-5;
  CHECK(touching > 10);
  CHECK(norm(after - before) < 1e-9 * norm(before));
}

/// Counts the moments at which impacts are resolved.
struct HeapWatch : Watch {
  std::uint64_t moments = 0;
  double at = -1;

  void impact(const Impact<double>& impact) {
    if (impact.time != at) ++moments;
    at = impact.time;
  }
};

TEST_CASE(
    "bodies that fall into a heap gain no energy and do not overlap, and impacts are resolved together") {
  struct Heap {
    int count;
    long impacts, together;  ///< at least, and at a moment
  };
  for (const Heap& heap : {Heap{20, 400, 2}, Heap{36, 1000, 3}}) {
    const int count = heap.count;
    CAPTURE(count);
    const Material<double> material{0.3, 0.5};
    std::vector<Body<double>> bodies;
    State y;
    for (int i = 0; i < count; ++i) {
      i % 2 == 0 ? bodies.push_back({Sphere{0.1}, 1.0, material})
                 : bodies.push_back({Box{0.12, 0.08, 0.1}, 1.0, material});
      RigidState<double> body;
      body.position = {0.36 * (i % 3 - 1) + 0.01 * (i % 7), 0.36 * (i / 3 % 3 - 1) + 0.01 * (i % 5),
                       0.25 + 0.36 * (i / 9)};
      body.orientation = quaternion_exp(Vec3<double>{1.0 * i, 0, 0});
      y.body.push_back(body);
    }
    std::vector<Plane<double>> pit{floor_plane(material)};
    for (const double side : {-1.0, 1.0}) {
      pit.push_back({{side, 0, 0}, -0.6, material});
      pit.push_back({{0, side, 0}, -0.6, material});
    }
    const Crowd world{bodies, pit};
    const Vec3<double> g{0, 0, -9.81};
    const double start = energy(world, y, g);
    HeapWatch watch{{world, g, start}};
    const auto report = simulate(world, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 0.7}, watch);
    CHECK(report.impacts > heap.impacts);
    CHECK(report.impacts > heap.together * long(watch.moments));
    CHECK(report.overruns == 0);
    CHECK(watch.rise < 1e-10 * start);
    CHECK(watch.last < 0.5 * start);
    CHECK(watch.deepest > -5e-5);
  }
}

TEST_CASE("a pyramid on a slope stands in a crowd as it does alone") {
  const Material<double> material{0.0, 0.5};
  const auto stand = [&](int rows, int others) {
    std::vector<Body<double>> bodies;
    State y;
    for (int row = 0; row < rows; ++row) {
      for (int k = 0; k < rows - row; ++k) {
        bodies.push_back({Box{0.1, 0.1, 0.1}, 1.0, material});
        y.body.push_back(at(0.21 * k + 0.105 * row, 0, 0.1 + 0.2 * row));
      }
    }
    for (int i = 0; i < others; ++i) {
      bodies.push_back({Sphere{0.1}, 1.0, material});
      y.body.push_back(at(10.0 + i, 0, 0.1));
    }
    const Crowd world{bodies, {floor_plane(material)}};
    // Gravity leans by 10 degrees; spheres lean against nothing and roll.
    Stepper stepper(world, Gravity<double>{{1.7, 0, -9.66}}, Rk4{}, {.step = 2e-3});
    const State start = y;
    for (int k = 0; k < 500; ++k) stepper.step(y, 2e-3 * k, 2e-3);
    const State later = y;
    for (int k = 0; k < 100; ++k) stepper.step(y, 1 + 2e-3 * k, 2e-3);
    double moved = 0, crept = 0;
    for (int i = 0; i < rows * (rows + 1) / 2; ++i) {
      moved = std::max(moved, norm(y[i].position - start[i].position));
      crept = std::max(crept, norm(y[i].position - later[i].position));
    }
    CHECK(moved < 1e-6);
    CHECK(crept < 1e-8);
  };
  stand(4, 0);  // alone: 10 bodies
  stand(6, 0);
  stand(6, 12);
}

TEST_CASE("what is placed at rest stays there, in a crowd, too") {
  const Material<double> material{0, 0.5};
  std::vector<Body<double>> bodies;
  State y;
  double still = 1e-9;  // m in 0.2 s
  SUBCASE("a pyramid of 45 boxes") {
    for (int row = 0; row < 9; ++row) {
      for (int k = 0; k < 9 - row; ++k) {
        bodies.push_back({Box{0.1, 0.1, 0.1}, 1.0, material});
        y.body.push_back(at(0.202 * (k + 0.5 * row), 0, 0.1 + 0.2 * row));
      }
    }
  }
  SUBCASE("a slab of 10 t on 36 boxes of 1 kg") {
    for (int i = 0; i < 36; ++i) {
      bodies.push_back({Box{0.1, 0.1, 0.1}, 1.0, material});
      y.body.push_back(at(0.21 * (i % 6), 0.21 * (i / 6), 0.1));
    }
    bodies.push_back({Box{0.66, 0.66, 0.1}, 1e4, material});
    y.body.push_back(at(0.525, 0.525, 0.3));
    still = 1e-7;
  }
  const Crowd world{bodies, {floor_plane(material)}};
  const State start = y;
  simulate(world, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 0.2});
  CHECK(farthest(y, start) < 1e-7);
  const State later = y;
  simulate(world, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 0.2});
  CHECK(farthest(y, later) < still);
}

TEST_CASE("islands of resting contacts that an impact does not reach keep their forces, in a crowd") {
  for (const int count : {12, 13}) {
    CAPTURE(count);
    const Material<double> material{0.3, 0.5};
    const std::vector<Body<double>> bodies(std::size_t(count),
                                           Body<double>(Sphere<double>{0.1}, 1.0, material));
    const Crowd world{bodies, {floor_plane(material)}};
    using Pair = detail::ContactPair<Crowd>;
    detail::ContactPairs<Crowd> pairs;
    detail::Reserved<Pair::Contact> at_end;
    const auto add = [&](int first, int second, bool rests, double gap, double impact) {
      Pair pair(world, {first, second}, 5e-3);
      pair.resting.fill(false);
      pair.resting[0] = pair.any_resting = rests;
      pair.impact = impact;
      pairs.emplace_back(pair);
      Pair::Contact contact{};
      contact.gap.fill(1.0);
      contact.gap[0] = gap;
      contact.used = 1;
      at_end.push_back(contact);
    };
    constexpr double cut = 1e-3, never = 2e-3;
    add(-1, 0, true, 0, never);  // rests on the floor, apart from all that happens
    add(-1, 1, true, 0, never);  // rests on the floor, and against what is hit
    add(-1, 5, true, 0, never);  // touches what is hit
    add(0, 6, false, 0.1, never);
    add(1, 2, true, 0, never);
    add(2, 3, false, 0, cut);  // the impact
    add(3, 5, false, 0, never);
    std::vector<int> all(bodies.size());
    std::iota(all.begin(), all.end(), 0);
    detail::KeptIslands<Crowd> kept(world);
    kept.clear(all);
    State y;
    y.body.resize(bodies.size());
    for (const int i : all) kept.start(i, y);
    const auto touches = [&](std::size_t k) { return at_end[k].gap[0] <= pairs[k].touch; };
    kept.choose(all, pairs, touches, cut, never);
    kept.end_part(all, pairs, cut);
    for (const int i : all) CHECK(kept.has(i) == (count > 12 && i == 0));

    Pair known(world, {-1, 0}, 5e-3), fresh(world, {0, 6}, 5e-3), other(world, {1, 2}, 5e-3);
    CHECK(kept.mark(known) == (count > 12));
    CHECK(kept.mark(fresh) == (count > 12));
    CHECK(!kept.mark(other));
    if (count == 12) continue;
    CHECK(known.any_resting);
    CHECK(known.resting[0]);
    CHECK(!known.resting[1]);
    CHECK(!fresh.any_resting);
    CHECK(kept.age(0, 5e-4) == 1.5e-3);
  }
}

TEST_CASE("a body that an impact drives into another group within a step does not pass through it") {
  // A fast heavy ball hits a lighter one, and that a light one, which flies off four times as fast as
  // anything did before, and would pass the ball in its way within the same step.
  const Material<double> material{1.0, 0.0};
  std::vector<Body<double>> bodies{{Sphere{0.1}, 1000.0, material},
                                   {Sphere{0.02}, 1.0, material},
                                   {Sphere{0.02}, 0.001, material},
                                   {Sphere{0.1}, 1.0, material}};
  State y;
  y.body.resize(4);
  y[0].velocity.x = 20;
  y[1].position.x = 0.125;
  y[2].position.x = 0.17;
  y[3].position.x = 0.85;
  for (int i = 4; i < 40; ++i) {
    bodies.push_back({Sphere{0.1}, 1.0, material});
    RigidState<double> body;
    body.position = {1.0 * (i % 8), 2.0 + 1.0 * (i / 8), 0};
    y.body.push_back(body);
  }
  const Crowd world(bodies);
  const Gravity<double> none{Vec3<double>{0, 0, 0}};
  for (const double step : {1e-3, 1e-2, 2e-2}) {
    CAPTURE(step);
    auto apart = y, together = y;
    const SimulationOptions options{.step = step, .duration = 0.02};
    const auto report = simulate(world, apart, none, Rk4{}, options);
    simulate(world, together, none, Rk4{}, options, Together{});
    CHECK(report.impacts > 1);
    CHECK(apart[2].position.x < apart[3].position.x);
    CHECK(apart[3].velocity.x > 0.01);
    CHECK(farthest(apart, together) < 1e-9);
    CHECK(energy(world, apart, none.g) == doctest::Approx(energy(world, y, none.g)).epsilon(1e-12));
  }
}

TEST_CASE_TEMPLATE("a body near a plane flies alone only where none of its points can meet it", Geometry,
                   Box<double>, Capsule<double>) {
  constexpr bool is_box = std::is_same_v<Geometry, Box<double>>;
  const Geometry geometry = [] {
    if constexpr (is_box) {
      return Box{0.5, 0.05, 0.05};
    } else {
      return Capsule{0.05, 0.45};
    }
  }();
  const Material<double> material{0.5, 0.0};
  // The second body is far away: so there are groups.
  const auto world = System<double, 2, Geometry>::of(Body{geometry, 1.0, material}, {floor_plane(material)});
  // Impacts within 10 ms of a body whose long axis is so far from level, and whose lowest point is 10 mm
  // above the floor.
  const auto impacts = [&](double tilt, double turn, double fall, double spin, double torque) {
    SystemState<double, 2> y;
    y[0].orientation = quaternion_exp(Vec3<double>{0, 0, turn}) *
                       quaternion_exp(Vec3<double>{0, is_box ? tilt : 0.5 * std::numbers::pi + tilt, 0});
    y[0].position.z =
        0.01 + (is_box ? 0.5 * std::sin(tilt) + 0.05 * std::cos(tilt) : 0.45 * std::sin(tilt) + 0.05);
    y[0].velocity.z = -fall;
    y[0].angular_velocity = {0, spin, 0};
    y[1].position = {10, 0, 10};
    const auto twist = [&](const auto&, const RigidState<double>&, int i, double) {
      return Wrench<double>{{}, {0, i == 0 ? torque : 0.0, 0}};
    };
    return simulate(world, y, Forces{twist}, Rk4{}, {.step = 0.01, .duration = 0.01}).impacts;
  };
  for (const double turn : {0.0, 1.0, 2.5}) {  // about the floor's normal, which changes nothing
    for (const double tilt : {0.05, 0.8, 1.5}) {
      CAPTURE(turn);
      CAPTURE(tilt);
      CHECK(impacts(tilt, turn, 0.0, 0.0, 0.0) == 0);
      CHECK(impacts(tilt, turn, 0.9, 0.0, 0.0) == 0);
      CHECK(impacts(tilt, turn, 1.1, 0.0, 0.0) == 1);
    }
    CHECK(impacts(0.05, turn, 0.0, 10.0, 0.0) + impacts(0.05, turn, 0.0, -10.0, 0.0) >= 1);
    CHECK(impacts(0.05, turn, 0.0, 0.0, 200.0) + impacts(0.05, turn, 0.0, 0.0, -200.0) >= 1);
  }
}

TEST_CASE("a body that turns and has stopped when the step ends does not fly alone into a plane") {
  const double half = 0.2, step = 1e-3;
  const Body<double, Box<double>> plate{Box{half, 0.1, 0.002}, 1.0};
  const auto world = System<double, 2, Box<double>>::of(plate, {floor_plane(Material<double>{})});
  for (const double phase : {0.2, 0.8, 1.5, 3.14}) {  // of a torque that accelerates, then brakes, in a step
    for (const double turn : {0.02, 0.1, 0.3, -0.3}) {
      CAPTURE(phase);
      CAPTURE(turn);
      const double rate = phase / step;
      const double most = turn * plate.inertia().y * rate * rate /
                          (2 * std::sin(0.5 * phase) - phase * std::cos(0.5 * phase));
      const auto twist = [&](const auto&, const RigidState<double>&, int i, double time) {
        return Wrench<double>{
            {}, {0, i == 0 ? most * std::cos(rate * (time - 0.5 * step) + 0.5 * std::numbers::pi) : 0.0, 0}};
      };
      SystemState<double, 2> y;
      y[0].position.z = 0.002 + 2.5e-4;
      y[1].position = {10, 0, 10};
      simulate(world, y, Forces{twist}, Rk4{}, {.step = step, .duration = step});
      double lowest = 1;
      for (const double x : {-half, half}) {
        for (const double z : {-0.002, 0.002})
          lowest = std::min(lowest, (y[0].position + rotate(y[0].orientation, {x, 0.1, z})).z);
      }
      CHECK(lowest > -2e-5);
    }
  }
}

TEST_CASE("a conveyor that rises and that many groups share carries them all") {
  const Material<double> material{0.0, 0.5};
  std::vector<Body<double>> bodies{Body<double>::kinematic(Box{20.0, 1.0, 0.1}, material)};
  State y;
  y.body.resize(1);
  y[0].velocity = {0.5, 0, 0.2};
  for (int i = 0; i < 40; ++i) {
    bodies.push_back({Box{0.1, 0.1, 0.1}, 1.0, material});
    RigidState<double> body;
    body.position = {-8.0 + 0.4 * i, 0, 0.2};
    body.velocity.z = 0.2;
    y.body.push_back(body);
  }
  const Crowd world(bodies);
  const auto report = simulate(world, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 1});
  CHECK(report.overruns == 0);
  CHECK(y[0].position.x == doctest::Approx(0.5));
  const double way = 0.5 - 0.5 * 0.5 / (2 * 0.5 * 9.81);  // they slide until they are as fast
  for (int i = 1; i <= 40; ++i) {
    CHECK(y[i].velocity.x == doctest::Approx(0.5).epsilon(1e-6));
    CHECK(y[i].position.x == doctest::Approx(-8.0 + 0.4 * (i - 1) + way).epsilon(1e-4));
    CHECK(y[i].position.z == doctest::Approx(0.4).epsilon(1e-5));
  }
}

TEST_CASE("a copy of a stepper goes on to the same bits, and one body that is lost stops the run") {
  const Material<double> material{0.3, 0.4};
  const Clusters clusters(14, 3, material);
  const Crowd world = clusters.system({floor_plane(material)});
  auto y = clusters.y;
  Stepper first(world, Gravity{}, Rk4{}, SimulationOptions{});
  for (int i = 0; i < 300; ++i) first.step(y, 0.0, 2e-3);
  auto copy = first;
  auto by_copy = y;
  for (int i = 0; i < 100; ++i) {
    first.step(y, 0.0, 2e-3);
    copy.step(by_copy, 0.0, 2e-3);
  }
  CHECK(by_copy == y);
  first.step(y, 0.0, 0.0);
  CHECK(by_copy == y);  // a step of no time changes no bit

  const auto fails = [](const auto&, const RigidState<double>&, int i, double time) {
    return Wrench<double>{{0, 0, i == 7 && time > 0.1 ? std::nan("") : 0.0}, {}};
  };
  auto lost = clusters.y;
  const auto report = simulate(world, lost, Forces{Gravity{}, fails}, Rk4{}, {.step = 2e-3, .duration = 1});
  CHECK(report.status == SimulationStatus::non_finite);
  CHECK(report.bad_body == 7);
  CHECK(report.time == doctest::Approx(0.1).epsilon(0.05));
}
