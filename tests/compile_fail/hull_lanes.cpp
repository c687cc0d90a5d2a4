// Convex hulls have no lanes: a batch of them in lanes must not compile. The test looks for the words.
#include <rbres/sim/batch.hpp>

#ifndef RBRES_LANES
#define RBRES_LANES double
#endif
using Shape = rbres::AnyConvexShape<double>;

int main() {
  const auto system = rbres::System<double, 1, Shape>::of(
      rbres::Body<double, Shape>(rbres::ConvexHull<double>::cylinder(0.1, 0.1, 8), 1.0));
  const auto start = [](std::ptrdiff_t) { return rbres::SystemState<double, 1>{}; };
  const auto forces = [](const auto&) { return rbres::Forces{}; };
  const auto observe = [](const auto&) {};
  rbres::simulate_batch<RBRES_LANES>(system, 1, start, forces, rbres::Rk4{}, {}, observe);
}
