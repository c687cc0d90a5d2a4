// What the way back through rollouts of a contact law gives, against central differences.
#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <rbres/contact/contact_query.hpp>
#include <rbres/learn/hybrid_law.hpp>
#include <rbres/learn/rollouts.hpp>

#include "learn_support.hpp"

using namespace rbres;
using namespace learn_support;

namespace {

using Law = ContactLaw<6, 2, double>;
using Hybrid = HybridLaw<6, 2, double>;

/// A body of each of these shapes, one above the other and overlapping, for some frames that no law explains.
Trajectory pile(const std::vector<int>& kinds, std::uint64_t seed) {
  Random r(seed);
  std::vector<Body<double>> bodies;
  for (const int kind : kinds)
    bodies.push_back(
        {shapes[static_cast<std::size_t>(kind)], 0.7 + 0.6 * static_cast<double>(bodies.size())});
  std::vector<RigidState<double>> states;
  for (int t = 0; t < 4; ++t) {
    for (std::size_t i = 0; i < bodies.size(); ++i) {
      RigidState<double> y;
      const double along = static_cast<double>(i);
      y.position = {0.02 * along + 0.01 * t, 0.05 * along, 0.13 + 0.17 * along + 0.003 * t};
      y.orientation = t == 0 ? random_orientation(r) : states[i].orientation;
      y.velocity = random_vector(r, 0.3);
      y.angular_velocity = random_vector(r, 2);
      states.push_back(y);
    }
  }
  return {bodies, states};
}

/// The same a little apart and closing in, so that they meet in the second frame or the third.
Trajectory closing(const std::vector<int>& kinds, const Plane<double>& floor) {
  Random r(3);
  std::vector<Body<double>> bodies;
  std::vector<RigidState<double>> start;
  for (const int kind : kinds) {
    const double number = static_cast<double>(bodies.size());
    bodies.push_back({shapes[static_cast<std::size_t>(kind)], 0.7 + 0.6 * number});
    RigidState<double>& y = start.emplace_back();
    y.position = {0.02 * number, 0.03 * number, 2};
    y.orientation = random_orientation(r);
    y.velocity = Vec3<double>{0, 0, -1 - 1.0 * number} + random_vector(r, 0.1);
    y.angular_velocity = random_vector(r, 2);
    const SceneSystem all(bodies, {floor});
    double apart = 2;
    for (double step = 1; step > 1e-9; step /= 2) {
      y.position.z = apart - step;
      const SceneState now{start};
      bool meets = false;
      for ([[maybe_unused]] const auto& contact : contacts(all, now)) meets = true;
      if (!meets) apart -= step;
    }
    y.position.z = apart + 0.02;
  }
  std::vector<RigidState<double>> states;
  for (int t = 0; t < 4; ++t) {
    for (RigidState<double> y : start) {
      y.position += random_vector(r, 0.01);
      states.push_back(y);
    }
    if (t == 0) states = start;
  }
  return {bodies, states};
}

/// Checks the derivatives of a pile's rollouts by the network's parameters. `reaches` is the least number of
/// contact points that the last frame must have.
template <class L = Law>
void check_pile(const std::vector<int>& kinds, std::size_t reaches,
                SceneStep::Velocity velocity = SceneStep::Velocity::instant, const PhysicsTerms& terms = {},
                ContactMoment moment = ContactMoment::halfway, bool resisted = false) {
  using Net = typename L::Network;
  for (const int kind : kinds) CAPTURE(kind);
  const bool impact = moment == ContactMoment::impact;
  auto law = random_law<L>(7, 0.3);
  law.scales.moment = moment;
  if constexpr (L::corrects) law.weight = 0.7;
  const Plane<double> floor{{0, 0, 1}, 0.01, {}};
  const Trajectory still = impact ? closing(kinds, floor) : pile(kinds, 3);
  Resistance resistance;
  std::vector<Wrench<double>> wrenches;
  if (resisted) {
    // So strong that a frame shows it.
    resistance = {{.density = 30, .rotational_drag = 1}, {.linear = 3, .angular = 5}};
    Random r(9);
    for (std::size_t i = 0; i < kinds.size(); ++i)
      wrenches.push_back({random_vector(r, 20), random_vector(r, 1)});
  }
  std::vector<Body<double>> bodies;
  for (int i = 0; i < still.bodies(); ++i) bodies.push_back(still.body(i));
  const TrajectorySet set(0.01, {0.3, 0, -9.81}, {floor}, {{bodies, still.states(), wrenches}}, resistance);
  constexpr double infinite = std::numeric_limits<double>::infinity();
  // Caps stay far away: beyond them there is no derivative.
  const Rollouts<L> rollouts(law, set, 3, 1, {{100, 1e4}, {1, 1e4}, {1, 1e4}, {0.1, 1e4}, infinite, terms},
                             velocity);
  const std::vector<std::uint32_t> items{0};
  auto scratch = rollouts.scratch();
  ParameterGradient<Net> gradient;
  Net network = law.network;
  const double value = rollouts.differentiate(network, items, {}, scratch, gradient);
  CHECK(rollouts.value(network, items, scratch) == doctest::Approx(value).epsilon(1e-12));
  if (terms.any()) {
    const Rollouts<L> without(law, set, 3, 1, {{100, 1e4}, {1, 1e4}, {1, 1e4}, {0.1, 1e4}}, velocity);
    CHECK(without.value(network, items, scratch) < 0.999 * value);
  }
  CHECK(scratch.frames[2].all[0].contacts.contacts.size() >= reaches);
  if (impact) {
    // Moments that depend on what the frames before have done, and answers to what others have changed.
    if (!L::corrects) CHECK(scratch.frames[2].answers > 2);
    int moments = 0;
    for (const std::size_t frame : {1u, 2u})
      for (const auto& answer : scratch.frames[frame].answered())
        for (const auto& contact : answer.contacts.contacts) moments += contact.moment.touching;
    CHECK(moments > 0);
  }
  if constexpr (L::corrects) {
    const auto& frame = scratch.frames[impact ? 2 : 0];
    CHECK(frame.all[0].before != frame.flown);
  }
  double worst = 0, largest = 0;
  for (const ParameterTensor& tensor : Net::tensors()) {
    for (int row = 0; row < tensor.rows; ++row) {
      const int column = row % tensor.columns;
      double& number = network.parameters()[tensor.index(row, column)];
      const double before = number, h = 3e-7;
      number = before + h;
      const double above = rollouts.value(network, items, scratch);
      number = before - h;
      const double below = rollouts.value(network, items, scratch);
      number = before;
      const double difference = (above - below) / (2 * h);
      worst = std::max(worst, std::abs(difference - gradient.numbers()[tensor.index(row, column)]));
      largest = std::max(largest, std::abs(difference));
    }
  }
  CHECK(largest > 0.1);
  CHECK(worst < 1e-6 * largest);
}

}  // namespace

TEST_CASE("rollouts beside a plane have the derivatives of central differences") {
  check_pile({0}, 1);
  check_pile({1}, 8);
  check_pile({2}, 2);
}

TEST_CASE("rollouts of every pair of shapes have the derivatives of central differences") {
  for (int first = 0; first < 3; ++first)
    for (int second = 0; second < 3; ++second) check_pile({first, second}, 3);
}

TEST_CASE("rollouts of three bodies that share contacts have the derivatives of central differences") {
  check_pile({0, 2, 0}, 4);
}

TEST_CASE("rollouts of velocities that are means have the derivatives of central differences") {
  check_pile({1, 0}, 4, SceneStep::Velocity::mean);
}

TEST_CASE("rollouts of a correction of the analytic law have the derivatives of central differences") {
  for (const auto& kinds : {std::vector{1}, {0, 1}, {1, 1}, {2, 0, 1}}) check_pile<Hybrid>(kinds, 3);
}

TEST_CASE("rollouts of impacts at their own moments have the derivatives of central differences") {
  constexpr auto instant = SceneStep::Velocity::instant;
  const auto check = [&](const std::vector<int>& kinds) {
    check_pile(kinds, 1, instant, {}, ContactMoment::impact);
  };
  for (int first = 0; first < 3; ++first) {
    check({first});
    for (int second = 0; second < 3; ++second) check({first, second});
  }
  check({0, 2, 0});
  check_pile<Hybrid>({2, 0, 1}, 1, instant, {}, ContactMoment::impact);
}

TEST_CASE("rollouts in a fluid, of bodies with wrenches, have the derivatives of central differences") {
  constexpr auto instant = SceneStep::Velocity::instant, mean = SceneStep::Velocity::mean;
  check_pile({0}, 1, instant, {}, ContactMoment::halfway, true);
  check_pile({1, 0}, 1, mean, {}, ContactMoment::halfway, true);
  check_pile({2, 1}, 1, instant, {}, ContactMoment::impact, true);
  check_pile<Hybrid>({2, 0, 1}, 3, instant, {}, ContactMoment::halfway, true);
}

TEST_CASE("terms of physics have the derivatives of central differences") {
  constexpr auto instant = SceneStep::Velocity::instant;
  check_pile({1, 0}, 4, instant, {.energy = 300});
  check_pile({1, 2}, 4, instant, {.penetration = 5000});
  check_pile({0, 1}, 4, instant, {.complementarity = 200});
  check_pile<Hybrid>({2, 0, 1}, 3, instant, {.energy = 10, .penetration = 300, .complementarity = 20});
}

TEST_CASE("rollouts that make no sense are refused") {
  const auto law = random_law<Law>(7, 0.3);
  const TrajectorySet set(0.01, {}, {}, {pile({0}, 3)}), other(0.02, {}, {}, {pile({0}, 3)});
  CHECK_NOTHROW(Rollouts<Law>(law, set, 3, 1));
  CHECK_THROWS_WITH_AS(Rollouts<Law>(law, set, 4, 1),
                       "Rollouts: scenes: expected one of at least 5 frames, found none", Error);
  CHECK_THROWS_WITH_AS(Rollouts<Law>(law, other, 1, 1),
                       "Rollouts: frame time of the trajectories: expected 0.01 s, found 0.02", Error);
  CHECK_THROWS_AS(Rollouts<Law>(law, set, 0, 1), Error);
  CHECK_THROWS_AS(Rollouts<Law>(law, set, 1, 0), Error);
}
