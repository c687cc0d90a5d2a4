// Work of each kind that instruction sets change, in the namespace RBRES_BUILD.
#include "work.hpp"

#include <array>
#include <numeric>
#include <rbres/core/pack.hpp>
#include <rbres/core/parallel.hpp>
#include <rbres/core/vector.hpp>
#include <rbres/nn/residual_network.hpp>

namespace RBRES_BUILD {

using namespace rbres;

Results work() {
  Results results;
  const ResidualNetwork<float, 13, 32, 1, 13> network(1);
  const Eigen::Vector<float, 13> inputs = Eigen::Vector<float, 13>::LinSpaced(-1, 1);
  results.network = static_cast<double>(network.forward(inputs).norm());

  using Lanes = Pack<double, native_lanes<double>>;
  results.norm = ScalarTraits<Lanes>::lane(norm(Vec3<Lanes>(Lanes(2), Lanes(3), Lanes(6))), 0);

  std::array<double, 4> numbers{};
  parallel_for(4, 2,
               [&](std::ptrdiff_t i) { numbers[static_cast<std::size_t>(i)] = static_cast<double>(i); });
  results.sum = std::accumulate(numbers.begin(), numbers.end(), 0.0);
  return results;
}

void refuse() {
  parallel_for(1, -1, [](std::ptrdiff_t) {});
}

}  // namespace RBRES_BUILD
