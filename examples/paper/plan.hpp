// What the experiment trains and on how much: the plan, and the names of its parts.
#pragma once

#include <algorithm>
#include <rbres/paper/paper.hpp>
#include <rbres/rbres.hpp>
#include <sstream>
#include <string>
#include <vector>

namespace paper {

using namespace rbres;

/// How much one network is trained.
struct Protocol {
  int scenarios;  ///< 80 % train, 10 % validate, 10 % test
  int epochs;
};

enum class Architecture { residual10, residual4, forward4, shallow };

/// What a learned law stands on: nothing but free flight, or the contacts of discrete simulation, which it
/// corrects (the paper's hybrid).
enum class LawKind { alone, hybrid };

inline std::string name(Architecture a) {
  constexpr const char* names[] = {"residual K=10", "residual K=4", "feed-forward K=4", "shallow 2x256"};
  return names[static_cast<int>(a)];
}
inline std::string name(Target t) { return t == Target::residual ? "residual target" : "state target"; }

/// How much a contact law is trained, see contact_law.hpp.
struct LawProtocol {
  int scenarios;  ///< of 2 s each; as many as a fifth of them choose the best weights
  int epochs;     ///< of 16-frame rollouts, by two
};

/// One network to train: a unit of work that is finished or not.
struct Unit {
  World world;
  BodySet set;
  std::size_t horizon;  ///< number in Plan::horizons
  Target target;
  Architecture architecture;
  std::uint64_t seed;
  Protocol protocol;
};

/// One contact law to learn.
struct LawUnit {
  World world;
  BodySet set;
  LawKind kind;
  std::uint64_t seed;
};

struct Plan {
  std::vector<double> horizons;  ///< s
  std::vector<Unit> units;
  std::vector<LawUnit> laws;
  std::vector<BodySet> sets;
  std::vector<std::size_t> tabled;  ///< numbers of the horizons that tables show
  LawProtocol law;
  int floor_scenarios;  ///< test scenarios for the predictability floor
  int timed_scenarios;  ///< scenarios per timing round; 72 fill lanes with every family and body count
  int timing_rounds;
  double rollout_seconds;
  int rollouts;                 ///< test scenarios rolled out
  std::size_t rollout_horizon;  ///< number of the horizon whose predictor is rolled out
  std::size_t figure_horizon;   ///< number of the horizon that the figures show
};

/// Some minutes on two cores: the standard set in both worlds at two horizons.
inline Plan quick_plan() {
  Plan plan{{0.02, 0.1, 0.5}, {}, {}, {BodySet::standard}, {1, 2}, {300, 2}, 200, 72, 5, 3, 20, 1, 2};
  const Protocol small{20'000, 12};
  for (const World world : {World::free_space, World::room}) {
    const auto add = [&](std::size_t h, Target target, Architecture a) {
      plan.units.push_back({world, BodySet::standard, h, target, a, 1, small});
    };
    plan.laws.push_back({world, BodySet::standard, LawKind::alone, 1});
    add(1, Target::residual, Architecture::residual4);
    add(2, Target::residual, Architecture::residual4);
    add(2, Target::state, Architecture::residual4);
    add(2, Target::residual, Architecture::shallow);
  }
  return plan;
}

/// The whole experiment. The full protocol of the paper (100,000 scenarios, up to 200 epochs, 10 blocks) is
/// spent where the question is whether the paper's claim holds: at its own horizon of 5 s with its own
/// target, and at 0.5 s, the longest horizon at which most contacts are still predictable. All other
/// questions are answered by a reduced protocol (20,000 scenarios). What tables compare has three seeds.
inline Plan full_plan() {
  Plan plan{{0.02, 0.1, 0.5, 1, 2, 5},
            {},
            {},
            {BodySet::standard, BodySet::box},
            {1, 2, 3, 5},
            {1000, 4},
            500,
            72,
            5,
            20,
            200,
            2,
            2};
  constexpr std::size_t half_second = 2, paper = 5;
  const Protocol full{100'000, 200}, reduced{20'000, 40};
  for (const World world : {World::free_space, World::room}) {
    for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
      const bool is_tabled = std::ranges::find(plan.tabled, h) != plan.tabled.end();
      const auto add = [&](BodySet set, Target target, Architecture a, std::uint64_t seed) {
        plan.units.push_back({world, set, h, target, a, seed, reduced});
      };
      for (const std::uint64_t seed : {1u, 2u, 3u}) {
        if (seed > 1 && !is_tabled) break;
        add(BodySet::standard, Target::residual, Architecture::residual4, seed);
        add(BodySet::standard, Target::residual, Architecture::forward4, seed);
        add(BodySet::standard, Target::residual, Architecture::shallow, seed);
        add(BodySet::standard, Target::state, Architecture::residual4, seed);
        if (!is_tabled) continue;
        add(BodySet::box, Target::residual, Architecture::residual4, seed);
        add(BodySet::box, Target::state, Architecture::residual4, seed);
      }
      if (is_tabled) add(BodySet::standard, Target::state, Architecture::forward4, 1);
    }
    for (const std::uint64_t seed : {1u, 2u, 3u}) {
      plan.units.push_back(
          {world, BodySet::standard, half_second, Target::residual, Architecture::residual10, seed, full});
      plan.laws.push_back({world, BodySet::standard, LawKind::alone, seed});
      plan.laws.push_back({world, BodySet::standard, LawKind::hybrid, seed});
      plan.laws.push_back({world, BodySet::box, LawKind::alone, seed});
    }
  }
  for (const std::uint64_t seed : {1u, 2u, 3u})
    plan.units.push_back(
        {World::free_space, BodySet::standard, paper, Target::state, Architecture::residual10, seed, full});
  return plan;
}

/// What tables call a contact law.
inline std::string name(LawKind kind) {
  return kind == LawKind::alone ? "learned contacts" : "RK4 20 ms, corrected";
}

/// A world and a set: "free-standard".
inline std::string label_of(World world, BodySet set) {
  return std::string(rbres::name(world)) + "-" + std::string(rbres::name(set));
}
/// Where results hold the contact laws.
inline std::string law_results(LawKind kind) { return kind == LawKind::alone ? "laws" : "hybrids"; }
/// A contact law in files.
inline std::string name(const LawUnit& law) {
  return (law.kind == LawKind::alone ? "law-" : "hybrid-") + label_of(law.world, law.set) + "-seed" +
         std::to_string(law.seed);
}
/// Calls each(law) for those of a world and set; `seed` 0 stands for all seeds.
template <class Each>
void for_laws(const Plan& plan, World world, BodySet set, std::uint64_t seed, const Each& each) {
  for (const LawUnit& law : plan.laws)
    if (law.world == world && law.set == set && (seed == 0 || law.seed == seed)) each(law);
}
/// What a unit's network is called in tables, whatever its protocol and seed.
inline std::string method_of(const Unit& u) { return name(u.architecture) + ", " + name(u.target); }

/// The unit's name in files and tables.
inline std::string name(const Unit& u, const Plan& plan) {
  constexpr const char* architectures[] = {"residual10", "residual4", "forward4", "shallow"};
  std::ostringstream out;
  out << rbres::name(u.world) << '-' << rbres::name(u.set) << "-h" << plan.horizons[u.horizon] << '-'
      << (u.target == Target::residual ? "residual" : "state") << '-'
      << architectures[static_cast<int>(u.architecture)] << "-seed" << u.seed << "-n" << u.protocol.scenarios
      << "-e" << u.protocol.epochs;
  return out.str();
}

}  // namespace paper
