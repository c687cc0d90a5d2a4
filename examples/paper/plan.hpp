// What the experiment trains and on how much: the plan, and the names of its parts.
#pragma once

#include <rbres/rbres.hpp>
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

inline std::string name(Architecture a) {
  constexpr const char* names[] = {"residual K=10", "residual K=4", "feed-forward K=4", "shallow 2x256"};
  return names[static_cast<int>(a)];
}
inline std::string name(Target t) { return t == Target::residual ? "residual target" : "state target"; }

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

struct Plan {
  std::vector<double> horizons;  ///< s
  std::vector<Unit> units;
  std::vector<BodySet> sets;
  int floor_scenarios;  ///< test scenarios for the predictability floor
  int timed_scenarios;  ///< scenarios per timing round
  double rollout_seconds;
  int rollouts;                 ///< test scenarios rolled out
  std::size_t rollout_horizon;  ///< number of the horizon whose predictor is rolled out
};

/// About a minute on two cores: the standard set in both worlds at two horizons.
inline Plan quick_plan() {
  Plan plan{{0.02, 0.1, 0.5}, {}, {BodySet::standard}, 100, 20, 3, 20, 1};
  const Protocol small{20'000, 16};
  for (const World world : {World::free_space, World::room}) {
    for (const std::size_t h : {std::size_t{1}, std::size_t{2}}) {
      plan.units.push_back(
          {world, BodySet::standard, h, Target::residual, Architecture::residual4, 1, small});
    }
    plan.units.push_back({world, BodySet::standard, 2, Target::state, Architecture::residual4, 1, small});
    plan.units.push_back({world, BodySet::standard, 2, Target::residual, Architecture::shallow, 1, small});
  }
  return plan;
}

/// The whole experiment. The full protocol of the paper (100,000 scenarios, up to 200 epochs, 10 blocks) is
/// spent where the question is whether the paper's claim holds: its own horizon of 5 s with its own target,
/// and 0.5 s, the longest horizon at which most contacts are still predictable. All other questions are
/// answered by a reduced protocol, with three seeds at 0.1, 0.5 and 1 s.
inline Plan full_plan() {
  Plan plan{{0.02, 0.1, 0.5, 1, 2, 5}, {}, {BodySet::standard, BodySet::box}, 500, 100, 20, 200, 2};
  const Protocol full{100'000, 200}, reduced{20'000, 40};
  for (const World world : {World::free_space, World::room}) {
    for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
      for (const BodySet set : plan.sets) {
        for (const Target target : {Target::residual, Target::state}) {
          plan.units.push_back({world, set, h, target, Architecture::residual4, 1, reduced});
        }
      }
      plan.units.push_back(
          {world, BodySet::standard, h, Target::residual, Architecture::forward4, 1, reduced});
      plan.units.push_back(
          {world, BodySet::standard, h, Target::residual, Architecture::shallow, 1, reduced});
    }
    for (const std::size_t h : {std::size_t{1}, std::size_t{2}, std::size_t{3}}) {
      for (const std::uint64_t seed : {2u, 3u}) {
        for (const auto a : {Architecture::residual4, Architecture::forward4, Architecture::shallow}) {
          plan.units.push_back({world, BodySet::standard, h, Target::residual, a, seed, reduced});
        }
      }
    }
  }
  plan.units.push_back(
      {World::free_space, BodySet::standard, 5, Target::state, Architecture::residual10, 1, full});
  plan.units.push_back(
      {World::free_space, BodySet::standard, 2, Target::residual, Architecture::residual10, 1, full});
  plan.units.push_back(
      {World::room, BodySet::standard, 2, Target::residual, Architecture::residual10, 1, full});
  return plan;
}

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
