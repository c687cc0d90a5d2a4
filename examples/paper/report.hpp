// The experiment's tables: one that is printed, and all that are saved.
#pragma once

#include <map>

#include "methods.hpp"
#include "verdict.hpp"

namespace paper {

inline std::string percent(double share) { return digits(100 * share); }
inline std::string seconds(double time) { return digits(time) + " s"; }

/// Accuracy and cost of every method of a place at horizon h.
inline Table accuracy_table(const Plan& plan, const Json& results, const Place& place, std::size_t h) {
  Table table{place.label() + ", " + seconds(plan.horizons[h]) + " ahead",
              {"", "position m²", "orient.", "vel. (m/s)²", "spin (rad/s)²", "angle °", "ECE %", "r",
               "±0.5 %", "µs [min, max]", "batch µs"},
              {},
              ""};
  const Json& times = results.at("timing").at(place.label()).at(std::to_string(h));
  for (const Method& m : methods_at(plan, results, place, h)) {
    std::vector<std::string> row{m.title()};
    for (const Quantity& q : quantities) row.push_back(m.value(q.pointer).text());
    row.push_back(m.value("/angle_deg").text());
    row.push_back(percent(m.value("/energy").mean));
    const bool collided = m.value("/collided").mean > 0;
    row.push_back(collided ? digits(m.value("/pearson").mean) : "-");
    row.push_back(collided ? percent(m.value("/within_half").mean) : "-");
    const Json& time = times.at(m.name);
    const auto us = [](const Json& t, const char* key) { return digits(t.at(key).get<double>()); };
    row.push_back(us(time["us"], "median") + " [" + us(time["us"], "low") + ", " + us(time["us"], "high") +
                  "]");
    row.push_back(time.contains("batch_us") ? us(time["batch_us"], "median") : "");
    table.rows.push_back(row);
  }
  return table;
}

/// Relative errors of every method of a place at horizon h.
inline Table relative_table(const Plan& plan, const Json& results, const Place& place, std::size_t h) {
  Table table{
      place.label() + ", " + seconds(plan.horizons[h]) + " ahead: relative errors, %",
      {"", "position", "orientation", "velocity", "ang. vel.", "median pos.", "median orient.", "median vel.",
       "median ang.", "element-wise pos.", "e.-w. orient.", "e.-w. vel.", "e.-w. ang."},
      {},
      ""};
  for (const Method& m : methods_at(plan, results, place, h)) {
    std::vector<std::string> row{m.title()};
    for (const char* key : {"/relative/", "/relative_median/", "/relative_elementwise/"}) {
      for (int i = 0; i < 4; ++i) row.push_back(percent(m.value(key + std::to_string(i)).mean));
    }
    table.rows.push_back(row);
  }
  return table;
}

/// How far truth moves when its step is halved, and how many contacts there were.
inline Table floor_table(const Plan& plan, const Json& results, const Place& place) {
  Table table{place.label() + ": predictability floor, how far truth moves when its step is halved",
              {"", "position m² (mean)", "median", "upper quartile", "angle ° (mean)"},
              {},
              ""};
  const Json& floors = results.at("floor").at(place.label());
  for (const auto& [family, unused] : floors.at("0").at("contacts").items()) {
    table.head.push_back(family + ": median (upper quartile)");
    table.head.push_back("had a contact %");
    table.head.push_back("several %");
  }
  for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
    const Json& at = floors.at(std::to_string(h));
    std::vector<std::string> row{seconds(plan.horizons[h]), digits(at["all"]["position"]),
                                 digits(at["all"]["all_scenarios"]["median"]),
                                 digits(at["all"]["all_scenarios"]["high"]), digits(at["all"]["angle_deg"])};
    for (const auto& [family, contacts] : at.at("contacts").items()) {
      const Json& q = at["all"]["families"][family];
      row.push_back(digits(q["median"]) + " (" + digits(q["high"]) + ")");
      row.push_back(percent(contacts["share"]));
      row.push_back(percent(contacts["several"]));
    }
    table.rows.push_back(row);
  }
  return table;
}

/// Quartiles of the position error per scenario, by family and by the number of collisions.
inline Table family_table(const Plan& plan, const Json& results, const Place& place, std::size_t h) {
  Table table{place.label() + ", " + seconds(plan.horizons[h]) +
                  " ahead: position error per scenario, m², median [quartiles]",
              {""},
              {},
              ""};
  for (const Method& m : methods_at(plan, results, place, h)) {
    const Json& families = m.seeds.front()->at("families");
    if (table.head.size() == 1) {
      for (const auto& [group, q] : families.items())
        table.head.push_back(group + " (" + std::to_string(q["count"].get<long>()) + ")");
    }
    std::vector<std::string> row{m.title() + (m.seeds.size() > 1 ? ": seed 1" : "")};
    for (const auto& [group, q] : families.items()) {
      row.push_back(q["count"] == 0
                        ? "-"
                        : digits(q["median"]) + " [" + digits(q["low"]) + ", " + digits(q["high"]) + "]");
    }
    table.rows.push_back(row);
  }
  return table;
}

/// Whether a method stands in tables that are to be short.
inline bool is_main(const std::string& method) {
  return method != "constant velocity" && method != "RK4 10 ms" && method != "RK4 5 ms" &&
         method != "RK4 2 ms";
}

/// What the paper claims at 5 s beside what the same kind of method does here at horizon h.
inline Table claims_table(const Plan& plan, const Json& results, std::size_t h) {
  Table table{"The paper's claims (at 5 s) beside this run at " + seconds(plan.horizons[h]),
              {"", "position m²", "orientation", "velocity (m/s)²", "ang. vel. (rad/s)²", "relative errors %",
               "ECE %", "r", "±0.5 m/s %", "µs"},
              {},
              ""};
  for (const Claim& claim : claims) {
    std::vector<std::string> row{std::string("paper: ") + claim.method};
    for (const double x : claim.errors) row.push_back(digits(x));
    const bool ours = &claim == &claims[0];
    for (const char* text :
         {ours ? "2.18 1.95 3.42 2.76" : "", claim.energy, ours ? "0.987" : "", ours ? "95" : "", claim.us})
      row.push_back(text);
    table.rows.push_back(row);
  }
  for (const Place& place : places(plan)) {
    const Json& times = results.at("timing").at(place.label()).at(std::to_string(h));
    for (const Method& m : methods_at(plan, results, place, h)) {
      if (!is_main(m.name)) continue;
      std::vector<std::string> row{place.label() + ": " + m.title()};
      for (const Quantity& q : quantities) row.push_back(m.value(q.pointer).text());
      std::string relative;
      for (int i = 0; i < 4; ++i)
        relative += (i > 0 ? " " : "") + percent(m.value("/relative/" + std::to_string(i)).mean);
      row.push_back(relative);
      row.push_back(percent(m.value("/energy").mean));
      row.push_back(digits(m.value("/pearson").mean));
      row.push_back(percent(m.value("/within_half").mean));
      row.push_back(digits(times.at(m.name).at("us").at("median")));
      table.rows.push_back(row);
    }
  }
  return table;
}

/// Position error against time in rollouts, at a few times.
inline Table rollout_table(const Json& rollout, const std::string& label, double step) {
  Table table{label + ": rollouts, position error m², " + seconds(step) + " at a time", {"after"}, {}, ""};
  const std::vector<double> times = rollout.at("time");
  for (const auto& [method, m] : rollout.items()) {
    if (method != "time") table.head.push_back(method);
  }
  for (const double wanted : {0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0}) {
    const auto at = std::find_if(times.begin(), times.end(), [=](double t) { return t >= wanted - 1e-6; });
    if (at == times.end()) continue;
    std::vector<std::string> row{seconds(*at)};
    for (const auto& [method, m] : rollout.items()) {
      if (method != "time") row.push_back(digits(m.at("position").at(std::size_t(at - times.begin()))));
    }
    table.rows.push_back(row);
  }
  table.note = "The network's cumulative error (the mean up to a time) against RK4's: " +
               cumulative_verdict(rollout, times) + ".";
  return table;
}

/// What training took and reached, unit by unit.
inline Table training_table(const Plan& plan, const Json& results) {
  Table table{"Training", {"", "epochs", "best validation loss", "seconds"}, {}, ""};
  for (const Unit& unit : plan.units) {
    const Json& m = results.at("networks").at(name(unit, plan));
    table.rows.push_back({name(unit, plan), std::to_string(m["epochs"].get<int>()),
                          digits(m["best_validation_loss"]), digits(m["curve"].back()[3])});
  }
  return table;
}

/// How much the networks were trained, and on what they were measured.
inline std::string protocol_text(const Plan& plan) {
  std::map<int, std::pair<int, int>> protocols;  // scenarios: epochs, networks
  for (const Unit& unit : plan.units) {
    auto& [epochs, networks] = protocols[unit.protocol.scenarios];
    epochs = unit.protocol.epochs;
    ++networks;
  }
  std::string text =
      "80 % of the scenarios train, 10 % validate (early stopping after 20 epochs without a better loss), "
      "and "
      "10 % of the smallest set of a world and body set test every method. Batches of 64, Adam, rate 1e-3 "
      "(1 + 0.1 t)^-0.75, L2 1e-4, dropout 0.2, as in the paper.\n\n";
  for (const auto& [scenarios, what] : protocols) {
    text += detail::text("- ", scenarios / 1000, "k: ", scenarios, " scenarios, up to ", what.first,
                         " epochs, ", what.second, " networks\n");
  }
  return text + "\n";
}

/// How far the main methods are off in each world at the last horizon, and what they cost.
inline Table summary_table(const Plan& plan, const Json& results) {
  const std::size_t last = plan.horizons.size() - 1;
  Table table{"Where bodies are " + seconds(plan.horizons[last]) +
                  " later: distance from the truth, root mean square",
              {""},
              {},
              ""};
  for (const Place& place : places(plan)) {
    table.head.push_back(place.label() + ", m");
    table.head.push_back("µs");
    const Json& times = results.at("timing").at(place.label()).at(std::to_string(last));
    for (const Method& m : methods_at(plan, results, place, last)) {
      if (!is_main(m.name)) continue;
      const auto same = [&](const auto& row) { return row[0] == m.title(); };
      auto row = std::find_if(table.rows.begin(), table.rows.end(), same);
      if (row == table.rows.end()) row = table.rows.insert(row, {m.title()});
      row->resize(table.head.size() - 2, "-");  // of worlds that do not have it
      row->push_back(digits(std::sqrt(3 * m.value("/position").mean)));
      row->push_back(digits(times.at(m.name).at("us").at("median")));
    }
  }
  for (auto& row : table.rows) row.resize(table.head.size(), "-");
  table.note = "µs: of one core, for one scenario of five bodies at most.";
  return table;
}

/// All tables as Markdown. `results` gets the verdicts by name.
inline std::string report(const Plan& plan, Json& results) {
  std::string markdown;
  const auto add = [&](const Table& table) {
    if (!table.rows.empty()) markdown += table.markdown();
  };
  const std::size_t last = plan.horizons.size() - 1;
  const auto heading = [&](const std::string& text) { markdown += "## " + text + "\n\n"; };

  heading("Protocol");
  markdown += protocol_text(plan);
  heading("Where the paper's figures are met");
  markdown +=
      "Mean square errors per component over the present bodies. The longest horizon at which, and at all "
      "shorter ones, the method's error is at most the paper's figure for its residual network.\n\n";
  for (const Place& place : places(plan)) add(met_table(plan, results, place));
  heading("Where the residual network is better");
  markdown +=
      "The other method's mean square error over the residual network's (residual target): above 1 the "
      "network is better. ± is the standard deviation over seeds.\n\n";
  for (const Place& place : places(plan)) add(better_table(plan, results, place));
  heading("Beside the paper's claims");
  add(claims_table(plan, results, last));
  heading("Accuracy and cost");
  markdown +=
      "ECE: mean |E - E_true| over mean |E_true|. r and ±0.5 m/s: velocity components of bodies in scenarios "
      "that had a contact. µs: processor time per scenario, one at a time on one thread, median [min, max] "
      "over rounds in "
      "which all methods take turns; batch: networks on 256 scenarios at once, RK4 on one in each lane of a "
      "register.\n\n";
  for (const Place& place : places(plan)) {
    for (std::size_t h = 0; h <= last; ++h) add(accuracy_table(plan, results, place, h));
  }
  heading("Predictability floor");
  markdown += "Where truth itself moves when its step is halved, no predictor can be better.\n\n";
  for (const Place& place : places(plan)) add(floor_table(plan, results, place));
  heading("Families");
  markdown +=
      "The paper claims medians of 1.5e-3 to 3.5e-3 m² by family and 4.2e-3 m² with several collisions.\n\n";
  for (const Place& place : places(plan)) {
    for (std::size_t h = 0; h <= last; ++h) add(family_table(plan, results, place, h));
  }
  heading("Rollouts");
  markdown += "The paper claims a cumulative error below RK4's up to about 10 s.\n\n";
  for (const auto& [label, rollout] : results["rollout"].items())
    add(rollout_table(rollout, label, plan.horizons[plan.rollout_horizon]));
  heading("Relative errors");
  markdown +=
      "Mean and median of |error| / |truth| per body and vector; and the paper's element-wise formula, the "
      "mean over components of |error_i| / |truth_i|. The last has no finite expectation: one component "
      "that happens to be near zero decides it, so it says little about any method.\n\n";
  for (const Place& place : places(plan)) {
    for (std::size_t h = 0; h <= last; ++h) add(relative_table(plan, results, place, h));
  }
  heading("Training");
  add(training_table(plan, results));
  return markdown;
}

}  // namespace paper
