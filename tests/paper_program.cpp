// rbres_paper from outside: two of them do not work in one folder. And a tiny experiment from inside.
#include "program_support.hpp"

#include <atomic>
#include <rbres/io/folder_lock.hpp>

#include "../examples/paper/experiment.hpp"

TEST_CASE("a folder that another process works in is refused") {
  const TemporaryFolder folder;
  std::filesystem::create_directories(folder / "results/parts");
  std::filesystem::create_directories(folder / "results/models");
  const rbres::FolderLock lock(folder / "results", "works here");
  CHECK(contains(refusal(folder, RBRES_PAPER, "--quick --out results"),
                 "results: another process works in this folder"));
}

TEST_CASE("a folder of something else, and a file that cannot be written, are refused at once") {
  const TemporaryFolder folder;
  std::filesystem::create_directories(folder / "mine");
  std::ofstream(folder / "mine/notes.txt") << "my own";
  CHECK(contains(refusal(folder, RBRES_PAPER, "--quick --out mine"),
                 "mine: expected an empty folder or one of this program's results, found another"));
  CHECK(contains(refusal(folder, RBRES_PAPER, "--quick --out new --json none/file.json"), "none/file.json"));
  CHECK(contains(refusal(folder, RBRES_PAPER, "--quick --out new --json mine"),
                 "expected a regular file to replace"));
  CHECK_FALSE(std::filesystem::exists(folder / "mine/parts"));
  CHECK_FALSE(std::filesystem::exists(folder / "new"));
}

TEST_CASE("a lock holds as long as it lives, and no folder that is not there") {
  const TemporaryFolder folder;
  const auto error = [&](const char* name) {
    return error_of([&] { rbres::FolderLock(folder / name, "is here"); });
  };
  {
    const rbres::FolderLock lock(folder / "", "is here");
    CHECK(error("") == (folder / "").string() + ": another process is here");
  }
  CHECK(error("") == "");
  CHECK(contains(error("none"), "none: cannot read: "));
}

namespace {

/// Few scenarios, networks and laws in both worlds.
paper::Plan tiny_plan() {
  paper::Plan plan = paper::quick_plan();
  plan.horizons = {0.02, 0.1};
  plan.tabled = {1};
  plan.law = {10, 1};
  plan.floor_scenarios = 4;
  plan.timed_scenarios = 2;
  plan.timing_rounds = 1;
  plan.rollout_seconds = 0.2;
  plan.rollouts = 2;
  plan.rollout_horizon = plan.figure_horizon = 1;
  std::erase_if(plan.units, [](const paper::Unit& unit) { return unit.horizon > 1; });
  for (const rbres::World world : {rbres::World::free_space, rbres::World::room})
    plan.units.push_back(
        {world, rbres::BodySet::standard, 1, rbres::Target::state, paper::Architecture::shallow, 1, {}});
  for (paper::Unit& unit : plan.units) unit.protocol = {100, 3};
  return plan;
}

/// The results without what the clock measures, as they are written.
std::string without_times(paper::Json results) {
  results.erase("timing");
  for (const char* kind : {"laws", "hybrids"})
    if (results.contains(kind))
      for (auto& place : results[kind])
        for (auto& law : place) law.erase("seconds");
  for (auto& network : results["networks"])
    for (auto& epoch : network["curve"]) epoch.erase(3);
  return results.dump();
}

/// The files of the folder whose names end so.
std::vector<std::string> names(const std::filesystem::path& folder, const std::string& ending) {
  std::vector<std::string> found;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.path().string().ends_with(ending)) found.push_back(entry.path().filename().string());
  std::ranges::sort(found);
  return found;
}

}  // namespace

TEST_CASE("several units at once, interrupted and gone on with, find what one after the other find") {
  const TemporaryFolder folder;
  const paper::Plan plan = tiny_plan();
  const auto run = [&](const char* name, const paper::RunOptions& options) {
    return without_times(paper::run_experiment(plan, paper::Store(folder / name), options));
  };
  const std::string expected = run("one", {.threads = 1});

  // The first that is finished cannot be saved: it stops the others.
  {
    const paper::Store store(folder / "several");
    std::filesystem::rename(folder / "several/models", folder / "several/away");
    const std::string error =
        error_of([&] { paper::run_experiment(plan, store, {.threads = 3, .checkpoint_every = 0}); });
    CHECK(contains(error, "several/models"));
    CHECK(names(folder / "several/parts", ".checkpoint").size() >= 1);
    CHECK(names(folder / "several/parts", "seed1.json").empty());
  }
  std::filesystem::rename(folder / "several/away", folder / "several/models");
  CHECK((run("several", {.threads = 3}) == expected));  // no page of numbers where it fails
  CHECK(names(folder / "several/parts", ".checkpoint").empty());
  const auto models = names(folder / "one/models", ".safetensors");
  REQUIRE(models.size() == plan.units.size() + plan.laws.size());
  for (const std::string& model : models)
    CHECK(read_bytes(folder / "one/models" / model) == read_bytes(folder / "several/models" / model));

  // Once more with more threads than units, and of nothing but results.
  CHECK((run("many", {.threads = 20}) == expected));
  CHECK((run("many", {.threads = 1}) == expected));
}

TEST_CASE("where one unit fails, no other begins, and its error is the caller's") {
  std::vector<paper::Work> units;
  std::atomic<int> begun = 0;
  for (int i = 0; i < 100; ++i)
    units.push_back({1.0 * i, [&, i](const paper::UnitRun& run) -> std::string {
                       ++begun;
                       CHECK(run.threads == 1);
                       if (i == 99) rbres::detail::fail("the longest fails");
                       for (;;) run.advance(0.1);
                     }});
  CHECK(error_of([&] { paper::do_all(units, 100, {.threads = 4}); }) == "the longest fails");
  CHECK(begun <= 4);
}
