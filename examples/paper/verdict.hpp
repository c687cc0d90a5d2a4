// What the tables say: where the paper's figures are met, and where the network is better than what.
#pragma once

#include <array>
#include <map>

#include "methods.hpp"

namespace paper {

/// What arXiv 2407.18798 claims, at 5 s: mean square errors of position (m^2), orientation, velocity
/// ((m/s)^2) and angular velocity ((rad/s)^2), energy error and time per scenario.
struct Claim {
  const char* method;
  double errors[4];
  const char *energy, *us;
};
inline constexpr Claim claims[] = {{"residual network", {2.37e-3, 4.62e-4, 1.85e-2, 3.21e-3}, "0.87", "2300"},
                                   {"RK4", {3.15e-3, 5.89e-4, 2.41e-2, 4.05e-3}, "0.12", "18700"},
                                   {"feed-forward", {5.84e-3, 1.23e-3, 3.76e-2, 7.92e-3}, "2.35", "1800"}};

struct Quantity {
  const char *name, *pointer;
};
inline constexpr Quantity quantities[] = {{"position", "/position"},
                                          {"orientation", "/orientation"},
                                          {"velocity", "/velocity"},
                                          {"angular velocity", "/angular_velocity"}};

/// results["met"][place]: the longest horizon (s) up to which each of the paper's four figures is met, for
/// every method of a place, and for truth with its step halved; 0 where it is not met at the shortest that
/// the method was run at.
inline Json find_met(const Plan& plan, const Json& results, const Place& place) {
  Json met;
  std::map<std::string, std::array<bool, 4>> ended;
  for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
    std::vector<Method> methods = methods_at(plan, results, place, h);
    methods.push_back(
        {"truth, step halved", "", {&results.at("floor").at(place.label()).at(std::to_string(h)).at("all")}});
    for (const Method& m : methods) {
      for (std::size_t q = 0; q < 4; ++q) {
        Json& until = met[m.method_title()][quantities[q].name];
        if (until.is_null()) until = 0.0;
        bool& end = ended[m.method_title()][q];
        end = end || !(m.value(quantities[q].pointer).mean <= claims[0].errors[q]);
        if (!end) until = plan.horizons[h];
      }
    }
  }
  return met;
}

/// One method's error over a network's, seed by seed of the network.
inline OverSeeds error_ratio(const Method& other, const Method& network, const Quantity& q) {
  std::vector<double> ratios;
  for (std::size_t s = 0; s < network.seeds.size(); ++s) {
    const Json::json_pointer pointer(q.pointer);
    const Json& theirs = *other.seeds[std::min(s, other.seeds.size() - 1)];
    ratios.push_back(number(theirs.at(pointer)) / number(network.seeds[s]->at(pointer)));
  }
  return OverSeeds(ratios);
}

/// results["better"][place][horizon]: the other methods' errors over those of the residual network (K = 4,
/// residual target): above 1 the network is better.
inline Json find_better(const Plan& plan, const Json& results, const Place& place) {
  Json better;
  const std::string ours = "residual K=4, residual target";
  for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
    const std::vector<Method> methods = methods_at(plan, results, place, h);
    const auto network =
        std::find_if(methods.begin(), methods.end(), [&](const Method& m) { return m.name == ours; });
    if (network == methods.end()) continue;
    for (const Quantity& q : {quantities[0], quantities[2]}) {
      for (const Method& other : methods) {
        if (&other == &*network || (other.is_learned() && other.trained_on != network->trained_on)) continue;
        const OverSeeds ratio = error_ratio(other, *network, q);
        better[digits(plan.horizons[h])][q.name][other.name] = {
            {"ratio", ratio.mean}, {"deviation", ratio.deviation}, {"seeds", ratio.count}};
      }
    }
  }
  return better;
}

}  // namespace paper
