#pragma once

#include <rbres/nn/residual_network.hpp>

inline auto exported_float() { return rbres::ResidualNetwork<float, 7, 20, 2, 5>(11); }

inline auto exported_double() {
  using namespace rbres;
  return Network<double, Sequential<Linear<3, 6>, Tanh, Linear<6, 4>, Silu>>(12);
}
