// Learning a contact law from trajectories that rbres itself made.
#include <doctest/doctest.h>

#include <algorithm>
#include <rbres/learn/learn_contacts.hpp>
#include <rbres/sim/simulate.hpp>

#include "error_of.hpp"
#include "learn_support.hpp"

using namespace rbres;
using namespace learn_support;

namespace {

using Law = ContactLaw<16, 2>;

/// A ball and a box dropped onto a floor.
template <class Bodies>
Trajectory drop(const Bodies& bodies, std::uint64_t seed, int frames) {
  const System<double, 2> system(bodies, {floor_plane(bodies[0].material())});
  Random r(seed);
  SystemState<double, 2> y;
  for (int i = 0; i < 2; ++i) {
    y[i].position = Vec3<double>{0.5 * i, 0, 0.3} + random_vector(r, 0.02);
    y[i].orientation = random_orientation(r);
    y[i].velocity = random_vector(r, 0.5);
    y[i].angular_velocity = random_vector(r, 3);
  }
  std::vector<RigidState<double>> states;
  simulate(system, y, Gravity{}, Rk4{},
           {.step = 1e-3, .duration = 0.01 * frames, .sample_rate = 100, .contacts = ContactMode::discrete},
           [&](double, const auto& now) { states.insert(states.end(), now.body.begin(), now.body.end()); });
  return {{bodies.begin(), bodies.end()}, states};
}
TrajectorySet drops(int scenes, std::uint64_t seed, int frames = 50) {
  const Material<double> material{0.4, 0.5};
  const std::array<Body<double>, 2> bodies{Body<double>{Sphere{0.1}, 1.0, material},
                                           Body<double>{Box{0.08, 0.1, 0.12}, 2.0, material}};
  std::vector<Trajectory> all;
  for (int s = 0; s < scenes; ++s) all.push_back(drop(bodies, seed + static_cast<std::uint64_t>(s), frames));
  return {0.01, {0, 0, -9.81}, {floor_plane(material)}, all};
}

const ContactLearning brief{.stages = {{1, 1, 10, 32}, {4, 4, 4, 16}}, .seed = 5, .threads = 2};

/// The mean cost of frames that begin with the truth.
double cost(const Law& law, const TrajectorySet& set) {
  const Rollouts<Law> rollouts(law, set, 1, 1);
  return Evaluation<Law::Network, Rollouts<Law>>(rollouts, 2).mean(law.network, rollouts);
}

}  // namespace

TEST_CASE("a learned law is much better than none on scenes that it has not seen") {
  const auto train = drops(30, 1), validation = drops(3, 1000), test = drops(10, 2000);
  std::vector<double> shares;
  const Law law = learn_contacts<Law>(train, validation, brief, [&](const ContactLearningReport& report) {
    shares.push_back(report.share_done);
    return true;
  });
  CHECK(shares.size() == 14);
  CHECK(std::ranges::is_sorted(shares));
  CHECK(shares.back() == doctest::Approx(1));
  CHECK(law.scales.frame_time == 0.01);
  const double untrained = cost(untrained_law<Law>(train, {.seed = 5}), test);
  CHECK(cost(law, test) < 0.5 * untrained);

  SUBCASE("and has the same bits for any number of threads") {
    ContactLearning other = brief;
    other.threads = 1;
    const Law again = learn_contacts<Law>(train, validation, other);
    CHECK(std::ranges::equal(again.network.parameters(), law.network.parameters()));
  }
  SUBCASE("unless it is stopped early") {
    int epochs = 0;
    const Law stopped = learn_contacts<Law>(train, validation, brief,
                                            [&](const ContactLearningReport&) { return ++epochs < 2; });
    CHECK(epochs == 2);
    CHECK(cost(stopped, test) < untrained);
  }
}

TEST_CASE("an untrained law has no contacts, and knows the scales of its world") {
  const auto set = drops(4, 1);
  const Law law = untrained_law<Law>(set, {.seed = 1});
  CHECK(law.scales.speed > 0.3);
  CHECK(law.scales.speed < 5);
  CHECK(law.scales.margin == doctest::Approx(0.2 * law.scales.gap()));
  const Law wide = untrained_law<Law>(set, {.margin = 0.6, .seed = 1});
  CHECK(wide.scales.margin == doctest::Approx(0.6 * wide.scales.gap()));
  const System<double, 2> system({set[0].body(0), set[0].body(1)}, set.planes());
  long touching = 0;
  for (int t = 0; t < set[0].frames(); ++t) {
    SystemState<double, 2> y{{set[0].state(t, 0), set[0].state(t, 1)}};
    const auto flown = fly(system, Gravity{}, Rk4{}, y, 0.0, 0.01);
    touching += simulate(system, y, Gravity{}, Rk4{}, law, {.step = 0.01, .duration = 0.01}).touching;
    for (int i = 0; i < 2; ++i) CHECK((y[i].vector() - flown[i].vector()).norm() < 1e-12);
  }
  CHECK(touching > 0);
}

TEST_CASE("learning that makes no sense is refused") {
  const auto set = drops(1, 1);
  CHECK_THROWS_AS(learn_contacts<Law>(set, set, {.stages = {}}), Error);
  CHECK_THROWS_AS(learn_contacts<Law>(set, set, {.stages = {{1, 1, 0, 8}}}), Error);
  CHECK_THROWS_AS(learn_contacts<Law>(set, set, {.learning_rate = 0}), Error);
  // Scenes that the last stage finds too short are so before the first.
  const ContactLearning two_stages{.stages = {{1, 1, 1, 8}, {20, 1, 1, 8}}};
  const auto short_ones = drops(8, 1, 18);
  const auto refusal = [&](const auto& train, const auto& validation) {
    return error_of(
        [&] { learn_contacts<Law>(train, validation, two_stages, [](const auto&) -> bool { throw 1; }); });
  };
  CHECK(refusal(short_ones, set) ==
        "training scenes: Rollouts: scenes: expected one of at least 21 frames, found none");
  CHECK(refusal(set, short_ones) ==
        "validation scenes: Rollouts: scenes: expected one of at least 21 frames, found none");
  for (const double margin : {0.0, -1.0, std::nan("")})
    CHECK_THROWS_AS(learn_contacts<Law>(set, set, {.margin = margin}), Error);
  const std::vector<Body<double>> one{{Sphere{0.1}, 1.0}};
  const TrajectorySet apart(0.01, {}, {}, {{one, std::vector<RigidState<double>>(3)}});
  CHECK_THROWS_WITH_AS(learn_contacts<Law>(apart, apart),
                       "contacts of a trajectory set: expected at least one, found none", Error);
}
