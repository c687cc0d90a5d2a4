// Compounds have neither lanes nor learned contact laws: both must not compile. The test looks for the words.
#include <rbres/learn/hybrid_law.hpp>
#include <rbres/sim/batch.hpp>

#ifndef RBRES_LANES
#define RBRES_LANES double
#endif
using Shape = rbres::Compound<double, 2>;

int main() {
  const auto system = rbres::System<double, 1, Shape>::of(rbres::Body(Shape{{rbres::Sphere{0.1}}}, 1.0));
  const auto start = [](std::ptrdiff_t) { return rbres::SystemState<double, 1>{}; };
  const auto forces = [](const auto&) { return rbres::Forces{}; };
  const auto observe = [](const auto&) {};
  rbres::simulate_batch<RBRES_LANES>(system, 1, start, forces, rbres::Rk4{}, {}, observe);
#ifdef RBRES_LEARNED
  rbres::SystemState<double, 1> y;
  rbres::simulate(system, y, rbres::Forces{}, rbres::Rk4{}, rbres::HybridLaw<>{}, {});
#endif
}
