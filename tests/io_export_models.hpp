#pragma once

#include <rbres/learn/hybrid_law.hpp>
#include <rbres/nn/residual_network.hpp>

inline auto exported_float() { return rbres::ResidualNetwork<float, 7, 20, 2, 5>(11); }

inline auto exported_double() {
  using namespace rbres;
  return Network<double, Sequential<Linear<3, 6>, Tanh, Linear<6, 4>, Silu>>(12);
}

/// A law of any numbers.
template <class Law>
Law any_law() {
  Law law;
  law.network = typename Law::Network(13);
  for (auto& number : law.input.mean) number = static_cast<typename Law::Scalar>(0.1);
  law.input.mean[3] = static_cast<typename Law::Scalar>(-0.7);
  law.input.deviation[5] = static_cast<typename Law::Scalar>(1.3);
  law.scales = {.frame_time = 1.0 / 300, .speed = 0.7, .margin = 0.013};
  return law;
}
inline auto exported_law() { return any_law<rbres::ContactLaw<6, 2>>(); }
inline auto exported_hybrid() {
  auto law = any_law<rbres::HybridLaw<5, 1, double>>();
  law.weight = 0.3;
  return law;
}
