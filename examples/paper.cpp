// The experiment of arXiv 2407.18798, run for real: simulate, train, evaluate, roll out.
#include <CLI/CLI.hpp>

#include "paper/figures.hpp"
#include "paper/report.hpp"
#include "paper/rollout.hpp"
#include "paper/training.hpp"

namespace paper {

/// Makes the data of one world and set, with progress.
template <BodySet Set>
ScenarioData make_data(const ScenarioSampler<Set>& sampler, Eigen::Index count, const Plan& plan) {
  const auto start = std::chrono::steady_clock::now();
  const ScenarioData data = generate(sampler, 0, count, plan.horizons, {}, [&](Eigen::Index done) {
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::printf("\r  %ld of %ld scenarios, %s left ", static_cast<long>(done), static_cast<long>(count),
                clock_text(seconds * static_cast<double>(count - done) / static_cast<double>(done)).c_str());
    std::fflush(stdout);
  });
  std::printf("\n");
  return data;
}

/// Everything that is measured in one world on one set. `results` collects it by name.
template <BodySet Set>
void run(World world, const Plan& plan, const Store& store, Json& results) {
  const std::string label = std::string(rbres::name(world)) + "-" + std::string(rbres::name(Set));
  Eigen::Index count = 0, least = std::numeric_limits<Eigen::Index>::max();
  std::vector<const Unit*> units;
  for (const Unit& unit : plan.units) {
    if (unit.world != world || unit.set != Set) continue;
    units.push_back(&unit);
    count = std::max<Eigen::Index>(count, unit.protocol.scenarios);
    least = std::min<Eigen::Index>(least, unit.protocol.scenarios);
  }
  const ScenarioSampler<Set> sampler(world, 1);
  Bench<Set> bench{plan, store, world, least / 10, {}};
  // The data are made when the first part that needs them is; a run that goes on may need none.
  const auto with_data = [&](const auto& make) {
    return [&, make] {
      if (bench.data.count() == 0) {
        std::printf("\n%s: simulating %ld scenarios over %g s\n", label.c_str(), static_cast<long>(count),
                    plan.horizons.back());
        bench.data = make_data(sampler, count, plan);
      }
      return make();
    };
  };
  results["floor"][label] = store.part("floor-" + label, with_data([&] { return bench.floor(sampler); }));
  results["baselines"][label] =
      store.part("baselines-" + label, with_data([&] { return bench.baselines(); }));
  for (const Unit* unit : units) {
    const std::string part = name(*unit, plan);
    std::printf("\n%s: %s, %s, %g s ahead, seed %d\n", label.c_str(), name(unit->architecture).c_str(),
                name(unit->target).c_str(), plan.horizons[unit->horizon], static_cast<int>(unit->seed));
    std::fflush(stdout);
    results["networks"][part] = store.part(part, with_data([&] { return train_unit(*unit, bench); }));
  }
  if constexpr (Set == BodySet::standard) {
    results["rollout"][label] = store.part("rollout-" + label, [&] { return roll_out(bench, sampler); });
  }
}

}  // namespace paper

int main(int argc, char** argv) {
  using namespace paper;
  CLI::App app{
      "The experiment of arXiv 2407.18798: simulate, train, evaluate, roll out. It may be stopped at any "
      "moment; the\n"
      "same command goes on where it was."};
  bool quick = false;
  std::string folder, json;
  app.add_flag("--quick", quick, "a small version, about a minute on two cores");
  app.add_option("--out", folder, "folder for results, models and figures")
      ->default_str("rbres_paper or rbres_paper_quick");
  app.add_option("--json", json, "also save every figure of every table, by name, to this file");
  try {
    app.parse(argc, argv);
    const Plan plan = quick ? quick_plan() : full_plan();
    const Store store(folder.empty() ? (quick ? "rbres_paper_quick" : "rbres_paper") : folder);
    std::printf("%s: %d networks to train; results go to %s\n",
                quick ? "The quick experiment" : "The whole experiment", static_cast<int>(plan.units.size()),
                store.folder().c_str());
    Json results;
    for (const World world : {World::free_space, World::room}) {
      for (const BodySet set : plan.sets) {
        set == BodySet::standard ? run<BodySet::standard>(world, plan, store, results)
                                 : run<BodySet::box>(world, plan, store, results);
      }
    }
    report(plan, results);
    draw_figures(plan, store, results);
    write_text(store.folder() / "results.json", results.dump(1) + "\n");
    if (!json.empty()) write_text(json, results.dump(1) + "\n");
    std::printf("\nEvery figure: %s\n", (store.folder() / "results.json").c_str());
  } catch (const CLI::ParseError& problem) {
    if (problem.get_exit_code() == 0) return app.exit(problem);  // --help
    std::fprintf(stderr, "rbres_paper: %s\n", problem.what());
    return 2;
  } catch (const std::exception& problem) {
    std::fprintf(stderr, "rbres_paper: %s\n", problem.what());
    return 2;
  }
}
