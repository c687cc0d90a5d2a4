// rbres_train from outside: what it saves and prints, that it goes on after a kill to the same bits, and that
// it overwrites nothing.
#include "io_file_size_limit.hpp"
#include "program_support.hpp"

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <cstring>
#include <limits>

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

/// The program at work in the folder. What it prints goes through a pipe that holds less than all of it, so
/// that it cannot be done before it is heard.
class Training {
 public:
  /// Returns when the program says `until`.
  Training(const TemporaryFolder& folder, const std::string& arguments, const std::string& until) {
    int ends[2];
    REQUIRE(::pipe2(ends, O_CLOEXEC) == 0);
    REQUIRE(::fcntl(ends[1], F_SETPIPE_SZ, 4096) == 4096);
    const std::string at = (folder / "").string();
    const std::string command =
        "cd '" + at + "' && TMPDIR='" + at + "' exec '" RBRES_TRAIN "' " + with(arguments) + " 2> .err";
    child_ = ::fork();
    REQUIRE(child_ >= 0);
    if (child_ == 0) {
      ::dup2(ends[1], STDOUT_FILENO);
      ::execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
      ::_exit(127);
    }
    ::close(ends[1]);
    output_ = ends[0];
    hear(until);
  }
  Training(const Training&) = delete;
  Training& operator=(const Training&) = delete;

  void hear(const std::string& until) {
    std::string heard;
    for (char c; !contains(heard, until) && ::read(output_, &c, 1) == 1;) heard += c;
    REQUIRE(contains(heard, until));
  }
  /// From now on its files can grow to so many bytes only.
  void limit_files(rlim_t size) {
    rlimit limit{};
    REQUIRE(::prlimit(child_, RLIMIT_FSIZE, nullptr, &limit) == 0);
    limit.rlim_cur = size;
    REQUIRE(::prlimit(child_, RLIMIT_FSIZE, &limit, nullptr) == 0);
  }
  void kill() {
    ::kill(child_, SIGKILL);
    REQUIRE(WIFSIGNALED(ended()));
  }
  /// Hears it out; its exit status.
  int finish() {
    for (char rest[256]; ::read(output_, rest, sizeof rest) > 0;) {
    }
    const int status = ended();
    REQUIRE(WIFEXITED(status));
    return WEXITSTATUS(status);
  }

 private:
  int ended() {
    ::close(output_);
    int status = 0;
    REQUIRE(::waitpid(child_, &status, 0) == child_);
    return status;
  }

  pid_t child_;
  int output_;
};

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
  Training(folder, options + "--checkpoint run --out resumed", "epoch   5/").kill();
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

TEST_CASE("two runs with one --out: the second is refused, the first keeps its model") {
  const TemporaryFolder folder;
  const std::string options = "--epochs 60 --patience 0 ";
  REQUIRE(train(folder, options + "--out alone").status == 0);
  Training first(folder, options + "--out both --json table", "epoch   5/");
  for (const char* second : {"--seed 2 --out both", "--seed 2 --out other --json table"})
    CHECK(contains(refusal(folder, RBRES_TRAIN, with(second)), ": cannot write: another writer holds "));
  CHECK(first.finish() == 0);
  CHECK(read_bytes(folder / "both") == read_bytes(folder / "alone"));
  CHECK(nlohmann::json::parse(read_bytes(folder / "table")).contains("model"));
}

TEST_CASE("two runs with one --checkpoint or one --log: the second is refused") {
  const TemporaryFolder folder;
  Training first(folder, "--checkpoint run --log log.csv --epochs 60 --patience 0 --out first", "epoch   5/");
  std::filesystem::remove(folder / "log.csv");
  for (const char* second :
       {"--out new --resume --checkpoint run --epochs 60", "--out new --checkpoint other --log log.csv"}) {
    const Outcome outcome = train(folder, second);
    CHECK(outcome.status == 2);
    CHECK(contains(outcome.err, ": cannot write: another writer holds "));
    CHECK(!contains(outcome.out, "simulating"));
  }
  CHECK(first.finish() == 0);
  for (const auto& [name, bytes] : files(folder)) CHECK(!contains(name, "partial"));
}

TEST_CASE("what cannot be written or read is found before anything is simulated") {
  const TemporaryFolder folder;
  REQUIRE(train(folder, "--checkpoint run --log log.csv").status == 0);
  write_bytes(folder / "thesis", "chapter one\n");
  const auto error = [&](const std::string& arguments) {
    const std::string line = refusal(folder, RBRES_TRAIN, with("--out new --data set " + arguments));
    CHECK(!contains(read_bytes(folder / ".out"), "simulating"));
    return line;
  };
  CHECK(contains(error("--log nowhere/log.csv"), "nowhere/log.csv: cannot write"));
  CHECK(contains(error("--start nowhere"), "nowhere: cannot read"));
  CHECK(contains(error("--start run"), "run: "));
  CHECK(contains(error("--resume --checkpoint nowhere"), "nowhere: cannot read"));
  // A log is written again by the run that goes on, but nothing else is.
  const std::string resume = "--resume --checkpoint run ";
  CHECK(contains(error(resume + "--log thesis"), "--log: thesis: expected the log of the run"));
  CHECK(contains(refusal(folder, RBRES_TRAIN, with("--out new --epochs 1 " + resume)),
                 "run: expected the progress of a run of at most 1 epochs, found that of 2"));
  CHECK(train(folder, resume + "--log log.csv --out new").status == 0);
}

TEST_CASE("a file that appears at --out stays, and the model is not lost") {
  const TemporaryFolder folder;
  const std::string options = "--epochs 60 --patience 0 ";
  REQUIRE(train(folder, options + "--out alone").status == 0);
  Training run(folder, options + "--out model", "epoch   5/");
  write_bytes(folder / "model", "someone's");
  CHECK(run.finish() == 2);
  CHECK(read_bytes(folder / "model") == "someone's");
  const std::string error = read_bytes(folder / ".err");
  CHECK(error.find('\n') == error.size() - 1);
  CHECK(contains(error, "model: exists by now and would be overwritten; the model is "));
  const auto at = error.find("; the model is ") + 15;
  CHECK(read_bytes(error.substr(at, error.size() - at - 1)) == read_bytes(folder / "alone"));
}

TEST_CASE("a disk that is full for a while: the run goes on, and nothing of it is lost") {
  const TemporaryFolder folder;
  const std::string options = "--epochs 200 --patience 0 ";
  REQUIRE(train(folder, options + "--out alone --log whole.csv").status == 0);
  const FileSizeLimit sigxfsz_is_ignored(RLIM_INFINITY);
  // The pipe holds some 30 epochs that nobody has heard of yet.
  Training run(folder, options + "--out model --log log.csv --checkpoint run", "epoch   5/");
  run.limit_files(1000);
  run.hear("epoch  90/");
  const std::string log = read_bytes(folder / "log.csv");
  CHECK(!contains(log, "\n80,"));
  run.limit_files(RLIM_INFINITY);
  CHECK(run.finish() == 0);
  CHECK(contains(read_bytes(folder / ".err"), "log.csv: cannot write: "));
  CHECK(contains(read_bytes(folder / ".err"), "run: cannot write: "));
  CHECK(read_bytes(folder / "model") == read_bytes(folder / "alone"));
  CHECK(read_bytes(folder / "log.csv") == read_bytes(folder / "whole.csv"));
  REQUIRE(train(folder, options + "--checkpoint run --resume --out again").status == 0);
  CHECK(read_bytes(folder / "again") == read_bytes(folder / "alone"));
}

TEST_CASE("a checkpoint that can no longer be written costs no model, and is said") {
  const TemporaryFolder folder;
  const std::string options = "--epochs 60 --patience 0 ";
  REQUIRE(train(folder, options + "--out alone").status == 0);
  std::filesystem::create_directory(folder / "away");
  Training run(folder, options + "--out model --checkpoint away/run", "epoch   5/");
  std::filesystem::rename(folder / "away", folder / "gone");
  CHECK(run.finish() == 2);
  const std::string error = read_bytes(folder / ".err");
  CHECK(contains(error, "away/run: cannot write: "));
  CHECK(contains(error, "; the model is model\n"));
  CHECK(read_bytes(folder / "model") == read_bytes(folder / "alone"));
}

TEST_CASE("links are not followed, also those that lead nowhere") {
  const TemporaryFolder folder;
  REQUIRE(train(folder, "--checkpoint run --log log.csv").status == 0);
  std::filesystem::create_symlink("victim", folder / "dangling");
  std::filesystem::create_symlink("log.csv", folder / "link");
  for (const char* option : {"--log", "--out", "--json", "--checkpoint"}) {
    CHECK(contains(refusal(folder, RBRES_TRAIN,
                           with((std::string(option) == "--out" ? "" : "--out new ") + std::string(option) +
                                " dangling")),
                   std::string(option) + ": dangling exists and would be overwritten"));
    CHECK(!std::filesystem::exists(folder / "victim"));
  }
  const std::string resume = "--out new --resume --checkpoint run --log ";
  const std::string expected =
      ": expected the log of the run that is resumed, or no file, found another file or a";
  CHECK(contains(refusal(folder, RBRES_TRAIN, with(resume + "dangling")), "--log: dangling" + expected));
  CHECK(contains(refusal(folder, RBRES_TRAIN, with(resume + "link")), "--log: link" + expected));
  CHECK(!std::filesystem::exists(folder / "victim"));
  std::filesystem::create_hard_link(folder / "log.csv", folder / "other");
  CHECK(contains(refusal(folder, RBRES_TRAIN, with(resume + "other")), "--log: other" + expected));
}

TEST_CASE("a disk without room for the model is found before training") {
  const TemporaryFolder folder;
  const FileSizeLimit limit(500'000);
  const std::string error = refusal(folder, RBRES_TRAIN, with("--out model"));
  CHECK(contains(error, "model: cannot write: "));
  CHECK(!contains(read_bytes(folder / ".out"), "epoch"));
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
  CHECK(contains(error("--out ''"), "--out: expected the name of a file"));
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
