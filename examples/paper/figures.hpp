// Draws the experiment's figures.
#pragma once

#include "../figures/gnuplot.hpp"
#include "plan.hpp"
#include "store.hpp"

namespace paper {

/// The network of the plan that a figure shows for a world at horizon h: the most trained one with residual
/// target.
inline const Unit* shown_unit(const Plan& plan, World world, BodySet set, std::size_t h) {
  const Unit* best = nullptr;
  for (const Unit& u : plan.units) {
    if (u.world != world || u.set != set || u.horizon != h || u.target != Target::residual || u.seed != 1)
      continue;
    const bool residual =
        u.architecture == Architecture::residual4 || u.architecture == Architecture::residual10;
    if (residual && (best == nullptr || u.protocol.scenarios > best->protocol.scenarios)) best = &u;
  }
  return best;
}

/// PNG and SVG (where gnuplot is found) under FOLDER/figures, for each world on the standard set.
inline void draw_figures(const Plan& plan, const Store& store, const Json& results) {
  const auto folder = store.folder() / "figures";
  bool drawn = true;
  const auto figure = [&](const std::string& name, const std::string& title, const std::string& x,
                          const std::string& y) {
    return figures::Figure{folder, name, title, x, y};
  };
  for (const World world : {World::free_space, World::room}) {
    const std::string label = std::string(rbres::name(world)) + "-standard";
    const std::string where = world == World::free_space ? "free space" : "room";
    const std::size_t h = plan.figure_horizon;
    const Json& times = results.at("timing").at(label).at(std::to_string(h));
    const auto us = [&](const std::string& method) {
      return times.at(method).at("us").at("median").get<double>();
    };
    std::ostringstream ahead;
    ahead << plan.horizons[h] << " s ahead, " << where;

    // Error against cost: every method, one point.
    std::vector<figures::LabelledPoints> methods;
    figures::LabelledPoints rk4{"RK4, discrete contacts", {}, {}, {}, true},
        continuous{"continuous contacts", {}, {}, {}}, trivial{"without contacts", {}, {}, {}},
        networks{"networks", {}, {}, {}}, laws{"learned laws", {}, {}, {}};
    for (const auto& [method, m] : results["baselines"][label][std::to_string(h)].items()) {
      auto& group = method.starts_with("RK4") ? rk4 : method.starts_with("continuous") ? continuous : trivial;
      group.labels.push_back(method.starts_with("RK4") ? method.substr(4) : method);
      group.x.push_back(us(method));
      group.y.push_back(number(m["position"]));
    }
    for_laws(plan, world, BodySet::standard, 1, [&](const LawUnit& law) {
      const Json& found = results[law_results(law.kind)][label]["seed 1"][std::to_string(h)];
      laws.labels.push_back(name(law.kind));
      laws.x.push_back(us(name(law.kind)));
      laws.y.push_back(number(found["position"]));
    });
    for (const Unit& u : plan.units) {
      if (u.world != world || u.set != BodySet::standard || u.horizon != h || u.seed != 1) continue;
      const Json& m = results["networks"][name(u, plan)];
      networks.labels.push_back(method_of(u));
      networks.x.push_back(us(method_of(u)));
      networks.y.push_back(number(m["position"]));
    }
    drawn &= figures::draw_trade_off(
        figure("error_against_cost-" + label, "Error against cost, " + ahead.str(),
               "microseconds per scenario, one thread", "mean square position error, m^2"),
        {rk4, continuous, trivial, networks, laws});

    // Rollouts.
    std::vector<figures::Curve> curves;
    for (const auto& [method, m] : results["rollout"][label].items()) {
      if (method != "time")
        curves.push_back({method, results["rollout"][label]["time"], numbers(m["position"])});
    }
    drawn &= figures::draw_curves(
        figure("rollout-" + label, "Rollouts, " + where, "time, s", "mean square position error, m^2"),
        curves, {.log_y = true});

    const Unit* unit = shown_unit(plan, world, BodySet::standard, h);
    if (unit == nullptr) continue;
    const Json& shown = results["networks"][name(*unit, plan)];
    drawn &= figures::draw_agreement(figure("velocity-" + label, "Velocity after contacts, " + ahead.str(),
                                            "actual, m/s", "predicted, m/s"),
                                     numbers(shown["velocity_pairs"]["actual"]),
                                     numbers(shown["velocity_pairs"]["predicted"]), 0.5, "m/s");
    figures::Curve train{"training", {}, {}}, validation{"validation", {}, {}};
    for (const Json& point : shown["curve"]) {
      train.x.push_back(point[0]), validation.x.push_back(point[0]);
      train.y.push_back(number(point[1])), validation.y.push_back(number(point[2]));
    }
    drawn &= figures::draw_curves(figure("training-" + label, "Training, " + ahead.str(), "epoch",
                                         "mean over samples of the squared normalised error"),
                                  {train, validation}, {.log_y = true});

    std::vector<std::string> families;
    std::vector<figures::QuartileSeries> series{
        {"residual network", {}}, {"contact-free flow", {}}, {"RK4 20 ms", {}}};
    const Json& baselines = results["baselines"][label][std::to_string(h)];
    for (const auto& [family, q] : shown["families"].items()) {
      if (family == "no collision" || family == "one collision" || q["count"] == 0) continue;
      families.push_back(family);
      const auto add = [&](std::size_t i, const Json& f) {
        series[i].quartiles.push_back({number(f["low"]), number(f["median"]), number(f["high"])});
      };
      add(0, q);
      add(1, baselines["contact-free flow"]["families"][family]);
      add(2, baselines["RK4 20 ms"]["families"][family]);
    }
    drawn &= figures::draw_quartiles(figure("families-" + label, "Quartiles over scenarios, " + ahead.str(),
                                            "", "mean square position error, m^2"),
                                     families, series);
  }
  std::printf("Figures: %s%s\n", folder.c_str(), drawn ? "" : (" " + figures::how_to_draw(folder)).c_str());
}

}  // namespace paper
