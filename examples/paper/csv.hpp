// All that the experiment measured, as CSV files that a program can plot: one line for each method of a
// world, set and horizon.
#pragma once

#include "methods.hpp"
#include "verdict.hpp"

namespace paper {

/// Lines of comma-separated cells under a head. Text stands in quotes, a number that there is none of is
/// empty.
class Csv {
 public:
  explicit Csv(const std::string& head) : text_(head + "\n") {}

  template <class... Cells>
  void line(const Cells&... cells) {
    start_ = true;
    (add(cells), ...);
    text_ += "\n";
  }
  const std::string& text() const { return text_; }

 private:
  void add(double x) {
    comma();
    if (!std::isfinite(x)) return;
    char number[32];
    std::snprintf(number, sizeof number, "%.6g", x);
    text_ += number;
  }
  void add(std::size_t n) { comma(), text_ += std::to_string(n); }
  void add(int n) { comma(), text_ += std::to_string(n); }
  void add(const std::string& s) { comma(), text_ += "\"" + s + "\""; }
  void add(const OverSeeds& x) { add(x.mean), add(x.deviation); }
  /// Numbers of an object, by key.
  void add(const std::pair<const Json*, std::vector<const char*>>& some) {
    for (const char* key : some.second) add(some.first->contains(key) ? number((*some.first)[key]) : NAN);
  }
  void comma() {
    if (!start_) text_ += ",";
    start_ = false;
  }

  std::string text_;
  bool start_ = true;
};

/// Calls each(place, horizon's number, method) for all that were measured.
template <class Each>
void for_methods(const Plan& plan, const Json& results, const Each& each) {
  for (const Place& place : places(plan)) {
    for (std::size_t h = 0; h < plan.horizons.size(); ++h)
      for (const Method& m : methods_at(plan, results, place, h)) each(place, h, m);
  }
}

/// Writes the tables into a folder: accuracy, families, floor, contacts, met, better, rollouts, training and
/// curves.
inline void write_csv(const Plan& plan, const Json& results, const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  const auto write = [&](const std::string& name, const Csv& csv) {
    write_text(folder / (name + ".csv"), csv.text());
  };

  Csv accuracy(
      "place,seconds_ahead,method,learned_from,seeds,position_m2,position_sd,orientation,orientation_sd,"
      "velocity,velocity_sd,spin,spin_sd,angle_deg,angle_sd,energy_error,r,within_half_m_s,"
      "relative_position,relative_orientation,relative_velocity,relative_spin,"
      "median_position,median_orientation,median_velocity,median_spin,"
      "elementwise_position,elementwise_orientation,elementwise_velocity,elementwise_spin,"
      "us,us_low,us_high,batch_us,batch_us_low,batch_us_high");
  Csv families(
      "place,seconds_ahead,method,learned_from,scenarios,count,position_low,position_median,position_high");
  for_methods(plan, results, [&](const Place& place, std::size_t h, const Method& m) {
    const Json& time = results.at("timing").at(place.label()).at(std::to_string(h)).at(m.name);
    const auto spread = [&](const char* kind) {
      static const Json none = Json::object();
      return std::pair(time.contains(kind) ? &time[kind] : &none,
                       std::vector<const char*>{"median", "low", "high"});
    };
    const auto of = [&](const std::string& kind, int i) {
      return m.value("/" + kind + "/" + std::to_string(i)).mean;
    };
    const auto four = [&](const std::string& kind) {
      return std::array{of(kind, 0), of(kind, 1), of(kind, 2), of(kind, 3)};
    };
    const auto [r0, r1, r2, r3] = four("relative");
    const auto [m0, m1, m2, m3] = four("relative_median");
    const auto [e0, e1, e2, e3] = four("relative_elementwise");
    accuracy.line(place.label(), plan.horizons[h], m.name, m.trained_on, m.seeds.size(), m.value("/position"),
                  m.value("/orientation"), m.value("/velocity"), m.value("/angular_velocity"),
                  m.value("/angle_deg"), m.value("/energy").mean, m.value("/pearson").mean,
                  m.value("/within_half").mean, r0, r1, r2, r3, m0, m1, m2, m3, e0, e1, e2, e3, spread("us"),
                  spread("batch_us"));
    for (const auto& [group, q] : m.seeds.front()->at("families").items())
      families.line(place.label(), plan.horizons[h], m.name, m.trained_on, group, q["count"].get<int>(),
                    number(q["low"]), number(q["median"]), number(q["high"]));
  });
  write("accuracy", accuracy);
  write("families", families);

  Csv floor("place,seconds_ahead,position_m2,position_median,position_high,angle_deg");
  Csv contacts("place,seconds_ahead,family,share_with_contact,share_with_several,mean_impacts");
  for (const Place& place : places(plan)) {
    for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
      const Json& at = results.at("floor").at(place.label()).at(std::to_string(h));
      const Json& all = at.at("all");
      floor.line(place.label(), plan.horizons[h], number(all["position"]),
                 number(all["all_scenarios"]["median"]), number(all["all_scenarios"]["high"]),
                 number(all["angle_deg"]));
      for (const auto& [family, c] : at.at("contacts").items())
        contacts.line(place.label(), plan.horizons[h], family, number(c["share"]), number(c["several"]),
                      number(c["mean_impacts"]));
    }
  }
  write("floor", floor);
  write("contacts", contacts);

  Csv met("place,method,quantity,met_until_s");
  for (const auto& [place, methods] : results.at("met").items())
    for (const auto& [method, all] : methods.items())
      for (const auto& [quantity, until] : all.items()) met.line(place, method, quantity, number(until));
  write("met", met);

  Csv better("place,seconds_ahead,quantity,method,error_over_networks,sd,seeds");
  for (const auto& [place, horizons] : results.at("better").items())
    for (const auto& [h, all] : horizons.items())
      for (const auto& [quantity, methods] : all.items())
        for (const auto& [method, x] : methods.items())
          better.line(place, std::stod(h), quantity, method, number(x["ratio"]), number(x["deviation"]),
                      x["seeds"].get<int>());
  write("better", better);

  Csv rollouts("place,seconds,method,position_m2,velocity");
  for (const auto& [place, rollout] : results.at("rollout").items())
    for (const auto& [method, m] : rollout.items())
      for (std::size_t k = 0; method != "time" && k < m["position"].size(); ++k)
        rollouts.line(place, number(rollout["time"][k]), method, number(m["position"][k]),
                      number(m["velocity"][k]));
  write("rollouts", rollouts);

  Csv training("network,epochs,best_validation_loss,seconds");
  Csv curves("network,epoch,training_loss,validation_loss,seconds");
  for (const Unit& unit : plan.units) {
    const Json& m = results.at("networks").at(name(unit, plan));
    training.line(name(unit, plan), m["epochs"].get<int>(), number(m["best_validation_loss"]),
                  number(m["curve"].back()[3]));
    for (const Json& point : m["curve"])
      curves.line(name(unit, plan), point[0].get<int>(), number(point[1]), number(point[2]),
                  number(point[3]));
  }
  write("training", training);
  write("curves", curves);
}

}  // namespace paper
