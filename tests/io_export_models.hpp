#pragma once

#include <rbres/learn/hybrid_law.hpp>
#include <rbres/nn/residual_network.hpp>
#include <rbres/predict/predictor.hpp>

inline auto exported_float() { return rbres::ResidualNetwork<float, 7, 20, 2, 5>(11); }

inline auto exported_half() {
  return rbres::ResidualNetwork<float, 7, 20, 2, 5, rbres::bfloat16>(exported_float());
}

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
inline auto exported_half_law() { return rbres::with_weights<rbres::bfloat16>(exported_law()); }
inline auto exported_hybrid() {
  auto law = any_law<rbres::HybridLaw<5, 1, double>>();
  law.weight = 0.3;
  law.scales.moment = rbres::ContactMoment::impact;
  return law;
}

/// A predictor of a ball, a box that no uniform solid is, and a static capsule.
inline auto exported_predictor() {
  using namespace rbres;
  const System<double, 3> bodies({Body<double>(Sphere{0.1}, 1.0 / 3),
                                  Body<double>(Box{0.1, 0.2, 0.3}, 2.0, Vec3<double>{0.1, 0.12, 0.11}),
                                  Body<double>::kinematic(Capsule{0.1, 0.7})});
  using Net = Network<float, Sequential<Linear<57, 8>, Tanh, Linear<8, 39>>>;
  Predictor<Net, 3> p{Net(14),          {},  {}, {bodies, {{0.1, 0, -9.7}}, {1.1, 0.5, 0.02}, {0.3, 0.2}},
                      Target::residual, 0.07};
  for (int i = 0; i < 39; ++i)
    p.output.deviation[i] = 0.01f * static_cast<float>(i + 1), p.output.mean[i] = 0.1f;
  for (int i = 0; i < 57; ++i)
    p.input.deviation[i] = 1 + 0.1f * static_cast<float>(i), p.input.mean[i] = -0.3f;
  return p;
}
