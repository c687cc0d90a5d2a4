// The experiment of arXiv 2407.18798, run for real: simulate, train, evaluate, roll out.
#include <ctime>

#include "common/command_line.hpp"
#include "paper/csv.hpp"
#include "paper/experiment.hpp"
#include "paper/figures.hpp"
#include "paper/report.hpp"

namespace paper {

/// The first lines of results.md: what was run, when and on what.
std::string origin(const std::string& command, const std::string& commit) {
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
  flag(app, "--quick", quick, "a small version, some minutes on two cores");
  const auto* out = app.add_option("--out", folder, "folder for results, models and figures")
                        ->default_str("rbres_paper or rbres_paper_quick");
  app.add_option("--json", json, "also save every figure of every table, by name, to this file");
  app.add_option("--commit", commit, "what results.md says of the version of the sources");
  return run_program("rbres_paper", app, argc, argv, [&] {
    if (out->count() > 0 && folder.empty()) throw Error("--out: expected the name of a folder, found none");
    const Plan plan = quick ? quick_plan() : full_plan();
    if (!json.empty()) const AtomicFile writable(json);  // else that would be said after hours
    const Store store(folder.empty() ? (quick ? "rbres_paper_quick" : "rbres_paper") : folder);
    std::printf("%s: %d networks and %d contact laws to train; results go to %s\n",
                quick ? "The quick experiment" : "The whole experiment", static_cast<int>(plan.units.size()),
                static_cast<int>(plan.laws.size()), store.folder().c_str());
    Json results = run_experiment(plan, store);
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
