// rbres_train from outside: what it saves and prints, that it goes on after a kill to the same bits, and that
// it overwrites nothing.
#include "program_support.hpp"

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <rbres/eval/baselines.hpp>
#include <rbres/io.hpp>

using namespace rbres;

namespace {

using Shallow = Network<float, Sequential<Linear<95, 256>, Relu, Linear<256, 256>, Relu, Linear<256, 65>>>;
using ShallowPredictor = Predictor<Shallow, 5>;

/// The options of a small run; what `changed` gives in their place ("--epochs 3 --horizon 0.2") or besides.
std::string with(const std::string& changed) {
  std::string all = changed;
  for (const auto& [option, value] : {std::pair{"--network", "shallow"},
                                      {"--world", "room"},
                                      {"--horizon", "0.1"},
                                      {"--scenarios", "100"},
                                      {"--epochs", "2"},
                                      {"--threads", "1"}}) {
    if (!contains(changed, option)) all += std::string(" ") + option + " " + value;
  }
  return all;
}

Outcome train(const TemporaryFolder& folder, const std::string& arguments) {
  return run(folder, RBRES_TRAIN, with(arguments));
}

/// Runs the program in the folder and kills it after some epochs. What it prints goes through a pipe that
/// holds less than all of it, so it cannot be done before.
void train_and_kill(const TemporaryFolder& folder, const std::string& arguments) {
  int ends[2];
  REQUIRE(::pipe(ends) == 0);
  REQUIRE(::fcntl(ends[1], F_SETPIPE_SZ, 4096) == 4096);
  const std::string command =
      "cd '" + (folder / "").string() + "' && exec '" RBRES_TRAIN "' " + with(arguments);
  const pid_t child = ::fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    ::dup2(ends[1], STDOUT_FILENO);
    ::close(ends[0]);
    ::close(ends[1]);
    ::execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    ::_exit(127);
  }
  ::close(ends[1]);
  std::string heard;
  for (char c; !contains(heard, "epoch   5/") && ::read(ends[0], &c, 1) == 1;) heard += c;
  ::kill(child, SIGKILL);
  ::close(ends[0]);
  int status = 0;
  REQUIRE(::waitpid(child, &status, 0) == child);
  REQUIRE(WIFSIGNALED(status));
}

}  // namespace

TEST_CASE("a small run: the model is saved, works elsewhere, and is as good as the table says") {
  const TemporaryFolder folder;
  const Outcome outcome = train(folder, "--scenarios 400 --epochs 12 --json a.json");
  CHECK(outcome.err == "");
  REQUIRE(outcome.status == 0);
  CHECK(contains(outcome.out, "320 scenarios to train on, 40 to validate, 40 to test"));
  CHECK(contains(outcome.out, "epoch  12/12"));
  CHECK(contains(outcome.out, "0.1 s ahead, 40 test scenarios"));
  CHECK(files(folder).size() == 2);

  const auto predictor = load<ShallowPredictor>(folder / "model.safetensors");
  CHECK(predictor.horizon == 0.1);
  CHECK(predictor.target == Target::state);
  const ScenarioData tests = generate(ScenarioSampler<BodySet::standard>(World::room, 1), 0, 40, {0.1});
  const auto body = scenario_body<BodySet::standard>();
  const auto error = [&](const auto& predict) {
    return measure(tests, 0, 0, predict_all(tests, 0, 40, predict), body.inertia(), body.mass()).position;
  };
  const auto json = nlohmann::json::parse(read_bytes(folder / "a.json"));
  const double position =
      error([&](const auto& y, const auto& w, int present) { return predictor.predict(y, w, present); });
  CHECK(json["model"]["position"].get<double>() == doctest::Approx(position));
  CHECK(json["contact-free flow"]["position"].get<double>() ==
        doctest::Approx(error(ContactFree{free_flow<BodySet::standard>(), 0.1})));
  auto untrained = predictor;
  untrained.network = Shallow(1);
  CHECK(position < 0.5 * error([&](const auto& y, const auto& w, int present) {
                     return untrained.predict(y, w, present);
                   }));
  CHECK(run(folder, RBRES_ROLLOUT, "--model model.safetensors --seconds 0.2").status == 0);

  const Outcome loop = run(folder, RBRES_CONTROL_LOOP, "model.safetensors");
  CHECK(loop.status == 0);
  CHECK(contains(loop.out, "200 decisions"));
  CHECK(contains(loop.out, " 0 allocations"));
  CHECK(contains(refusal(folder, RBRES_CONTROL_LOOP, "missing"), "missing: cannot read"));
}

TEST_CASE("killed and resumed is unbroken") {
  const TemporaryFolder folder;
  const std::string options = "--epochs 60 --patience 0 ";
  REQUIRE(train(folder, options + "--out unbroken").status == 0);
  train_and_kill(folder, options + "--checkpoint run --out resumed");
  CHECK(!std::filesystem::exists(folder / "resumed"));
  const Outcome outcome = train(folder, options + "--checkpoint run --resume --out resumed");
  CHECK(outcome.err == "");
  REQUIRE(outcome.status == 0);
  CHECK(contains(outcome.out, "resumed after epoch "));
  CHECK(!contains(outcome.out, "epoch   4/60"));  // or it began anew
  CHECK(read_bytes(folder / "resumed") == read_bytes(folder / "unbroken"));
  // A run that is done is only evaluated again.
  REQUIRE(train(folder, options + "--checkpoint run --resume --out again --threads 2").status == 0);
  CHECK(read_bytes(folder / "again") == read_bytes(folder / "unbroken"));
}

TEST_CASE("a data set is made once, and gives the model of the same scenarios in memory") {
  const TemporaryFolder folder;
  REQUIRE(train(folder, "--out memory").status == 0);
  const Outcome made = train(folder, "--data set --out made");
  REQUIRE(made.status == 0);
  CHECK(contains(made.out, "simulating 100 scenarios over 5 s into set"));
  const Outcome found = train(folder, "--data set --out found");
  REQUIRE(found.status == 0);
  CHECK(!contains(found.out, "simulating"));
  for (const char* name : {"made", "found"})
    CHECK(read_bytes(folder / name) == read_bytes(folder / "memory"));

  const auto error = [&](const std::string& arguments) {
    return refusal(folder, RBRES_TRAIN, with("--data " + arguments));
  };
  CHECK(contains(error("set --world free"), "set: world: expected \"free\", found \"room\""));
  CHECK(contains(error("set --set box"), "set: set: expected \"box\", found \"standard\""));
  CHECK(contains(error("set --scenarios 101"), "expected 1 to 100 to be read, found 101"));
  CHECK(contains(error("set --horizon 0.04"), "set: horizons: expected one of"));
  CHECK(contains(error("new --horizon 0.04"), "--horizon: expected one of 0.02, 0.1, 0.5, 1, 2, 5"));
  CHECK(contains(error("."), "expected a data set or an empty folder"));
}

TEST_CASE("what is wrong costs one line and no file") {
  const TemporaryFolder folder;
  REQUIRE(train(folder, "--checkpoint run --json table").status == 0);
  write_bytes(folder / "broken", read_bytes(folder / "run").substr(0, 5000));
  const auto error = [&](const std::string& arguments) {
    return refusal(folder, RBRES_TRAIN, with(arguments));
  };
  CHECK(contains(error("--bogus"), "--bogus"));
  CHECK(contains(error("--scenarios 9"), "expected a number from 10 to 10000000, found 9"));
  CHECK(contains(error("--epochs 0"), "--epochs"));
  CHECK(contains(error("--batch-size 1.5"), "--batch-size"));
  CHECK(contains(error("--learning-rate nan"), "found nan"));
  CHECK(contains(error("--dropout 1"), "found 1"));
  CHECK(contains(error("--l2 -1e-4"), "found -1e-4"));
  CHECK(contains(error("--seed -1"), "found -1"));
  CHECK(contains(error("--network huge"),
                 "--network: expected one of forward4, residual10, residual4, shallow"));
  CHECK(contains(error("--world mars"), "--world: expected one of free, room, found mars"));
  CHECK(contains(error("--out new --horizon 0.03"), "horizon 0: expected"));
  CHECK(contains(error(""), "--out: model.safetensors exists"));
  CHECK(contains(error("--out new --json table"), "--json: table exists"));
  CHECK(contains(error("--out new --json ./new"), "--json: ./new is the file of --out, too"));
  CHECK(contains(error("--out nowhere/new"), "nowhere/new: cannot write"));
  CHECK(contains(error("--out new --checkpoint run"), "--checkpoint: run exists"));
  CHECK(contains(error("--out new --resume"), "--resume: goes on from a --checkpoint FILE"));
  const std::string resume = "--out new --resume --checkpoint ";
  CHECK(contains(error(resume + "missing"), "missing: cannot read"));
  CHECK(contains(error(resume + "broken"), "broken"));
  CHECK(contains(error(resume + "model.safetensors"), "model.safetensors: metadata"));
  CHECK(contains(error(resume + "run --l2 0.5"), "run: metadata 'options'"));
  CHECK(contains(error(resume + "run --horizon 0.2"), "run: metadata 'data'"));
  CHECK(contains(error(resume + "run --target residual"), "run: metadata 'data'"));
  CHECK(contains(error(resume + "run --network residual4"), "run: metadata 'architecture'"));
  CHECK(contains(error("--out new --learning-rate 1e20"), "the loss was no number"));
  CHECK(run(folder, RBRES_TRAIN, "--help").status == 0);
}
