#pragma once

#include <rbres/learn/contact_law.hpp>

namespace rbres::RBRES_ABI {

/// A learned correction of Newton's restitution and Coulomb's friction, after the hybrid of the paper: each
/// frame is that of discrete contacts (see ContactMode) with the bodies' own materials, and the network's
/// impulses come on top, `weight` times as strong. They follow from the frame's free flight, as those of a
/// ContactLaw do: what the analytic law makes of it, it makes by the same rule every time, so that nothing is
/// hidden from the network. The analytic law is not cut into impulses of contact points: those that share a
/// body are solved together, and a sum of answers to each alone would be another law, not the one that was
/// identified. An untrained hybrid is that law to the bit, and so is one of weight 0. Linear and angular
/// momentum are kept as far as the analytic law keeps them.
template <int Width = 48, int Rounds = 2, std::floating_point T = float, WeightOf<T> W = T>
struct HybridLaw : ContactLaw<Width, Rounds, T, W> {
  /// Discrete contacts come first.
  static constexpr bool corrects = true;
  /// How strong the network's impulses are.
  double weight = 1;

  /// Takes one system's state over frames.
  template <class System>
  using Step = detail::LawStep<HybridLaw, System>;
};

/// The same law with its network's weights kept as W, each rounded to the nearest.
template <class W, int Width, int Rounds, std::floating_point T, class Kept>
HybridLaw<Width, Rounds, T, W> with_weights(const HybridLaw<Width, Rounds, T, Kept>& law) {
  const ContactLaw<Width, Rounds, T, Kept>& network = law;
  return {with_weights<W>(network), law.weight};
}

}  // namespace rbres::RBRES_ABI
