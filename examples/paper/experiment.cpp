#include "experiment.hpp"

#include <rbres/io/scenario_data.hpp>

#include "methods.hpp"
#include "rollout.hpp"
#include "timing.hpp"

namespace paper {

namespace {

/// Calls each(world, std::integral_constant<BodySet, Set>) for all of the plan.
template <class Each>
void for_all(const Plan& plan, const Each& each) {
  for (const auto& [world, set] : places(plan)) {
    if (set == BodySet::standard)
      each(world, std::integral_constant<BodySet, BodySet::standard>{});
    else
      each(world, std::integral_constant<BodySet, BodySet::box>{});
  }
}

/// Calls each(unit) for the networks of a world and set.
template <class Each>
void for_networks(const Plan& plan, World world, BodySet set, const Each& each) {
  for (const Unit& unit : plan.units)
    if (unit.world == world && unit.set == set) each(unit);
}

/// How many scenarios the data of a world and set have.
Eigen::Index data_count(const Plan& plan, World world, BodySet set) {
  int most = 0;
  for_networks(plan, world, set, [&](const Unit& unit) { most = std::max(most, unit.protocol.scenarios); });
  return most;
}

/// A bench without data. A tenth of the smallest set of a network tests all methods.
template <BodySet Set>
Bench<Set> make_bench(const Plan& plan, const Store& store, World world) {
  int least = std::numeric_limits<int>::max();
  for_networks(plan, world, Set, [&](const Unit& unit) { least = std::min(least, unit.protocol.scenarios); });
  return {plan, store, world, least / 10, {}};
}

/// The data of a bench, from the folder where they are kept. What is missing there is made first.
template <BodySet Set>
ScenarioData make_data(const Bench<Set>& bench) {
  const auto folder = bench.store.folder() / "data" / bench.label();
  const auto& horizons = bench.plan.horizons;
  const Eigen::Index count = data_count(bench.plan, bench.world, Set);
  std::printf("\n%s: %ld scenarios over %g s\n", bench.label().c_str(), static_cast<long>(count),
              horizons.back());
  ScenarioProgress progress(count);
  write_dataset(folder, bench.sampler(), count, horizons, {}, progress);
  progress.end();
  return read_dataset(folder, bench.sampler(), count, horizons);
}

/// All that decides what a unit finds.
template <BodySet Set>
Json made_from(const Bench<Set>& bench, const Unit&) {
  return bench.made_from();
}
template <BodySet Set>
Json made_from(const Bench<Set>& bench, const LawUnit&) {
  Json all = bench.made_from();
  all.update({{"scenarios_learned", bench.plan.law.scenarios}, {"epochs", bench.plan.law.epochs}});
  return all;
}

/// What people call a unit.
std::string title(const Plan& plan, const Unit& unit) {
  return detail::text(label_of(unit.world, unit.set), ": ", method_of(unit), ", ",
                      plan.horizons[unit.horizon], " s ahead, seed ", unit.seed);
}
std::string title(const Plan&, const LawUnit& unit) {
  return detail::text(label_of(unit.world, unit.set), ": ", name(unit.kind), ", seed ", unit.seed);
}
/// And how well it has learned.
std::string outcome(const Unit&, const Json& found) {
  return detail::text("validation loss ", digits(found.at("best_validation_loss")), " after ",
                      found.at("epochs").get<int>(), " epochs, ",
                      clock_text(found.at("curve").back()[3].get<double>()));
}
std::string outcome(const LawUnit&, const Json& found) {
  return clock_text(found.at("seconds").get<double>());
}

/// How long a unit takes, roughly, in seconds of a core.
double amount(const Plan&, const Unit& unit) {
  const int parameters = with_architecture(
      unit.architecture, [](auto a) { return static_cast<int>(NetworkOf<a()>::type::parameter_count); });
  return 1e-10 * unit.protocol.scenarios * unit.protocol.epochs * parameters;
}
double amount(const Plan& plan, const LawUnit&) { return 0.03 * plan.law.scenarios * plan.law.epochs; }

/// The data, and what is measured of them and of the baselines. Adds the units that are still to be done.
template <BodySet Set>
void prepare(World world, const Plan& plan, const Store& store, Json& results, std::vector<Work>& units) {
  const auto bench = std::make_shared<Bench<Set>>(make_bench<Set>(plan, store, world));
  // A run that goes on may need no data.
  const auto need_data = [&] {
    if (bench->data.count() == 0) bench->data = make_data(*bench);
  };
  const auto part = [&](const std::string& kind, const Json& setting, const auto& make) {
    Json made_from = bench->made_from();
    made_from.update(setting);
    results[kind][bench->label()] = store.part(kind + "-" + bench->label(), made_from, [&] {
      need_data();
      return make();
    });
  };
  part("floor", {{"scenarios_of_shares", data_count(plan, world, Set)}, {"halved", plan.floor_scenarios}},
       [&] { return bench->floor(); });
  part("baselines", Json::object(), [&] { return bench->baselines(); });
  const auto add = [&](const auto& unit, const std::string& part) {
    const Json made_from = paper::made_from(*bench, unit);
    if (store.find(part, made_from)) return remove_checkpoint(store, part);
    need_data();
    units.push_back({amount(plan, unit), [=, &unit, &plan, &store](const UnitRun& run) {
                       const Json found = train(unit, *bench, run);
                       store.keep(part, made_from, found);
                       remove_checkpoint(store, part);
                       return title(plan, unit) + ": " + outcome(unit, found);
                     }});
  };
  for_laws(plan, world, Set, 0, [&](const LawUnit& law) { add(law, name(law)); });
  for_networks(plan, world, Set, [&](const Unit& unit) { add(unit, name(unit, plan)); });
}

/// What the units of a world and set have found, and how they do when they are rolled out.
template <BodySet Set>
void collect(World world, const Plan& plan, const Store& store, Json& results) {
  const Bench<Set> bench = make_bench<Set>(plan, store, world);
  const std::string label = bench.label();
  for_laws(plan, world, Set, 0, [&](const LawUnit& law) {
    results[law_results(law.kind)][label]["seed " + std::to_string(law.seed)] =
        store.find(name(law), made_from(bench, law)).value();
  });
  for_networks(plan, world, Set, [&](const Unit& unit) {
    const std::string name = paper::name(unit, plan);
    results["networks"][name] = store.find(name, made_from(bench, unit)).value();
  });
  if constexpr (Set == BodySet::standard) {
    results["rollout"][label] = store.part("rollout-" + label,
                                           {{"model", name(rolled_out(plan, world, Set), plan)},
                                            {"seconds", plan.rollout_seconds},
                                            {"scenarios", plan.rollouts},
                                            {"made_from", bench.made_from()}},
                                           [&] { return roll_out(bench); });
  }
}

}  // namespace

Json run_experiment(const Plan& plan, const Store& store, const RunOptions& options) {
  Json results;
  std::vector<Work> units;
  for_all(plan, [&](World world, auto set) { prepare<set()>(world, plan, store, results, units); });
  if (!units.empty())
    std::printf("\n%d networks and contact laws to train, several at once\n", static_cast<int>(units.size()));
  do_all(std::move(units), plan.units.size() + plan.laws.size(), options);
  for_all(plan, [&](World world, auto set) { collect<set()>(world, plan, store, results); });
  // Nothing else of this process runs meanwhile.
  for_all(plan, [&](World world, auto set) {
    const Bench<set()> bench{plan, store, world, 0, {}};
    results["timing"][bench.label()] = time_methods(bench);
  });
  return results;
}

}  // namespace paper
