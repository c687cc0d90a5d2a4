// A contact law, learned in the paper's own worlds: where bodies go between their contacts is known, and a
// network says what an impact does.
#pragma once

#include <filesystem>
#include <rbres/learn/hybrid_law.hpp>
#include <rbres/learn/learn_contacts.hpp>
#include <rbres/paper/paper.hpp>
#include <span>

#include "plan.hpp"
#include "work.hpp"

namespace paper {

/// Impacts come one after the other, so that one round is enough.
template <LawKind Kind>
using LawOf = std::conditional_t<Kind == LawKind::alone, ContactLaw<48, 1>, HybridLaw<48, 1>>;

/// A law as a predictor of scenarios, frame by frame. The law must outlive it. Compiled once.
template <LawKind Kind, BodySet Set>
struct LawScenario {
  using State = SystemState<double, Scenario::most_bodies>;
  using Wrenches = std::array<Wrench<double>, Scenario::most_bodies>;
  using Law = LawOf<Kind>;

  World world;
  const Law* law;
  double horizon;  ///< s

  /// Learns from scenarios that no table is made of; resumes from the checkpoint where there is one.
  static Law learn(World world, const LawProtocol& protocol, std::uint64_t seed,
                   const std::filesystem::path& checkpoint, const UnitRun& run);

  State operator()(const State& y, const Wrenches& wrench, int present) const {
    std::array<State, 1> next;
    rollout(y, wrench, next, present);
    return next[0];
  }
  /// Fills `states` with the states 1, 2, ... horizons later.
  void rollout(const State& y, const Wrenches& wrench, std::span<State> states, int present) const;
};

extern template struct LawScenario<LawKind::alone, BodySet::standard>;
extern template struct LawScenario<LawKind::alone, BodySet::box>;
extern template struct LawScenario<LawKind::hybrid, BodySet::standard>;
extern template struct LawScenario<LawKind::hybrid, BodySet::box>;

/// Calls with(std::integral_constant<LawKind, Kind>).
template <class With>
auto with_law(LawKind kind, const With& with) {
  if (kind == LawKind::alone) return with(std::integral_constant<LawKind, LawKind::alone>{});
  return with(std::integral_constant<LawKind, LawKind::hybrid>{});
}

}  // namespace paper
