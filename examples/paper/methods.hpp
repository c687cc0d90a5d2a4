// The results of one world, set and horizon, method by method.
#pragma once

#include "measure.hpp"
#include "table.hpp"

namespace paper {

inline std::string digits(const Json& x) { return digits(number(x)); }

/// Mean and standard deviation (of n - 1) over seeds.
struct OverSeeds {
  double mean = std::numeric_limits<double>::quiet_NaN(), deviation = 0;
  std::size_t count = 0;

  explicit OverSeeds(const std::vector<double>& values) : count(values.size()) {
    if (values.empty()) return;
    mean = 0;
    for (const double x : values) mean += x / static_cast<double>(count);
    for (const double x : values) deviation += (x - mean) * (x - mean);
    deviation = count > 1 ? std::sqrt(deviation / static_cast<double>(count - 1)) : 0;
  }
  std::string text() const { return digits(mean) + (count > 1 ? " ± " + digits(deviation) : ""); }
};

/// One method: a baseline, or what one protocol learned, with its seeds.
struct Method {
  std::string name;        ///< as in timings
  std::string trained_on;  ///< scenarios: "20k"; empty for a baseline
  std::vector<const Json*> seeds;

  bool is_learned() const { return !trained_on.empty(); }
  /// The name, and of what has learned the number of scenarios.
  std::string method_title() const { return name + (is_learned() ? ", " + trained_on : ""); }
  /// A figure over the seeds: value("/position").
  OverSeeds value(const std::string& pointer) const {
    std::vector<double> values;
    for (const Json* seed : seeds) values.push_back(number(seed->at(Json::json_pointer(pointer))));
    return OverSeeds(values);
  }
};

/// A world and set of the plan.
struct Place {
  World world;
  BodySet set;
  std::string label() const { return label_of(world, set); }
};
inline std::vector<Place> places(const Plan& plan) {
  std::vector<Place> all;
  for (const World world : {World::free_space, World::room}) {
    for (const BodySet set : plan.sets) all.push_back({world, set});
  }
  return all;
}

/// Every method of a place at horizon h: baselines, then laws and networks in the order of the plan. It
/// points into the results, which must not grow meanwhile.
inline std::vector<Method> methods_at(const Plan& plan, const Json& results, const Place& place,
                                      std::size_t h) {
  std::vector<Method> all;
  for (const auto& [method, m] : results.at("baselines").at(place.label()).at(std::to_string(h)).items())
    all.push_back({method, "", {&m}});
  const auto add = [&](const std::string& method, const std::string& learned_from, const Json& found) {
    const auto same = std::find_if(all.begin(), all.end(), [&](const Method& m) {
      return m.name == method && m.trained_on == learned_from;
    });
    if (same == all.end())
      all.push_back({method, learned_from, {&found}});
    else
      same->seeds.push_back(&found);
  };
  for_laws(plan, place.world, place.set, 0, [&](const LawUnit& law) {
    const Json& found = results.at(law_results(law.kind)).at(place.label());
    add(name(law.kind), std::to_string(plan.law.scenarios),
        found.at("seed " + std::to_string(law.seed)).at(std::to_string(h)));
  });
  for (const Unit& unit : plan.units) {
    if (unit.world != place.world || unit.set != place.set || unit.horizon != h) continue;
    add(method_of(unit), std::to_string(unit.protocol.scenarios / 1000) + "k",
        results.at("networks").at(name(unit, plan)));
  }
  return all;
}

}  // namespace paper
