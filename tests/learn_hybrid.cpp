// A learned correction of the analytic law: what it starts from, what it keeps, and how it stands in the
// simulator.
#include <doctest/doctest.h>

#include <cmath>
#include <rbres/body/mechanics.hpp>
#include <rbres/learn/contact_law_simulator.hpp>
#include <rbres/learn/learn_contacts.hpp>
#include <rbres/learn/scene_simulator.hpp>
#include <rbres/sim/simulate.hpp>

#include "../examples/common/count_allocations.hpp"
#include "learn_support.hpp"

using namespace rbres;
using namespace learn_support;

namespace {

using Law = HybridLaw<16, 2, double>;

System<double, 4> material_heap(std::vector<Plane<double>> planes = {}) {
  const Material<double> material{0.4, 0.3};
  for (Plane<double>& plane : planes) plane.material = material;
  const auto plain = heap();
  return {{plain[0].scaled(1, 1, 1, material), plain[1].scaled(1, 1, 1, material),
           plain[2].scaled(1, 1, 1, material), plain[3].scaled(1, 1, 1, material)},
          std::move(planes)};
}

SystemState<double, 4> analytic_frame(const System<double, 4>& system, SystemState<double, 4> y,
                                      const Gravity<double>& gravity = {}) {
  Stepper stepper(system, gravity, Rk4{}, {.step = 0.01, .contacts = ContactMode::discrete});
  stepper.step(y, 0, 0.01);
  return y;
}

/// The heap dropped onto a floor, by the analytic law.
TrajectorySet drops(int scenes, int frames) {
  const auto system = material_heap({floor_plane<double>()});
  std::vector<Trajectory> all;
  for (int s = 0; s < scenes; ++s) {
    auto y = close_together(static_cast<std::uint64_t>(s));
    std::vector<RigidState<double>> states(y.body.begin(), y.body.end());
    for (int t = 0; t < frames; ++t) {
      y = analytic_frame(system, y);
      states.insert(states.end(), y.body.begin(), y.body.end());
    }
    all.push_back({{system[0], system[1], system[2], system[3]}, states});
  }
  return {0.01, Gravity<double>{}.g, system.planes(), all};
}

}  // namespace

TEST_CASE("before training a hybrid is the analytic law, and so is one of weight 0") {
  const TrajectorySet set = drops(3, 30);
  auto untrained = untrained_law<Law>(set, {.seed = 1}), weightless = law_of_some_moment<Law>(1, 0.05);
  weightless.weight = 0;
  for (const Law* law : {&untrained, &weightless}) {
    for (const Trajectory& scene : set) {
      ContactLawSimulator<Law> hybrid(set, scene, *law);
      SceneSimulator analytic(set, scene, {}, {});
      SceneState found{{scene.frame(0).begin(), scene.frame(0).end()}}, expected = found;
      const long before = allocations;
      for (int t = 0; t < 30; ++t) hybrid(found);
      CHECK(allocations == before);
      for (int t = 0; t < 30; ++t) analytic(expected);
      CHECK(found.body == expected.body);
      CHECK(distance(found[0], scene.state(0, 0)) > 0.1);
    }
  }
}

TEST_CASE("a correction keeps linear and angular momentum") {
  const auto system = material_heap();
  const Gravity<double> weightless{{0, 0, 0}};
  const double corrected = check_momentum(
      system, [&](const auto& y) { return analytic_frame(system, y, weightless); },
      [&](std::uint64_t seed, const auto& y) {
        auto law = law_of_some_moment<Law>(seed, 0.05);
        law.weight = 0.5;
        return one_frame(system, y, law, weightless);
      });
  CHECK(corrected > 0.3);
}

TEST_CASE("a hybrid turns with the world") {
  Random r(5);
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const auto law = law_of_some_moment<Law>(seed, 0.05);
    const Quat<double> turn = random_orientation(r);
    const Vec3<double> shift = random_vector(r, 2), up{0, 0, 1}, normal = rotate(turn, up);
    const Gravity<double> gravity{{0.5, 0, -9.81}};
    const auto system = material_heap({{up, 0.02, {}}}),
               turned_system = material_heap({{normal, 0.02 + dot(normal, shift), {}}});
    const auto y = close_together(seed), expected = turned(one_frame(system, y, law, gravity), turn, shift);
    const auto found =
        one_frame(turned_system, turned(y, turn, shift), law, Gravity<double>{rotate(turn, gravity.g)});
    for (int i = 0; i < 4; ++i) CHECK(distance(found[i], expected[i]) < 1e-9);
  }
}
