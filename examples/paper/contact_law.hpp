// A contact law, learned in the paper's own worlds: where bodies go between their contacts is known, and a
// network says what an impact does.
#pragma once

#include <filesystem>
#include <functional>
#include <rbres/learn/contact_law.hpp>
#include <rbres/learn/learn_contacts.hpp>
#include <rbres/paper/paper.hpp>
#include <span>

#include "plan.hpp"

namespace paper {

/// Impacts come one after the other, so that one round is enough.
using Law = ContactLaw<48, 1>;

/// Learns from scenarios that no table is made of; resumes from the checkpoint where there is one, and leaves
/// one every few seconds. Says after each epoch how far it is. Compiled once, as all of this file.
template <BodySet Set>
Law learn_law(World world, const LawProtocol& protocol, std::uint64_t seed,
              const std::filesystem::path& checkpoint,
              const std::function<void(const ContactLearningReport&)>& say);

/// A law as a predictor of scenarios, frame by frame. The law must outlive it.
template <BodySet Set>
struct LawScenario {
  using State = SystemState<double, Scenario::most_bodies>;
  using Wrenches = std::array<Wrench<double>, Scenario::most_bodies>;

  World world;
  const Law* law;
  double horizon;  ///< s

  State operator()(const State& y, const Wrenches& wrench, int present) const {
    std::array<State, 1> next;
    rollout(y, wrench, next, present);
    return next[0];
  }
  /// Fills `states` with the states 1, 2, ... horizons later.
  void rollout(const State& y, const Wrenches& wrench, std::span<State> states, int present) const;
};

extern template struct LawScenario<BodySet::standard>;
extern template struct LawScenario<BodySet::box>;

}  // namespace paper
