// The files of rbres_train: it goes on after a kill to the same bits, overwrites nothing, follows no link,
// and loses nothing where a disk is full.
#include "io_file_size_limit.hpp"
#include "train_program.hpp"

#include <nlohmann/json.hpp>

TEST_CASE("killed and resumed is unbroken") {
  const TemporaryFolder folder;
  const std::string options = "--epochs 60 --patience 0 ";
  REQUIRE(train(folder, options + "--out unbroken").status == 0);
  Training(folder, with(options + "--checkpoint run --out resumed"), "epoch   5/").kill();
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
  Training first(folder, with(options + "--out both --json table"), "epoch   5/");
  for (const char* second : {"--seed 2 --out both", "--seed 2 --out other --json table"})
    CHECK(contains(refusal(folder, RBRES_TRAIN, with(second)), ": cannot write: another writer holds "));
  CHECK(first.finish() == 0);
  CHECK(read_bytes(folder / "both") == read_bytes(folder / "alone"));
  CHECK(nlohmann::json::parse(read_bytes(folder / "table")).contains("model"));
}

TEST_CASE("two runs with one --checkpoint or one --log: the second is refused") {
  const TemporaryFolder folder;
  Training first(folder, with("--checkpoint run --log log.csv --epochs 60 --patience 0 --out first"),
                 "epoch   5/");
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
  Training run(folder, with(options + "--out model"), "epoch   5/");
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
  // One line for two epochs; the pipe holds those of some 70 that nobody has heard of yet.
  Training run(folder, with(options + "--out model --log log.csv --checkpoint run"), "epoch   6/");
  run.limit_files(1000);
  run.hear("epoch 120/");
  const std::string log = read_bytes(folder / "log.csv");
  CHECK(!contains(log, "\n110,"));
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
  Training run(folder, with(options + "--out model --checkpoint away/run"), "epoch   5/");
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
