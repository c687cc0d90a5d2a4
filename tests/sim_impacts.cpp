// What an observer hears of impacts: the impulses account for all that impacts do.
#include <doctest/doctest.h>

#include <map>
#include <rbres/rbres.hpp>
#include <vector>

#include "../examples/common/count_allocations.hpp"

using namespace rbres;

namespace {

using Vector = Vec3<double>;

/// Compares the impulses of each instant with the states around it.
template <class System>
struct Ledger {
  using State = typename System::State;
  const System* system = nullptr;
  std::map<double, std::vector<std::pair<State, State>>> states;  // around each instant's groups of impacts
  std::map<double, std::vector<Impact<double>>> impulses;
  double last = -1;
  bool sorted = true;

  void impact(double time, const State& before, const State& after) {
    states[time].push_back({before, after});
  }
  void impact(const Impact<double>& heard) {
    sorted = sorted && heard.time >= last;
    last = heard.time;
    impulses[heard.time].push_back(heard);
  }

  /// The largest velocity change (m/s, world frame; of a turn, times the radius) without its impulse.
  double worst() const {
    double worst = 0;
    for (const auto& [time, around] : states) {
      const State& y = around.front().first;
      State expected = y;
      std::vector<Vector> spin;  // angular momentum, world frame
      for (int i = 0; i < system->size(); ++i)
        spin.push_back(rotate(y[i].orientation, scale((*system)[i].inertia(), y[i].angular_velocity)));
      const auto at = impulses.find(time);
      if (at == impulses.end()) return 1;
      for (const auto& heard : at->second) {
        const auto add = [&](int i, const Vector& p) {
          if (i < 0 || (*system)[i].is_kinematic()) return;
          expected[i].velocity += (1 / (*system)[i].mass()) * p;
          spin[std::size_t(i)] += cross(heard.point - y[i].position, p);
        };
        add(heard.second, heard.impulse);
        add(heard.first, -heard.impulse);
        if (std::abs(norm(heard.normal) - 1) > 1e-12 || dot(heard.normal, heard.impulse) < 0) return 2;
      }
      for (int i = 0; i < system->size(); ++i) {
        const auto& after = around.back().second[i];
        worst = std::max(worst, norm(after.velocity - expected[i].velocity));
        const Vector turned =
            rotate(after.orientation, scale((*system)[i].inertia(), after.angular_velocity));
        const Vector moment = (*system)[i].inertia();
        worst = std::max(worst, norm(turned - spin[std::size_t(i)]) * (*system)[i].bounding_radius() /
                                    std::min({moment.x, moment.y, moment.z}));
      }
    }
    return worst;
  }
};

std::vector<Body<double>> bodies(const Material<double>& material) {
  return {{Box{0.12, 0.08, 0.1}, 1.0, material},
          {Sphere{0.1}, 0.7, material},
          {Capsule{0.06, 0.1}, 1.3, material},
          {Box{0.1, 0.1, 0.05}, 0.4, material},
          Body<double>::kinematic(Box{0.3, 0.3, 0.05}, material)};
}
RigidState<double> start(int i) {
  RigidState<double> y;
  if (i == 4) {
    y.position = {0, 0, 0.4};
    return y;
  }
  y.position = {0.25 * (i % 2) - 0.12, 0.25 * (i / 2) - 0.12, 0.8 + 0.1 * i};
  y.orientation = normalized(Quat<double>{0.1 * i, 0.3, -0.2, 0.9});
  y.velocity = {0.3 * (1.5 - i), 0.2, -1};
  y.angular_velocity = {1, 2.0 - i, -3};
  return y;
}

template <class System>
void check_ledger(const System& system, typename System::State y, ContactMode mode) {
  Ledger<System> ledger;
  ledger.system = &system;
  const auto report =
      simulate(system, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 1.5, .contacts = mode}, ledger);
  CHECK(ledger.sorted);
  if (mode == ContactMode::discrete) {
    CHECK(ledger.impulses.empty());
    return;
  }
  CHECK(report.impacts > 5);
  CHECK(ledger.states.size() == ledger.impulses.size());
  CHECK(ledger.worst() < 1e-11);
}

/// Spheres without gravity in a closed box.
struct Gas {
  System<double, dynamic, Sphere<double>> system;
  SystemState<double, dynamic> y;

  explicit Gas(int side, double friction)
      : system(std::vector<Body<double, Sphere<double>>>(std::size_t(side * side * side),
                                                         {Sphere{0.05}, 1.0, {1.0, friction}}),
               room(0.15 * side, 0.3 * side, Material<double>{1.0, friction})) {
    Random random(1, 2);
    for (int i = 0; i < system.size(); ++i) {
      RigidState<double> body;
      body.position = {0.3 * (i % side + 0.5) - 0.15 * side, 0.3 * (i / side % side + 0.5) - 0.15 * side,
                       0.3 * (i / side / side + 0.5)};
      body.velocity = {random.uniform(-2, 2), random.uniform(-2, 2), random.uniform(-2, 2)};
      y.body.push_back(body);
    }
  }
};

struct Impulses {
  std::vector<Impact<double>> all;
  void impact(const Impact<double>& heard) { all.push_back(heard); }
};
struct ImpulsesAndStates : Impulses {
  using Impulses::impact;
  void impact(double, const auto&, const auto&) {}
};

}  // namespace

TEST_CASE("impulses are what impacts change, for every shape, plane and kinematic body") {
  for (const double restitution : {0.0, 0.5, 1.0}) {
    for (const double friction : {0.0, 0.4}) {
      CAPTURE(restitution);
      CAPTURE(friction);
      const Material<double> material{restitution, friction};
      const auto all = bodies(material);
      const auto walls = room(0.6, 3.0, material);
      SystemState<double, dynamic> y;
      for (int i = 0; i < 5; ++i) y.body.push_back(start(i));
      SystemState<double, 5> fixed;
      for (int i = 0; i < 5; ++i) fixed[i] = start(i);
      for (const auto mode : {ContactMode::continuous, ContactMode::discrete}) {
        check_ledger(System<double, dynamic>(all, walls), y, mode);
        check_ledger(System<double, 5>({all[0], all[1], all[2], all[3], all[4]}, walls), fixed, mode);
      }
      const System<double, 3, Sphere<double>> balls(
          {{{Sphere{0.1}, 1.0, material}, {Sphere{0.12}, 3.0, material}, {Sphere{0.08}, 0.2, material}}},
          walls);
      SystemState<double, 3> three;
      for (int i = 0; i < 3; ++i) three[i] = start(i);
      check_ledger(balls, three, ContactMode::continuous);
    }
  }
}

TEST_CASE("impulses of many bodies, stepped in groups, are heard in order and account for their motion") {
  for (const double friction : {0.0, 0.5}) {
    const Gas gas(5, friction);
    const SimulationOptions options{.step = 2e-3, .duration = 0.5};
    auto y = gas.y;
    Impulses heard;
    const auto report = simulate(gas.system, y, Gravity{Vector{0, 0, 0}}, Rk4{}, options, heard);
    CHECK(report.impacts > 150);
    CHECK(heard.all.size() == std::size_t(report.impacts));
    auto expected = gas.y;
    for (std::size_t k = 0; k < heard.all.size(); ++k) {
      const auto& impact = heard.all[k];
      if (k > 0) REQUIRE(impact.time >= heard.all[k - 1].time);
      expected[impact.second].velocity += impact.impulse;
      if (!impact.with_plane()) expected[impact.first].velocity -= impact.impulse;
    }
    double worst = 0;
    for (int i = 0; i < gas.system.size(); ++i)
      worst = std::max(worst, norm(expected[i].velocity - y[i].velocity));
    CHECK(worst < 1e-12);

    auto together = gas.y;
    ImpulsesAndStates also;  // states around impacts need all bodies at one time
    simulate(gas.system, together, Gravity{Vector{0, 0, 0}}, Rk4{}, options, also);
    REQUIRE(also.all.size() >= 50);
    for (std::size_t k = 0; k < 50; ++k) {
      CHECK(also.all[k].first == heard.all[k].first);
      CHECK(also.all[k].second == heard.all[k].second);
      CHECK(also.all[k].time == doctest::Approx(heard.all[k].time).epsilon(1e-9));
      CHECK(norm(also.all[k].impulse - heard.all[k].impulse) < 1e-8);
    }
  }
}

TEST_CASE("listening changes no bit, and a step of groups allocates nothing") {
  const Gas gas(5, 0.3);
  auto y = gas.y, silent = gas.y;
  const SimulationOptions options{.step = 2e-3, .duration = 0.5};
  Impulses heard;
  simulate(gas.system, y, Gravity{}, Rk4{}, options, heard);
  simulate(gas.system, silent, Gravity{}, Rk4{}, options);
  CHECK(y == silent);

  Stepper stepper(gas.system, Gravity{}, Rk4{}, options);
  auto walk = gas.y;
  const long before = allocations;
  for (int i = 0; i < 250; ++i) stepper.step(walk, 2e-3 * i, 2e-3);
  CHECK(allocations == before);
  CHECK(stepper.tally().impacts > 150);
}
