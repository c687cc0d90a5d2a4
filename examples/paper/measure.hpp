// Measures predictors and baselines on the test scenarios of one world and set.
#pragma once

#include <cstdio>

#include "../common/progress.hpp"
#include "../scenarios/compiled.hpp"
#include "plan.hpp"
#include "store.hpp"

namespace paper {

inline Json to_json(const Metrics& m) {
  const auto four = [](const double(&x)[4]) { return Json{x[0], x[1], x[2], x[3]}; };
  return {{"position", m.position},
          {"orientation", m.orientation},
          {"velocity", m.velocity},
          {"angular_velocity", m.angular_velocity},
          {"angle_deg", m.angle},
          {"relative", four(m.relative)},
          {"relative_median", four(m.relative_median)},
          {"relative_elementwise", four(m.elementwise)},
          {"energy", m.energy},
          {"pearson", m.pearson},
          {"within_half", m.within_half},
          {"bodies", m.bodies},
          {"collided", m.collided}};
}

/// The data of one world and set, and who is measured on it. Scenarios 0 ... tests - 1 are the test set of
/// every method.
template <BodySet Set>
struct Bench {
  static constexpr std::uint64_t seed = 1;  // of the scenarios

  const Plan& plan;
  const Store& store;
  World world;
  Eigen::Index tests;
  ScenarioData data;

  std::string label() const { return label_of(world, Set); }
  ScenarioSampler<Set> sampler() const { return {world, seed}; }

  /// All that decides what is found on this bench, beside the part's own setting.
  Json made_from() const {
    return {{"scenarios", scenario_version},
            {"seed", seed},
            {"truth_step", TruthOptions{}.step},
            {"horizons", plan.horizons},
            {"tests", tests},
            {"version", {RBRES_VERSION_MAJOR, RBRES_VERSION_MINOR, RBRES_VERSION_PATCH}}};
  }

  /// All accuracy figures of one method at horizon h.
  template <class Predict>
  Json method(std::size_t h, const Predict& predict, int threads = 0) const {
    return accuracy(h, predict_all(ScenarioTransitions(data, h), 0, tests, predict, threads));
  }

  Json accuracy(std::size_t h, const Eigen::MatrixXd& predicted) const {
    const ScenarioTransitions transitions(data, h);
    Json found = to_json(rbres::measure(transitions, 0, predicted, scenario_system<Set, 5>(world)));
    const auto quartiles = [&](const auto& chosen) {
      const Quartiles q =
          position_quartiles(transitions, 0, predicted, chosen);  // of none: NaN, which is null
      return Json{{"low", q.low}, {"median", q.median}, {"high", q.high}, {"count", q.count}};
    };
    found["all_scenarios"] = quartiles([](std::size_t) { return true; });
    for (const auto& [group, chosen] : groups(h)) found["families"][group] = quartiles(chosen);
    return found;
  }

  /// The families of this world, and the scenarios with and without collisions by horizon h, by name.
  std::vector<std::pair<std::string, std::function<bool(std::size_t)>>> groups(std::size_t h) const {
    std::vector<std::pair<std::string, std::function<bool(std::size_t)>>> all;
    for (const Family family : families()) {
      all.emplace_back(rbres::name(family),
                       [this, family](std::size_t s) { return data.family[s] == family; });
    }
    const auto impacts = [this, h](std::size_t s) {
      return data.impacts(static_cast<Eigen::Index>(h), static_cast<Eigen::Index>(s));
    };
    all.emplace_back("no collision", [=](std::size_t s) { return impacts(s) == 0; });
    all.emplace_back("one collision", [=](std::size_t s) { return impacts(s) == 1; });
    all.emplace_back("several collisions", [=](std::size_t s) { return impacts(s) > 1; });
    return all;
  }
  std::vector<Family> families() const {
    if (world == World::free_space) return {Family::flight, Family::pair, Family::cluster};
    return {Family::drop, Family::scatter};
  }

  /// Some velocity components, predicted and actual, of bodies in scenarios that had a contact.
  Json velocity_pairs(std::size_t h, const Eigen::MatrixXd& predicted) const {
    Json actual = Json::array(), guess = Json::array();
    const ScenarioTransitions transitions(data, h);
    for (Eigen::Index c = 0; c < predicted.cols() && actual.size() < 2000; ++c) {
      if (!transitions.had_impact(c)) continue;
      for (int b = 0; b < transitions.present(c); ++b) {
        for (int i = 13 * b + 7; i < 13 * b + 10; ++i) {
          actual.push_back(data.states[h](i, c));
          guess.push_back(static_cast<float>(predicted(i, c)));
        }
      }
    }
    return {{"actual", actual}, {"predicted", guess}};
  }

  /// Calls each(name, predict) for contact-free flow, constant velocity, RK4 with discrete contacts, and the
  /// continuous contacts by which truth is made, at a frame's step.
  template <class Each>
  void baselines_at(std::size_t h, const Each& each) const {
    each("contact-free flow", ContactFree{free_flow<Set>(), plan.horizons[h]});
    each("constant velocity", ConstantVelocity{plan.horizons[h]});
    for (const int ms : rk4_steps) {
      each(rk4_name(ms),
           SimulatedScenario<Set>{
               world, {.step = ms * 1e-3, .duration = plan.horizons[h], .contacts = ContactMode::discrete}});
    }
    each("continuous 20 ms", SimulatedScenario<Set>{world, {.step = 0.02, .duration = plan.horizons[h]}});
  }

  /// The accuracy of every baseline at every horizon.
  Json baselines() const {
    Json all;
    ProgressLine line;
    for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
      line.print(static_cast<double>(h) / static_cast<double>(plan.horizons.size()),
                 detail::text("baselines at ", plan.horizons[h], " s"));
      baselines_at(h, [&](const std::string& method_name, const auto& predict) {
        all[std::to_string(h)][method_name] = method(h, predict);
      });
    }
    line.end();
    return all;
  }

  /// How far truth moves when its step is halved: no predictor can be better. Also, by family, the share of
  /// scenarios that have had a contact, and several.
  Json floor() const {
    Json all;
    const Eigen::Index count = std::min<Eigen::Index>(tests, plan.floor_scenarios);
    TruthOptions half;
    half.step /= 2;
    const ScenarioData finer = generate(sampler(), 0, count, plan.horizons, half);
    for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
      Json& at = all[std::to_string(h)];
      at["all"] = accuracy(h, finer.states[h].cast<double>());
      for (const Family family : families()) {
        double contact = 0, several = 0, of = 0, impacts = 0;
        for (std::size_t s = 0; s < data.family.size(); ++s) {
          if (data.family[s] != family) continue;
          const auto met = data.impacts(static_cast<Eigen::Index>(h), static_cast<Eigen::Index>(s));
          ++of;
          contact += met > 0;
          several += met > 1;
          impacts += met;
        }
        at["contacts"][std::string(rbres::name(family))] = {
            {"share", contact / of}, {"several", several / of}, {"mean_impacts", impacts / of}};
      }
    }
    return all;
  }

  static constexpr int rk4_steps[] = {20, 10, 5, 2, 1};  // ms
  static std::string rk4_name(int ms) { return "RK4 " + std::to_string(ms) + " ms"; }
};

}  // namespace paper
