// Measures predictors and baselines on the test scenarios of one world and set.
#pragma once

#include <cstdio>

#include "plan.hpp"
#include "store.hpp"

namespace paper {

inline Json to_json(const Metrics& m, double us) {
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
          {"collided", m.collided},
          {"us_per_scenario", us}};
}

/// The data of one world and set, and who is measured on it. Scenarios 0 ... tests - 1 are the test set of
/// every method.
template <BodySet Set>
struct Bench {
  const Plan& plan;
  const Store& store;
  World world;
  Eigen::Index tests;
  ScenarioData data;

  std::string label() const { return std::string(rbres::name(world)) + "-" + std::string(rbres::name(Set)); }

  /// All figures of one method at horizon h. `single` predicts for one scenario, on one thread: that is what
  /// is timed.
  template <class Predict>
  Json method(std::size_t h, const Predict& predict) const {
    const auto body = scenario_body<Set>();
    const Eigen::MatrixXd predicted = predict_all(data, 0, tests, predict);
    const double us = microseconds(data, 0, std::min<Eigen::Index>(tests, plan.timed_scenarios), predict);
    Json found = to_json(rbres::measure(data, h, 0, predicted, body.inertia(), body.mass()), us);
    found["velocity_pairs"] = velocity_pairs(h, predicted);
    const auto quartiles = [&](const std::string& key, const auto& chosen) {
      const Quartiles q = position_quartiles(data, h, 0, predicted, chosen);
      if (q.count > 0)
        found["families"][key] = {{"low", q.low}, {"median", q.median}, {"high", q.high}, {"count", q.count}};
    };
    const int first = world == World::free_space ? 0 : 3, last = world == World::free_space ? 2 : 4;
    for (int f = first; f <= last; ++f) {
      quartiles(std::string(rbres::name(static_cast<Family>(f))),
                [&](std::size_t s) { return data.family[s] == static_cast<Family>(f); });
    }
    return found;
  }

  /// Some velocity components, predicted and actual, of bodies in scenarios that had a contact.
  Json velocity_pairs(std::size_t h, const Eigen::MatrixXd& predicted) const {
    Json actual = Json::array(), guess = Json::array();
    for (Eigen::Index c = 0; c < predicted.cols() && actual.size() < 2000; ++c) {
      const auto scenario = static_cast<std::size_t>(c);
      if (!(static_cast<double>(data.first_contact[scenario]) <= data.horizons[h] + 1e-6)) continue;
      for (int b = 0; b < data.body_count[scenario]; ++b) {
        for (int i = 13 * b + 7; i < 13 * b + 10; ++i) {
          actual.push_back(data.states[h](i, c));
          guess.push_back(static_cast<float>(predicted(i, c)));
        }
      }
    }
    return {{"actual", actual}, {"predicted", guess}};
  }

  Simulated<Set> simulated(std::size_t h, double step, ContactMode mode) const {
    return {world, {.step = step, .duration = plan.horizons[h], .contacts = mode}};
  }

  /// Contact-free flow, constant velocity and RK4 with discrete contacts, at every horizon.
  Json baselines() const {
    Json all;
    for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
      std::printf("  baselines at %g s\n", plan.horizons[h]);
      std::fflush(stdout);
      Json& at = all[std::to_string(h)];
      at["contact-free flow"] = method(h, ContactFree{free_flow<Set>(), plan.horizons[h]});
      at["constant velocity"] = method(h, ConstantVelocity{plan.horizons[h]});
      for (const int ms : {20, 10, 5, 2, 1}) {
        at["RK4 " + std::to_string(ms) + " ms"] = method(h, simulated(h, ms * 1e-3, ContactMode::discrete));
      }
    }
    return all;
  }

  /// How far truth moves when its step is halved: no predictor can be better. Mean square position error and
  /// angle, and quartiles by family. Also the share of scenarios that have had a contact.
  Json floor(const ScenarioSampler<Set>& sampler) const {
    Json all;
    const Eigen::Index count = std::min<Eigen::Index>(tests, plan.floor_scenarios);
    TruthOptions half;
    half.step /= 2;
    const ScenarioData finer = generate(sampler, 0, count, plan.horizons, half);
    const auto body = scenario_body<Set>();
    for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
      const Eigen::MatrixXd states = finer.states[h].cast<double>();
      Json& at = all[std::to_string(h)];
      at["all"] = to_json(rbres::measure(data, h, 0, states, body.inertia(), body.mass()), 0);
      const int first = world == World::free_space ? 0 : 3, last = world == World::free_space ? 2 : 4;
      for (int f = first; f <= last; ++f) {
        const auto family = static_cast<Family>(f);
        const Quartiles q =
            position_quartiles(data, h, 0, states, [&](std::size_t s) { return data.family[s] == family; });
        long met = 0, of = 0;
        for (std::size_t s = 0; s < data.family.size(); ++s) {
          if (data.family[s] != family) continue;
          ++of;
          met += static_cast<double>(data.first_contact[s]) <= plan.horizons[h] + 1e-6;
        }
        at["families"][std::string(rbres::name(family))] = {
            {"low", q.low},
            {"median", q.median},
            {"high", q.high},
            {"contact_share", double(met) / double(std::max(of, 1L))}};
      }
    }
    return all;
  }
};

}  // namespace paper
