// The experiment's tables: one that is printed, and five in a report of two pages. All else is in CSV files.
#pragma once

#include "methods.hpp"
#include "table.hpp"
#include "verdict.hpp"

namespace paper {

inline std::string seconds(double time) { return digits(time) + " s"; }

/// Whether a method stands in tables that are to be short.
inline bool is_main(const std::string& method) {
  return method != "constant velocity" && method != "RK4 10 ms" && method != "RK4 5 ms" &&
         method != "RK4 2 ms" && !method.starts_with("feed-forward K=4, state target");
}

/// A table whose columns are filled one after the other, and whose rows are methods in the order in which
/// they first come; "-" where a method has nothing in a column.
class MethodTable {
 public:
  explicit MethodTable(const std::string& title) : table_{title, {""}, {}, ""} {}

  void column(const std::string& head) { table_.head.push_back(head); }
  /// Into the last column.
  void cell(const std::string& method, const std::string& text) {
    auto row = std::find_if(table_.rows.begin(), table_.rows.end(),
                            [&](const auto& r) { return r.front() == method; });
    if (row == table_.rows.end()) row = table_.rows.insert(row, {method});
    row->resize(table_.head.size() - 1, "-");
    row->push_back(text);
  }
  Table finish(const std::string& note = "") {
    for (auto& row : table_.rows) row.resize(table_.head.size(), "-");
    table_.note = note;
    return table_;
  }

 private:
  Table table_;
};

/// The worlds of a set, as columns name them.
inline std::vector<Place> places_of(const Plan& plan, BodySet set) {
  std::vector<Place> all;
  for (const Place& place : places(plan))
    if (place.set == set) all.push_back(place);
  return all;
}
inline std::string column_of(const Place& place) {
  return place.world == World::free_space ? "free" : "room";
}

/// Position errors of a set by world and horizon.
inline Table errors_table(const Plan& plan, const Json& results, BodySet set) {
  MethodTable table(std::string(set == BodySet::standard ? "Balls" : "Boxes") +
                    ": mean square position error, m²");
  for (const Place& place : places_of(plan, set)) {
    for (const std::size_t h : plan.tabled) {
      table.column(column_of(place) + ", " + seconds(plan.horizons[h]));
      for (const Method& m : methods_at(plan, results, place, h))
        if (is_main(m.name)) table.cell(m.method_title(), m.value("/position").text());
    }
  }
  return table.finish();
}

/// Up to which horizon the paper's figures are met.
inline Table met_table(const Plan& plan, const Json& results) {
  MethodTable table("Up to which horizon the paper's four figures are met, s");
  std::string figures;
  for (std::size_t q = 0; q < 4; ++q)
    figures += (q > 0 ? ", " : "") + std::string(quantities[q].name) + " " + digits(claims[0].errors[q]);
  for (const Place& place : places_of(plan, BodySet::standard)) {
    for (const Quantity& q : quantities) {
      table.column(column_of(place) + ": " + q.name);
      for (const auto& [method, until] : results.at("met").at(place.label()).items()) {
        const double end = number(until.at(q.name));
        if (is_main(method)) table.cell(method, end > 0 ? digits(end) : "-");
      }
    }
  }
  return table.finish("The figures: " + figures +
                      ". A dash: not at the shortest horizon that the method was run at.");
}

/// What the paper claims beside what the same kinds of methods do here, both at horizon h.
inline Table claims_table(const Plan& plan, const Json& results, std::size_t h) {
  MethodTable table("What the paper claims for 5 s, and what is measured here at " +
                    seconds(plan.horizons[h]));
  for (const Quantity& q : quantities) {
    table.column(q.name);
    const auto i = static_cast<std::size_t>(&q - quantities);
    for (const Claim& claim : claims)
      table.cell(std::string("paper: ") + claim.method, digits(claim.errors[i]));
    for (const Place& place : places_of(plan, BodySet::standard)) {
      for (const Method& m : methods_at(plan, results, place, h))
        if (is_main(m.name))
          table.cell(column_of(place) + ": " + m.method_title(), m.value(q.pointer).text());
    }
  }
  return table.finish();
}

/// What a scenario costs at horizon h.
inline Table cost_table(const Plan& plan, const Json& results, std::size_t h) {
  MethodTable table("Time for one scenario, " + seconds(plan.horizons[h]) + " ahead, µs of one core");
  for (const Place& place : places_of(plan, BodySet::standard)) {
    const Json& times = results.at("timing").at(place.label()).at(std::to_string(h));
    for (const bool batch : {false, true}) {
      table.column(column_of(place) + (batch ? ", of many" : ", alone"));
      for (const Method& m : methods_at(plan, results, place, h)) {
        const Json& time = times.at(m.name);
        const char* kind = batch ? "batch_us" : "us";
        if (!is_main(m.name) || !time.contains(kind)) continue;
        const Json& t = time[kind];
        table.cell(
            m.method_title(),
            digits(number(t["median"])) +
                (batch ? "" : " [" + digits(number(t["low"])) + ", " + digits(number(t["high"])) + "]"));
      }
    }
  }
  return table.finish(
      "Median [smallest, largest] over rounds in which all methods take turns. Of many: networks take 256 "
      "scenarios at once, simulations one in each lane of a register; laws go one by one.");
}

/// How much was learned, and on what methods were measured.
inline std::string protocol_text(const Plan& plan) {
  std::map<int, std::pair<int, int>> protocols;  // scenarios: epochs, networks
  for (const Unit& unit : plan.units) {
    auto& [epochs, networks] = protocols[unit.protocol.scenarios];
    epochs = unit.protocol.epochs;
    ++networks;
  }
  std::string text;
  for (const auto& [scenarios, what] : protocols) {
    text += detail::text(text.empty() ? "" : "; ", what.second, " networks on ", scenarios / 1000,
                         ",000 scenarios for up to ", what.first, " epochs");
  }
  return text +
         detail::text("; ", plan.laws.size(), " contact laws on ", plan.law.scenarios, " scenarios of 2 s");
}

/// How far the main methods are off in each world at the last horizon, and what they cost.
inline Table summary_table(const Plan& plan, const Json& results) {
  const std::size_t last = plan.horizons.size() - 1;
  MethodTable table("Where bodies are " + seconds(plan.horizons[last]) +
                    " later: distance from the truth, root mean square");
  for (const Place& place : places(plan)) {
    const Json& times = results.at("timing").at(place.label()).at(std::to_string(last));
    const auto each = [&](const std::string& head, const auto& text) {
      table.column(head);
      for (const Method& m : methods_at(plan, results, place, last))
        if (is_main(m.name)) table.cell(m.method_title(), text(m));
    };
    each(place.label() + ", m",
         [](const Method& m) { return digits(std::sqrt(3 * m.value("/position").mean)); });
    each("µs", [&](const Method& m) { return digits(number(times.at(m.name).at("us").at("median"))); });
  }
  return table.finish("µs: of one core, for one scenario of five bodies at most.");
}

/// The report as Markdown.
inline std::string report(const Plan& plan, const Json& results) {
  const std::size_t last = plan.horizons.size() - 1;
  std::string markdown =
      "## The question\n\n"
      "The paper claims that a residual network predicts where 3 to 5 colliding bodies are 5 s later, more "
      "exactly than RK4. Which method is how far off after which time, and what does it cost?\n\n"
      "## The method\n\n"
      "Scenarios come from one documented sampler: *free* space, where bodies fly, meet in pairs and in "
      "clusters, and a *room*, where they drop and scatter between walls. Truth is the simulation that finds "
      "every impact at its own time, at a step of " +
      digits(1000 * TruthOptions{}.step) +
      " ms; *floor.csv* says how far it moves when that step is halved. Networks have the paper's sizes: 256 "
      "wide, K residual blocks or as many plain ones, or two hidden layers (*shallow*). Their target is the "
      "state itself, as in the paper, or the *residual* to the *contact-free flow*: the motion that forces "
      "and "
      "air cause, without any contact. Training is the paper's: Adam, batches of 64, rate 1e-3 "
      "(1 + 0.1 t)^-0.75, L2 1e-4, dropout 0.2; 80 % of the scenarios train, 10 % stop early, 10 % of the "
      "smallest set of a world test every method. *RK4* checks contacts at the end of each step; "
      "*continuous* "
      "finds them within it; *learned contacts* fly freely between impacts whose law a network has learned; "
      "*corrected* is RK4 with a network's impulses on top.\n\n" +
      ("Trained: " + protocol_text(plan)) +
      ". ± is the standard deviation over the seeds of a method that has several.\n\n## Tables\n\n";
  for (const BodySet set : plan.sets) markdown += errors_table(plan, results, set).markdown();
  markdown += met_table(plan, results).markdown();
  markdown += claims_table(plan, results, last).markdown();
  markdown += cost_table(plan, results, plan.figure_horizon).markdown();
  markdown +=
      "All else that was measured (orientation, velocity, spin, energy, relative errors, families of "
      "scenarios, rollouts, curves of training; every horizon) is in the CSV files of `tables`.\n";
  return markdown;
}

}  // namespace paper
