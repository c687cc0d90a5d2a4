// What the tables say: where the paper's figures are met, and where the network is better than what.
#pragma once

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

/// The longest horizon up to which each of the paper's four figures is met, for every method of a place, and
/// for truth with its step halved. Also saved as results["met"].
inline Table met_table(const Plan& plan, Json& results, const Place& place) {
  Table table{place.label() + ": up to which horizon the paper's figures are met", {""}, {}, ""};
  for (int q = 0; q < 4; ++q)
    table.head.push_back(std::string(quantities[q].name) + " ≤ " + digits(claims[0].errors[q]));
  struct Row {
    std::string title;
    bool still[4] = {true, true, true, true};
    double until[4] = {};
  };
  std::vector<Row> rows;
  for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
    std::vector<Method> methods = methods_at(plan, results, place, h);
    methods.push_back(
        {"truth, step halved", "", {&results.at("floor").at(place.label()).at(std::to_string(h)).at("all")}});
    for (const Method& m : methods) {
      const std::string title = m.name + (m.is_network() ? ", " + m.trained_on : "");
      auto row = std::find_if(rows.begin(), rows.end(), [&](const Row& r) { return r.title == title; });
      if (row == rows.end()) row = rows.insert(rows.end(), Row{title});
      for (int q = 0; q < 4; ++q) {
        row->still[q] = row->still[q] && m.value(quantities[q].pointer).mean <= claims[0].errors[q];
        if (row->still[q]) row->until[q] = plan.horizons[h];
      }
    }
  }
  Json& saved = results["met"][place.label()];
  for (const Row& row : rows) {
    std::vector<std::string> cells{row.title};
    for (int q = 0; q < 4; ++q) {
      cells.push_back(row.until[q] > 0 ? digits(row.until[q]) + " s" : "never");
      saved[row.title][quantities[q].name] = row.until[q];
    }
    table.rows.push_back(cells);
  }
  table.note = "Horizons: those the method was run at; \"never\": not at the shortest of them.";
  return table;
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

/// The other methods' errors over the residual network's, by horizon. Also saved as results["better"].
inline Table better_table(const Plan& plan, Json& results, const Place& place) {
  Table table{place.label() + ": error of others over that of the residual network (K=4, residual target)",
              {""},
              {},
              ""};
  const std::string ours = "residual K=4, residual target";
  for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
    const std::vector<Method> methods = methods_at(plan, results, place, h);
    const auto network =
        std::find_if(methods.begin(), methods.end(), [&](const Method& m) { return m.name == ours; });
    if (network == methods.end()) continue;
    for (const Quantity& q : {quantities[0], quantities[2]}) {
      table.head.push_back(digits(plan.horizons[h]) + " s, " + q.name);
      for (auto& row : table.rows) row.emplace_back();
      for (const Method& other : methods) {
        if (&other == &*network || (other.is_network() && other.trained_on != network->trained_on)) continue;
        auto row = std::find_if(table.rows.begin(), table.rows.end(),
                                [&](const auto& r) { return r.front() == other.name; });
        if (row == table.rows.end()) {
          row = table.rows.insert(table.rows.end(), std::vector<std::string>(table.head.size()));
          row->front() = other.name;
        }
        const OverSeeds ratio = error_ratio(other, *network, q);
        row->back() = ratio.text();
        results["better"][place.label()][digits(plan.horizons[h])][q.name][other.name] = {
            {"ratio", ratio.mean}, {"deviation", ratio.deviation}, {"seeds", ratio.count}};
      }
    }
  }
  return table;
}

/// Up to which time the network's cumulative error is below that of RK4, step by step.
inline std::string cumulative_verdict(const Json& rollout, const std::vector<double>& times) {
  const auto cumulative = [&](const std::string& method) {
    std::vector<double> mean = numbers(rollout.at(method).at("position"));
    double sum = 0;
    for (std::size_t i = 0; i < mean.size(); ++i) sum += mean[i], mean[i] = sum / static_cast<double>(i + 1);
    return mean;
  };
  const std::vector<double> ours = cumulative("residual network");
  std::string text;
  for (const auto& [method, unused] : rollout.items()) {
    if (!method.starts_with("RK4")) continue;
    const std::vector<double> theirs = cumulative(method);
    std::string below;
    for (std::size_t i = 0; i < times.size(); ++i) {
      const bool is_below = ours[i] < theirs[i];
      if (is_below && (i == 0 || !(ours[i - 1] < theirs[i - 1])))
        below += (below.empty() ? "" : " and ") + std::string("from ") + digits(times[i]) + " s";
      if (is_below && (i + 1 == times.size() || !(ours[i + 1] < theirs[i + 1])))
        below += " to " + digits(times[i]) + " s";
    }
    text += (text.empty() ? "" : "; ") + method + ": " + (below.empty() ? "never below" : "below " + below);
  }
  return text;
}

}  // namespace paper
