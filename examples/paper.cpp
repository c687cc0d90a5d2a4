// The experiment of arXiv 2407.18798, run for real: simulate, train, evaluate, roll out.
#include <ctime>
#include <rbres/io/scenario_data.hpp>

#include "common/command_line.hpp"
#include "paper/csv.hpp"
#include "paper/figures.hpp"
#include "paper/report.hpp"
#include "paper/rollout.hpp"
#include "paper/timing.hpp"

namespace paper {

/// The data of one world and set, from the folder where they are kept. What is missing there is made first.
template <BodySet Set>
ScenarioData make_data(const Bench<Set>& bench, Eigen::Index count) {
  const auto folder = bench.store.folder() / "data" / bench.label();
  const auto& horizons = bench.plan.horizons;
  std::printf("\n%s: %ld scenarios over %g s\n", bench.label().c_str(), static_cast<long>(count),
              horizons.back());
  ScenarioProgress progress(count);
  write_dataset(folder, bench.sampler(), count, horizons, {}, progress);
  progress.end();
  return read_dataset(folder, bench.sampler(), count, horizons);
}

/// Everything that is measured in one world on one set. `results` collects it by name.
template <BodySet Set>
void run(World world, const Plan& plan, const Store& store, Json& results) {
  const std::string label = label_of(world, Set);
  Eigen::Index count = 0, least = std::numeric_limits<Eigen::Index>::max();
  std::vector<const Unit*> units;
  for (const Unit& unit : plan.units) {
    if (unit.world != world || unit.set != Set) continue;
    units.push_back(&unit);
    count = std::max<Eigen::Index>(count, unit.protocol.scenarios);
    least = std::min<Eigen::Index>(least, unit.protocol.scenarios);
  }
  Bench<Set> bench{plan, store, world, least / 10, {}};
  // The data are made when the first part that needs them is; a run that goes on may need none.
  const auto part = [&](const std::string& name, const Json& setting, const auto& make) {
    Json made_from = bench.made_from();
    made_from.update(setting);
    return store.part(name, made_from, [&] {
      if (bench.data.count() == 0) bench.data = make_data(bench, count);
      return make();
    });
  };
  results["floor"][label] =
      part("floor-" + label, {{"scenarios_of_shares", count}, {"halved", plan.floor_scenarios}},
           [&] { return bench.floor(); });
  results["baselines"][label] = part("baselines-" + label, Json::object(), [&] { return bench.baselines(); });
  for_laws(plan, world, Set, 0, [&](const LawUnit& law) {
    results[law_results(law.kind)][label]["seed " + std::to_string(law.seed)] =
        part(name(law), {{"scenarios_learned", plan.law.scenarios}, {"epochs", plan.law.epochs}},
             [&] { return learn_contacts_of(bench, law); });
    remove_checkpoint(store, name(law));
  });
  for (const Unit* unit : units) {
    const std::string name = paper::name(*unit, plan);
    Json found = part(name, Json::object(), [&] {
      std::printf("\n%s: %s, %g s ahead, seed %d (network %d of %d)\n", label.c_str(),
                  method_of(*unit).c_str(), plan.horizons[unit->horizon], static_cast<int>(unit->seed),
                  1 + static_cast<int>(results["networks"].size()), static_cast<int>(plan.units.size()));
      return train_unit(*unit, bench);
    });
    results["networks"][name] = std::move(found);
    remove_checkpoint(store, name);
  }
  if constexpr (Set == BodySet::standard) {
    results["rollout"][label] = store.part("rollout-" + label,
                                           {{"model", name(rolled_out(plan, world, Set), plan)},
                                            {"seconds", plan.rollout_seconds},
                                            {"scenarios", plan.rollouts},
                                            {"made_from", bench.made_from()}},
                                           [&] { return roll_out(bench); });
  }
}

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

/// The first lines of results.md: what was run, when and on what.
inline std::string origin(const std::string& command, const std::string& commit) {
  std::string processor = "unknown processor", line;
  for (std::ifstream cpuinfo("/proc/cpuinfo"); std::getline(cpuinfo, line);) {
    if (line.starts_with("model name")) processor = line.substr(line.find(':') + 2);
  }
  const std::time_t now = std::time(nullptr);
  char date[32];
  std::strftime(date, sizeof date, "%Y-%m-%d", std::gmtime(&now));
  return detail::text("# Results of rbres_paper\n\nMade by `", command, "` on ", date, ", rbres ",
                      RBRES_VERSION_MAJOR, ".", RBRES_VERSION_MINOR, ".", RBRES_VERSION_PATCH,
                      commit.empty() ? "" : ", commit " + commit, "; ", processor, ", ", default_threads(),
                      " threads; compiler ", __VERSION__, "; scenarios \"", scenario_version, "\".\n\n");
}

}  // namespace paper

int main(int argc, char** argv) {
  using namespace paper;
  CLI::App app{
      "The experiment of arXiv 2407.18798: simulate, train, evaluate, roll out. It may be stopped at any "
      "moment; the\n"
      "same command goes on where it was."};
  bool quick = false;
  std::string folder, json, commit;
  app.add_flag("--quick", quick, "a small version, some minutes on two cores");
  app.add_option("--out", folder, "folder for results, models and figures")
      ->default_str("rbres_paper or rbres_paper_quick");
  app.add_option("--json", json, "also save every figure of every table, by name, to this file");
  app.add_option("--commit", commit, "what results.md says of the version of the sources");
  return run_program("rbres_paper", app, argc, argv, [&] {
    const Plan plan = quick ? quick_plan() : full_plan();
    if (!json.empty()) const AtomicFile writable(json);  // else that would be said after hours
    const Store store(folder.empty() ? (quick ? "rbres_paper_quick" : "rbres_paper") : folder);
    std::printf("%s: %d networks to train; results go to %s\n",
                quick ? "The quick experiment" : "The whole experiment", static_cast<int>(plan.units.size()),
                store.folder().c_str());
    Json results;
    for_all(plan, [&](World world, auto set) { run<set()>(world, plan, store, results); });
    for_all(plan, [&](World world, auto set) {
      const Bench<set()> bench{plan, store, world, 0, {}};
      results["timing"][bench.label()] = time_methods(bench);
    });
    const std::string command = "rbres_paper" + std::string(quick ? " --quick" : "");
    Json met, better;
    for (const Place& place : places(plan)) {
      met[place.label()] = find_met(plan, results, place);
      better[place.label()] = find_better(plan, results, place);
    }
    results["met"] = met;
    results["better"] = better;
    write_text(store.folder() / "results.md", origin(command, commit) + report(plan, results));
    write_csv(plan, results, store.folder() / "tables");
    write_text(store.folder() / "results.json", results.dump(1) + "\n");
    if (!json.empty()) write_text(json, results.dump(1) + "\n");
    summary_table(plan, results).print();
    const auto at = [&](const char* file) { return (store.folder() / file).string(); };
    std::printf("\nReport: %s\nAll tables: %s\nTheir numbers by name: %s\nModels: %s\n",
                at("results.md").c_str(), at("tables").c_str(), at("results.json").c_str(),
                at("models").c_str());
    draw_figures(plan, store, results);
  });
}
