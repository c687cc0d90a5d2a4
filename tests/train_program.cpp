// rbres_train from outside: what it saves, prints and refuses.
#include "train_program.hpp"

#include "../examples/scenarios/compiled.hpp"

#include <cstring>
#include <limits>

#include <rbres/io.hpp>

using namespace rbres;

namespace {

using Shallow = Network<float, Sequential<Linear<95, 256>, Relu, Linear<256, 256>, Relu, Linear<256, 65>>>;
using ShallowPredictor = Predictor<Shallow, 5>;

}  // namespace

TEST_CASE("a small run: the model is saved, works elsewhere, and is as good as the table says") {
  const TemporaryFolder folder;
  const Outcome outcome = train(folder, "--scenarios 400 --epochs 12 --json a.json");
  CHECK(outcome.err == "");
  REQUIRE(outcome.status == 0);
  CHECK(contains(outcome.out, "320 scenarios to train on, 40 to validate, 40 to test"));
  CHECK(contains(outcome.out, "epoch  12/12"));
  CHECK(!contains(outcome.out, "\r"));
  CHECK(contains(outcome.out, "0.1 s ahead, 40 test scenarios"));
  CHECK(files(folder).size() == 2);

  const auto predictor = load<ShallowPredictor>(folder / "model.safetensors");
  CHECK(predictor.horizon == 0.1);
  CHECK(predictor.target == Target::state);
  const ScenarioData tests = generate(ScenarioSampler<BodySet::standard>(World::room, 1), 0, 40, {0.1});
  const ScenarioTransitions transitions(tests, 0);
  const auto system = scenario_system<BodySet::standard, 5>(World::room);
  const auto error = [&](const auto& predict) {
    return measure(transitions, 0, predict_all(transitions, 0, 40, predict), system).position;
  };
  const auto json = nlohmann::json::parse(read_bytes(folder / "a.json"));
  const double position = error(predictor);
  CHECK(json["model"]["position"].get<double>() == doctest::Approx(position));
  CHECK(json["contact-free flow"]["position"].get<double>() ==
        doctest::Approx(error(ContactFree{free_flow<BodySet::standard>(), 0.1})));
  auto untrained = predictor;
  untrained.network = Shallow(1);
  CHECK(position < 0.5 * error(untrained));
  CHECK(run(folder, RBRES_ROLLOUT, "--model model.safetensors --seconds 0.2").status == 0);

  const Outcome loop = run(folder, RBRES_CONTROL_LOOP, "model.safetensors");
  CHECK(loop.status == 0);
  CHECK(contains(loop.out, "200 decisions"));
  CHECK(contains(loop.out, " 0 allocations"));
  CHECK(contains(refusal(folder, RBRES_CONTROL_LOOP, "missing"), "missing: cannot read"));
}

TEST_CASE("by default what pays, with --paper what the paper trains, but for what other options say") {
  const TemporaryFolder folder;
  const auto scenarios = [&](const std::string& options) {
    Training run(folder, options + " --threads 1", "");
    const std::string line = run.hear("\n");
    run.kill();
    return line;
  };
  CHECK(scenarios("") == "room-standard: simulating 20000 scenarios over 0.5 s\n");
  CHECK(scenarios("--paper") == "free-standard: simulating 100000 scenarios over 5 s\n");
  const auto network_and_epochs = [&](const std::string& options) {
    Training run(folder, options + " --scenarios 20 --patience 0 --threads 1", " left\n");
    const std::string network = run.hear(":");
    run.hear("epoch   1/");
    const std::string epochs = run.hear(" ");
    run.kill();
    return network + epochs;
  };
  CHECK(network_and_epochs("") == "shallow 2x256, residual target, 0.5 s ahead:40 ");
  for (const char* options : {"--paper --horizon 0.02", "--horizon 0.02 --paper"})
    CHECK(network_and_epochs(options) == "residual K=10, state target, 0.02 s ahead:200 ");
}

TEST_CASE("optimisers, schedules, a log; a run is extended, and a model is trained further") {
  const TemporaryFolder folder;
  const std::string tuned =
      "--optimizer adamw --weight-decay 0.02 --l2 0 --clip 0.5 --warm-up 4 --min-delta 1e-3 --schedule "
      "constant ";
  const std::string log = "--log log.csv --checkpoint run ";
  REQUIRE(train(folder, tuned + "--epochs 5 --out whole").status == 0);
  REQUIRE(train(folder, tuned + log + "--epochs 3 --out part").status == 0);
  REQUIRE(train(folder, tuned + log + "--epochs 5 --resume --out extended").status == 0);
  CHECK(read_bytes(folder / "extended") == read_bytes(folder / "whole"));
  CHECK(read_bytes(folder / "part") != read_bytes(folder / "whole"));
  const std::string text = read_bytes(folder / "log.csv");
  CHECK(text.starts_with("epoch,train_loss,validation_loss,learning_rate\n1,"));
  CHECK(std::count(text.begin(), text.end(), '\n') == 6);
  CHECK(contains(text, "\n5,"));
  CHECK(contains(refusal(folder, RBRES_TRAIN, with("--out new --resume --checkpoint run --epochs 9")),
                 "run: metadata 'options'"));

  // A cosine is as long as its run.
  REQUIRE(train(folder, "--schedule cosine --checkpoint waves --epochs 3 --out wave").status == 0);
  const std::string longer = refusal(
      folder, RBRES_TRAIN, with("--schedule cosine --checkpoint waves --resume --epochs 5 --out new"));
  CHECK(contains(longer, "over 5 epochs"));
  CHECK(contains(longer, "over 3 epochs"));

  for (const std::string other : {"--optimizer sgd --learning-rate 1e-4", "--schedule cosine", "--clip 0.01"})
    REQUIRE(train(folder, other + " --out " + std::to_string(other.size())).status == 0);
  REQUIRE(train(folder, "--start whole --learning-rate 1e-30 --dropout 0 --l2 0 --out same").status == 0);
  const auto first = load<ShallowPredictor>(folder / "whole"), same = load<ShallowPredictor>(folder / "same");
  CHECK(
      (first.network.forward(Shallow::Input::Ones()) - same.network.forward(Shallow::Input::Ones())).norm() ==
      0);
  CHECK(first.input.mean == same.input.mean);
  CHECK(contains(refusal(folder, RBRES_TRAIN, with("--start whole --target residual --out new")),
                 "--start: whole"));
  CHECK(contains(refusal(folder, RBRES_TRAIN, with("--optimizer rmsprop --out new")),
                 "one of adam, adamw, sgd"));
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
  std::string truth = read_bytes(folder / "set/state_0.1s.npy");
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(truth.data() + 128, &nan, sizeof nan);
  write_bytes(folder / "set/state_0.1s.npy", truth);
  CHECK(contains(error("set --out new"), "set/state_0.1s.npy: SHA-256 digest: expected"));
}

TEST_CASE("--threads reaches all work: with one no other is started") {
  const TemporaryFolder folder;
  // A program built with the address sanitizer wants that library first unless told otherwise.
  const auto said = [&](const std::string& threads) {
    const Outcome outcome = run(folder, "/usr/bin/env",
                                "ASAN_OPTIONS=verify_asan_link_order=0 LD_PRELOAD='" RBRES_ANNOUNCE_THREADS
                                "' '" RBRES_TRAIN "' " +
                                    with("--scenarios 600 --threads " + threads + " --out model" + threads));
    CHECK(outcome.status == 0);
    return outcome.err;
  };
  CHECK(said("1") == "");
  CHECK(contains(said("2"), "starts a thread"));
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
  CHECK(contains(error("--out new --horizon 0.03"), "expected a whole number of frames of 20 ms"));
  CHECK(contains(error(""), "--out: model.safetensors exists"));
  CHECK(contains(error("--out new --json table"), "--json: table exists"));
  CHECK(contains(error("--out ''"), "--out: expected the name of a file"));
  CHECK(contains(error("--out new --json ./new"), "--json: ./new is the file of --out, too"));
  CHECK(contains(error("--data new --checkpoint new"), "--checkpoint: new is the file of --data, too"));
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
