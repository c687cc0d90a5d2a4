// Systems whose type says how many planes there is room for: the same bits as others, and no heap.
#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <rbres/sim/batch.hpp>
#include <vector>

#include "../examples/common/count_allocations.hpp"
#include "error_of.hpp"

using namespace rbres;

namespace {

/// A ball, a box and a capsule over a floor and a wall; with P = dynamic on the heap.
template <int P>
System<double, 3, AnyShape<double>, P> three_bodies() {
  using Any = Body<double, AnyShape<double>>;
  const Material<double> material{0.3, 0.5};
  return {{Any(Sphere(0.1), 1.0, material), Any(Box{0.1, 0.15, 0.05}, 2.0, material),
           Any(Capsule(0.05, 0.1), 0.5, material)},
          {floor_plane(material), {{1, 0, 0}, -0.2, material}},
          {{0, 2}}};
}

SystemState<double, 3> in_the_air() {
  SystemState<double, 3> y;
  for (int i = 0; i < 3; ++i) {
    y[i].position = {0.02 * i, 0.01 * i, 0.3 + 0.3 * i};
    y[i].velocity = {-1, 0.1, 0};
    y[i].angular_velocity = {1.0 * i, 1, 2};
  }
  return y;
}

template <int P>
SystemState<double, 3> after_a_second(ContactMode mode) {
  const auto system = three_bodies<P>();
  auto y = in_the_air();
  simulate(system, y, Gravity{}, Rk4{}, {.step = 5e-3, .duration = 1, .contacts = mode});
  return y;
}

}  // namespace

TEST_CASE("room in the type changes no bit and takes nothing from the heap") {
  for (const ContactMode mode : {ContactMode::continuous, ContactMode::discrete}) {
    const auto heap = after_a_second<dynamic>(mode);
    CHECK(heap[0].position.z < 0.5);
    const long before = allocations;
    const auto fixed = after_a_second<3>(mode);
    CHECK(allocations == before);
    CHECK(fixed == heap);
  }
}

TEST_CASE("an observer hears as many impulses as there are, whatever the room") {
  struct Heard {
    std::vector<Impact<double>> impulses;
    void impact(const Impact<double>& impulse) { impulses.push_back(impulse); }
  };
  // A box that falls flat on the one plane, and an elastic ball that meets two planes many times in a step.
  const auto listen = [](const auto& system, SystemState<double, 1> y, double step) {
    Heard heard;
    const auto report = simulate(system, y, Gravity{}, Rk4{}, {.step = step, .duration = 0.5}, heard);
    CHECK(report.status == SimulationStatus::finished);
    return heard.impulses;
  };
  const auto equal = [](const Impact<double>& a, const Impact<double>& b) {
    return a.time == b.time && a.first == b.first && a.point == b.point && a.impulse == b.impulse;
  };
  const auto check_equal = [&](const auto& fixed, const auto& heap, const SystemState<double, 1>& y,
                               double step, std::size_t least) {
    const auto a = listen(fixed, y, step), b = listen(heap, y, step);
    CHECK(a.size() >= least);
    CHECK(std::equal(a.begin(), a.end(), b.begin(), b.end(), equal));
  };
  SystemState<double, 1> y;
  y[0].position.z = 0.3;
  const Body box(Box<double>{0.1, 0.1, 0.1}, 1.0, Material<double>{0.3, 0.5});
  check_equal(System<double, 1, Box<double>, 1>({box}, {floor_plane<double>()}),
              System<double, 1, Box<double>>({box}, {floor_plane<double>()}), y, 1e-3, 8);
  y[0].velocity.z = -20;
  const Material<double> elastic{1.0, 0.0};
  const Body ball(Sphere<double>{0.1}, 1.0, elastic);
  const Plane<double> floor = floor_plane(elastic), ceiling{{0, 0, -1}, -0.5, elastic};
  check_equal(System<double, 1, Sphere<double>, 2>({ball}, {floor, ceiling}),
              System<double, 1, Sphere<double>>({ball}, {floor, ceiling}), y, 0.05, 20);
}

TEST_CASE("a system of lanes has the same room") {
  const auto run = [](const auto& system) {
    SystemState<double, 3> end;
    simulate_batch<Pack<double, 2>>(
        system, 1, [](std::ptrdiff_t) { return in_the_air(); }, [](const auto&) { return Gravity{}; }, Rk4{},
        SimulationOptions{.step = 5e-3, .duration = 0.5}, [&](const auto& sample) { end = sample.state; }, 1);
    return end;
  };
  CHECK(run(three_bodies<3>()) == run(three_bodies<dynamic>()));
}

TEST_CASE("more planes than there is room for are refused") {
  using Any = Body<double, AnyShape<double>>;
  const auto with_planes = [](auto... planes) {
    return error_of([&] { System<double, 1, AnyShape<double>, 1>({Any(Sphere(0.1), 1.0)}, {planes...}); });
  };
  CHECK(with_planes() == "");
  CHECK(with_planes(floor_plane<double>()) == "");
  CHECK(with_planes(floor_plane<double>(), floor_plane<double>()) ==
        "elements of a list: expected at most 1, found 2");
  CHECK(System<double, 1, AnyShape<double>, 1>({Any(Sphere(0.1), 1.0)}).planes().empty());
}
